"""The ablation as tables and a picture, from the numbers that were measured."""

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from reports.ablation.results import BLOCKS, Ablation, AblationEntry
from reports.engine.conditions import SETTINGS
from reports.render.charts import in_style, set_ticks
from reports.render.tables import Table, TableCell, difference_interval, percent, tint_of
from reports.score.paired import MIN_FRAMES, Paired

TICKS = (-30, -10, -3, -1, 0, 1, 3, 10, 30)
"""Ticks of the picture's scale, in points; the scale is linear within 1 and logarithmic beyond."""


def ablation_tables(ablation: Ablation) -> list[Table]:
    """Return what each switch is worth.

    Args:
        ablation: what was measured.

    Returns:
        a table for each of `BLOCKS`: rows of the ablation by conditions; the error in per cent, and
        beside it the paired difference to the reference.
    """
    return [_switch_table(ablation, title) for title in BLOCKS]


@in_style
def ablation_figure(ablation: Ablation, kind: str = "simulated captures") -> Figure:
    """Draw the paired differences with their intervals, one panel a block and condition.

    Green is better than the reference beyond the interval, red is worse, gray is neither.
    """
    entries, by_place = ablation.entries, ablation.by_place
    conditions = list(dict.fromkeys(entry.condition for entry in entries))
    order = dict.fromkeys(entry.row for entry in entries)
    blocks = {
        reference: [row for row in order if row in rows and row != reference]
        for reference, rows in BLOCKS.values()
    }
    blocks = {reference: rows for reference, rows in blocks.items() if rows}
    heights = [len(rows) + 1 for rows in blocks.values()]
    width = max(4.0, 1.6 + 1.7 * len(conditions))  # so that a page does not shrink the words away
    figure = Figure(figsize=(width, 1.4 + 0.3 * sum(heights)))
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
            words = SETTINGS[condition].words if condition in SETTINGS else condition
            panel.set_title(f"{words}\n{reference}: {100 * base.error:.2f} % wrong", fontsize=9)
        line[0].set_yticks(range(len(rows)), rows, fontsize=9)
        line[0].set_ylim(len(rows) - 0.5, -0.5)
        line[0].set_ylabel(f"against {reference}", fontsize=9)
    label = f"difference in accuracy, points,\npaired 95 % interval ({kind})"
    figure.supxlabel(label, fontsize=9)
    figure.tight_layout()
    return figure


def _draw_panel(panel: Axes, compared: Sequence[Paired]) -> None:
    """Draw the comparisons of one condition below each other."""
    panel.axvline(0, color="0.7", linewidth=1)
    for y, paired in enumerate(compared):
        colour = {"good": "C2", "bad": "C3", "": "0.4"}[tint_of(paired)]
        if paired.frames >= MIN_FRAMES:
            panel.plot([paired.low, paired.high], [y, y], color=colour)
        panel.plot(paired.difference, y, "o", color=colour, markersize=4)
    panel.set_xscale("symlog", linthresh=1, linscale=0.6)
    set_ticks(panel.xaxis, TICKS, [f"{tick:g}".replace("-", "\N{MINUS SIGN}") for tick in TICKS])
    panel.grid(axis="x", color="0.92")
    panel.tick_params(axis="x", labelsize=7)


def _switch_table(ablation: Ablation, title: str) -> Table:
    """Rows of one block by conditions."""
    reference, rows = BLOCKS[title]
    by_place = ablation.by_place
    bits = {entry.condition: entry.bits for entry in ablation.entries}
    shown = [row for row in dict.fromkeys(row for row, _ in by_place) if row in rows]
    return Table(
        [
            f"row, against {reference}",
            *(f"{name or 'all'}, {count:,} bits" for name, count in bits.items()),
        ],
        [[row, *(_error_cell(by_place[row, name], reference) for name in bits)] for row in shown],
        title,
    )


def _error_cell(entry: AblationEntry, reference: str) -> TableCell:
    """Error of a row, and its difference to the reference."""
    text = percent(entry.error)
    if reference not in entry.against:
        return TableCell(text)
    paired = entry.against[reference]
    interval = "no interval" if paired.frames < MIN_FRAMES else difference_interval(paired)
    return TableCell(text, f"{paired.difference:+.2f}, {interval}", tint_of(paired))
