"""How often and how soon a message arrives from simulated hand-held video.

Each run draws a picture, a room, a pose, the motion of the hand, both clocks, and the moment of the
loop at which the camera joins. What a phone does to the frames is chosen: its processing, a codec
(``--codec.name h264 --codec.kbits 8000``), lost frames. The same draws are filmed whatever is
chosen. The receiver gets the frames and their times alone.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from itertools import product
from pathlib import Path
from typing import Any

import pandas as pd

from data_gen.film.codec import through_codec
from data_gen.pairs import PAIRS, pair_names
from export.film_graph import FilmGraph
from export.runtime import OWN_TIME_LIMIT_S, Decoder
from lab.films.trial import (
    Delivery,
    FilmReading,
    FilmSettings,
    Take,
    check_filmed,
    check_settings,
    film_message,
)
from lab.study import Results, Study, StudyFlags, Workshop
from link.errors import at_least
from models import FILM_GRAPH
from reports.engine.backends import one_thread
from reports.engine.checked import Count, Share
from reports.render.tables import Table, percent, share_interval
from reports.score.intervals import wilson


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
class DeliverySummary:
    """What became of the messages of one view, or of all."""

    view: str
    """Angle of observation in words, or "all"."""
    runs: Count
    """Number of runs."""
    delivered: Count
    """Number of runs in which the message came."""
    ci_low: Share
    """Lower end of Wilson's 95 % interval of the share that was delivered."""
    ci_high: Share
    """Upper end of this interval."""
    wrong_messages: Count
    """Number of runs in which a message came that was not sent."""
    seconds_median: float | None
    """Median of the seconds of film until the message; None where none came."""
    seconds_95: float | None
    """95 % quantile of these seconds."""
    bits_wrong: Share
    """Share of the decided bits that are wrong."""
    goodput_bit_s: float
    """Bits of delivered messages in a second of film."""


@dataclass(frozen=True)
class DeliveryContent:
    """What was measured under one setting."""

    camera: str
    """What differs from a plain camera with lossless frames, in one word; empty for nothing."""
    summary: list[DeliverySummary]
    """A row for each view, and one for all."""
    runs: list[Delivery]
    """Every run."""


def deliver(take: Take) -> dict[str, Any]:
    """Film until the message comes or the loops are over.

    Returns:
        the fields of a `Delivery`.
    """
    one_thread()
    filmed = film_message(take)
    decoder = Decoder(take.model, 1, OWN_TIME_LIMIT_S)
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
    graphs = [takes[0].model, FILM_GRAPH]
    found = workshop.each(deliver, {take.name: take for take in takes}, graphs)
    made = [Delivery.from_stored(run) for run in found.values()]
    return sorted(made, key=lambda run: (run.pair, run.view_deg, run.run))


def summarise_deliveries(runs: Sequence[Delivery], settings: FilmSettings) -> list[DeliverySummary]:
    """Pool the runs of each view, and all of them."""
    table = pd.DataFrame([asdict(delivery) for delivery in runs])
    views = sorted({delivery.view_deg for delivery in runs})
    groups = {f"{view:g}°": table[table["view_deg"] == view] for view in views} | {"all": table}
    rows = []
    for name, group in groups.items():
        came, filmed = group[group["delivered"]], float(group["seconds"].sum())
        low, high = wilson(len(came), len(group))
        rows.append(
            DeliverySummary(
                view=name,
                runs=len(group),
                delivered=len(came),
                ci_low=low,
                ci_high=high,
                wrong_messages=int(group["wrong"].sum()),
                seconds_median=float(came["seconds"].median()) if len(came) else None,
                seconds_95=float(came["seconds"].quantile(0.95)) if len(came) else None,
                bits_wrong=int(group["bits_wrong"].sum()) / max(1, int(group["bits"].sum())),
                goodput_bit_s=8 * settings.n_bytes * len(came) / max(filmed, 1 / settings.fps),
            )
        )
    return rows


def delivery_blocks(results: Mapping[str, Results[DeliveryContent]]) -> dict[str, str]:
    """Tabulate the settings of a plain camera."""
    return {"receiver": delivery_table(results).markdown()}


def delivery_table(results: Mapping[str, Results[DeliveryContent]]) -> Table:
    """Show one row for each setting of the preset paper before a plain camera."""
    heads = (
        "states/s", "camera fps", "pairs", "runs", "delivered in 3 loops", "95 % interval",
        "wrong messages", "bits wrong %", "seconds, median (95 %)",
        "goodput, bit/s",
    )  # fmt: skip
    rows = []
    for stored in results.values():
        row, setup = stored.content.summary[-1], stored.meta["flags"]
        if stored.content.camera or setup["preset"] != "paper":
            continue  # the page shows plain cameras alone
        seconds = "–"
        if row.seconds_median is not None:
            seconds = f"{row.seconds_median:.1f} ({row.seconds_95:.1f})"
        rows.append(
            [
                f"{setup['state_hz']:g}",
                f"{setup['fps']:g}",
                str(len(setup["pairs"])),
                str(row.runs),
                str(row.delivered),
                f"{share_interval(row.ci_low, row.ci_high, 1)} %",
                str(row.wrong_messages),
                percent(row.bits_wrong),
                seconds,
                f"{row.goodput_bit_s:.0f}",
            ]
        )
    title = (
        "Simulated hand-held video of `paper` at 1280 × 720, 0° and 45°, a 100-byte message; "
        "picture, room, pose, clocks (±1 %) and start in the loop drawn anew in each run "
        "(`python -m lab delivery`):"
    )
    return Table(heads, rows, title)


def check_delivery(flags: DeliveryFlags) -> None:
    """Raise an `InputError` that names the first flag with a wrong value."""
    at_least(1, runs=flags.runs)
    check_filmed(flags.pairs, flags.views)
    check_settings(flags.film)


def measure_delivery(flags: DeliveryFlags, workshop: Workshop) -> DeliveryContent:
    """Film, receive and pool."""
    runs = deliveries(flags.film, flags.pairs, flags.views, flags.runs, flags.seed, workshop)
    return DeliveryContent(flags.film.camera, summarise_deliveries(runs, flags.film), runs)


STUDY = Study(
    name="delivery",
    flags=DeliveryFlags,
    content=DeliveryContent,
    measure=measure_delivery,
    blocks=delivery_blocks,
    page=Path("docs/receiver.md"),
    check=check_delivery,
    label=lambda flags: flags.film.name(flags.seed),
)
"""The study that `python -m lab delivery` runs."""
