"""Charts as inline SVG: a few kilobytes, the page's own fonts and colours, the same bytes always.

Drawn at the width of a phone, so that text has one size on every screen.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from reports.render.markup import Html, join, tag

WIDTH, HEIGHT = 360, 280
LEFT, RIGHT, TOP, BOTTOM = 46, 101, 10, 44
LABEL_PX = 13
"""Least distance between two labels."""
KNEE = 3e-4
"""Share of wrong bits at which the scale of accuracies turns from logarithmic to linear."""
COLOURS = {
    "naive": "#8a8f98",
    "two_step": "#3a9fd6",
    "oorc": "#1166b0",
    "hidden_ratex": "#b8589a",
    "blind": "#0a9468",
    "phi": "#7b61c9",
    "learned": "#d4520a",
    "cnn": "#c28a00",
    "ideal": "#8a6d5a",
    "ideal_change": "#4f6a5e",
    "rivaGAN": "#b04a3a",
    "DWT-DCT": "#5a7d8c",
    "DWT-DCT in Y": "#7a8a2a",
    "DWT-DCT-SVD": "#6b6bb0",
    "DWT-DCT-SVD in Y": "#b07ab8",
    "blind-watermark": "#2f8f9c",
}
"""By method; told apart with the common kinds of colour blindness (after Okabe and Ito)."""
SPARE = ("#7a8a2a", "#5a7d8c", "#a8584a", "#6b6bb0")
MARKERS = ("circle", "square", "diamond", "up", "down")


def colour_of(method: str) -> str:
    """A method's colour, the same in every chart."""
    return COLOURS.get(method, SPARE[sum(method.encode()) % len(SPARE)])


def marker_of(method: str) -> str:
    """A method's marker, the same in every chart."""
    names = list(COLOURS)
    number = names.index(method) if method in names else sum(method.encode())
    return MARKERS[number % len(MARKERS)]


@dataclass(frozen=True)
class Point:
    """A value with its interval."""

    x: float
    y: float
    low: float
    high: float
    note: str = ""
    """Shown where the pointer rests."""


@dataclass(frozen=True)
class Line:
    """Points of one method."""

    name: str
    points: Sequence[Point]
    joined: bool = True
    marked: bool = True
    colour: str = ""
    """In place of the method's."""


@dataclass(frozen=True)
class Axis:
    """Label, ticks as (value, text), and range."""

    label: str
    ticks: Sequence[tuple[float, str]]
    low: float
    high: float
    scale: Callable[[float], float] = float
    """Increasing; makes a coordinate of a value."""

    def place(self, value: float) -> float:
        """In [0, 1]."""
        low, high = self.scale(self.low), self.scale(self.high)
        value = min(max(value, self.low), self.high)
        return (self.scale(value) - low) / (high - low)


def accuracy_scale(accuracy: float) -> float:
    """Spreads what lies near 1: 99 % is as far from 90 % as 99.9 % nearly is from 99 %."""
    return float(-np.log10(1 - min(accuracy, 1.0) + KNEE))


def accuracy_axis(least: float) -> Axis:
    """Accuracy in [0, 1] from about ``least`` to 1, in per cent of bits."""
    ticks = [(0.3, "30"), (0.5, "50"), (0.7, "70"), (0.8, "80"), (0.9, "90"), (0.95, "95")]
    ticks += [(0.98, "98"), (0.99, "99"), (0.995, "99.5"), (0.999, "99.9"), (1.0, "100")]
    low = max([value for value, _ in ticks if value <= least], default=0.0)
    if not low:
        ticks.insert(0, (0.0, "0"))
    shown = [tick for tick in ticks if tick[0] >= low]
    if low < 0.8:
        shown = [tick for tick in shown if tick[1] not in ("98", "99.5")]
    return Axis("bits right, %", shown, low, 1.0, accuracy_scale)


