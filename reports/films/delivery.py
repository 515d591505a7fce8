"""Messages from simulated hand-held video: python -m reports.films.delivery.

Each run draws a picture, a room, a pose, the motion of the hand, both clocks, and the moment of the
loop at which the camera joins. What a phone does to the frames is chosen: its processing, a codec
(``--codec.name h264 --codec.kbits 8000``), lost frames. The same draws are filmed whatever is
chosen. The receiver gets the frames and their times alone. Runs are stored as they end, and a
restarted command goes on where it stopped.
"""

import json
import os
import zlib
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field, fields, replace
from importlib.metadata import version
from itertools import product
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import pandas as pd
import tyro
from numpy.typing import NDArray
from tyro.conf import OmitArgPrefixes

from data_gen.channel.optics import check_view
from data_gen.film.codec import CodecSettings, through_codec
from data_gen.film.frame import VideoFrame
from data_gen.film.phone import PhoneSettings
from data_gen.film.scenes import SceneSettings
from data_gen.film.stream import VideoSettings, film
from data_gen.frame_pair import Source, shuffled_pictures
from data_gen.pairs import PAIRS
from export.receive.receiver import Receiver
from export.runtime import OWN_TIME_LIMIT_S, Decoder
from export.to_onnx import to_onnx
from link.code.framing import encode, frames_needed
from link.embed import check_kappa, embed
from link.errors import ParameterError, at_least, choose, each_once, read_flags, run_cli
from link.files.lock import locked
from link.images import write_bytes
from link.layout import Layout, make_layout
from link.outside import read_json
from link.presets import PRESETS
from models import shipped_checkpoint, shipped_graphs
from models.neural.checkpoint import load_checkpoint
from reports.engine.backends import one_thread
from reports.engine.checked import write_json
from reports.engine.digest import code_digest, file_digest, package_versions, short_digest
from reports.engine.provenance import provenance
from reports.engine.stored import resume
from reports.render.tables import Table, percent, share_interval
from reports.score.accuracy import wilson
from reports.score.reliability import Bin, confidence_bins, merge_bins

STORED_VERSION = 2
"""Raise it when `deliver` changes what it does, so that older runs are not read again."""
DECIDING = (
    "data_gen.film.stream", "data_gen.film.codec", "data_gen.frame_pair", "export.receive.receiver",
)  # fmt: skip
"""Modules that decide, with all that they import, what a run gives."""
GRIDS = (8, 16)
"""Numbers of blocks along each side that a message may be filmed with."""
MAX_LOOPS = 100.0
"""Largest number of loops of the message after which a run may be given up."""


