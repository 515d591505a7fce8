"""What codecs and phones cost the receiver.

A simulated hand-held camera films a message once for each pair, view, kappa and run. The film then
passes lossless, through every codec and through every effect of a phone, and a receiver reads each
of these variants from the frames and times alone. So the variants of a row of the table saw the
same scenes, hands and noise. Filming ends when every receiver has its message, or after three loops
of it. Frames go through all variants as they are filmed, and none is kept.
"""

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from data_gen.film.codec import CodecChannel, CodecSettings
from data_gen.film.frame import VideoFrame
from data_gen.film.phone import PhoneProcessor, PhoneSettings
from data_gen.pairs import PAIRS
from export.film_graph import FilmGraph
from export.runtime import OWN_TIME_LIMIT_S, Decoder
from lab.films.trial import (
    FilmReading,
    FilmSettings,
    MessageFilm,
    Take,
    check_filmed,
    check_settings,
    film_message,
    receiver_model,
)
from lab.study import Results, Study, StudyFlags, Workshop
from link.embed import check_kappa
from link.errors import at_least, choose, each_once
from link.layout import Layout
from link.presets import PRESETS
from models import FILM_GRAPH
from reports.engine.backends import one_thread
from reports.engine.checked import Count, Share
from reports.render.tables import Table, percent, share_interval
from reports.score.intervals import pooled_interval, wilson
from reports.score.reliability import Bin, calibration_error, merge_bins


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
class CodecsFlags(StudyFlags):
    """A message from three loops of a hand-held video, through codecs and phones (simulated)."""

    pairs: tuple[str, ...] = tuple(PAIRS)
    """Camera-display pairs."""
    views: tuple[float, ...] = (0.0, 45.0)
    """Angles between the camera and the normal of the display, degrees."""
    kappas: tuple[int, ...] = (3, 5)
    """Gray levels added to a block that carries a 1."""
    variants: tuple[str, ...] = tuple(VARIANTS)
    """Names of what happens to a film, keys of VARIANTS in lab/films/codecs.py."""
    preset: str = FilmSettings.preset
    """Preset whose grid, modulation and pilots or patches the display shows."""
    state_hz: float = FilmSettings.state_hz
    """Number of states that the display shows a second; two of them are a frame pair."""
    fps: float = FilmSettings.fps
    """Number of frames that the camera takes a second."""
    runs: int = 11
    """Number of films for each pair, view and kappa."""
    n_bytes: int = 100
    """Length of the message, bytes."""
    block: str = "codecs"
    """Name of the results, and of their block in docs/films.md: a key of BLOCKS in
    lab/films/codecs.py."""

    def film(self, kappa: int) -> FilmSettings:
        """Return the setting of the films of one kappa."""
        return FilmSettings(
            kappa=kappa,
            preset=self.preset,
            state_hz=self.state_hz,
            fps=self.fps,
            n_bytes=self.n_bytes,
        )


@dataclass(frozen=True)
class VariantRow:
    """What became of the films of one variant, kappa and view."""

    variant: str
    """Key of `VARIANTS`."""
    kappa: Count
    """Gray levels added to a block that carries a 1."""
    view_deg: float
    """Angle between the camera and the normal of the display, degrees."""
    runs: Count
    """Number of films."""
    delivered: Count
    """Number of films from which the message came."""
    ci_low: Share
    """Lower end of Wilson's 95 % interval of the share that was delivered."""
    ci_high: Share
    """Upper end of this interval."""
    wrong_messages: Count
    """Number of films from which a message came that was not sent."""
    bits: Count
    """Number of bits that were decided."""
    wrong_bits: Share | None
    """Share of these bits that are wrong; None without a bit."""
    wrong_bits_low: float
    """Lower end of the 95 % interval of this share, which knows that errors cluster by film."""
    wrong_bits_high: float
    """Upper end of this interval."""
    calibration_error: float | None
    """Expected calibration error of the bits that were not erased; None without a bit."""
    kbits: float | None
    """Mean rate of the compressed frames, in thousands of bits a second; None without a codec."""


@dataclass(frozen=True)
class CodecsContent:
    """What was measured."""

    rows: list[VariantRow]
    """One row for each variant, kappa and view."""


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
        fps, rng = filmed.take.settings.fps, np.random.default_rng(filmed.take.run)
        self.reading = FilmReading(filmed, decoder, FilmGraph(FILM_GRAPH, 1))
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
    layout = item.take.settings.layout
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


