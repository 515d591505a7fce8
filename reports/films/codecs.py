"""What codecs and phones cost the receiver: python -m reports.films.codecs.

A simulated hand-held camera films a message once for each pair, view, kappa and run. The film then
passes lossless, through every codec and through every effect of a phone, and a receiver reads each
of these variants from the frames and times alone. So the variants of a row of the table saw the
same scenes, hands and noise. Filming ends when every receiver has its message, or after three loops
of it. Frames go through all variants as they are filmed, and none is kept.

Films are stored as they end, and a restarted command goes on where it stopped. The table is written
into a block of docs/films.md.
"""

import os
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from importlib.metadata import version
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import tyro

from data_gen.channel.optics import check_view
from data_gen.film.codec import CodecChannel, CodecSettings
from data_gen.film.frame import VideoFrame
from data_gen.film.phone import PhoneProcessor, PhoneSettings
from data_gen.pairs import PAIRS
from export.runtime import OWN_TIME_LIMIT_S, Decoder
from link.cli import read_flags, run_cli
from link.embed import check_kappa
from link.errors import at_least, choose, each_once
from link.files.lock import locked
from link.layout import Layout
from link.presets import PRESETS
from reports.engine.backends import Backend, one_thread
from reports.engine.checked import write_json
from reports.engine.digest import short_digest
from reports.engine.provenance import provenance
from reports.engine.stored import resume
from reports.films.delivery import check_delivery, deciding_parts, receiver_model
from reports.films.messages import DeliveryConfig, FilmReading, MessageFilm, Take, film_message
from reports.render.tables import Table, percent, share_interval, write_blocks
from reports.score.intervals import pooled_interval, wilson
from reports.score.reliability import Bin, calibration_error, merge_bins

STORED_VERSION = 2
"""Raise it when `read_variants` changes what it does, so that older films are not read again."""


@dataclass(frozen=True)
class Variant:
    """What happens to a film before the receiver gets it."""

    title: str
    """What the table calls it."""
    codec: CodecSettings = field(default_factory=CodecSettings)
    """Codec through which the frames pass."""
    phone: PhoneSettings = field(default_factory=PhoneSettings)
    """What a phone does to the frames before."""


def _codecs(name: str, title: str, preset: str, rates: Iterable[int]) -> dict[str, Variant]:
    return {
        f"{name}-{rate}": Variant(
            f"{title}, {rate / 1000:g} Mbit/s", CodecSettings(name, rate, preset=preset)
        )
        for rate in rates
    }


VARIANTS = {
    "lossless": Variant("lossless"),
    **_codecs("h264", "H.264", "veryfast", (12_000, 8_000, 4_000, 2_000)),
    "h264-8000-b2": Variant(
        "H.264, 8 Mbit/s, 2 B frames", CodecSettings("h264", 8_000, b_frames=2)
    ),
    **_codecs("hevc", "HEVC", "ultrafast", (8_000, 4_000)),
    "denoise": Variant("noise reduction, α 0.3", phone=PhoneSettings(noise_reduction=0.3)),
    "tones": Variant("local tone mapping, limit 2", phone=PhoneSettings(local_tone=2.0)),
    "stabilise": Variant("stabilisation, ± 0.3 px", phone=PhoneSettings(stabilise_s=0.5)),
    "sharpen": Variant("sharpening, 1", phone=PhoneSettings(sharpen=1.0)),
    "barrel": Variant("barrel distortion, −0.1", phone=PhoneSettings(distortion=-0.1)),
    "phone": Variant(
        "all five, H.264, 8 Mbit/s",
        CodecSettings("h264", 8_000),
        PhoneSettings(
            noise_reduction=0.3, local_tone=2.0, stabilise_s=0.5, sharpen=1.0, distortion=-0.1
        ),
    ),
}
"""Variants of a film by the name that ``--variants`` takes."""


BLOCKS = {
    "codecs": "few variants and many films of the preset paper",
    "phones": "all variants and few films of the preset paper",
    "phones_robust": "all variants and few films of the preset robust",
    "phones_fast": "all variants and few films of the preset fast",
    "phones_hidden": "all variants and few films of the preset hidden",
}
"""Blocks of docs/films.md by name, and what they are there for."""


