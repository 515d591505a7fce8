"""How fast presets deliver a message from simulated hand-held video.

Each run draws a picture, a room, a pose, the motion of the hand, both clocks, and the moment of the
loop at which the camera joins. The receiver gets the frames and their times alone. Goodput is the
message's bits over the time from the first camera frame to the delivery: finding the display and
its clock are included. The table shows every series whose results the folder holds, so settings and
views can be filmed one after the other.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from data_gen.channel.optics import check_view
from data_gen.film.codec import CodecSettings, through_codec
from data_gen.film.message import FilmSettings, Take, film_message
from data_gen.film.phone import PhoneSettings
from data_gen.pairs import PAIRS, pair_names
from export.film_graph import FilmGraph
from export.runtime import OWN_TIME_LIMIT_S, Decoder
from lab.study import Results, Study, StudyFlags, Workshop
from link.code.framing import frames_needed
from link.errors import at_least, choose, each_once
from models import FILM_GRAPH, shipped_graphs
from receiver.receiver import Receiver
from reports.render.tables import Table, number, percent, share_interval
from reports.score.intervals import wilson

FAST = FilmSettings(preset="fast", state_hz=30, fps=60, n_bytes=20_000)
"""The setting "fast", a camera of 60 frames a second before the preset `fast`."""
HIDDEN = FilmSettings(preset="hidden", kappa=1, state_hz=60, fps=120, n_bytes=20_000, loops=10)
"""The setting "hidden", below the threshold of sight at the preset's distance."""
SETTINGS = {
    "paper": FilmSettings(n_bytes=100),
    "robust": FilmSettings(preset="robust", n_bytes=2_000),
    "hidden, 30 fps": replace(HIDDEN, fps=30),
    "hidden, 60 fps": replace(HIDDEN, fps=60),
    "hidden, 30 fps, 33 ms": replace(HIDDEN, fps=30, shutter=1 / 30),
    "hidden, 30 fps, 4 ms": replace(HIDDEN, fps=30, shutter=1 / 250),
    "hidden, 24 fps of 50 Hz": replace(HIDDEN, fps=24, state_hz=50, shutter=1 / 100),
    "hidden, 25 fps of 75 Hz": replace(HIDDEN, fps=25, state_hz=75, shutter=1 / 100),
    "hidden, 29.97 fps of 72 Hz": replace(HIDDEN, fps=29.97, state_hz=72, shutter=1 / 100),
    "hidden, 50 fps of 60 Hz": replace(HIDDEN, fps=50, shutter=1 / 100),
    "hidden, 59.94 fps of 75 Hz": replace(HIDDEN, fps=59.94, state_hz=75, shutter=1 / 100),
    "hidden": HIDDEN,
    "fast": FAST,
    "moving, robust": FilmSettings(preset="robust", n_bytes=100, carriers="moving"),
    "moving, 30 fps": replace(HIDDEN, fps=30, n_bytes=100, carriers="moving"),
    "moving, 60 fps": replace(HIDDEN, fps=60, n_bytes=100, carriers="moving"),
    "moving, fast": replace(FAST, n_bytes=100, carriers="moving"),
}
"""Settings of display, camera and message, by name. Carriers of "moving" are scenes that are drawn
for each film; each of these settings is there `THROUGH` what a phone does, too."""
THROUGH: dict[str, dict[str, Any]] = {
    "H.264 12 Mbit": {"codec": CodecSettings("h264", kbits=12_000)},
    "H.264 8 Mbit": {"codec": CodecSettings("h264", kbits=8_000)},
    "noise reduction": {"phone": PhoneSettings(noise_reduction=0.5)},
}
"""What a phone does to the frames of moving pictures, by name: megabits are those of a second, and
noise reduction mixes half of the frame before into each frame."""
SETTINGS |= {
    f"{name}, {way}": replace(SETTINGS[name], **changed)
    for name in list(SETTINGS)
    if SETTINGS[name].carriers == "moving"
    for way, changed in THROUGH.items()
}


@dataclass(frozen=True)
class RatesFlags(StudyFlags):
    """How fast presets deliver a message (simulated)."""

    settings: tuple[str, ...] = tuple(SETTINGS)
    """Names of settings, keys of SETTINGS in lab/films/rates.py."""
    pairs: tuple[str, ...] = tuple(PAIRS)
    """Camera-display pairs."""
    views: tuple[float, ...] = (0.0, 45.0)
    """Angles between the camera and the normal of the display, degrees."""
    runs: int = 1
    """Number of runs for each setting, pair and view."""
    n_bytes: int | None = None
    """Length of the message, bytes, instead of the settings' own."""

    def film(self, name: str) -> FilmSettings:
        """Return a setting, with the message's length that was asked for."""
        setting = choose(SETTINGS, name, "name in --settings")
        return setting if self.n_bytes is None else replace(setting, n_bytes=self.n_bytes)


@dataclass(frozen=True)
class Delivery:
    """Result of one message."""

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
    seconds: float
    """Time of the film until then, or until the run was given up, seconds."""
    bits: int
    """Number of bits that were decided on the way."""
    bits_wrong: int
    """Number of these that are wrong, each frame pair held against the one that it fits best."""


@dataclass(frozen=True)
class FilmSeries:
    """Films of one setting from one angle."""

    setting: str
    """Name of the setting."""
    n_bytes: int
    """Length of the message, bytes."""
    view: float
    """Angle between the camera and the normal of the display, degrees."""
    runs: list[Delivery]
    """Every run."""


