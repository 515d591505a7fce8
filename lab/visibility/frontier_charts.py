"""Charts of what layouts show and what is read from them, for docs and the page of evaluate.py."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.transforms import ScaledTranslation, Transform

from lab.comparison.peers.page import COLOURS, LEAST_ACCURACY, OURS, PeerRow, best_readings
from lab.visibility.frontier_results import (
    CHART_HZ,
    FrontierResults,
    FrontierSetting,
    ReadRow,
    SettingResult,
    decided_information,
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
"""Width beside a panel in which methods, grids and other systems are named, inches."""
LEAST_BITS = 0.1
"""Bits a frame pair at which the chart of bits over PSNR ends below."""


@dataclass(frozen=True)
class FrontierChart:
    """One of the charts that stand beside each other."""

    title: str
    """What it shows, in a few words."""
    draw: Callable[[Axes], None]
    """Draws into a panel."""


def frontier_charts(results: FrontierResults, peers: Sequence[PeerRow] = ()) -> list[FrontierChart]:
    """Make the charts: right bits and rates over visibility, then right bits and bits over PSNR.

    Args:
        results: what the study stored.
        peers: readings of other systems, which have a place where the x axis is PSNR.
    """
    others = [row for row in best_readings(peers) if row.method not in OURS]
    views = results.views
    widest = views[-1]

    def over_seen(view: float) -> Callable[[Axes], None]:
        return lambda panel: _draw_right(panel, results, view, by_psnr=False, peers=())

    def over_psnr(view: float) -> Callable[[Axes], None]:
        return lambda panel: _draw_right(panel, results, view, by_psnr=True, peers=others)

    return [
        *(FrontierChart(f"Right bits over visibility, {view:g}°", over_seen(view))
          for view in views),
        FrontierChart("Bits a second over visibility", lambda panel: _draw_rates(panel, results)),
        *(FrontierChart(f"Right bits over PSNR, {view:g}°", over_psnr(view)) for view in views),
        FrontierChart(
            f"Bits a frame pair over PSNR, {widest:g}°",
            lambda panel: _draw_bits(panel, results, widest, others),
        ),
    ]  # fmt: skip


@in_style
def frontier_figure(results: FrontierResults, peers: Sequence[PeerRow] = ()) -> Figure:
    """Draw all charts as panels of one figure, for docs."""
    charts = frontier_charts(results, peers)
    figure, panels = new_panels(len(charts), 2, NAMES_IN, title=True)
    for panel, chart in zip(panels, charts, strict=True):
        chart.draw(panel)
        panel.set_title(chart.title)
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


def _draw_right(
    panel: Axes,
    results: FrontierResults,
    view: float,
    by_psnr: bool,
    peers: Sequence[PeerRow],
) -> None:
    """Draw right bits at one view over contrast over threshold, or over PSNR beside peers."""
    here = [row for row in peers if row.condition == f"{view:g}°"]
    least = min(
        [row.accuracy for row in here]
        + [row.accuracy for result in results.settings for row in result.read]
    )
    set_accuracy_axis(panel, "y", max(least - 0.02, LEAST_ACCURACY), short=True)
    panel.yaxis.labelpad = 1
    bottom = panel.get_ylim()[0]
    for result, row, look in _rows_at(results, view):
        place = result.psnr if by_psnr else result.seen_at(CHART_HZ)
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
    for method, mine in _by_system(here):
        heights = [max(row.accuracy, bottom) for row in mine]
        panel.plot(
            [row.psnr for row in mine], heights, "--", marker="x", color=colour_of(method, COLOURS)
        )
    if by_psnr:
        _set_psnr_axis(panel, results, here)
    else:
        _set_seen_axis(panel, results, f"contrast over threshold, {CHART_HZ} states/s")
    _name(panel, results, here)


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
    _name(panel, results, (), ("learned",))


def _draw_bits(
    panel: Axes, results: FrontierResults, view: float, peers: Sequence[PeerRow]
) -> None:
    """Draw the information of a frame pair at one view over PSNR, of ours and of peers."""
    here = [row for row in peers if row.condition == f"{view:g}°"]
    for result, row, look in _rows_at(results, view):
        carried = max(result.message_bits * row.information, LEAST_BITS)
        beside = _beside(panel, results, row.method)
        (mark,) = panel.plot([result.psnr], [carried], transform=beside, **look)
        add_note(mark, f"{result.setting.name}, {row.method}: {carried:,.0f} bits")
    for method, mine in _by_system(here):
        carried_bits = [
            max(2 / row.frames_used * row.message_bits * decided_information(row.accuracy),
                LEAST_BITS)
            for row in mine
        ]  # fmt: skip
        colour = colour_of(method, COLOURS)
        panel.plot([row.psnr for row in mine], carried_bits, "--", marker="x", color=colour)
    most = max(result.message_bits for result in results.settings)
    panel.set(yscale="log", ylim=(0.7 * LEAST_BITS, 1.5 * most))
    panel.set_ylabel("bits a frame pair", labelpad=1)
    values = [0.1, 1.0, 10.0, 100.0, 1000.0, 10000.0]
    set_ticks(panel.yaxis, values, ["0.1", "1", "10", "100", "1k", "10k"])
    panel.grid(axis="both")
    _set_psnr_axis(panel, results, here)
    _name(panel, results, here)


def _by_system(rows: Sequence[PeerRow]) -> Iterator[tuple[str, list[PeerRow]]]:
    """Rows of each system, from the most to the least visible strength."""
    ordered = sorted(rows, key=lambda row: (row.method, row.psnr))
    for method, mine in groupby(ordered, key=lambda row: row.method):
        yield method, list(mine)


def _set_seen_axis(panel: Axes, results: FrontierResults, label: str) -> None:
    """Give a panel a logarithmic x axis of contrast over threshold, with a line at 1."""
    seen = [rate.seen for result in results.settings for rate in result.shown] + [1.0]
    low, high = 0.8 * min(seen), 1.2 * max(seen)
    panel.axvline(1.0, linestyle=":", color=MUTED, linewidth=1.2)
    panel.set(xscale="log", xlim=(low, high), xlabel=label)
    shown = [tick for tick in (0.1, 0.3, 1.0, 3.0, 10.0, 30.0) if low <= tick <= high]
    set_ticks(panel.xaxis, shown, [f"{tick:g}" for tick in shown])


def _set_psnr_axis(panel: Axes, results: FrontierResults, peers: Sequence[PeerRow]) -> None:
    """Give a panel an x axis of PSNR on which settings and other systems have a place."""
    decibels = [result.psnr for result in results.settings] + [row.psnr for row in peers]
    panel.set_xlim(min(decibels) - 1, max(decibels) + 1)
    panel.set_xlabel("PSNR of a displayed frame, dB")


def _name(
    panel: Axes,
    results: FrontierResults,
    peers: Sequence[PeerRow],
    methods: Sequence[str] | None = None,
) -> None:
    """Name beside a panel the colours of methods, the shapes of grids and the other systems."""
    names = results.methods if methods is None else methods
    handles = [Line2D([], [], color=colour_of(name), linewidth=4, label=name) for name in names]
    grids = {result.setting.grid: result.setting for result in results.settings}
    for grid, setting in grids.items():
        look = _look(setting, MUTED) | {"markerfacecolor": MUTED, "markersize": 6}
        handles.append(Line2D([], [], linestyle="", label=grid, **look))
    if any(result.setting.modulation == "on_off" for result in results.settings):
        open_mark: dict[str, Any] = {"marker": "s", "color": MUTED, "markerfacecolor": PAPER}
        handles.append(Line2D([], [], linestyle="", label="open: on-off", **open_mark))
    if len({result.setting.kappa for result in results.settings}) > 1:
        handles.append(Line2D([], [], linestyle="", label="larger: larger κ"))
    for method in dict.fromkeys(row.method for row in peers):
        colour = colour_of(method, COLOURS)
        handles.append(Line2D([], [], color=colour, linestyle="--", marker="x", label=method))
    place = {"loc": "upper left", "bbox_to_anchor": (1.0, 1.02), "borderaxespad": 0.3}
    panel.legend(handles=handles, handlelength=1.2, handletextpad=0.5, fontsize=9.5, **place)
