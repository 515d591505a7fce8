"""The ablation as tables and a picture, from the numbers that ablation.json stores."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, NullLocator
from pydantic import Field

from link.outside import read_json
from reports.engine.checked import Count, Number, Share, checked
from reports.engine.provenance import Making
from reports.render.charts import in_style
from reports.render.tables import Table, TableCell, Tint, difference_interval, percent
from reports.score.paired import MIN_FRAMES, Paired
from reports.studies.switches import ADDED, FLOORS, REMOVED, WHOLE_DECODERS

BLOCKS = {
    "Added to plain OORC": ("oorc", ("oorc", "phi", *ADDED, "full", "learned", *FLOORS)),
    "Removed from the full decoder": ("full", ("full", *REMOVED, "learned", *FLOORS)),
}
"""The two halves of the ablation by title: the reference row, and the rows compared with it."""
TICKS = (-30, -10, -3, -1, 0, 1, 3, 10, 30)
"""Ticks of the picture's scale, in points; the scale is linear within 1 and logarithmic beyond."""


@dataclass(frozen=True)
class AblationEntry:
    """Errors of one row of the ablation in one condition."""

    row: str
    """Name of the row, such as "full-rows"."""
    condition: str
    """Name of the setting of the channel."""
    frames: Count
    """Number of frame pairs."""
    bits: Count
    """Number of bits whose truth is known."""
    errors: Count
    """Number of bits that are decided wrong."""
    error: Share
    """Share of the bits that are decided wrong, in [0, 1]."""
    ci_low: Share
    """Lower end of the 95 % interval of ``error``, which knows that errors cluster."""
    ci_high: Share
    """Upper end of the 95 % interval of ``error``."""
    against: dict[str, Paired]
    """Comparison with each reference row that was decoded, other than the row itself."""


@dataclass(frozen=True)
class CellBehind:
    """A cell in which a decoder to use is behind OORC beyond the paired 95 % interval."""

    row: str
    """Name of the decoder's row."""
    condition: str
    """Name of the setting of the channel."""
    pair: str
    """Name of the camera-display pair."""
    view_deg: Number
    """Angle of observation, degrees."""
    kappa: Count
    """Gray levels added for a bit 1."""
    difference: Number
    """Accuracy of the decoder less that of OORC, points."""
    low: Number
    """Lower end of the interval of the difference, points."""
    high: Number
    """Upper end of the interval of the difference, points; below 0."""


@dataclass(frozen=True)
class AblationSettings:
    """The part of the study's settings that its tables show."""

    frames: Annotated[int, Field(ge=1)]
    """Number of frame pairs in each cell."""


@dataclass(frozen=True)
class AblationMaking(Making):
    """What an ablation.json says of its making."""

    settings: AblationSettings
    """Settings of the study."""


@dataclass(frozen=True)
class Ablation:
    """Content of an ablation.json."""

    meta: AblationMaking
    """What produced the numbers."""
    entries: list[AblationEntry]
    """One entry for each row in each condition."""
    behind_oorc: list[CellBehind]
    """Cells in which a decoder to use is behind OORC."""

    def __post_init__(self) -> None:
        """Check that the tables find every entry and comparison that they show."""
        places = [(entry.row, entry.condition) for entry in self.entries]
        rows, conditions = ({place[side] for place in places} for side in (0, 1))
        if len(set(places)) != len(places) or len(places) != len(rows) * len(conditions):
            raise ValueError("needs one entry for each row in each condition")
        for entry in self.entries:
            against = {reference for reference, _ in BLOCKS.values()} & rows - {entry.row}
            against |= {"oorc"} if entry.row in WHOLE_DECODERS else set()
            if not against <= set(entry.against):
                raise ValueError(f"{entry.row:.40} lacks a comparison")


def read_ablation(file: Path) -> Ablation:
    """Read an ablation.json that `reports.studies.ablation` wrote.

    Raises:
        InputError: the file is missing or damaged.
    """
    return checked(Ablation, read_json(file), str(file))


def ablation_tables(ablation: Ablation) -> list[Table]:
    """Return what each switch is worth, and how the whole decoders stand against OORC.

    Returns:
        a table for each of `BLOCKS` (rows of the ablation by conditions; the error in per cent, and
        beside it the paired difference to the reference), and one of the whole decoders.
    """
    tables = [_switch_table(ablation.entries, title) for title in BLOCKS]
    return [*tables, _whole_decoders_table(ablation)]


