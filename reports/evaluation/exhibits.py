"""Tables and figures of one run, as its page shows them."""

import math
from collections.abc import Sequence

from matplotlib.figure import Figure

from reports.captured.evidence import FilmSeen, Told, WrongBits
from reports.evaluation.findings import Standing, SweptAccuracy
from reports.render.charts import (
    INK,
    MUTED,
    Point,
    Series,
    dot_chart,
    draw_series,
    in_style,
    new_panels,
    set_accuracy_axis,
    set_ticks,
)
from reports.render.tables import Table, percent, share_interval
from reports.run import Cost, Response, Story, SweepCurve

TICK_DISTANCE = 0.075
"""Least distance of two ticks of a swept quantity, as a share of the axis."""
COST_TICKS = (0.3, 1, 3, 10, 30, 100, 300)
"""Multiples of the reference's time that the axis of costs may name."""
SEEN = "#1166b0"
"""Colour of the display's outline."""
GRAY_TICKS = (0, 64, 128, 192, 255)
"""Gray levels that the axes of a response name."""


@in_style
def summary_figure(ranked: Sequence[Standing]) -> Figure:
    """Draw the accuracy of each method with its interval.

    Args:
        ranked: at least one method that has an accuracy.
    """
    scored = [s for s in ranked if s.accuracy is not None]
    figure, panel = dot_chart(
        [
            Series(s.method, [Point(s.accuracy or 0, 0, s.low, s.high, f"{percent(s.accuracy)} %")])
            for s in scored
        ]
    )
    set_accuracy_axis(panel, "x", min(s.low for s in scored), short=True)
    return figure


@in_style
def sweep_figure(curve: SweepCurve, swept: Sequence[SweptAccuracy], least: float) -> Figure:
    """Draw accuracy against a swept quantity, a line a method.

    Args:
        curve: the sweep.
        swept: accuracies of this sweep, at least one.
        least: smallest accuracy that the axis reaches down to, in [0, 1].
    """
    figure, (panel,) = new_panels()
    values = [curve.scale * point.value for point in curve.points]
    place = math.log if curve.log else float
    span = place(max(values)) - place(min(values)) or 1.0
    ticks: list[float] = []
    for value in values:
        if not ticks or (place(value) - place(ticks[-1])) / span > TICK_DISTANCE:
            ticks.append(value)
    if curve.log:
        factor = math.exp(0.03 * span)
        panel.set(xscale="log", xlim=(min(values) / factor, max(values) * factor))
    else:
        panel.set_xlim(min(values) - 0.03 * span, max(values) + 0.03 * span)
    set_ticks(panel.xaxis, ticks, [f"{tick:.3g}" for tick in ticks])
    panel.set_xlabel(curve.axis)
    set_accuracy_axis(panel, "y", least)
    lines: dict[str, list[Point]] = {}
    for entry in swept:
        note = (
            f"{entry.method}, {entry.value:g}: {percent(entry.accuracy)} % "
            f"({share_interval(entry.low, entry.high)}), {entry.errors} of {entry.bits} bits wrong"
        )
        point = Point(entry.value, entry.accuracy, entry.low, entry.high, note)
        lines.setdefault(entry.method, []).append(point)
    draw_series(panel, [Series(method, points) for method, points in lines.items()])
    return figure


def sweep_table(curve: SweepCurve, swept: Sequence[SweptAccuracy]) -> Table:
    """Make the table of a sweep's accuracies: a row for each method and value."""
    heads = ["method", curve.axis, "frame pairs", "bits", "wrong", "right %", "95 % interval"]
    methods = list(dict.fromkeys(entry.method for entry in swept))
    rows = [
        [
            entry.method,
            f"{entry.value:g}",
            f"{entry.frames}",
            f"{entry.bits:,}",
            f"{entry.errors}",
            percent(entry.accuracy),
            share_interval(entry.low, entry.high),
        ]
        for entry in sorted(swept, key=lambda entry: methods.index(entry.method))
    ]
    return Table(heads, rows)


@in_style
def response_figure(response: Response) -> Figure:
    """Draw the true camera-display transfer function and what methods find of it."""
    figure, (panel,) = new_panels()
    panel.set(xlim=(0, 255), ylim=(0, 255), xlabel="displayed gray level", ylabel="captured")
    for axis in (panel.xaxis, panel.yaxis):
        set_ticks(axis, GRAY_TICKS, [f"{level}" for level in GRAY_TICKS])
        axis.grid(True)
    panel.fill_between(
        response.displayed, response.low, response.high, color=MUTED, alpha=0.18, linewidth=0
    )
    true = zip(response.displayed, response.median, strict=True)
    lines = [Series("true", [Point(a, b, b, b) for a, b in true], INK)]
    for method, curve in response.found.items():
        inside = [Point(d, c, c, c) for d, c in curve if 0 <= d <= 255]
        if inside:
            lines.append(Series(method, inside))
    draw_series(panel, lines, markers=False)
    return figure