def line_chart(
    title: str,
    x: Axis,
    y: Axis,
    lines: Sequence[Line],
    diagonal: bool = False,
    band: Html | None = None,
    margin: float = RIGHT,
) -> Html:
    """Lines with intervals, each named at its right end.

    Args:
        title: read out in place of the picture.
        x: horizontal axis.
        y: vertical axis.
        lines: at least one; where points of several share an x they are set a little apart.
        diagonal: draw y = x.
        band: markup to draw below the lines.
        margin: room for the names.
    """
    right = WIDTH - margin

    def px(value: float) -> float:
        return LEFT + x.place(value) * (right - LEFT)

    def py(value: float) -> float:
        return HEIGHT - BOTTOM - y.place(value) * (HEIGHT - TOP - BOTTOM)

    parts: list[Html] = [tag("title", title), *_axes(x, y, right, px, py)]
    if diagonal:
        ends = {"x1": px(x.low), "y1": py(x.low), "x2": px(x.high), "y2": py(x.high)}
        parts.append(tag("line", class_="guide", **_rounded(ends)))
    if band is not None:
        parts.append(band)
    ends_y = []
    for number, line in enumerate(lines):
        shift = 2.4 * (number - (len(lines) - 1) / 2) if line.marked else 0.0
        places = [(px(p.x) + shift, py(p.y), py(p.low), py(p.high), p.note) for p in line.points]
        parts.append(_drawn(line, places))
        ends_y.append(places[-1][1])
    for line, end, label in zip(lines, ends_y, spread(ends_y), strict=True):
        colour = line.colour or colour_of(line.name)
        parts.append(
            tag(
                "g",
                tag("path", d=f"M{right + 3} {end:.1f}L{right + 12} {label:.1f}", class_="lead"),
                _marker(marker_of(line.name), right + 16, label)
                if line.marked
                else tag("path", d=f"M{right + 12} {label:.1f}h8", class_="stroke"),
                tag("text", line.name, x=right + 23, y=f"{label + 4:.1f}"),
                style=f"--c:{colour}",
            )
        )
    return _svg(HEIGHT, *parts)


def dot_chart(title: str, x: Axis, lines: Sequence[Line], left: int = 92) -> Html:
    """One row a line, its first point with an interval, its note at the right."""
    row, height = 24, 24 * len(lines) + 40
    right = 84

    def px(value: float) -> float:
        return left + x.place(value) * (WIDTH - left - right)

    parts = [tag("title", title)]
    bottom = height - 36
    for value, label in x.ticks:
        parts.append(tag("path", d=f"M{px(value):.1f} 4V{bottom}", class_="grid"))
        parts.append(
            tag(
                "text",
                label,
                x=f"{px(value):.1f}",
                y=bottom + 14,
                class_="tick",
                text_anchor="middle",
            )
        )
    middle = (left + WIDTH - right) / 2
    parts.append(tag("text", x.label, x=f"{middle:.0f}", y=height - 6, text_anchor="middle"))
    for number, line in enumerate(lines):
        y, p = 4 + row * (number + 0.5), line.points[0]
        parts.append(tag("text", line.name, x=left - 8, y=f"{y + 4:.1f}", text_anchor="end"))
        place = (px(p.x), y, px(p.low), px(p.high))
        interval = tag("path", d=f"M{place[2]:.1f} {y:.1f}H{place[3]:.1f}", class_="stroke")
        parts.append(
            tag(
                "g",
                interval,
                _marker(marker_of(line.name), place[0], y, 4.0),
                tag("title", p.note),
                style=f"--c:{line.colour or colour_of(line.name)}",
            )
        )
        parts.append(tag("text", p.note, x=WIDTH - right + 10, y=f"{y + 4:.1f}", class_="tick"))
    return _svg(height, *parts)


def area(
    x: Axis, y: Axis, low: Sequence[tuple[float, float]], high: Sequence[tuple[float, float]]
) -> Html:
    """The region between two curves of (x, y), for `line_chart`'s ``band``."""
    places = [
        f"{LEFT + x.place(a) * (WIDTH - LEFT - RIGHT):.1f} "
        f"{HEIGHT - BOTTOM - y.place(b) * (HEIGHT - TOP - BOTTOM):.1f}"
        for a, b in [*low, *reversed(high)]
    ]
    return tag("path", d=f"M{'L'.join(places)}Z", class_="band")


