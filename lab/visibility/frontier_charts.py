"""Charts of what layouts show and what is read from them."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.transforms import ScaledTranslation, Transform

from lab.visibility.frontier_results import (
    CHART_HZ,
    FrontierResults,
    FrontierSetting,
    ReadRow,
    SettingResult,
)
from reports.render.charts import (
    MUTED,
    PAPER,
    add_note,
    colour_of,
    in_style,
    marker_of,
    new_panels,
    set_accuracy_axis,
    set_ticks,
)
from reports.render.tables import percent, share_interval

GRID_MARKERS = {(8, 8): "s", (24, 32): "D", (48, 64): "^", (96, 128): "o"}
"""Markers of grids, given as rows and columns, in charts."""
NAMES_IN = 1.75
"""Width beside a panel in which methods and grids are named, inches."""
LEAST_BITS = 0.1
"""Bits a frame pair that stand for less than that, on a logarithmic axis."""
LEAST_ACCURACY = 0.3
"""Accuracy at which the charts end below; chance gives 0.5."""


@in_style
def frontier_figure(results: FrontierResults) -> Figure:
    """Draw right bits over visibility, a panel for each view, and bits a second over visibility."""
    figure, panels = new_panels(len(results.views) + 1, 2, NAMES_IN, title=True)
    for panel, view in zip(panels, results.views, strict=False):
        _draw_right(panel, results, view)
        panel.set_title(f"Right bits over visibility, {view:g}°")
    _draw_rates(panels[-1], results)
    panels[-1].set_title("Bits a second over visibility")
    return figure


def _look(setting: FrontierSetting, colour: str) -> dict[str, Any]:
    """How a setting's points are drawn: grids by shape, on-off open, a larger kappa larger."""
    grid = (setting.rows, setting.cols)
    return {
        "marker": GRID_MARKERS.get(grid, marker_of(setting.grid)),
        "color": colour,
        "markerfacecolor": PAPER if setting.modulation == "on_off" else colour,
        "markersize": 3.5 + min(setting.kappa, 5),
    }


def _beside(panel: Axes, results: FrontierResults, method: str) -> Transform:
    """Move a method's points a little along x, so that methods at equal x can be told apart."""
    number = results.methods.index(method) - (len(results.methods) - 1) / 2
    inch = panel.figure.dpi_scale_trans
    return panel.transData + ScaledTranslation(2.6 * number / 72, 0, inch)


def _rows_at(
    results: FrontierResults, view: float
) -> Iterator[tuple[SettingResult, ReadRow, dict[str, Any]]]:
    """Rows of one view with their settings and looks, `learned` last, so that it lies on top."""
    for method in sorted(results.methods, key=lambda name: name == "learned"):
        for result in results.settings:
            for row in result.read:
                if (row.method, row.view_deg) == (method, view):
                    yield result, row, _look(result.setting, colour_of(method))


def _draw_right(panel: Axes, results: FrontierResults, view: float) -> None:
    """Draw right bits at one view over contrast over threshold."""
    least = min(row.accuracy for result in results.settings for row in result.read)
    set_accuracy_axis(panel, "y", max(least - 0.02, LEAST_ACCURACY), short=True)
    panel.yaxis.labelpad = 1
    bottom = panel.get_ylim()[0]
    for result, row, look in _rows_at(results, view):
        place = result.seen_at(CHART_HZ)
        look |= {"clip_on": False, "transform": _beside(panel, results, row.method)}
        ends = np.clip([row.ci_low, row.ci_high], bottom, 1)
        bar = {"linewidth": 1, "alpha": 0.6, "marker": ""}
        panel.plot([place, place], ends, **look | bar)
        (mark,) = panel.plot([place], [max(row.accuracy, bottom)], **look)
        add_note(
            mark,
            f"{result.setting.name}, {row.method}: {percent(row.accuracy)} % "
            f"({share_interval(row.ci_low, row.ci_high)}), {row.bits} bits",
        )
    _set_seen_axis(panel, results, f"contrast over threshold, {CHART_HZ} states/s")
    _name(panel, results, results.methods)


def _draw_rates(panel: Axes, results: FrontierResults) -> None:
    """Draw the information that `learned` carries a second at every rate over visibility."""
    for result in results.settings:
        look = _look(result.setting, colour_of("learned"))
        places = [rate.seen for rate in result.shown]
        rates = [max(result.bits_a_pair, LEAST_BITS) * r.states_hz / 2 for r in result.shown]
        (mark,) = panel.plot(places, rates, linewidth=1, **look)
        add_note(mark, result.setting.name)
    panel.set_yscale("log")
    panel.set_ylabel("bits a second", labelpad=0)
    _set_seen_axis(panel, results, "contrast over threshold")
    set_ticks(panel.yaxis, [1e2, 1e3, 1e4, 1e5], ["100", "1k", "10k", "100k"])
    panel.grid(axis="both")
    _name(panel, results, ("learned",))


def _set_seen_axis(panel: Axes, results: FrontierResults, label: str) -> None:
    """Give a panel a logarithmic x axis of contrast over threshold, with a line at 1."""
    seen = [rate.seen for result in results.settings for rate in result.shown] + [1.0]
    low, high = 0.8 * min(seen), 1.2 * max(seen)
    panel.axvline(1.0, linestyle=":", color=MUTED, linewidth=1.2)
    panel.set(xscale="log", xlim=(low, high), xlabel=label)
    shown = [tick for tick in (0.1, 0.3, 1.0, 3.0, 10.0, 30.0) if low <= tick <= high]
    set_ticks(panel.xaxis, shown, [f"{tick:g}" for tick in shown])


def _name(panel: Axes, results: FrontierResults, methods: Sequence[str]) -> None:
    """Name beside a panel the colours of methods and the shapes of grids."""
    handles = [Line2D([], [], color=colour_of(name), linewidth=4, label=name) for name in methods]
    grids = {result.setting.grid: result.setting for result in results.settings}
    for grid, setting in grids.items():
        look = _look(setting, MUTED) | {"markerfacecolor": MUTED, "markersize": 6}
        handles.append(Line2D([], [], linestyle="", label=grid, **look))
    if any(result.setting.modulation == "on_off" for result in results.settings):
        open_mark: dict[str, Any] = {"marker": "s", "color": MUTED, "markerfacecolor": PAPER}
        handles.append(Line2D([], [], linestyle="", label="open: on-off", **open_mark))
    if len({result.setting.kappa for result in results.settings}) > 1:
        handles.append(Line2D([], [], linestyle="", label="larger: larger κ"))
    place = {"loc": "upper left", "bbox_to_anchor": (1.0, 1.02), "borderaxespad": 0.3}
    panel.legend(handles=handles, handlelength=1.2, handletextpad=0.5, fontsize=9.5, **place)