def response_table(responses: Sequence[Response]) -> Table:
    """Make the table of errors of the responses that methods find, means over frame pairs."""
    methods = list(dict.fromkeys(method for r in responses for method in r.error))
    rows = []
    for pair, view in dict.fromkeys((r.pair, r.view_deg) for r in responses):
        mine = [r for r in responses if (r.pair, r.view_deg) == (pair, view)]
        errors = [[r.error[method] for r in mine if method in r.error] for method in methods]
        means = [f"{sum(values) / len(values):.1f}" if values else "–" for values in errors]
        rows.append([f"{pair}, {view:g}°", f"{len(mine)}", *means])
    title = (
        "Root mean square error of the displayed level that a method finds, gray levels; mean over "
        "frame pairs"
    )
    return Table(["frame pairs of", "n", *methods], rows, title)


@in_style
def cost_figure(cost: Cost) -> Figure:
    """Draw the time of each method as a multiple of the reference's, with quartiles."""
    ratios = _ranked_costs(cost)
    low = min([0.8, *(first for first, _, _ in ratios.values())])
    high = max(last for _, _, last in ratios.values())
    figure, panel = dot_chart(
        [
            Series(method, [Point(median, 0, first, last, f"{median:.1f} ×")])
            for method, (first, median, last) in ratios.items()
        ]
    )
    ticks = [tick for tick in COST_TICKS if low <= tick <= high * 1.2]
    panel.set(xscale="log", xlim=(low, high * 1.2), xlabel=f"× {cost.reference}")
    set_ticks(panel.xaxis, ticks, [f"{tick:g}" for tick in ticks])
    return figure


def cost_table(cost: Cost) -> Table:
    """Make the table of each method's time as a multiple of the reference's; no row without one."""
    rows = [
        [method, f"{median:.2f}", f"{first:.2f} – {last:.2f}"]
        for method, (first, median, last) in _ranked_costs(cost).items()
    ]
    return Table(["method", f"× {cost.reference}", "quartiles"], rows)


def story_table(story: Story) -> Table:
    """Make the table of what was measured in the blocks of a frame pair."""
    heads = ["mean over blocks, gray levels", "wrong blocks", "other blocks"]
    rows = [[name, f"{a:.2f}", f"{b:.2f}"] for name, (a, b) in story.measured.items()]
    return Table(heads, rows)


def _ranked_costs(cost: Cost) -> dict[str, tuple[float, float, float]]:
    """Multiples by method without the reference, the quickest first."""
    timed = [(name, ratios) for name, ratios in cost.ratios.items() if name != cost.reference]
    return dict(sorted(timed, key=lambda entry: entry[1][1]))


@in_style
def wrong_bits_figure(counted: Sequence[WrongBits], axis: str) -> Figure:
    """Draw the share of right bits over time, or over another quantity, a line a method.

    Args:
        counted: counts in rising order of their values, at least one.
        axis: label of the horizontal axis.
    """
    figure, (panel,) = new_panels()
    values = [entry.value for entry in counted]
    margin = 0.03 * (max(values) - min(values)) or 0.5
    panel.set_xlim(min(values) - margin, max(values) + margin)
    panel.set_xlabel(axis)
    right = [1 - entry.wrong / entry.known for entry in counted]
    set_accuracy_axis(panel, "y", max(0.5, min(right)))
    lines: dict[str, list[Point]] = {}
    for entry, share in zip(counted, right, strict=True):
        lines.setdefault(entry.method, []).append(Point(entry.value, share, share, share))
    draw_series(panel, [Series(method, points) for method, points in lines.items()], markers=False)
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
    for number, place in enumerate(film.places):
        x, y = zip(*[*place.corners, place.corners[0]], strict=True)
        look = 0.25 + 0.5 * number / len(film.places)
        panel.plot(x, y, color=SEEN, linewidth=0.9, alpha=look)
    panel.set_xlabel("pixels of the camera’s frame")
    return figure


def seen_table(films: Sequence[FilmSeen]) -> Table:
    """Tabulate what the receiver saw of each film."""
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
            ]
        )
    heads = ("film", "frames with display", "frames/s", "states/s", "exposure, ms")
    return Table((*heads, "mean level", "at limit %", "cut off"), rows)


def told_table(told: Sequence[Told]) -> Table:
    """Tabulate what the scores of each method tell."""
    rows = [
        [
            each.method,
            percent(each.read),
            f"{each.information:.3f}",
            "–" if each.bit_s is None else f"{each.bit_s:,.0f}",
        ]
        for each in told
    ]
    return Table(("method", "read %", "bits a block", "bits a second"), rows)
