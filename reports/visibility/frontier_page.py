"""What layouts show and what is read from them: stored results, their tables, and their charts.

The study `reports.visibility.frontier` stores its results in docs/hidden.json. Its command,
docs/hidden.md and the report of evaluate.py show them by the tables and charts of this module.
"""

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from itertools import groupby
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.transforms import ScaledTranslation, Transform
from pydantic import Field

from link.images import write_bytes
from link.layout import Layout, make_layout
from link.outside import read_json
from reports.engine.checked import Count, Number, Share, checked
from reports.engine.provenance import Making
from reports.render.charts import (
    MUTED,
    PAPER,
    add_note,
    colour_of,
    marker_of,
    new_panels,
    set_accuracy_axis,
    set_ticks,
)
from reports.render.tables import Table, TableCell, percent, share_interval
from reports.studies.peers.page import COLOURS, LEAST_ACCURACY, OURS, PeerRow, best_readings

Positive = Annotated[int, Field(ge=1, le=2**20)]
"""Type of a number of things in a stored file of which there is at least one."""
CHART_HZ = 60
"""States a second at which the charts of right bits show contrast over threshold."""
GRID_MARKERS = {(8, 8): "s", (24, 32): "D", (48, 64): "^", (96, 128): "o"}
"""Markers of grids, given as rows and columns, in charts."""
NAMES_IN = 1.75
"""Width beside a panel in which methods, grids and other systems are named, inches."""
LEAST_BITS = 0.1
"""Bits a frame pair at which the chart of bits over PSNR ends below."""


@dataclass(frozen=True)
class FrontierSetting:
    """A layout and a kappa that are compared."""

    rows: Positive
    """Number of rows of blocks."""
    cols: Positive
    """Number of columns of blocks."""
    modulation: str
    """Key of `link.layout.MODULATIONS`."""
    kappa: Positive
    """Number of gray levels by which blocks change."""
    ratex: bool = False
    """Whether five ratex patches calibrate, as in the paper, in place of pilots."""

    @property
    def layout(self) -> Layout:
        """The layout that the display shows."""
        pilots = 0 if self.ratex else "auto"
        return make_layout(self.rows, self.cols, modulation=self.modulation, pilots=pilots)

    @property
    def grid(self) -> str:
        """Rows and columns in words."""
        return f"{self.rows} × {self.cols}"

    @property
    def name(self) -> str:
        """What tables call the setting."""
        known = "ratex" if self.ratex else "pilots"
        return f"{self.grid} {self.modulation}, {known}, κ {self.kappa}"


PAPER_SETTING = FrontierSetting(8, 8, "on_off", 3, ratex=True)
"""The paper's setting, against which visibility and rates are compared."""
PAPER_HZ = 15
"""States a second of the paper's display."""


@dataclass(frozen=True)
class ShownRate:
    """How visible a setting is at one rate."""

    states_hz: Positive
    """States a second, on a display of 60 refreshes a second."""
    seen: Annotated[float, Field(ge=1e-9, le=1e9)]
    """Contrast over threshold of one block; above 1 it is seen."""
    jod: Number | None
    """Quality by ColorVideoVDP, in JOD of which 10 is the best; None where it was not measured."""


@dataclass(frozen=True)
class Lead:
    """How far `learned` is ahead of another method on identical captures."""

    points: Number
    """Accuracy of `learned` less that of the other method, points."""
    low: Number
    """Lower end of the 95 % interval of the lead, points, by a bootstrap over frame pairs."""
    high: Number
    """Upper end of the 95 % interval of the lead, points."""


@dataclass(frozen=True)
class ReadRow:
    """What one method reads of a setting at one view, over all camera-display pairs."""

    view_deg: Number
    """Angle of observation, in degrees from the display's normal."""
    method: str
    """Label of the method."""
    frames: Count
    """Number of frame pairs."""
    bits: Annotated[int, Field(ge=1, le=2**53)]
    """Number of bits in all frame pairs."""
    correct: Count
    """Number of bits that were read right."""
    accuracy: Share
    """Share of bits that were read right, in [0, 1]."""
    ci_low: Share
    """Lower end of the 95 % interval of the accuracy, which knows that errors cluster by frame
    pair."""
    ci_high: Share
    """Upper end of the 95 % interval of the accuracy."""
    information: Annotated[float, Field(ge=-1e9, le=1)]
    """Information about a sent bit, in bits, before coding: of the scores, where they are
    log-likelihood ratios, and else of the decided bits (`decided_information`)."""
    lead: Lead | None
    """How far `learned` is ahead of this method; None for `learned` itself."""