@dataclass(frozen=True)
class DeliveryConfig:
    """A message from at most three loops of a hand-held video (simulated)."""

    pairs: tuple[str, ...] = tuple(PAIRS)
    """Camera-display pairs."""
    views: tuple[float, ...] = (0.0, 45.0)
    """Angles between the camera and the normal of the display, degrees."""
    kappa: int = 3
    """Gray levels added to a block that carries a 1."""
    preset: str = "paper"
    """Preset whose grid, modulation and pilots or patches the display shows; kappa and rates are
    those of the other flags."""
    grid: int | None = None
    """Number of blocks along each side, 8 or 16, instead of the preset's."""
    redundancy: float | None = None
    """Number of coded bits for each bit of the message, on fine grids, instead of the preset's."""
    state_hz: float = 15.0
    """Number of states that the display shows a second; two of them are a frame pair."""
    fps: float = 30.0
    """Number of frames that the camera takes a second."""
    n_bytes: int = 100
    """Length of the message, bytes."""
    runs: int = 6
    """Number of runs for each pair and view."""
    loops: float = 3.0
    """Number of loops of the message after which a run is given up."""
    coverage: tuple[float, float] = (0.15, 0.6)
    """Least and largest share of the image that the display covers; drawn between them."""
    outside: float = 0.0
    """Largest share of the picture's width by which a corner lies outside the image."""
    hand: float = VideoSettings.hand
    """Motion of the hand relative to the usual."""
    drop: float = VideoSettings.drop
    """Probability that a camera frame is lost."""
    jitter_s: float = VideoSettings.jitter_s
    """Standard deviation, in seconds, of how early or late the sensor takes a frame."""
    phone: OmitArgPrefixes[PhoneSettings] = field(default_factory=PhoneSettings)
    """What a phone does to the frames before it stores them."""
    codec: CodecSettings = field(default_factory=CodecSettings)
    """Codec through which the frames pass."""
    seed: int = 0
    """Seed of all draws."""
    jobs: int = os.cpu_count() or 1
    """Number of processes."""
    out: Path = Path("runs/delivery")
    """Folder of the results; runs are stored in a folder of their own in it."""

    @property
    def layout(self) -> Layout:
        """Layout that the display shows."""
        preset = choose(PRESETS, self.preset, "preset")
        return preset.layout if self.grid is None else make_layout(self.grid, self.grid)

    @property
    def coded(self) -> float | None:
        """Redundancy of the loop, or None on coarse grids, whose code has a fixed rate."""
        usual = PRESETS[self.preset].redundancy_on(self.layout)
        return usual if self.redundancy is None else self.redundancy

    @property
    def name(self) -> str:
        """Name of the setting, for files."""
        rates = f"{self.state_hz:g}hz_{self.fps:g}fps"
        grid = f"grid{self.layout.rows}" if self.preset == "paper" else self.preset
        grid += "" if self.redundancy is None else f"_redundancy{self.redundancy:g}"
        name = f"{grid}_{rates}_kappa{self.kappa}_{self.n_bytes}B_seed{self.seed}"
        return "_".join([name, self.camera] if self.camera else [name])

    @property
    def camera(self) -> str:
        """What differs from a plain camera with lossless frames, in one word; empty for nothing."""
        words = [
            f"{entry.name}{value:g}"
            for part in (self, self.phone)
            for entry in fields(part)
            if part is self.phone or entry.name in ("outside", "hand", "drop", "jitter_s")
            if (value := getattr(part, entry.name)) != entry.default
        ]
        return "_".join([*words, *([self.codec.label] if self.codec.on else [])])

    def video(self, scene: SceneSettings, seconds: float | None = None) -> VideoSettings:
        """Return the settings of a film of a scene."""
        return VideoSettings(
            scene=scene,
            fps=self.fps,
            state_hz=self.state_hz,
            seconds=seconds,
            hand=self.hand,
            drop=self.drop,
            jitter_s=self.jitter_s,
            phone=self.phone,
        )


@dataclass(frozen=True)
class Take:
    """One film of a message that is to be received."""

    config: DeliveryConfig
    """Setting of display, camera and message."""
    pair: str
    """Camera-display pair."""
    view: float
    """Angle between the camera and the normal of the display, degrees."""
    run: int
    """Number of the run among those of the pair and view."""
    model: Path
    """Exported decoder of the receiver."""


@dataclass(frozen=True)
class Delivery:
    """What became of one message."""

    pair: str
    """Camera-display pair."""
    view_deg: float
    """Angle between the camera and the normal of the display, degrees."""
    run: int
    """Number of the run among those of the pair and view."""
    picture: str
    """Name of the picture that carried the message."""
    delivered: bool
    """Whether the message came."""
    wrong: bool
    """Whether a message came that was not sent."""
    loops: float
    """Number of loops of the message until then, or until the run was given up."""
    seconds: float
    """Time of the film until then, seconds."""
    frames: int
    """Number of frames until then."""
    frames_with_display: int
    """Number of frames in which the display was found."""
    bits: int
    """Number of bits that were decided on the way."""
    bits_wrong: int
    """Number of these that are wrong, each frame pair held against the one that it fits best."""
    loop_frames: int
    """Number of frame pairs in a loop of the message."""
    receiver_fps: float
    """Number of frames that the receiver took in a second of computing."""
    bins: list[Bin] = field(default_factory=list)
    """Bits that were decided and not erased, sorted by how sure the receiver was of them."""


@dataclass(frozen=True, eq=False)
class MessageFilm:
    """A film of a message, drawn and ready to be taken."""

    take: Take
    """Setting, pair, view and number of the film."""
    picture: str
    """Name of the picture that carries the message."""
    message: bytes
    """Message that the display sends."""
    bits: NDArray[np.integer]
    """Bits of the loop's frame pairs, (loop frames, n_bits) of 0 or 1."""
    frames: Iterator[VideoFrame]
    """Frames of at most as many loops as the setting allows; they can be taken once."""


