"""Accuracy against one quantity at a time."""

import math
from collections.abc import Sequence
from typing import Any

from reports.render.markup import Html, join, table, tag
from reports.render.sections.common import absent, interval, named, percent
from reports.render.svg import (
    Axis,
    Line,
    Point,
    accuracy_axis,
    line_chart,
)
from reports.run import Run, SweepPoint
from reports.score.findings import (
    standing,
)
from reports.studies.sweeps import SCALES


def sweeps(run: Run) -> Html:
    """A chart with intervals for each quantity."""
    if not run.sweeps:
        return absent("Sweeps", "The full comparison has them; or name some with --sweeps.")
    least = min(
        standing(point.rows, row.method)[3] or 0.0 for point in run.sweeps for row in point.rows
    )
    y = accuracy_axis(max(0.5, least) if least > 0.45 else 0.3)
    parts = []
    for name in dict.fromkeys(point.sweep for point in run.sweeps):
        points = [point for point in run.sweeps if point.sweep == name]
        parts.append(_sweep(name, points, run.sweep_texts[name], y))
    first = run.sweeps[0]
    pairs = ", ".join(dict.fromkeys(row.pair for row in first.rows))
    note = tag(
        "p",
        f"Simulated; pairs {pairs}; κ 3 and 45° where the sweep sets nothing else, held-out "
        "pictures and draws, protocol of this run. Bars are 95 % intervals that hold that errors "
        "cluster by frame pair. The scale is stretched near 100 %.",
        class_="note",
    )
    return join(note, tag("div", *parts, class_="grid"))


def _sweep(name: str, points: Sequence[SweepPoint], texts: dict[str, Any], y: Axis) -> Html:
    factor = SCALES.get(name, 1.0)
    values = [factor * point.value for point in points]
    scale = math.log if texts["log"] else float
    ticks = [(value, f"{value:.3g}") for value in values]
    span = scale(max(values)) - scale(min(values)) or 1.0
    kept: list[tuple[float, str]] = []
    for tick in ticks:
        if not kept or (scale(tick[0]) - scale(kept[-1][0])) / span > 0.075:
            kept.append(tick)
    margin = 0.03 * span
    low, high = (
        (math.exp(scale(min(values)) - margin), math.exp(scale(max(values)) + margin))
        if texts["log"]
        else (min(values) - margin, max(values) + margin)
    )
    x = Axis(texts["axis"], kept, low, high, scale)
    methods = list(dict.fromkeys(row.method for point in points for row in point.rows))
    lines, rows = [], []
    for method in methods:
        marks = []
        for value, point in zip(values, points, strict=True):
            frames, bits, errors, accuracy, least, most = standing(point.rows, method)
            if accuracy is None:
                continue
            note = (
                f"{method}, {value:g}: {percent(accuracy)} % ({interval(least, most)}), "
                f"{errors} of {bits} bits wrong"
            )
            marks.append(Point(value, accuracy, least, most, note))
            rows.append((method, value, frames, bits, errors, accuracy, least, most))
        if marks:
            lines.append(Line(method, marks))
    numbers = table(
        ["method", texts["axis"], "frame pairs", "bits", "wrong", "right %", "95 % interval"],
        [
            [named(m), f"{v:g}", f, f"{b:,}", e, percent(a), interval(lo, hi)]
            for m, v, f, b, e, a, lo, hi in rows
        ],
    )
    counts = sorted({row[2] for row in rows})
    sizes = sorted({row[3] for row in rows})
    size = f"{counts[0]} frame pairs, {sizes[0]:,}"
    size += f" to {sizes[-1]:,} bits a point." if len(sizes) > 1 else " bits a point."
    return tag(
        "figure",
        tag("h3", texts["title"]),
        line_chart(f"Accuracy by {texts['axis']}", x, y, lines),
        tag("figcaption", f"{size} {texts['note']}"),
        tag("details", tag("summary", "numbers"), numbers),
    )
