"""What whole windows of film tell beyond frame pairs, on the same films.

Each film is read twice: by frame pairs alone, and by windows of frames (`models.neural.film`) with
frame pairs where the picture moves. Both receivers find, follow and time the display by themselves,
and both read on to the film's end, so that all films count alike.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from itertools import product
from pathlib import Path
from typing import Any

import pandas as pd

from data_gen.film.codec import through_codec
from data_gen.pairs import pair_names
from export.film_graph import FilmGraph
from export.runtime import OWN_TIME_LIMIT_S, Decoder
from lab.films.rates import RatesFlags, check_rates
from lab.films.trial import FilmReading, Take, film_message
from lab.study import Results, Study, Workshop
from link.errors import at_least
from models import FILM_GRAPH
from reports.engine.backends import one_thread
from reports.render.tables import Table, number, percent
from reports.score.reliability import (
    Bin,
    binned_information,
    calibration_error,
    merge_bins,
)

METHODS = ("pairs", "film")
"""How films are read."""
COMPARED = ("hidden", "faint", "slow camera", "slanted", "fast", "robust")
"""Settings that are compared, keys of `lab.films.rates.SETTINGS`."""


@dataclass(frozen=True)
class FilmFlags(RatesFlags):
    """Bits read by frame pairs and by windows of film, from the same films (simulated)."""

    settings: tuple[str, ...] = COMPARED
    """Names of settings, keys of SETTINGS in lab/films/rates.py."""
    states: int = 90
    """Length of each film, in states of the display."""


@dataclass(frozen=True)
class Reading:
    """What one method read of one film."""

    setting: str
    """Name of the setting."""
    method: str
    """One of `METHODS`."""
    pair: str
    """Camera-display pair."""
    view_deg: float
    """Angle between the camera and the normal of the display, degrees."""
    run: int
    """Number of the film among those of the setting, pair and view."""
    picture: str
    """Name of the picture that carries the message."""
    bits: int
    """Number of bits that were decided."""
    bits_wrong: int
    """Number of these that are wrong, each frame pair held against the one that it fits best."""
    bins: list[Bin] = field(default_factory=list)
    """Bits that were decided and not erased, sorted by how sure the receiver was of them."""


@dataclass(frozen=True)
class FilmContent:
    """What was measured."""

    readings: list[Reading]
    """One entry for each film and method."""


@dataclass(frozen=True)
class Comparison:
    """One film that both methods read."""

    take: Take
    """The film."""
    setting: str
    """Name of its setting."""
    seconds: float
    """Its length, seconds."""


def read_both(item: Comparison) -> list[dict[str, Any]]:
    """Film, and let both receivers read.

    Returns:
        the fields of a `Reading` for each of `METHODS`.
    """
    one_thread()
    take, filmed = item.take, film_message(item.take)
    decoder = Decoder(take.model, 1, OWN_TIME_LIMIT_S)
    readings = {
        "pairs": FilmReading(filmed, decoder),
        "film": FilmReading(filmed, decoder, FilmGraph(FILM_GRAPH, 1)),
    }
    for frame in through_codec(filmed.frames, take.settings.codec, take.settings.fps):
        if frame.time_s > item.seconds:
            break
        for reading in readings.values():
            reading.push(frame)
    found = []
    for method, reading in readings.items():
        reading.finish()
        read = asdict(reading.delivery()) | {"setting": item.setting, "method": method}
        found.append({each.name: read[each.name] for each in fields(Reading)})
    return found


def measure_films(flags: FilmFlags, workshop: Workshop) -> FilmContent:
    """Read every film by every method."""
    items = {}
    for name, run, view, pair in product(
        flags.settings, range(flags.runs), flags.views, pair_names(flags.pairs)
    ):
        settings = flags.film(name)
        take = Take(settings, pair, view, run, flags.seed)
        items[f"{name} {take.name}"] = Comparison(take, name, flags.states / settings.state_hz)
    inputs = sorted({item.take.model for item in items.values()})
    read = workshop.each(read_both, items, [*inputs, FILM_GRAPH])
    readings = [
        Reading(**{**each, "bins": [Bin(**one) for one in each["bins"]]})
        for both in read.values()
        for each in both
    ]
    return FilmContent(readings)


def film_blocks(results: Mapping[str, Results[FilmContent]]) -> dict[str, str]:
    """Tabulate both methods beside each other, by setting and view."""
    all_readings = [each for stored in results.values() for each in stored.content.readings]
    runs = pd.DataFrame([vars(each) for each in all_readings])
    rows = []
    for (setting, view), cell in runs.groupby(["setting", "view_deg"], sort=False):
        by = {method: cell[cell["method"] == method] for method in METHODS}
        knew = {
            method: each.groupby(["pair", "run"])[["bins", "bits"]].apply(_information)
            for method, each in by.items()
        }
        both = pd.DataFrame(knew).dropna()
        ratios = both["film"] / both["pairs"]
        wrong = [percent(each["bits_wrong"].sum() / each["bits"].sum()) for each in by.values()]
        means = [number(both[method].mean(), 3) for method in METHODS]
        errors = [number(calibration_error(merge_bins(each["bins"])), 3) for each in by.values()]
        spread = f"{number(ratios.min(), 2)} – {number(ratios.max(), 2)}"
        ratio = number(both["film"].mean() / (both["pairs"].mean() or float("nan")), 2)
        rows.append([setting, f"{view:g}°", str(len(both)), *wrong, *means, ratio, spread, *errors])
    heads = (
        "setting", "view", "films", "wrong %, pairs", "film", "bits a block, pairs", "film",
        "ratio", "least and largest", "calibration error, pairs", "film",
    )  # fmt: skip
    title = (
        "Simulated hand-held video at 1280 × 720, read by frame pairs and by windows of film; "
        "information in bits a block and frame pair, mean over films that both read "
        "(`python -m lab film`):"
    )
    return {"film": Table(heads, rows, title, left=2).markdown()}


def _information(films: pd.DataFrame) -> float:
    """Give the information of films, in bits a block and frame pair; NaN where none was read."""
    bits = int(films["bits"].sum())
    return binned_information(merge_bins(films["bins"]), bits) if bits else float("nan")


def check_film(flags: FilmFlags) -> None:
    """Raise an `InputError` that names the first flag with a wrong value."""
    check_rates(flags)
    at_least(2, states=flags.states)


STUDY = Study(
    name="film",
    flags=FilmFlags,
    content=FilmContent,
    measure=measure_films,
    blocks=film_blocks,
    page=Path("docs/films.md"),
    check=check_film,
)
"""The study that `python -m lab film` runs."""