def film_message(take: Take) -> MessageFilm:
    """Draw a message, what carries it, and how it is filmed; no frame is filmed yet."""
    config = take.config
    layout = config.layout
    grid = layout.rows if config.preset == "paper" else config.preset
    setting = f"{config.kappa} {grid} {config.state_hz} {config.fps}"
    key = f"{take.pair} {take.view} {take.run} {setting}"
    rng = np.random.default_rng([config.seed, zlib.crc32(key.encode())])
    source = Source(layout, "test", config.seed)
    pictures = shuffled_pictures(source)
    picture = pictures[int(rng.integers(len(pictures)))]
    message = rng.bytes(config.n_bytes)
    bits = encode(message, layout.n_bits, config.coded)
    pairs_shown = [embed(picture.rgb, frame, layout, config.kappa) for frame in bits]
    states = [state for shown in pairs_shown for state in (shown.original, shown.embedded)]
    coverage = float(rng.uniform(*config.coverage))
    outside = float(rng.uniform(0, config.outside)) if config.outside else 0.0
    scene = SceneSettings(coverage=coverage, pictures=pictures, free=0.03, outside=outside)
    settings = config.video(scene, config.loops * 2 * len(bits) / config.state_hz)
    frames = film(states, layout, source.pair(take.pair), take.view, settings, rng)
    return MessageFilm(take, picture.name, message, bits, frames)


class FilmReading:
    """What a receiver reads of a film, frame by frame.

    Args:
        filmed: the film, whose truth is compared with what is read; its frames are not taken.
        decoder: decoder of the receiver.
    """

    def __init__(self, filmed: MessageFilm, decoder: Decoder) -> None:
        self._filmed = filmed
        self._receiver = Receiver(decoder, filmed.take.config.fps)
        self._received: bytes | None = None
        self._wrong = self._decided = self._frames = 0
        self._bins: list[Bin] = []
        self._spent = self._time = 0.0

    @property
    def ended(self) -> bool:
        """Whether a message came."""
        return self._received is not None

    def push(self, frame: VideoFrame) -> None:
        """Give the receiver the next frame and its time."""
        self._frames, self._time = self._frames + 1, frame.time_s
        start = perf_counter()
        step = self._receiver.push(frame.rgb, frame.time_s)
        self._spent += perf_counter() - start
        for pair in step.pairs:
            scores = pair.soft.scores
            shown = nearest_frame(scores, self._filmed.bits)
            self._wrong += int(((scores > 0) != shown).sum())
            self._decided += len(shown)
            seen = np.flatnonzero(scores)
            if seen.size:
                self._bins = merge_bins([self._bins, confidence_bins(scores[seen], shown[seen])])
        if step.message is not None:
            self._received = step.message.data

    def delivery(self) -> Delivery:
        """Say what became of the message."""
        take, bits = self._filmed.take, self._filmed.bits
        return Delivery(
            pair=take.pair,
            view_deg=take.view,
            run=take.run,
            picture=self._filmed.picture,
            delivered=self._received == self._filmed.message,
            wrong=self.ended and self._received != self._filmed.message,
            loops=self._time * take.config.state_hz / 2 / len(bits),
            seconds=self._time,
            frames=self._frames,
            frames_with_display=self._receiver.found,
            bits=self._decided,
            bits_wrong=self._wrong,
            loop_frames=len(bits),
            receiver_fps=self._frames / max(self._spent, 1e-9),
            bins=self._bins,
        )


def deliver(take: Take) -> dict[str, Any]:
    """Film until the message comes or the loops are over.

    Returns:
        the fields of a `Delivery`.
    """
    one_thread()
    filmed = film_message(take)
    reading = FilmReading(filmed, Decoder(take.model, 1, OWN_TIME_LIMIT_S))
    for frame in through_codec(filmed.frames, take.config.codec, take.config.fps):
        reading.push(frame)
        if reading.ended:
            break
    return asdict(reading.delivery())


def nearest_frame(scores: NDArray[np.float64], bits: NDArray[np.integer]) -> NDArray[np.integer]:
    """Choose the frame pair of a loop that the scores of a frame pair fit best.

    >>> nearest_frame(np.array([2.0, -1.0, 3.0]), np.array([[0, 1, 0], [1, 0, 0]])).tolist()
    [1, 0, 0]

    Args:
        scores: (n_bits,) scores of the bits; positive means 1.
        bits: (loop frames, n_bits) of 0 or 1.

    Returns:
        (n_bits,) bits of that frame pair.
    """
    return np.asarray(bits[((scores > 0) != bits).sum(axis=1).argmin()])


