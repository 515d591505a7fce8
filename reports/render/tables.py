"""Results as tables: one object that prints as Markdown for terminals and docs, and on the page.

A study makes a `Table` once; `Table.markdown` and the page's template show the same cells.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import pandas as pd

from link.errors import InputError
from link.images import write_bytes
from reports.score.accuracy import pool
from reports.score.paired import MIN_FRAMES, Paired

Tint = Literal["", "good", "bad"]


@dataclass(frozen=True)
class TableCell:
    """One entry of a table: a main text, and what stands smaller beside it."""

    text: str
    small: str = ""
    """Shown smaller on the page, and in brackets in Markdown."""
    tint: Tint = ""
    """Colour on the page: "good" is green, "bad" is red."""


@dataclass(frozen=True)
class Table:
    """Heads and rows of texts."""

    heads: Sequence[str]
    rows: Sequence[Sequence[str | TableCell]]
    title: str = ""
    """A line above the table; empty for none."""
    left: int = 1
    """Number of leading columns that are text, aligned left; the others are numbers."""

    def markdown(self) -> str:
        """The table as GitHub shows it, its title above.

        >>> print(Table(["method", "right %"], [["oorc", TableCell("99.2", "98 to 100")]]).markdown())
        | method | right % |
        |---|---:|
        | oorc | 99.2 (98 to 100) |
        """
        marks = ["---"] * self.left + ["---:"] * (len(self.heads) - self.left)
        lines = [f"| {' | '.join(self.heads)} |", f"|{'|'.join(marks)}|"]
        lines += [f"| {' | '.join(map(_markdown, row))} |" for row in self.rows]
        return "\n".join([self.title, "", *lines] if self.title else lines)

    @property
    def cells(self) -> list[list[TableCell]]:
        """The rows with every entry as a `TableCell`, for templates."""
        return [[c if isinstance(c, TableCell) else TableCell(c) for c in row] for row in self.rows]


def percent(share: float | None, digits: int = 2) -> str:
    """A share in [0, 1] as a number of per cent; a dash where it is missing."""
    return "–" if share is None or pd.isna(share) else f"{100 * share:.{digits}f}"


def share_interval(low: float, high: float, digits: int = 2) -> str:
    """An interval of shares in [0, 1], in per cent."""
    return f"{100 * low:.{digits}f} – {100 * high:.{digits}f}"


def difference_interval(paired: Paired) -> str:
    """The 95 % interval of a paired difference, points."""
    if paired.frames < MIN_FRAMES:
        return f"no interval from {paired.frames} frame pairs"
    return f"{paired.low:+.2f} to {paired.high:+.2f}"


def summary_table(scores: pd.DataFrame, title: str) -> Table:
    """Accuracy of each method over all cells, with the interval that knows clusters, and the paper's.

    Args:
        scores: a score table (`reports.score.accuracy.score`).
        title: of the table.
    """
    rows = [
        [
            row.method,
            percent(row.accuracy),
            share_interval(row.low, row.high) if row.bits else "–",
            str(row.bits),
            percent(row.paper),
        ]
        for row in pool(scores).itertuples()
    ]
    return Table(["method", "accuracy %", "95 % interval", "bits", "paper %"], rows, title)


def cell_tables(scores: pd.DataFrame) -> list[Table]:
    """A table for each kappa and view, pairs by methods: ours with half its interval / the paper's.

    Args:
        scores: a score table.
    """
    methods = [str(name) for name in scores["method"].unique()]
    tables = []
    for (kappa, view), group in scores.groupby(["kappa", "view_deg"], sort=False, dropna=False):
        pooled = pool(group, ["pair", "method"]).set_index(["pair", "method"])
        rows = [
            [str(pair)]
            + [
                _beside_paper(pooled, pair, m) if (pair, m) in pooled.index else "–"
                for m in methods
            ]
            for pair in group["pair"].unique()
        ]
        title = f"κ = {kappa}, {view:g}°: accuracy %, ± half the 95 % interval / the paper's"
        tables.append(Table(["pair", *methods], rows, title))
    return tables


def replace_block(page: Path, name: str, content: str) -> None:
    """Put ``content`` between ``<!-- name -->`` and ``<!-- /name -->`` of a page.

    Raises:
        InputError: the page is not here, or has no such markers.
    """
    block = re.compile(rf"(<!-- {name} -->\n).*?(<!-- /{name} -->)", re.DOTALL)
    if not page.is_file() or not block.search(page.read_text()):
        raise InputError(f"{page}: not here, or without {name!r} markers; run from the checkout")
    text = block.sub(lambda match: f"{match[1]}{content}\n{match[2]}", page.read_text())
    write_bytes(page, text.encode())


def _markdown(cell: str | TableCell) -> str:
    if isinstance(cell, str):
        return cell
    return f"{cell.text} ({cell.small})" if cell.small else cell.text


def _beside_paper(pooled: pd.DataFrame, pair: object, method: str) -> str:
    """Ours ± half the interval, and the paper's number where it has one."""
    row = pooled.loc[(pair, method)]
    if not row["bits"]:
        return "–"
    text = f"{100 * row['accuracy']:.1f} ±{50 * (row['high'] - row['low']):.1f}"
    return text if pd.isna(row["paper"]) else f"{text} / {100 * row['paper']:.1f}"
