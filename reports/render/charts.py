"""Charts: matplotlib figures in one style, as SVG for the page and as PNG for docs.

Figures are made with `new_panels`, without pyplot and its global state, by functions under
`in_style`. A chart of the page is drawn at the width of a phone, so that its text has one size on
every screen. It is drawn with the colours of a light page; `to_svg` replaces these by the page's
own, which know of dark screens.
"""

import hashlib
import io
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import wraps
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import matplotlib
import numpy as np
from markupsafe import Markup, escape
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.scale import FuncScale
from matplotlib.ticker import FixedLocator, NullLocator
from matplotlib.transforms import ScaledTranslation
from numpy.typing import ArrayLike, NDArray

from link.images import write_bytes
from models import DECODERS, Card

P = ParamSpec("P")
R = TypeVar("R")

_STYLE_SHEET = Path(__file__).with_name("report.mplstyle")
STYLE = matplotlib.rc_params_from_file(_STYLE_SHEET, use_default_template=False)
"""Settings of matplotlib with which all charts are drawn."""
INK, MUTED, RULE = (str(STYLE[of]) for of in ("text.color", "axes.edgecolor", "grid.color"))
"""Colours of text, of what is less important, and of thin lines."""
PAPER = "#ffffff"
"""Colour of the page behind them."""
OF_PAGES = (
    (INK, "currentColor"),
    (MUTED, "var(--muted)"),
    (RULE, "var(--rule)"),
    (PAPER, "var(--paper)"),
    (r"font-family: [^;]*; ", ""),
    (r"xlink:href", "href"),
    (r'<g id="[^"]*">', "<g>"),
    (r' transform="rotate\(-0 [^"]*"', ""),
    (r"\s+", " "),
)
"""Patterns of matplotlib's SVG, and what the page has in their places: variables of report.css for
the drawn colours, the page's font, and less space."""
SPARE_COLOURS = ("#7a8a2a", "#5a7d8c", "#a8584a", "#6b6bb0")
"""Colours of labels that are no method's."""
SPARE_MARKERS = ("o", "s", "D", "^", "v")
"""Markers of labels that are no method's."""
KNEE = 3e-4
"""Share of wrong bits at which the scale of accuracies turns from logarithmic to linear."""
ACCURACY_TICKS = (0.0, 0.3, 0.5, 0.7, 0.8, 0.9, 0.95, 0.98, 0.99, 0.995, 0.999, 1.0)
"""Accuracies that an axis may name."""
PANEL_IN = (5.0, 3.9)
"""Width and height of a panel with its labels, inches; 72 of the SVG's units are an inch."""
COLUMNS = 3
"""Largest number of panels beside each other."""
LEGEND_IN = 1.4
"""Width beside a panel in which its lines are named, inches."""


def in_style(draw: Callable[P, R]) -> Callable[P, R]:
    """Let a function draw with the settings of `STYLE`, which end with it.

    >>> in_style(lambda: matplotlib.rcParams["font.size"])()
    11.5
    """

    @wraps(draw)
    def styled(*args: P.args, **kwargs: P.kwargs) -> R:
        with matplotlib.rc_context(STYLE):
            return draw(*args, **kwargs)

    return styled


@dataclass(frozen=True)
class Series:
    """Measured values of one method."""

    label: str
    """Name of the method, which decides its colour."""
    x: Sequence[float]
    """Places on the horizontal axis, in its unit, from left to right."""
    y: Sequence[float]
    """Measured values there, in the unit of the vertical axis."""
    intervals: Sequence[Sequence[float]] = ()
    """Lower and upper ends of the intervals of ``y``; empty for a line whose values are not marked.
    """
    name: str = ""
    """Text in the legend; the label where it is empty."""


def look_of(label: str) -> Card:
    """Colour and marker of a method, which are the same in every chart and table.

    >>> look_of("oorc").colour
    '#1166b0'

    Args:
        label: name of a method, or any other text.

    Returns:
        the method's card, or one with a spare colour and marker.
    """
    number = sum(label.encode())
    colour = SPARE_COLOURS[number % len(SPARE_COLOURS)]
    spare = Card(label, colour, SPARE_MARKERS[number % len(SPARE_MARKERS)])
    return DECODERS.get(label, spare)