def receiver_model(config: DeliveryConfig) -> Path:
    """Path of the shipped decoder for the layout of a setting, exported where none ships."""
    layout = config.layout
    shipped = shipped_graphs().get(layout)
    if shipped is not None:
        return shipped
    path = config.out / config.name / "decoder.onnx"
    folder = shipped_checkpoint(layout)
    write_bytes(path, to_onnx(load_checkpoint(folder, layout=layout), folder.name))
    return path


def deciding_parts(config: DeliveryConfig, model: Path) -> list[str]:
    """List all that decides a run apart from pair, view and number: settings, code, packages."""
    settings = (config.kappa, config.layout, config.state_hz, config.fps, config.n_bytes)
    camera = (config.hand, config.drop, config.jitter_s, config.phone, config.codec)
    return [
        repr(
            (
                STORED_VERSION,
                *settings,
                config.coded,
                config.loops,
                config.outside,
                config.coverage,
                *camera,
                config.seed,
            )
        ),
        code_digest(*DECIDING),
        file_digest([model]),
        *package_versions(),
        version("av") if config.codec.on else "",
    ]


def stored_runs(config: DeliveryConfig, model: Path) -> Path:
    """File of the runs, named after all that decides them apart from pair, view and number."""
    mark = short_digest(*deciding_parts(config, model))
    return config.out / config.name / f"runs_{mark}.jsonl"


def bound_seconds(delivery: Delivery, config: DeliveryConfig) -> float:
    """Time in which no code could deliver faster at this run's share of wrong bits (hard bits).

    It is the capacity of a binary symmetric channel, for a receiver that knows from the start the
    clock of the display and the place in the loop.
    """
    n_bits = config.layout.n_bits
    p = min(max(delivery.bits_wrong / max(delivery.bits, 1), 1e-9), 0.5)
    entropy = -p * np.log2(p) - (1 - p) * np.log2(1 - p)
    per_pair = max(n_bits * (1 - entropy), 1e-9)
    return float(8 * config.n_bytes / per_pair * 2 / config.state_hz)


def summarise_deliveries(
    deliveries: list[Delivery], config: DeliveryConfig
) -> list[dict[str, Any]]:
    """Pool the runs of each view, and all of them.

    Returns:
        for each view, and then for "all": numbers of runs and of messages ``delivered``, with
        Wilson's 95 % interval of their share; ``wrong_messages``; median and 95 % quantile of the
        seconds (None where no message came), median of the loops, and median of `bound_seconds`;
        share of ``bits_wrong``; and bits of delivered messages in a second of film.
    """
    runs = pd.DataFrame([asdict(delivery) for delivery in deliveries])
    runs["bound"] = [bound_seconds(delivery, config) for delivery in deliveries]
    groups = {f"{view:g}°": runs[runs["view_deg"] == view] for view in config.views} | {"all": runs}
    rows = []
    for name, group in groups.items():
        came, filmed = group[group["delivered"]], float(group["seconds"].sum())
        low, high = wilson(len(came), len(group))
        rows.append(
            {
                "view": name,
                "runs": len(group),
                "delivered": len(came),
                "ci_low": low,
                "ci_high": high,
                "wrong_messages": int(group["wrong"].sum()),
                "seconds_median": float(came["seconds"].median()) if len(came) else None,
                "seconds_95": float(came["seconds"].quantile(0.95)) if len(came) else None,
                "loops_median": float(came["loops"].median()) if len(came) else 0.0,
                "bound_seconds": float(group["bound"].median()),
                "bits_wrong": int(group["bits_wrong"].sum()) / max(1, int(group["bits"].sum())),
                "goodput_bit_s": 8 * config.n_bytes * len(came) / max(filmed, 1 / config.fps),
            }
        )
    return rows