@dataclass(frozen=True)
class SettingResult:
    """What a setting shows, and what is read of it."""

    setting: FrontierSetting
    """The layout and its kappa."""
    message_bits: Positive
    """Number of message bits in a frame pair."""
    psnr: Number
    """Peak signal-to-noise ratio of a displayed frame against the picture, dB, mean over frame
    pairs. Ratex patches stand in both and do not count."""
    shown: Annotated[list[ShownRate], Field(min_length=1)]
    """One entry for each rate."""
    read: Annotated[list[ReadRow], Field(min_length=1)]
    """One row for each view and method."""

    @property
    def bits_a_pair(self) -> float:
        """Bits of information that the scores of `learned` carry a frame pair, over all views."""
        own = [row for row in self.read if row.method == "learned"]
        share = sum(row.bits * row.information for row in own) / sum(row.bits for row in own)
        return self.message_bits * max(0.0, share)

    def seen_at(self, states_hz: int) -> float:
        """Contrast over threshold at a rate that was measured."""
        return next(rate.seen for rate in self.shown if rate.states_hz == states_hz)


@dataclass(frozen=True)
class FrontierResults:
    """Content of a hidden.json."""

    meta: dict[str, Any]
    """What produced the results; `reports.engine.provenance.Making` at least."""
    settings: Annotated[list[SettingResult], Field(min_length=1)]
    """One entry for each setting."""

    def __post_init__(self) -> None:
        """Check that the tables find what they compare with."""
        if len({result.setting for result in self.settings}) != len(self.settings):
            raise ValueError("a setting is there twice")
        rates = {tuple(rate.states_hz for rate in result.shown) for result in self.settings}
        if len(rates) != 1 or not {PAPER_HZ, CHART_HZ} <= set(*rates):
            raise ValueError(f"settings need the same rates, {PAPER_HZ} and {CHART_HZ} among them")
        if PAPER_SETTING not in [result.setting for result in self.settings]:
            raise ValueError("the paper's setting is missing")
        for result in self.settings:
            places = {(row.view_deg, row.method) for row in result.read}
            if len(places) != len(result.read):
                raise ValueError(f"{result.setting.name}: a view and method are there twice")
            if not places >= {(view, "learned") for view, _ in places}:
                raise ValueError(f"{result.setting.name}: learned is missing at a view")

    @property
    def paper(self) -> SettingResult:
        """The entry of the paper's setting."""
        return next(result for result in self.settings if result.setting == PAPER_SETTING)

    @property
    def views(self) -> list[float]:
        """Angles of observation in degrees, ascending."""
        return sorted({row.view_deg for result in self.settings for row in result.read})

    @property
    def methods(self) -> list[str]:
        """Labels of the methods in order of first appearance."""
        return list(dict.fromkeys(row.method for result in self.settings for row in result.read))


def write_frontier(file: Path, results: FrontierResults) -> None:
    """Write results as strict JSON: {"meta": ..., "settings": [...]}."""
    text = json.dumps(asdict(results), indent=1, allow_nan=False) + "\n"
    write_bytes(file, text.encode())


def read_frontier(file: Path) -> FrontierResults:
    """Read a hidden.json that `write_frontier` wrote.

    Raises:
        InputError: the file is missing or damaged.
    """
    results = checked(FrontierResults, read_json(file), str(file))
    checked(Making, results.meta, f"{file}, meta")
    return results


def decided_information(accuracy: float) -> float:
    """Work out the information of a decided bit about the sent one: of a symmetric channel, bits.

    Args:
        accuracy: share of bits that are read right, in [0, 1].

    Returns:
        a number in [0, 1]; 0 where the accuracy is at most 0.5, since nobody knows to turn bits.

    >>> round(decided_information(0.9), 3), decided_information(0.4), decided_information(1.0)
    (0.531, 0.0, 1.0)
    """
    if accuracy <= 0.5 or accuracy == 1:
        return float(accuracy == 1)
    shares = np.array([accuracy, 1 - accuracy])
    return float(1 + (shares * np.log2(shares)).sum())