@in_style
def new_panels(
    count: int = 1,
    legend: float = LEGEND_IN,
    title: bool = False,
) -> tuple[Figure, list[Axes]]:
    """Make a figure of equal panels.

    Args:
        count: number of panels.
        legend: width to leave free at the right of each panel, inches.
        title: whether panels have titles.

    Returns:
        the figure, and its panels in reading order.
    """
    columns = min(COLUMNS, count)
    rows = -(-count // columns)
    width, height = PANEL_IN
    figure = Figure(figsize=(width * columns, height * rows))
    left, right, bottom, top = 0.65, 0.1 + legend, 0.62, 0.4 if title else 0.14
    panels = []
    for number in range(count):
        row, column = divmod(number, columns)
        box = (
            (column * width + left) / (width * columns),
            ((rows - 1 - row) * height + bottom) / (height * rows),
            (width - left - right) / (width * columns),
            (height - bottom - top) / (height * rows),
        )
        panels.append(figure.add_axes(box))
    return figure, panels


def accuracy_scale(accuracy: ArrayLike) -> NDArray[np.float64]:
    """Spread what lies near 1: 99 % is as far from 90 % as 99.9 % nearly is from 99 %.

    >>> np.round(np.diff(accuracy_scale([0.9, 0.99, 0.999])), 2)
    array([0.99, 0.9 ])
    """
    wrong = 1 - np.minimum(np.asarray(accuracy, np.float64), 1.0)
    return np.asarray(-np.log10(wrong + KNEE))


def accuracy_from_scale(height: ArrayLike) -> NDArray[np.float64]:
    """Invert `accuracy_scale`."""
    return np.asarray(1 + KNEE - 10 ** -np.asarray(height, np.float64))


def accuracy_ticks(least: float) -> list[float]:
    """Accuracies that an axis from about ``least`` to 1 names, ascending; the first is its end.

    Args:
        least: smallest accuracy that is shown, in [0, 1].
    """
    low = max(tick for tick in ACCURACY_TICKS[:-1] if tick <= max(least, 0.0))
    dropped = {0.98, 0.995} if low < 0.8 else set()
    return [tick for tick in ACCURACY_TICKS if tick >= low and tick not in dropped - {low}]


def set_accuracy_axis(panel: Axes, least: float) -> None:
    """Give the vertical axis the scale of accuracies, with ticks in per cent of bits.

    Args:
        panel: its heights are shares in [0, 1].
        least: smallest accuracy that is shown.
    """
    ticks = accuracy_ticks(least)
    scale = FuncScale(None, (accuracy_scale, accuracy_from_scale))
    panel.set(yscale=scale, ylim=(ticks[0], 1.0), ylabel="bits right, %")
    set_ticks(panel.yaxis, ticks, [f"{100 * tick:g}" for tick in ticks])
    panel.yaxis.grid(True)


def set_ticks(axis: Axis, values: Sequence[float], labels: Sequence[str]) -> None:
    """Give an axis exactly these ticks."""
    axis.set_major_locator(FixedLocator(values))
    axis.set_minor_locator(NullLocator())
    axis.set_ticklabels(labels)


def draw_series(panel: Axes, series: Sequence[Series], legend: str = "beside") -> None:
    """Draw lines of methods with intervals, and name them in the order of all charts.

    Args:
        panel: where to draw; its limits are set already, and what lies beyond is drawn at them.
        series: lines with at least one value each. Values with intervals are marked and have bars;
            such lines stand a little apart along x, so that bars at equal x can be told apart.
        legend: where the names stand: "beside" the panel, or inside, as matplotlib names a corner.
    """
    low, high = sorted(panel.get_ylim())
    for number, line in enumerate(series):
        card = look_of(line.label)
        shift = 2.4 * (number - (len(series) - 1) / 2) / 72 if line.intervals else 0.0
        moved = panel.transData + ScaledTranslation(shift, 0, panel.figure.dpi_scale_trans)
        look: dict[str, Any] = {"color": card.colour, "clip_on": False, "transform": moved}
        heights = np.clip(line.y, low, high)
        panel.plot(line.x, heights, **look)
        for x, height, ends in zip(line.x, heights, line.intervals, strict=False):
            panel.plot([x] * 2, np.clip(ends, low, high), linewidth=1.1, alpha=0.75, **look)
            edge: dict[str, Any] = {"markeredgecolor": PAPER, "markeredgewidth": 0.6}
            panel.plot([x], [height], card.marker, **edge, **look)
    order = {name: number for number, name in enumerate(DECODERS)}  # others stand before them
    handles = [
        Line2D(
            [],
            [],
            color=look_of(line.label).colour,
            marker=look_of(line.label).marker if line.intervals else "",
            label=line.name or line.label,
        )
        for line in sorted(series, key=lambda line: order.get(line.label, -1))
    ]
    place: dict[str, Any] = {"loc": legend}
    if legend == "beside":
        place = {"loc": "upper left", "bbox_to_anchor": (1.0, 1.02), "borderaxespad": 0.3}
    panel.legend(handles=handles, handlelength=1.2, handletextpad=0.5, **place)


@in_style
def save_png(figure: Figure, path: Path) -> None:
    """Write a figure as a PNG on white, under a temporary name first; its folder is made.

    Args:
        figure: what was drawn.
        path: the file.
    """
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=110, metadata={"Software": None})
    write_bytes(path, buffer.getvalue())


@in_style
def to_svg(figure: Figure, title: str) -> Markup:
    """Turn a figure into an element of the page: the same bytes for the same drawing.

    Text stays text, in the page's font. The background is transparent, and the colours of text and
    axes are the page's own, in light and in dark. It fills the width that it is given.

    Args:
        figure: what was drawn.
        title: read out in place of the picture.
    """
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg", transparent=True, metadata={"Date": None, "Creator": None})
    drawn = re.sub(r"[^\t\n\r -\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]", "", buffer.getvalue())
    box = re.search(r'viewBox="[^"]*"', drawn)
    assert box is not None, "matplotlib states it"
    _, body = drawn.split("</defs>", 1)  # without matplotlib's style, which is for whole pages
    prefix = hashlib.sha256(f"{title}\n{drawn}".encode()).hexdigest()[:8]
    for pattern, shown in (*OF_PAGES, (r'(<[^>]* id="|href="#|url\(#)', rf"\g<1>{prefix}")):
        body = re.sub(pattern, shown, body)
    words = escape(title)
    return Markup(f'<svg {box[0]} role="img" aria-label="{words}"><title>{words}</title>{body}')