@in_style
def ablation_figure(ablation: Ablation) -> Figure:
    """Draw the paired differences with their intervals, one panel a block and condition.

    Green is better than the reference beyond the interval, red is worse, gray is neither.
    """
    entries = ablation.entries
    by_place = {(entry.row, entry.condition): entry for entry in entries}
    conditions = list(dict.fromkeys(entry.condition for entry in entries))
    order = dict.fromkeys(entry.row for entry in entries)
    blocks = {
        reference: [row for row in order if row in rows and row not in (reference, *FLOORS)]
        for reference, rows in BLOCKS.values()
    }
    blocks = {reference: rows for reference, rows in blocks.items() if rows}
    heights = [len(rows) + 1 for rows in blocks.values()]
    figure = Figure(figsize=(1.6 + 2.4 * len(conditions), 1.4 + 0.3 * sum(heights)))
    panels = figure.subplots(
        len(blocks),
        len(conditions),
        sharex="row",
        sharey="row",
        squeeze=False,
        height_ratios=heights,
    )
    for line, (reference, rows) in zip(panels, blocks.items(), strict=True):
        for panel, condition in zip(line, conditions, strict=True):
            _draw_panel(panel, [by_place[row, condition].against[reference] for row in rows])
            base = by_place[reference, condition]
            panel.set_title(f"{condition}\n{reference}: {100 * base.error:.2f} % wrong", fontsize=9)
        line[0].set_yticks(range(len(rows)), rows, fontsize=9)
        line[0].set_ylim(len(rows) - 0.5, -0.5)
        line[0].set_ylabel(f"less that of {reference}", fontsize=9)
    label = "difference in accuracy, points, paired 95 % interval (simulated captures)"
    figure.supxlabel(label, fontsize=9)
    figure.tight_layout()
    return figure


def _draw_panel(panel: Axes, compared: Sequence[Paired]) -> None:
    """Draw the comparisons of one condition below each other."""
    panel.axvline(0, color="0.7", linewidth=1)
    for y, paired in enumerate(compared):
        colour = {"good": "C2", "bad": "C3", "": "0.4"}[_tint(paired)]
        if paired.frames >= MIN_FRAMES:
            panel.plot([paired.low, paired.high], [y, y], color=colour)
        panel.plot(paired.difference, y, "o", color=colour, markersize=4)
    panel.set_xscale("symlog", linthresh=1, linscale=0.6)
    panel.xaxis.set_major_locator(FixedLocator(TICKS))
    panel.xaxis.set_minor_locator(NullLocator())
    panel.xaxis.set_major_formatter("{x:g}")
    panel.grid(axis="x", color="0.92")
    panel.tick_params(axis="x", labelsize=7)


def _switch_table(entries: Sequence[AblationEntry], title: str) -> Table:
    """Rows of one block by conditions."""
    reference, rows = BLOCKS[title]
    by_place = {(entry.row, entry.condition): entry for entry in entries}
    bits = {entry.condition: entry.bits for entry in entries}
    shown = [row for row in dict.fromkeys(entry.row for entry in entries) if row in rows]
    return Table(
        [f"row, against {reference}", *(f"{name}, {count:,} bits" for name, count in bits.items())],
        [[row, *(_error_cell(by_place[row, name], reference) for name in bits)] for row in shown],
        title,
    )


def _error_cell(entry: AblationEntry, reference: str) -> TableCell:
    """Error of a row, its multiple of the floor's, and its difference to the reference."""
    floor = entry.against.get("ideal")
    multiple = "" if floor is None or floor.ratio is None else f" ×{floor.ratio:.2f}"
    text = percent(entry.error) + multiple
    if reference not in entry.against:
        return TableCell(text)
    paired = entry.against[reference]
    return TableCell(text, f"{paired.difference:+.2f}, {_interval(paired)}", _tint(paired))


def _whole_decoders_table(ablation: Ablation) -> Table:
    """Errors of decoders to use as a multiple of OORC's, and the cells in which they are behind."""
    frames = ablation.meta.settings.frames
    rows = []
    for entry in ablation.entries:
        if entry.row not in WHOLE_DECODERS:
            continue
        paired = entry.against["oorc"]
        high = "∞" if paired.ratio_high is None else f"{paired.ratio_high:.2f}"
        behind = [
            cell
            for cell in ablation.behind_oorc
            if (cell.row, cell.condition) == (entry.row, entry.condition)
        ]
        named = ["; ".join(map(_cell_behind, behind))] if behind else []
        rows.append(
            [
                entry.row,
                entry.condition,
                "–" if paired.ratio is None else f"{paired.ratio:.2f}",
                f"{paired.ratio_low:.2f} to {high}",
                ": ".join([f"{len(behind)} of {entry.frames // frames}", *named]),
            ]
        )
    multiple = "multiple of OORC's errors"
    heads = ["row", "condition", multiple, "95 % interval", "cells behind OORC"]
    return Table(heads, rows, "Whole decoders against OORC", left=2)


def _cell_behind(cell: CellBehind) -> str:
    return (
        f"{cell.pair} {cell.view_deg:g}° κ {cell.kappa}: {cell.difference:+.2f}, "
        f"{cell.low:+.2f} to {cell.high:+.2f}"
    )


def _interval(paired: Paired) -> str:
    return "no interval" if paired.frames < MIN_FRAMES else difference_interval(paired)


def _tint(paired: Paired) -> Tint:
    return "good" if paired.low > 0 else "bad" if paired.high < 0 else ""