def spread(wanted: Sequence[float]) -> list[float]:
    """Heights of labels, each as near to where it is wanted as the others let it, in its order."""
    order = np.argsort(wanted, kind="stable")
    placed = np.array([wanted[i] for i in order], float)
    top, bottom = TOP + 4.0, HEIGHT - BOTTOM
    for i in range(1, len(placed)):
        placed[i] = max(placed[i], placed[i - 1] + LABEL_PX)
    placed -= max(0.0, float(placed[-1]) - bottom)
    for i in range(len(placed) - 2, -1, -1):
        placed[i] = min(placed[i], placed[i + 1] - LABEL_PX)
    placed += max(0.0, top - float(placed[0]))
    for i in range(1, len(placed)):
        placed[i] = max(placed[i], placed[i - 1] + LABEL_PX)
    found = [0.0] * len(placed)
    for rank, i in enumerate(order):
        found[int(i)] = float(placed[rank])
    return found


def _svg(height: float, *parts: Html) -> Html:
    return tag("svg", *parts, viewBox=f"0 0 {WIDTH} {height:g}", role="img")


def _rounded(places: dict[str, float]) -> dict[str, str]:
    return {key: f"{value:.1f}" for key, value in places.items()}


def _axes(
    x: Axis, y: Axis, right: float, px: Callable[[float], float], py: Callable[[float], float]
) -> list[Html]:
    bottom = HEIGHT - BOTTOM
    parts = []
    for value, label in y.ticks:
        parts.append(tag("path", d=f"M{LEFT} {py(value):.1f}H{right}", class_="grid"))
        place = {"x": str(LEFT - 6), "y": f"{py(value) + 4:.1f}"}
        parts.append(tag("text", label, class_="tick", text_anchor="end", **place))
    for value, label in x.ticks:
        parts.append(tag("path", d=f"M{px(value):.1f} {bottom}v4", class_="axis"))
        place = {"x": f"{px(value):.1f}", "y": str(bottom + 16)}
        parts.append(tag("text", label, class_="tick", text_anchor="middle", **place))
    parts.append(tag("path", d=f"M{LEFT} {bottom}H{right}", class_="axis"))
    middle = f"{(LEFT + right) / 2:.0f}"
    parts.append(tag("text", x.label, x=middle, y=HEIGHT - 8, text_anchor="middle"))
    height = (TOP + bottom) / 2
    turned = f"translate(11 {height:.0f}) rotate(-90)"
    parts.append(tag("text", y.label, transform=turned, text_anchor="middle"))
    return parts


def _drawn(line: Line, places: Sequence[tuple[float, float, float, float, str]]) -> Html:
    parts: list[Html] = []
    if line.joined:
        path = "L".join(f"{x:.1f} {y:.1f}" for x, y, *_ in places)
        parts.append(tag("path", d=f"M{path}", class_="curve"))
    for x, y, low, high, note in places if line.marked else ():
        whisker = tag("path", d=f"M{x:.1f} {low:.1f}V{high:.1f}", class_="stroke thin")
        mark = _marker(marker_of(line.name), x, y)
        parts.append(tag("g", whisker, mark, tag("title", note)) if note else join(whisker, mark))
    return tag("g", *parts, style=f"--c:{line.colour or colour_of(line.name)}")


def _marker(kind: str, x: float, y: float, r: float = 3.0) -> Html:
    shapes = {
        "square": f"M{x - r:.1f} {y - r:.1f}h{2 * r:g}v{2 * r:g}h{-2 * r:g}Z",
        "diamond": f"M{x:.1f} {y - 1.3 * r:.1f}l{1.3 * r:g} {1.3 * r:g}l{-1.3 * r:g} {1.3 * r:g}"
        f"l{-1.3 * r:g} {-1.3 * r:g}Z",
        "up": f"M{x:.1f} {y - 1.2 * r:.1f}l{1.2 * r:g} {2.1 * r:g}h{-2.4 * r:g}Z",
        "down": f"M{x:.1f} {y + 1.2 * r:.1f}l{1.2 * r:g} {-2.1 * r:g}h{-2.4 * r:g}Z",
    }
    if kind == "circle":
        return tag("circle", cx=f"{x:.1f}", cy=f"{y:.1f}", r=f"{r:g}", class_="mark")
    return tag("path", d=shapes[kind], class_="mark")
