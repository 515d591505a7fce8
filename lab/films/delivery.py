"""How often and how soon a message arrives from simulated hand-held video.

Each run draws a picture, a room, a pose, the motion of the hand, both clocks, and the moment of the
loop at which the camera joins. What a phone does to the frames is chosen: its processing, a codec
(``--codec.name h264 --codec.kbits 8000``), lost frames. The same draws are filmed whatever is
chosen. The receiver gets the frames and their times alone.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from itertools import product
from typing import Any

import pandas as pd

from data_gen.film.codec import through_codec
from data_gen.film.message import FilmSettings, Take, check_settings, film_message
from data_gen.pairs import PAIRS, pair_names
from export.film_graph import FilmGraph
from export.runtime import OWN_TIME_LIMIT_S, Decoder
from lab.films.trial import Delivery, FilmReading, check_filmed, graph_of
from lab.study import Results, Study, StudyFlags, Workshop
from link.errors import at_least
from link.presets import PRESETS
from models import FILM_GRAPH
from reports.engine.backends import one_thread
from reports.render.tables import Table, number, percent, share_interval
from reports.score.intervals import wilson
from sender.hiding import Hiding, Onlooker

FILM_FLAGS = ("preset", "kappa", "state_hz", "fps", "n_bytes")
"""Names of the settings that a row of the table tells."""


@dataclass(frozen=True)
class DeliveryFlags(FilmSettings, StudyFlags):
    """A message from at most three loops of a hand-held video (simulated)."""

    pairs: tuple[str, ...] = tuple(PAIRS)
    """Camera-display pairs."""
    views: tuple[float, ...] = (0.0, 45.0)
    """Angles between the camera and the normal of the display, degrees."""
    runs: int = 6
    """Number of runs for each pair and view."""

    @property
    def film(self) -> FilmSettings:
        """What is shown, and how it is filmed."""
        return FilmSettings(
            **{each.name: getattr(self, each.name) for each in fields(FilmSettings)}
        )


@dataclass(frozen=True)
class DeliveryContent:
    """What was measured under one setting."""

    camera: str
    """What differs from a plain camera with lossless frames, in one word; empty for nothing."""
    runs: list[Delivery]
    """Every run."""


def deliver(take: Take) -> dict[str, Any]:
    """Film until the message comes or the loops are over.

    Returns:
        the fields of a `Delivery`.
    """
    one_thread()
    filmed = film_message(take)
    decoder = Decoder(graph_of(take), 1, OWN_TIME_LIMIT_S)
    reading = FilmReading(filmed, decoder, FilmGraph(FILM_GRAPH, 1))
    for frame in through_codec(filmed.frames, take.settings.codec, take.settings.fps):
        reading.push(frame)
        if reading.ended:
            break
    return asdict(reading.delivery())


def deliveries(
    settings: FilmSettings,
    pairs: Sequence[str],
    views: Sequence[float],
    runs: int,
    seed: int,
    workshop: Workshop,
) -> list[Delivery]:
    """Film a message for each pair, view and run, and let a receiver read it.

    Returns:
        what became of each, ordered by pair, view and run.
    """
    takes = [
        Take(settings, pair, view, run, seed)
        for run, view, pair in product(range(runs), views, pair_names(pairs))
    ]
    graphs = [graph_of(takes[0]), FILM_GRAPH]
    found = workshop.each(deliver, {take.name: take for take in takes}, graphs)
    made = [Delivery(**run) for run in found.values()]
    return sorted(made, key=lambda run: (run.pair, run.view_deg, run.run))


ROW_HEADS = (
    "setting", "grid", "κ", "states/s", "camera fps", "bytes", "view", "delivered",
    "95 % interval", "wrong messages", "goodput, kbit/s, median", "least", "seconds, median",
    "bits wrong %", "contrast over threshold",
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
        f"{film.layout.rows} × {film.layout.cols}",
        str(film.kappa),
        f"{film.state_hz:g}",
        f"{film.fps:g}",
        f"{film.n_bytes:,}",
        f"{view:g}°",
        f"{len(came)} of {len(runs)}",
        f"{share_interval(*wilson(len(came), len(runs)), 0)} %",
        str(int(table["wrong"].sum())),
        f"{rate.median():.3g}" if len(came) else "–",
        f"{rate.min():.3g}" if len(came) else "–",
        number(came["seconds"].median(), 2),
        percent(table["bits_wrong"].sum() / max(1, table["bits"].sum())),
        f"{contrast_of(film.preset, film.state_hz, film.kappa):.3g}",
    ]


def contrast_of(preset: str, state_hz: float, kappa: int) -> float:
    """Contrast over threshold of one block, as `sender` prints it for a preset."""
    chosen = PRESETS[preset]
    return Hiding(chosen.layout, state_hz, Onlooker(distance=chosen.distance_m)).seen(kappa)


def delivery_blocks(results: Mapping[str, Results[DeliveryContent]]) -> dict[str, str]:
    """Tabulate all settings and views."""
    rows = []
    for stored in results.values():
        flags, content = stored.meta["flags"], stored.content
        film = FilmSettings(**{name: flags[name] for name in FILM_FLAGS})
        for view in flags["views"]:
            runs = [run for run in content.runs if run.view_deg == view]
            name = " ".join([film.preset, content.camera]).rstrip()
            rows.append(deliveries_row(name, film, view, runs))
    return {"delivery": Table(ROW_HEADS, rows, "Simulated hand-held video:").markdown()}


def check_delivery(flags: DeliveryFlags) -> None:
    """Raise an `InputError` that names the first flag with a wrong value."""
    at_least(1, runs=flags.runs)
    check_filmed(flags.pairs, flags.views)
    check_settings(flags.film)


def measure_delivery(flags: DeliveryFlags, workshop: Workshop) -> DeliveryContent:
    """Film, receive and pool."""
    runs = deliveries(flags.film, flags.pairs, flags.views, flags.runs, flags.seed, workshop)
    return DeliveryContent(flags.film.camera, runs)


STUDY = Study(
    name="delivery",
    flags=DeliveryFlags,
    content=DeliveryContent,
    measure=measure_delivery,
    blocks=delivery_blocks,
    check=check_delivery,
    label=lambda flags: flags.film.name(flags.seed),
)
"""The study that `python -m lab delivery` runs."""
