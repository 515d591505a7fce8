"""Tables and figures of one run, as its page shows them."""

from collections.abc import Mapping, Sequence

import pandas as pd
from matplotlib.figure import Figure

from reports.captured.evidence import FilmSeen, WrongBits
from reports.render.charts import (
    Series,
    draw_series,
    in_style,
    new_panels,
    set_accuracy_axis,
)
from reports.render.tables import Table

SEEN = "#1166b0"
"""Colour of the display's outline."""


@in_style
def wrong_bits_figure(counted: Sequence[WrongBits], axis: str) -> Figure:
    """Draw the share of right bits over time, or over another quantity, a line a method.

    Args:
        counted: counts in rising order of their values, at least one.
        axis: label of the horizontal axis.
    """
    figure, (panel,) = new_panels()
    table = pd.DataFrame(map(vars, counted))
    table["right"] = 1 - table["wrong"] / table["known"]
    first, last = table["value"].min(), table["value"].max()
    margin = 0.03 * (last - first) or 0.5
    panel.set_xlim(first - margin, last + margin)
    panel.set_xlabel(axis)
    set_accuracy_axis(panel, max(0.5, table["right"].min()))
    groups = table.groupby("method", sort=False)
    draw_series(panel, [Series(method, mine["value"], mine["right"]) for method, mine in groups])
    return figure


@in_style
def places_figure(film: FilmSeen) -> Figure:
    """Draw where the display was in the camera's frame, all over a film.

    Args:
        film: a film in which the display was found.
    """
    width, height = film.size
    figure, (panel,) = new_panels(legend=0.1)
    panel.set(xlim=(0, width), ylim=(height, 0), aspect="equal")
    for at, place in enumerate(film.places):
        x, y = zip(*[*place.corners, place.corners[0]], strict=True)
        look = 0.25 + 0.5 * at / len(film.places)
        panel.plot(x, y, color=SEEN, linewidth=0.9, alpha=look)
    panel.set_xlabel("pixels of the camera’s frame")
    return figure


def seen_table(films: Sequence[FilmSeen], bits_s: Mapping[str, float]) -> Table:
    """Tabulate what the receiver saw of each film, and how much the best method reads in a second.

    Args:
        films: what the receiver saw.
        bits_s: as `reports.captured.evidence.FilmEvidence.bits_s`.
    """
    rows = []
    for film in films:
        shutter = 1000 * film.exposed / film.state_hz if film.state_hz else None
        rows.append(
            [
                film.film,
                f"{film.found} of {film.frames}",
                f"{film.fps:g}",
                "–" if film.state_hz is None else f"{film.state_hz:.2f}",
                "–" if shutter is None else f"{shutter:.1f}",
                "–" if film.level is None else f"{film.level:.0f}",
                f"{100 * film.clipped:.1f}",
                str(film.cut),
                f"{bits_s[film.film]:,.0f}" if film.film in bits_s else "–",
            ]
        )
    heads = ("recording", "frames with display", "frames/s", "states/s", "exposure, ms")
    return Table((*heads, "mean level", "at limit %", "cut off", "most bits a second"), rows)
