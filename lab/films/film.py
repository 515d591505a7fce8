"""What whole windows of film tell beyond frame pairs, on the same films.

Each film is read several times: by frame pairs alone, and by windows of frames with frame pairs
where the picture moves; by the paper's method, by a plain linear one, and by the decoders that
ship. All receivers find, follow and time the display by themselves, and all read on to the film's
end, so that all films count alike.
"""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, fields
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import pandas as pd

from data_gen.film.codec import through_codec
from data_gen.film.message import Take, film_message
from data_gen.pairs import pair_names
from export.film_graph import FilmGraph
from export.runtime import OWN_TIME_LIMIT_S, Decoder
from lab.films.rates import RatesFlags, check_rates
from lab.films.trial import FilmReading, graph_of
from lab.study import Results, Study, Workshop
from link.errors import at_least
from link.frames import SoftBits
from link.images import as_rgb
from link.layout import Layout
from link.observation import Observation
from link.types import Image
from models import FILM_GRAPH, BlockDecoder
from models.film.methods import LinearFilm
from models.paper.oorc import OORC
from receiver.decoders import WindowDecoder
from reports.engine.backends import one_thread
from reports.render.tables import Table, number, percent
from reports.score.reliability import (
    Bin,
    binned_information,
    calibration_error,
    merge_bins,
)


class Ready:
    """A decoder of the suite as a receiver asks for it, with nothing to load."""

    def __init__(self, decoder: BlockDecoder) -> None:
        self.decode = decoder.decode

    def prepare(self) -> None:
        """Do nothing: the decoder is there."""


METHODS: dict[str, tuple[bool, Callable[[], WindowDecoder] | None]] = {
    "oorc, pairs": (False, None),
    "learned, pairs": (True, None),
    "oorc, film": (False, partial(Ready, OORC())),
    "linear, film": (False, partial(Ready, LinearFilm())),
    "learned, film": (True, partial(FilmGraph, FILM_GRAPH, 1)),
}
"""How films are read, by name: whether frame pairs are decoded by the graph that ships, or else by
OORC; and what makes the reader of windows of film, or None where they are not read."""
LEARNED = ("learned, pairs", "learned, film")
"""Methods whose ratio the table gives."""
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


class ReferenceDecoder:
    """Decodes frame pairs by OORC (`models.paper.oorc`), as a receiver asks for it.

    Its scores are margins of an SVM and no log-likelihood ratios, as their calibration error says.
    """

    def __init__(self, layout: Layout) -> None:
        self.layout = layout

    def prepare(self) -> None:
        """Do nothing: there is nothing to load."""

    def decode(self, original: Image, embedded: Image, /) -> SoftBits:
        """Score the message bits of two rectified frames."""
        return OORC().decode(Observation.still(as_rgb(original), as_rgb(embedded), self.layout))


def read_methods(item: Comparison) -> list[dict[str, Any]]:
    """Film, and let all receivers read.

    Returns:
        the fields of a `Reading` for each of `METHODS`.
    """
    one_thread()
    take, filmed = item.take, film_message(item.take)
    shipped = Decoder(graph_of(take), 1, OWN_TIME_LIMIT_S)
    reference = ReferenceDecoder(take.settings.layout)
    readings = {
        name: FilmReading(filmed, shipped if ships else reference, film() if film else None)
        for name, (ships, film) in METHODS.items()
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
    inputs = sorted({graph_of(item.take) for item in items.values()})
    read = workshop.each(read_methods, items, [*inputs, FILM_GRAPH])
    readings = [
        Reading(**{**each, "bins": [Bin(**one) for one in each["bins"]]})
        for by_methods in read.values()
        for each in by_methods
    ]
    return FilmContent(readings)


def film_blocks(results: Mapping[str, Results[FilmContent]]) -> dict[str, str]:
    """Tabulate all methods beside each other, by setting and view."""
    all_readings = [each for stored in results.values() for each in stored.content.readings]
    runs = pd.DataFrame([vars(each) for each in all_readings])
    told, errors = [], []
    for (setting, view), cell in runs.groupby(["setting", "view_deg"], sort=False):
        by = {method: cell[cell["method"] == method] for method in METHODS}
        knew = pd.DataFrame(
            {
                method: each.groupby(["pair", "run"])[["bins", "bits"]].apply(_information)
                for method, each in by.items()
            }
        ).dropna()
        pairs, film = (knew[method] for method in LEARNED)
        ratios = film / pairs
        means = [number(knew[method].mean(), 3) for method in METHODS]
        spread = f"{number(ratios.min(), 2)} – {number(ratios.max(), 2)}"
        ratio = number(film.mean() / (pairs.mean() or float("nan")), 2)
        place = (setting, f"{view:g}°")
        told.append([*place, str(len(knew)), *means, ratio, spread])
        wrong = [percent(each["bits_wrong"].sum() / each["bits"].sum()) for each in by.values()]
        bins = [merge_bins(each["bins"]) for each in by.values()]
        errors.append([*place, *wrong, *(number(calibration_error(each), 3) for each in bins)])
    names = tuple(METHODS)
    told_title = (
        "Simulated hand-held video at 1280 × 720: information in bits a block and frame pair, mean "
        f"over films that all methods read; ratio of {LEARNED[1]} to {LEARNED[0]} of the means, "
        "and its least and largest of a film (`python -m lab film`):"
    )
    errors_title = "The same films: bits wrong %, then the calibration error, by method:"
    told_heads = ("setting", "view", "films", *names, "ratio", "least and largest")
    errors_heads = ("setting", "view", *names, *names)
    return {
        "film": Table(told_heads, told, told_title, left=2).markdown(),
        "film_errors": Table(errors_heads, errors, errors_title, left=2).markdown(),
    }


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