@dataclass(frozen=True)
class CodecsConfig:
    """A message from three loops of a hand-held video, through codecs and phones (simulated)."""

    pairs: tuple[str, ...] = tuple(PAIRS)
    """Camera-display pairs."""
    views: tuple[float, ...] = (0.0, 45.0)
    """Angles between the camera and the normal of the display, degrees."""
    kappas: tuple[int, ...] = (3, 5)
    """Gray levels added to a block that carries a 1."""
    variants: tuple[str, ...] = tuple(VARIANTS)
    """Names of what happens to a film, keys of VARIANTS in reports/films/codecs.py."""
    preset: str = DeliveryConfig.preset
    """Preset whose grid, modulation and pilots or patches the display shows."""
    state_hz: float = DeliveryConfig.state_hz
    """Number of states that the display shows a second; two of them are a frame pair."""
    fps: float = DeliveryConfig.fps
    """Number of frames that the camera takes a second."""
    runs: int = 11
    """Number of films for each pair, view and kappa."""
    n_bytes: int = 100
    """Length of the message, bytes."""
    seed: int = 0
    """Seed of all draws."""
    jobs: int = os.cpu_count() or 1
    """Number of processes."""
    out: Path = Path("runs/codecs")
    """Folder of the results, which are named after the block, and of the stored films."""
    page: Path = Path("docs/films.md")
    """Page of which a block is written."""
    block: str = "codecs"
    """Name of that block, a key of BLOCKS in reports/films/codecs.py."""

    def delivery(self, kappa: int) -> DeliveryConfig:
        """Return the setting of the films of one kappa."""
        return DeliveryConfig(
            kappa=kappa,
            preset=self.preset,
            state_hz=self.state_hz,
            fps=self.fps,
            n_bytes=self.n_bytes,
            seed=self.seed,
            out=self.out,
        )


@dataclass(frozen=True)
class VariantsTake:
    """One film and the variants of it that are read."""

    take: Take
    """Setting, pair, view and number of the film."""
    variants: tuple[str, ...]
    """Names of the variants, keys of `VARIANTS`."""


class Lane:
    """The way of a film's frames through one variant to a receiver of its own.

    Args:
        variant: what happens to the frames.
        filmed: the film, whose frames are not taken.
        decoder: decoder of the receiver.
        layout: layout of the displayed picture.
    """

    def __init__(
        self, variant: Variant, filmed: MessageFilm, decoder: Decoder, layout: Layout
    ) -> None:
        fps, rng = filmed.take.config.fps, np.random.default_rng(filmed.take.run)
        self.reading = FilmReading(filmed, decoder)
        """What the receiver has read so far."""
        self._phone = PhoneProcessor(variant.phone, (layout.width, layout.height), rng)
        self._codec = CodecChannel(variant.codec, fps) if variant.codec.on else None

    @property
    def kbits(self) -> float | None:
        """Rate of the compressed frames, in thousands of bits a second; None without a codec."""
        return None if self._codec is None else self._codec.kbits

    def push(self, frame: VideoFrame) -> None:
        """Pass the next frame on, as far as variant and codec let it through."""
        processed = self._phone.process(frame)
        self._read([processed] if self._codec is None else self._codec.push(processed))

    def finish(self) -> None:
        """Read what the codec still holds when the film has ended."""
        if self._codec is not None and not self.reading.ended:
            self._read(self._codec.finish())

    def _read(self, frames: Iterable[VideoFrame]) -> None:
        for frame in frames:
            if self.reading.ended:
                return
            self.reading.push(frame)


def read_variants(item: VariantsTake) -> dict[str, dict[str, Any]]:
    """Film until every variant's message came or the loops are over.

    Returns:
        by the name of the variant the fields of a `Delivery`, and ``kbits``, the measured rate of
        the codec or None.
    """
    one_thread()
    filmed = film_message(item.take)
    layout = item.take.config.layout
    decoder = Decoder(item.take.model, 1, OWN_TIME_LIMIT_S)
    lanes = {name: Lane(VARIANTS[name], filmed, decoder, layout) for name in item.variants}
    for frame in filmed.frames:
        going = [lane for lane in lanes.values() if not lane.reading.ended]
        if not going:
            break
        for lane in going:
            lane.push(frame)
    for lane in lanes.values():
        lane.finish()
    return {
        name: {**asdict(lane.reading.delivery()), "kbits": lane.kbits}
        for name, lane in lanes.items()
    }


def variant_rows(
    films: Mapping[str, Mapping[str, Any]], config: CodecsConfig
) -> list[dict[str, Any]]:
    """Pool the films of each variant, kappa and view.

    Args:
        films: results of `read_variants` by name; the name begins with the film's kappa.
        config: what was filmed.

    Returns:
        for each variant, kappa and view: numbers of ``runs`` and of messages ``delivered``, with
        Wilson's 95 % interval of their share; ``wrong_messages``; number of ``bits`` that were
        decided, the share of them that is ``wrong_bits``, with its interval; the
        ``calibration_error`` of those that were not erased; and the mean ``kbits``.
    """
    flat = [
        {"variant": variant, "kappa": int(name.split()[0]), **result}
        for name, found in films.items()
        for variant, result in found.items()
    ]
    table = pd.DataFrame(flat)
    rows = []
    for variant, kappa, view in product(config.variants, config.kappas, config.views):
        chosen = (table["variant"] == variant) & (table["kappa"] == kappa)
        group = table[chosen & (table["view_deg"] == view)]
        delivered, bits = int(group["delivered"].sum()), int(group["bits"].sum())
        low, high = wilson(delivered, len(group))
        wrong_low, wrong_high = pooled_interval(group["bits_wrong"], group["bits"])
        bins = merge_bins([Bin(**found) for found in run] for run in group["bins"])
        rates = group["kbits"].dropna()
        rows.append(
            {
                "variant": variant,
                "kappa": kappa,
                "view_deg": view,
                "runs": len(group),
                "delivered": delivered,
                "ci_low": low,
                "ci_high": high,
                "wrong_messages": int(group["wrong"].sum()),
                "bits": bits,
                "wrong_bits": int(group["bits_wrong"].sum()) / bits if bits else None,
                "wrong_bits_low": wrong_low,
                "wrong_bits_high": wrong_high,
                "calibration_error": calibration_error(bins) if bins else None,
                "kbits": float(rates.mean()) if len(rates) else None,
            }
        )
    return rows