def delivery_table(folder: Path) -> Table:
    """Show the stored results of a plain camera's settings, one row for each file of a folder."""
    heads = (
        "grid", "states/s", "camera fps", "pairs", "runs", "delivered in 3 loops", "95 % interval",
        "wrong messages", "bits wrong %", "seconds, median (95 %)", "loops", "bound, s",
        "goodput, bit/s",
    )  # fmt: skip
    rows = []
    for path in sorted(folder.glob("*.json")):
        stored = read_json(path)
        if stored.get("camera") or stored["config"].get("preset", "paper") != "paper":
            continue  # reports.films.codecs compares what phones do
        row, setup = stored["summary"][-1], stored["config"]
        rows.append(
            [
                f"{setup['grid'] or 8} × {setup['grid'] or 8}",
                f"{setup['state_hz']:g}",
                f"{setup['fps']:g}",
                str(len(setup["pairs"])),
                str(row["runs"]),
                str(row["delivered"]),
                f"{share_interval(row['ci_low'], row['ci_high'], 1)} %",
                str(row["wrong_messages"]),
                percent(row["bits_wrong"]),
                "–"
                if row["seconds_median"] is None
                else f"{row['seconds_median']:.1f} ({row['seconds_95']:.1f})",
                f"{row['loops_median']:.2f}",
                f"{row['bound_seconds']:.1f}",
                f"{row['goodput_bit_s']:.0f}",
            ]
        )
    title = (
        "Simulated hand-held video at 1280 × 720, 0° and 45°, κ = 3, a 100-byte message; picture, "
        "room, pose, clocks (±1 %) and start in the loop drawn anew in each run "
        "(`python -m reports.films.delivery`):"
    )
    return Table(heads, rows, title)


def delivery_block(folder: Path) -> str:
    """Show the stored results of all settings, and say what the bound is."""
    bound = (
        "*bound*: the time that a perfect code for hard bits would need at the same share of wrong "
        "bits, if the receiver knew the clock and the place in the loop from the start."
    )
    return f"{delivery_table(folder).markdown()}\n\n{bound}"


def check_delivery(config: DeliveryConfig) -> None:
    """Raise an `InputError` that names the first flag with a wrong value, before any work."""
    at_least(1, runs=config.runs, jobs=config.jobs, n_bytes=config.n_bytes)
    at_least(0, seed=config.seed)
    each_once(pairs=config.pairs, views=config.views)
    for pair in config.pairs:
        choose(PAIRS, pair, "name in --pairs")
    for view in config.views:
        check_view(view, "views")
    check_kappa(config.kappa)
    choose(PRESETS, config.preset, "preset")
    if config.grid is not None and (config.preset != "paper" or config.grid not in GRIDS):
        raise ParameterError("grid", f"need 8 or 16, and the preset paper, got {config.grid}")
    frames_needed(config.n_bytes, config.layout.n_bits, "n_bytes")
    if not 0 < config.loops <= MAX_LOOPS:
        raise ParameterError(
            "loops", f"need more than 0 and at most {MAX_LOOPS:g}, got {config.loops:g}"
        )
    least, most = config.coverage
    for share in config.coverage:
        scene = SceneSettings(coverage=share)
        config.video(scene).check()
        replace(scene, outside=config.outside).check()
    config.codec.check()
    if not least <= most:
        raise ParameterError("coverage", f"the largest share, {most:g}, is below the least")


def main() -> None:
    """Film, receive, store, print."""
    config = read_flags(lambda: tyro.cli(DeliveryConfig))
    check_delivery(config)
    with locked(config.out):
        print(run_deliveries(config))


def run_deliveries(config: DeliveryConfig) -> Path:
    """Film, receive, store, print, while no other process writes the folder.

    Returns:
        the file of the results.
    """
    model = receiver_model(config)
    takes = {
        f"{pair} {view:g} {run}": Take(config, pair, view, run, model)
        for run, view, pair in product(range(config.runs), config.views, config.pairs)
    }
    stored = resume(deliver, takes, stored_runs(config, model), config.jobs, "runs")
    deliveries = [Delivery(**run) for run in stored.values()]
    summary = summarise_deliveries(deliveries, config)
    for row in summary:
        print(json.dumps(row))
    setup = {key: value for key, value in asdict(config).items() if key not in ("out", "jobs")}
    content = {
        "meta": provenance(config.seed, simulated=True),
        "camera": config.camera,
        "config": setup,
        "summary": summary,
        "runs": sorted(stored.values(), key=lambda run: (run["pair"], run["view_deg"], run["run"])),
    }
    file = config.out / f"{config.name}.json"
    write_json(file, content)
    return file


if __name__ == "__main__":
    run_cli(main)
