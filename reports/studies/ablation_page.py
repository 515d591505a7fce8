"""Ablation: outcomes -> entries, Markdown tables and a picture."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib
import numpy as np

from link.images import make_folder
from reports.engine.predict import OBSERVERS
from reports.score.metrics import Row, clustered_interval
from reports.score.paired import MIN_FRAMES, Frame, Outcomes, Paired, compare, tally
from reports.studies.variants import ADDED, REMOVED

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.ticker import FixedLocator, NullLocator

REFERENCES = ("oorc", "full", "ideal")
TABLES = {
    "Added to plain OORC": ("oorc", ("oorc", "phi", *ADDED, "full", "learned", *OBSERVERS)),
    "Removed from the full decoder": ("full", ("full", *REMOVED, "learned", *OBSERVERS)),
}
"""By title: the reference, and the rows compared with it."""
TICKS = (-30, -10, -3, -1, 0, 1, 3, 10, 30)
"""Of the picture's scale, points; it is linear within 1 and logarithmic beyond."""


@dataclass(frozen=True)
class Entry:
    """A row of the ablation in one condition."""

    row: str
    condition: str
    frames: int
    bits: int
    errors: int
    error: float
    """errors / bits in [0, 1]."""
    ci_low: float
    """95 % interval of ``error`` by `clustered_interval`."""
    ci_high: float
    against: dict[str, Paired]
    """By reference: those of `REFERENCES` that were decoded, less the row itself."""


@dataclass(frozen=True)
class Standing:
    """A whole decoder against OORC in one condition, cell by cell."""

    row: str
    condition: str
    cells: int
    behind: dict[Frame, Paired]
    """Cells in which it is behind beyond the paired 95 % interval."""


def measure(rows: Sequence[Row], found: Outcomes, condition: str, seed: int) -> list[Entry]:
    """Entries of one condition, a method each, in the order of ``found``.

    Args:
        rows: scores of all methods and cells.
        found: outcomes of the same predictions.
        condition: its name.
        seed: of the resamples, the same for every comparison.
    """
    entries = []
    for name in found:
        mine = [row for row in rows if row.method == name]
        bits = sum(row.bits for row in mine)
        errors = bits - sum(row.correct for row in mine)
        low, high = clustered_interval(mine)
        against = {
            reference: compare(tally(found, name, reference)[1], np.random.default_rng(seed))
            for reference in REFERENCES
            if reference in found and reference != name
        }
        frames, error = sum(row.frames for row in mine), errors / bits
        entries.append(
            Entry(name, condition, frames, bits, errors, error, 1 - high, 1 - low, against)
        )
    return entries


def table(entries: Sequence[Entry], reference: str, rows: Sequence[str]) -> str:
    """Markdown: rows x conditions, error and paired difference to the reference."""
    cells = {(entry.row, entry.condition): entry for entry in entries}
    bits = {entry.condition: entry.bits for entry in entries}
    heads = " | ".join(f"{name}, {count:,} bits" for name, count in bits.items())
    lines = [f"| row | {heads} |", f"|---|{'---:|' * len(bits)}"]
    for row in dict.fromkeys(entry.row for entry in entries):
        if row in rows:
            parts = [_cell(cells[row, name], reference) for name in bits]
            lines.append(f"| {row} | {' | '.join(parts)} |")
    return "\n".join(lines)


def tables(entries: Sequence[Entry]) -> str:
    """Markdown: every table of `TABLES` under its title."""
    return "\n\n".join(
        f"## {title}\n\nDifferences are to `{reference}`.\n\n{table(entries, reference, rows)}"
        for title, (reference, rows) in TABLES.items()
    )