def variant_rows(films: Mapping[str, Mapping[str, Any]], flags: CodecsFlags) -> list[VariantRow]:
    """Pool the films of each variant, kappa and view.

    Args:
        films: results of `read_variants` by name; the name begins with the film's kappa.
        flags: what was filmed.

    Returns:
        a row for each variant, kappa and view.
    """
    flat = [
        {"variant": variant, "kappa": int(name.split()[0]), **result}
        for name, found in films.items()
        for variant, result in found.items()
    ]
    table = pd.DataFrame(flat)
    rows = []
    for variant, kappa, view in product(flags.variants, flags.kappas, flags.views):
        chosen = (table["variant"] == variant) & (table["kappa"] == kappa)
        group = table[chosen & (table["view_deg"] == view)]
        delivered, bits = int(group["delivered"].sum()), int(group["bits"].sum())
        low, high = wilson(delivered, len(group))
        wrong_low, wrong_high = pooled_interval(group["bits_wrong"], group["bits"])
        bins = merge_bins([Bin(**found) for found in run] for run in group["bins"])
        rates = group["kbits"].dropna()
        rows.append(
            VariantRow(
                variant=variant,
                kappa=kappa,
                view_deg=view,
                runs=len(group),
                delivered=delivered,
                ci_low=low,
                ci_high=high,
                wrong_messages=int(group["wrong"].sum()),
                bits=bits,
                wrong_bits=int(group["bits_wrong"].sum()) / bits if bits else None,
                wrong_bits_low=wrong_low,
                wrong_bits_high=wrong_high,
                calibration_error=calibration_error(bins) if bins else None,
                kbits=float(rates.mean()) if len(rates) else None,
            )
        )
    return rows


def codecs_table(results: Results[CodecsContent]) -> Table:
    """Tabulate variants by kappa and view."""
    setup = results.meta["flags"]
    heads = (
        "film", "κ", "view", "delivered in 3 loops", "95 % interval", "bits wrong %",
        "95 % interval", "calibration error %", "Mbit/s",
    )  # fmt: skip
    cells = [
        [
            VARIANTS[row.variant].title,
            str(row.kappa),
            f"{row.view_deg:g}°",
            f"{row.delivered} of {row.runs}",
            f"{share_interval(row.ci_low, row.ci_high, 0)} %",
            percent(row.wrong_bits),
            share_interval(row.wrong_bits_low, row.wrong_bits_high) if row.bits else "–",
            percent(row.calibration_error) if row.bits else "–",
            "–" if row.kbits is None else f"{row.kbits / 1000:.1f}",
        ]
        for row in results.content.rows
    ]
    layout = PRESETS[setup["preset"]].layout
    title = (
        f"Simulated hand-held video at 1280 × 720, {setup['fps']:g} frames/s, of "
        f"{setup['state_hz']:g} states/s on {layout.rows} × {layout.cols} blocks; a "
        f"{setup['n_bytes']}-byte message, {len(setup['pairs'])} camera–display pairs, seed "
        f"{setup['seed']}. Rows of one κ and view read the same films. Wrong messages: "
        f"{sum(row.wrong_messages for row in results.content.rows)}."
    )
    return Table(heads, cells, title, left=3)


def check_codecs(flags: CodecsFlags) -> None:
    """Raise an `InputError` that names the first flag with a wrong value."""
    at_least(1, runs=flags.runs)
    choose(BLOCKS, flags.block, "block")
    each_once(kappas=flags.kappas, variants=flags.variants)
    check_filmed(flags.pairs, flags.views)
    for name in flags.variants:
        choose(VARIANTS, name, "name in --variants").codec.check()
    for kappa in flags.kappas:
        check_kappa(kappa, "kappas")
        check_settings(flags.film(kappa))


def measure_codecs(flags: CodecsFlags, workshop: Workshop) -> CodecsContent:
    """Film, and read every variant."""
    model = receiver_model(flags.film(flags.kappas[0]).layout, workshop.out)
    items = {
        f"{kappa} {pair} {view:g} {run}": VariantsTake(
            Take(flags.film(kappa), pair, view, run, flags.seed, model), flags.variants
        )
        for run, kappa, view, pair in product(
            range(flags.runs), flags.kappas, flags.views, flags.pairs
        )
    }
    read = workshop.each(read_variants, items, [model, FILM_GRAPH])
    return CodecsContent(variant_rows(read, flags))


def codecs_blocks(results: Mapping[str, Results[CodecsContent]]) -> dict[str, str]:
    """Show the table of each block."""
    return {block: codecs_table(stored).markdown() for block, stored in results.items()}


STUDY = Study(
    name="codecs",
    flags=CodecsFlags,
    content=CodecsContent,
    measure=measure_codecs,
    blocks=codecs_blocks,
    page=Path("docs/films.md"),
    check=check_codecs,
    label=lambda flags: flags.block,
)
"""The study that `python -m lab codecs` runs."""