def bits_table(results: FrontierResults) -> Table:
    """Tabulate right bits by setting, view and method, and how far `learned` is ahead."""
    rows = [
        [
            result.setting.name,
            f"{row.view_deg:g}°",
            row.method,
            percent(row.accuracy),
            share_interval(row.ci_low, row.ci_high),
            f"{row.bits - row.correct:,} of {row.bits:,}",
            f"{result.message_bits * max(0.0, row.information):,.0f}",
            _lead_cell(row.lead),
        ]
        for result in results.settings
        for row in sorted(result.read, key=lambda row: row.view_deg)
    ]
    heads = ["setting", "view", "method", "right bits %", "95 % interval", "wrong",
             "bits a frame pair", "learned ahead, points"]  # fmt: skip
    return Table(heads, rows, left=3)


def _lead_cell(lead: Lead | None) -> str | TableCell:
    """Show a lead: green where its interval lies above 0, red where it does not."""
    if lead is None:
        return "–"
    interval = f"{lead.low:+.2f} to {lead.high:+.2f}"
    return TableCell(f"{lead.points:+.2f}", interval, "good" if lead.low > 0 else "bad")


def close_table(results: FrontierResults) -> Table | None:
    """Tabulate where `learned` is not clearly ahead of another method; None where it always is."""
    rows: list[list[str | TableCell]] = []
    for result in results.settings:
        for row in sorted(result.read, key=lambda row: row.view_deg):
            if row.lead is not None and row.lead.low <= 0:
                ours = next(
                    own.accuracy
                    for own in result.read
                    if (own.method, own.view_deg) == ("learned", row.view_deg)
                )
                name, view = result.setting.name, f"{row.view_deg:g}°"
                right = [percent(ours), percent(row.accuracy)]
                rows.append([name, view, row.method, *right, _lead_cell(row.lead)])
    heads = ["setting", "view", "method", "learned right %", "method right %", "points ahead"]
    title = "Where learned is not clearly ahead: the interval of its lead reaches 0 or below"
    return Table(heads, rows, title, left=3) if rows else None


def rate_table(results: FrontierResults) -> Table:
    """Tabulate visibility and bits a second, and both against the paper's setting."""
    paper = results.paper
    seen, bits_hz = paper.seen_at(PAPER_HZ), paper.bits_a_pair * PAPER_HZ / 2
    rows = []
    for result in results.settings:
        for rate in result.shown:
            carried = result.bits_a_pair * rate.states_hz / 2
            rows.append(
                [
                    result.setting.name,
                    str(rate.states_hz),
                    f"{rate.seen:.2f}",
                    f"{result.psnr:.1f}",
                    "–" if rate.jod is None else f"{rate.jod:.2f}",
                    f"{carried:,.0f}",
                    f"{rate.seen / seen:.2f}",
                    f"{carried / bits_hz:.1f}" if bits_hz else "–",
                ]
            )
    heads = ["setting", "states/s", "contrast over threshold", "PSNR dB", "JOD", "bits/s",
             "× seen of the paper's", "× bits/s of the paper's"]  # fmt: skip
    return Table(heads, rows)


def frontier_blocks(file: Path) -> dict[str, str]:
    """Make the blocks of docs/hidden.md by name.

    Args:
        file: what `write_frontier` wrote.
    """
    results = read_frontier(file)
    rows = [row for result in results.settings for row in result.read]
    each = ", ".join(str(count) for count in sorted({row.frames for row in rows}))
    how = f"Seed {results.meta['seed']}, {each} frame pairs at each view, simulated."
    tables = {"hidden_bits": bits_table(results), "hidden_rates": rate_table(results)}
    return {name: f"{how}\n\n{table.markdown()}" for name, table in tables.items()}


@dataclass(frozen=True)
class FrontierChart:
    """A chart that is drawn alone in the report, and beside the others in docs."""

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


def chart_figure(chart: FrontierChart) -> Figure:
    """Draw one chart alone, for the report."""
    figure, (panel,) = new_panels(legend=NAMES_IN)
    chart.draw(panel)
    return figure


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