@dataclass(frozen=True)
class RatesContent:
    """Results of all settings and views."""

    series: list[FilmSeries]
    """One entry for each setting and view."""


def deliver(take: Take) -> Delivery:
    """Film until the message comes or the loops are over, and hold what is read against it."""
    filmed, fps = film_message(take), take.settings.fps
    decoder = Decoder(shipped_graphs()[take.settings.layout], 1, OWN_TIME_LIMIT_S)
    receiver = Receiver(decoder, fps, FilmGraph(FILM_GRAPH, 1))
    frames = through_codec(filmed.frames, take.settings.codec, fps)
    received: bytes | None = None
    wrong = decided = 0
    time = 0.0
    while received is None:
        frame = next(frames, None)
        time = time if frame is None else frame.time_s
        step = receiver.finish() if frame is None else receiver.push(frame.rgb, time)
        for scores in (pair.soft.scores for pair in step.pairs):
            shown = nearest_frame(scores, filmed.bits)
            wrong += int(((scores > 0) != shown).sum())
            decided += len(shown)
        received = step.message.data if step.message is not None else None
        if frame is None:
            break
    return Delivery(
        pair=take.pair,
        view_deg=take.view,
        run=take.run,
        picture=filmed.picture,
        delivered=received == filmed.message,
        wrong=received not in (None, filmed.message),
        seconds=time,
        bits=decided,
        bits_wrong=wrong,
    )


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


ROW_HEADS = (
    "setting", "states/s", "camera fps", "bytes", "view", "delivered", "95 % interval",
    "goodput, kbit/s (least)", "seconds, median", "bits wrong %",
)  # fmt: skip
"""Heads of the columns of `deliveries_row`."""


def deliveries_row(
    name: str, film: FilmSettings, view: float, runs: Sequence[Delivery]
) -> list[str]:
    """Write what became of one setting's messages.

    Args:
        name: of the setting.
        film: what was shown, and how it was filmed.
        view: angle between the camera and the normal of the display, degrees.
        runs: every run from this angle.
    """
    table = pd.DataFrame([vars(run) for run in runs])
    came = table[table["delivered"]]
    rate = 8e-3 * film.n_bytes / came["seconds"]
    return [
        name,
        f"{film.state_hz:g}",
        f"{film.fps:g}",
        f"{film.n_bytes:,}",
        f"{view:g}°",
        f"{len(came)} of {len(runs)}",
        f"{share_interval(*wilson(len(came), len(runs)), 0)} %",
        f"{rate.median():.3g} ({rate.min():.3g})" if len(came) else "–",
        number(came["seconds"].median(), 2),
        percent(table["bits_wrong"].sum() / max(1, table["bits"].sum())),
    ]


def rates_blocks(results: Mapping[str, Results[RatesContent]]) -> dict[str, str]:
    """Tabulate all series, in the order of `SETTINGS`, of the messages' lengths and the views."""
    order = list(SETTINGS)
    found = [series for stored in results.values() for series in stored.content.series]
    found.sort(key=lambda each: (order.index(each.setting), each.n_bytes, each.view))
    wrong = sum(run.wrong for series in found for run in series.runs)
    rows = []
    for series in found:
        film = replace(SETTINGS[series.setting], n_bytes=series.n_bytes)
        rows.append(deliveries_row(series.setting, film, series.view, series.runs))
    title = (
        "Simulated hand-held video at 1280 × 720; picture, room, pose, clocks (±1 %) and start in "
        "the loop drawn anew in each run, which ends after three loops, or ten of `hidden` "
        f"(`python -m lab rates`). Wrong messages: {wrong}."
    )
    return {"rates": Table(ROW_HEADS, rows, title).markdown()}


def check_rates(flags: RatesFlags) -> None:
    """Raise an `InputError` that names the first flag with a wrong value."""
    at_least(1, runs=flags.runs)
    each_once(settings=flags.settings, pairs=pair_names(flags.pairs), views=flags.views)
    for view in flags.views:
        check_view(view, "views")
    for name in flags.settings:
        film = flags.film(name)
        at_least(1, n_bytes=film.n_bytes)
        frames_needed(film.n_bytes, film.layout.n_bits, "n_bytes")


def measure_rates(flags: RatesFlags, workshop: Workshop) -> RatesContent:
    """Film a message for each setting, angle, pair and run, and let a receiver read it."""
    series = []
    for name, view in product(flags.settings, flags.views):
        film = flags.film(name)
        takes = [
            Take(film, pair, view, run, flags.seed)
            for run, pair in product(range(flags.runs), pair_names(flags.pairs))
        ]
        graphs = [shipped_graphs()[film.layout], FILM_GRAPH]
        found = workshop.each(deliver, {take.name: take for take in takes}, graphs)
        runs = sorted(found.values(), key=lambda run: (run.pair, run.run))
        series.append(FilmSeries(name, film.n_bytes, view, runs))
    return RatesContent(series)


def label_of_rates(flags: RatesFlags) -> str:
    """Name results after their settings, views, messages and seed."""
    words = [*flags.settings, *(f"{view:g}" for view in flags.views)]
    words += [] if flags.n_bytes is None else [f"{flags.n_bytes}B"]
    words += [f"seed{flags.seed}"] if flags.seed else []
    return "_".join(words).replace(",", "").replace(" ", "_")


STUDY = Study(
    name="rates",
    flags=RatesFlags,
    content=RatesContent,
    measure=measure_rates,
    blocks=rates_blocks,
    page=Path("docs/receiver.md"),
    check=check_rates,
    label=label_of_rates,
)
"""The study that `python -m lab rates` runs."""
