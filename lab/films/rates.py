"""How fast presets deliver a message from simulated hand-held video.

Goodput is the message's bits over the time from the first camera frame to the delivery: finding the
display and its clock are included. The table shows every series whose results the folder holds, so
settings and views can be filmed one after the other.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from data_gen.film.message import FilmSettings, check_settings
from data_gen.pairs import PAIRS
from lab.films.delivery import ROW_HEADS, deliveries, deliveries_row
from lab.films.trial import Delivery, check_filmed
from lab.study import Results, Study, StudyFlags, Workshop
from link.errors import at_least, choose, each_once
from reports.render.tables import Table

FAST = FilmSettings(preset="fast", state_hz=30, fps=60, n_bytes=20_000)
"""The setting "fast", a camera of 60 frames a second before the preset `fast`."""
SLANTED = replace(FAST, preset="hidden")
"""The setting "slanted", the same on the larger blocks of the preset `hidden`."""
HIDDEN = FilmSettings(preset="hidden", kappa=1, state_hz=60, fps=120, n_bytes=20_000, loops=10)
"""The setting "hidden", below the threshold of sight at the preset's distance."""
SETTINGS = {
    "paper": FilmSettings(n_bytes=100),
    "robust": FilmSettings(preset="robust", n_bytes=2_000),
    "slow camera": FilmSettings(preset="hidden", kappa=1, n_bytes=20_000),
    "faint": FilmSettings(preset="hidden", kappa=1, state_hz=30, fps=60, n_bytes=20_000),
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
    "slanted": SLANTED,
    "fast": FAST,
}
"""Settings of display, camera and message, by name. "slanted" is "fast" on the grid of "hidden",
whose larger blocks are for slanted and distant displays."""


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
    """What was measured."""

    series: list[FilmSeries]
    """One entry for each setting and view."""


def rates_blocks(results: Mapping[str, Results[RatesContent]]) -> dict[str, str]:
    """Tabulate all series, in the order of `SETTINGS`, of the messages' lengths and the views."""
    order = list(SETTINGS)
    found = [series for stored in results.values() for series in stored.content.series]
    found.sort(key=lambda each: (order.index(each.setting), each.n_bytes, each.view))
    rows = []
    for series in found:
        film = replace(SETTINGS[series.setting], n_bytes=series.n_bytes)
        rows.append(deliveries_row(series.setting, film, series.view, series.runs))
    title = (
        "Simulated hand-held video at 1280 × 720; picture, room, pose, clocks (±1 %) and start in "
        "the loop drawn anew in each run, which ends after three loops, or ten of `hidden` "
        "(`python -m lab rates`):"
    )
    return {"rates": Table(ROW_HEADS, rows, title).markdown()}


def check_rates(flags: RatesFlags) -> None:
    """Raise an `InputError` that names the first flag with a wrong value."""
    at_least(1, runs=flags.runs)
    each_once(settings=flags.settings)
    check_filmed(flags.pairs, flags.views)
    for name in flags.settings:
        check_settings(flags.film(name))


def measure_rates(flags: RatesFlags, workshop: Workshop) -> RatesContent:
    """Film and receive every setting from every angle."""
    found = []
    for name in flags.settings:
        film = flags.film(name)
        for view in flags.views:
            runs = deliveries(film, flags.pairs, (view,), flags.runs, flags.seed, workshop)
            found.append(FilmSeries(name, film.n_bytes, view, runs))
    return RatesContent(found)


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