def against_oorc(entries: Sequence[Entry], standings: Sequence[Standing]) -> str:
    """Markdown: errors as a multiple of OORC's, and the cells behind it."""
    by_place = {(entry.row, entry.condition): entry.against for entry in entries}
    lines = [
        "## Whole decoders against OORC",
        "",
        "| row | condition | multiple of OORC's errors | 95 % interval | cells behind OORC |",
        "|---|---|---:|---:|---|",
    ]
    for standing in standings:
        paired = by_place[standing.row, standing.condition]["oorc"]
        value = "–" if paired.ratio is None else f"{paired.ratio:.2f}"
        high = "∞" if paired.ratio_high is None else f"{paired.ratio_high:.2f}"
        named = "; ".join(
            f"{pair} {view:g}° κ {kappa}: {result.difference:+.2f}, {interval_of(result)}"
            for (_, pair, view, kappa), result in standing.behind.items()
        )
        lines.append(
            f"| {standing.row} | {standing.condition} | {value} | {paired.ratio_low:.2f} to {high} "
            f"| {len(standing.behind)} of {standing.cells}{': ' if named else ''}{named} |"
        )
    return "\n".join(lines)


def plot(path: Path, entries: Sequence[Entry]) -> None:
    """Paired differences with their intervals as a PNG: tables below each other, conditions beside.

    Green is better than the reference beyond the interval, red is worse, gray neither.
    """
    conditions = list(dict.fromkeys(entry.condition for entry in entries))
    order = list(dict.fromkeys(entry.row for entry in entries))
    shown = {
        reference: [row for row in order if row in rows and row not in (reference, *OBSERVERS)]
        for reference, rows in TABLES.values()
    }
    shown = {reference: rows for reference, rows in shown.items() if rows}
    heights = [len(rows) + 1 for rows in shown.values()]
    figure, panels = plt.subplots(
        len(shown),
        len(conditions),
        figsize=(1.6 + 2.4 * len(conditions), 1.4 + 0.3 * sum(heights)),
        sharex="row",
        sharey="row",
        squeeze=False,
        height_ratios=heights,
    )
    by_place = {(entry.row, entry.condition): entry for entry in entries}
    for line, (reference, rows) in zip(panels, shown.items(), strict=True):
        for panel, condition in zip(line, conditions, strict=True):
            panel.axvline(0, color="0.7", linewidth=1)
            for y, row in enumerate(rows):
                paired = by_place[row, condition].against[reference]
                colour = "C2" if paired.low > 0 else "C3" if paired.high < 0 else "0.4"
                if paired.frames >= MIN_FRAMES:
                    panel.plot([paired.low, paired.high], [y, y], color=colour)
                panel.plot(paired.difference, y, "o", color=colour, markersize=4)
            panel.set_xscale("symlog", linthresh=1, linscale=0.6)
            panel.xaxis.set_major_locator(FixedLocator(TICKS))
            panel.xaxis.set_minor_locator(NullLocator())
            panel.xaxis.set_major_formatter("{x:g}")
            panel.grid(axis="x", color="0.92")
            panel.tick_params(axis="x", labelsize=7)
            base = by_place[reference, condition]
            panel.set_title(f"{condition}\n{reference}: {100 * base.error:.2f} % wrong", fontsize=9)
        line[0].set_yticks(range(len(rows)), rows)
        line[0].set_ylim(len(rows) - 0.5, -0.5)
        line[0].set_ylabel(f"less that of {reference}")
    figure.supxlabel("difference in accuracy, points, paired 95 % interval (simulated captures)")
    figure.tight_layout()
    make_folder(path.parent)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def interval_of(paired: Paired) -> str:
    """The interval of a difference in points, where there is one."""
    if paired.frames < MIN_FRAMES:
        return "no interval"
    return f"{paired.low:+.2f} to {paired.high:+.2f}"


def _cell(entry: Entry, reference: str) -> str:
    parts = [f"{100 * entry.error:.2f}"]
    if reference in entry.against:
        paired = entry.against[reference]
        parts.append(f"({paired.difference:+.2f}, {interval_of(paired)})")
    ideal = entry.against.get("ideal")
    if ideal is not None and ideal.ratio is not None:
        parts.append(f"×{ideal.ratio:.2f}")
    return " ".join(parts)