def codecs_table(rows: list[dict[str, Any]], config: CodecsConfig) -> Table:
    """Tabulate the rows of `variant_rows`."""
    heads = (
        "film", "κ", "view", "delivered in 3 loops", "95 % interval", "bits wrong %",
        "95 % interval", "calibration error %", "wrong messages", "Mbit/s",
    )  # fmt: skip
    cells = [
        [
            VARIANTS[row["variant"]].title,
            str(row["kappa"]),
            f"{row['view_deg']:g}°",
            f"{row['delivered']} of {row['runs']}",
            f"{share_interval(row['ci_low'], row['ci_high'], 0)} %",
            percent(row["wrong_bits"]),
            share_interval(row["wrong_bits_low"], row["wrong_bits_high"]) if row["bits"] else "–",
            percent(row["calibration_error"]) if row["bits"] else "–",
            str(row["wrong_messages"]),
            "–" if row["kbits"] is None else f"{row['kbits'] / 1000:.1f}",
        ]
        for row in rows
    ]
    layout = PRESETS[config.preset].layout
    title = (
        f"Simulated hand-held video at 1280 × 720, {config.fps:g} frames/s, of "
        f"{config.state_hz:g} states/s on {layout.rows} × {layout.cols} blocks; a "
        f"{config.n_bytes}-byte message, {len(config.pairs)} camera–display pairs, seed "
        f"{config.seed}. Rows of one κ and view read the same films."
    )
    return Table(heads, cells, title, left=3)


def check_codecs(config: CodecsConfig) -> None:
    """Raise an `InputError` that names the first flag with a wrong value, before any work."""
    at_least(1, runs=config.runs, jobs=config.jobs)
    at_least(0, seed=config.seed)
    choose(BLOCKS, config.block, "block")
    each_once(
        pairs=config.pairs, views=config.views, kappas=config.kappas, variants=config.variants
    )
    for pair in config.pairs:
        choose(PAIRS, pair, "name in --pairs")
    for view in config.views:
        check_view(view, "views")
    for name in config.variants:
        choose(VARIANTS, name, "name in --variants").codec.check()
    for kappa in config.kappas:
        check_kappa(kappa, "kappas")
        check_delivery(config.delivery(kappa))


def stored_films(config: CodecsConfig, model: Path) -> Path:
    """File of the films, named after all that decides them apart from their names."""
    variants = [(name, VARIANTS[name]) for name in config.variants]
    parts = [
        repr((STORED_VERSION, variants)),
        *deciding_parts(config.delivery(DeliveryConfig.kappa), model),
        version("av") if any(variant.codec.on for _, variant in variants) else "",
    ]
    mark = short_digest(*parts)
    return config.out / f"films_{mark}.jsonl"


def main() -> None:
    """Film, receive, store, print, write codecs.json and the page's block."""
    config = read_flags(lambda: tyro.cli(CodecsConfig))
    check_codecs(config)
    with locked(config.out):
        _run(config)


def _run(config: CodecsConfig) -> None:
    """Film, receive, store, print, write, while no other process writes the folder."""
    model = receiver_model(config.delivery(config.kappas[0]))
    items = {
        f"{kappa} {pair} {view:g} {run}": VariantsTake(
            Take(config.delivery(kappa), pair, view, run, model), config.variants
        )
        for run, kappa, view, pair in product(
            range(config.runs), config.kappas, config.views, config.pairs
        )
    }
    films = resume(read_variants, items, stored_films(config, model), Backend(config.jobs), "films")
    rows = variant_rows(films, config)
    setup = {key: value for key, value in asdict(config).items() if key not in ("out", "jobs")}
    content = {
        "meta": provenance(config.seed, simulated=True),
        "config": setup | {"page": str(config.page)},
        "rows": rows,
    }
    file = config.out / f"{config.block}.json"
    write_json(file, content)
    table = codecs_table(rows, config).markdown()
    print(table)
    write_blocks(config.page, {config.block: table})
    print(f"written: {file}, {config.page}")


if __name__ == "__main__":
    run_cli(main)
