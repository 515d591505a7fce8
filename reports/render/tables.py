"""Results as tables: one object that prints as Markdown for terminals and docs, and on the page.

A study makes a `Table` once; `Table.markdown` and the page's template show the same cells.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Any, Literal

import pandas as pd

from link.errors import InputError
from link.images import write_bytes
from link.markdown import markdown_table
from reports.score.accuracy import pool
from reports.score.paired import MIN_FRAMES, Paired
from reports.score.reliability import told

Tint = Literal["", "good", "bad"]
FAR = 3.0
"""Points between our accuracy and the paper's from which a cell is coloured."""


@dataclass(frozen=True)
class TableCell:
    """One entry of a table: a main text, and what stands smaller beside it."""

    text: str
    """Main text."""
    small: str = ""
    """Text that is smaller on the page; Markdown sets it beside the main text."""
    tint: Tint = ""
    """Colour on the page: "good" is green, "bad" is red."""
    beside: str = "({})"
    """Markdown around the small text, which takes the place of {}."""

    @property
    def markdown(self) -> str:
        """The entry in Markdown."""
        return f"{self.text} {self.beside.format(self.small)}" if self.small else self.text


@dataclass(frozen=True)
class Table:
    """Heads and rows of texts."""

    heads: Sequence[str | TableCell]
    """Texts above the columns."""
    rows: Sequence[Sequence[str | TableCell]]
    """Texts of each row, as many as there are heads."""
    title: str = ""
    """A line above the table; empty for none."""
    left: int = 1
    """Number of leading columns that are text, aligned left; the others are numbers."""

    def markdown(self) -> str:
        """The table as GitHub shows it, its title above.

        >>> rows = [["oorc", TableCell("99.2", "98 to 100")]]
        >>> print(Table(["method", "right %"], rows).markdown())
        | method | right % |
        |---|---:|
        | oorc | 99.2 (98 to 100) |
        """
        rows = [[cell.markdown for cell in row] for row in self.cells]
        table = markdown_table([head.markdown for head in self.head_cells], rows, self.left)
        return f"{self.title}\n\n{table}" if self.title else table

    @property
    def head_cells(self) -> list[TableCell]:
        """The heads, every one as a `TableCell`, for templates."""
        return _as_cells(self.heads)

    @property
    def cells(self) -> list[list[TableCell]]:
        """The rows with every entry as a `TableCell`, for templates."""
        return [_as_cells(row) for row in self.rows]


def percent(share: float | None, digits: int = 2) -> str:
    """A share in [0, 1] as a number of per cent; a dash where it is missing."""
    return number(None if share is None else 100 * share, digits)


def number(value: float | None, digits: int) -> str:
    """A number with its digits after the point; a dash where it is missing."""
    return "–" if value is None or not isfinite(value) else f"{value:.{digits}f}"


def share_interval(low: float, high: float, digits: int = 2) -> str:
    """An interval of shares in [0, 1], in per cent."""
    return f"{100 * low:.{digits}f} – {100 * high:.{digits}f}"


def difference_interval(paired: Paired) -> str:
    """The 95 % interval of a paired difference, points."""
    if paired.frames < MIN_FRAMES:
        return f"no interval from {paired.frames} captures"
    return f"{paired.low:+.2f} to {paired.high:+.2f}"


def tint_of(paired: Paired) -> Tint:
    """Colour of a paired difference: none where its interval holds 0."""
    return "good" if paired.low > 0 else "bad" if paired.high < 0 else ""


def summary_table(
    scores: pd.DataFrame, title: str, against: Mapping[str, Paired | None] | None = None
) -> Table:
    """Accuracy of each method over all cells, with its clustered interval, and the paper's if any.

    Args:
        scores: a score table (`reports.score.accuracy.score`).
        title: title of the table.
        against: by method its comparison with a reference, where the table shall show that too;
            methods are then in this order.
    """
    pooled = pool(scores).set_index("method", drop=False)
    shown = pooled if against is None else pooled.loc[list(against)]
    heads: list[str | TableCell] = ["method", "accuracy %", "95 % interval"]
    heads += ["bits"] if against is None else ["wrong of bits"]
    compared = against is not None and any(against.values())
    in_paper = bool(scores["paper"].notna().any())
    if compared:
        heads += [
            TableCell("points", "to the reference"),
            TableCell("× errors", "of the reference"),
        ]
    heads += ["paper %"] if in_paper else []
    rows: list[list[str | TableCell]] = []
    for row in shown.itertuples():
        known = row.bits > 0
        interval = share_interval(row.low, row.high) if known else "–"
        cells: list[str | TableCell] = [row.method, percent(row.accuracy), interval]
        if against is None:
            cells.append(str(row.bits))
        else:
            cells.append(f"{row.errors:,} of {row.bits:,}" if known else "–")
        if against is not None and compared:
            cells += _against_cells(against[row.method])
        rows.append([*cells, percent(row.paper)] if in_paper else cells)
    return Table(heads, rows, title)


def cell_tables(scores: pd.DataFrame) -> list[Table]:
    """Make a table for each kappa and view of a score table.

    Returns:
        tables of pairs by methods: ours with half its interval, and the paper's number.
    """
    methods = [str(name) for name in scores["method"].unique()]
    tables = []
    for (kappa, view), group in scores.groupby(["kappa", "view_deg"], sort=False, dropna=False):
        pooled = pool(group, ["pair", "method"])
        cells = {(row.pair, row.method): _beside_paper(row) for row in pooled.itertuples()}
        pairs = [str(pair) for pair in group["pair"].unique()]
        rows = [[pair, *(cells.get((pair, m), "–") for m in methods)] for pair in pairs]
        if len(pairs) > 1:
            means = [_mean_cell(pooled[pooled["method"] == m]) for m in methods]
            rows.append(["mean", *means])
        title = f"κ = {kappa}, {view:g}°: accuracy %, ± half the 95 % interval / the paper's"
        tables.append(Table(["pair", *methods], rows, title))
    return tables


def information_table(records: pd.DataFrame, blocks_s: float = 0.0) -> Table:
    """Tabulate how many bits each method read at all, and what its scores tell.

    Args:
        records: predictions of one condition, or of a folder of captures.
        blocks_s: number of message blocks that the display shows a second; 0 where it is not known.
    """
    rows = []
    for method, mine in records[records["known"] > 0].groupby("method", sort=False):
        read, information = told(mine)
        second = [f"{information * blocks_s:,.0f}"] if blocks_s else []
        rows.append([method, percent(read), number(information, 3), *second])
    title = (
        "Bits that were not erased, and the information of all in bits a block and frame pair, by "
        "how often bits of like scores are right:"
    )
    heads = ["method", "read %", "information", *(["bits a second"] if blocks_s else [])]
    return Table(heads, rows, title)


BY = {
    "pair": "camera and display",
    "view_deg": "angle, degrees",
    "kappa": "κ",
    "picture": "picture",
}
"""Columns of the predictions by which accuracies are broken down where they vary, and their
heads."""
MOST_VALUES = 40
"""Largest number of values by which the page gives accuracies, those with most errors first."""


def tables_by(records: pd.DataFrame) -> list[Table]:
    """Give accuracies by each of `BY` that varies: a row a value, a column a method.

    Args:
        records: predictions.
    """
    tables = []
    for name, head in BY.items():
        known = records[(records["known"] > 0) & records[name].notna()]
        if known[name].nunique() < 2:
            continue
        sums = known.groupby([name, "method"], sort=True)[["correct", "known"]].sum()
        shares = (sums["correct"] / sums["known"]).unstack()
        shares = shares[list(dict.fromkeys(known["method"]))]
        if name == "picture":
            shares = shares.loc[shares.mean(axis=1).sort_values().index[:MOST_VALUES]]
        cells = [
            [f"{value:g}" if name == "view_deg" else str(value), *map(percent, row)]
            for value, row in zip(shares.index, shares.to_numpy(), strict=True)
        ]
        tables.append(Table([head, *map(str, shares.columns)], cells, f"Right bits by {head}, %:"))
    return tables


def replace_block(page: Path, name: str, content: str) -> None:
    """Put ``content`` between ``<!-- name -->`` and ``<!-- /name -->`` of a page.

    Raises:
        InputError: the page is not here, or has no such markers.
    """
    block = re.compile(rf"(<!-- {name} -->\n).*?(<!-- /{name} -->)", re.DOTALL)
    if not page.is_file() or not block.search(page.read_text("utf-8")):
        raise InputError(f"{page}: not here, or without {name!r} markers; run from the checkout")
    text = block.sub(lambda match: f"{match[1]}{content}\n{match[2]}", page.read_text("utf-8"))
    write_bytes(page, text.encode())


def _as_cells(row: Sequence[str | TableCell]) -> list[TableCell]:
    return [cell if isinstance(cell, TableCell) else TableCell(cell) for cell in row]


def _beside_paper(row: Any) -> str | TableCell:
    """Ours ± half the interval, and the paper's number where it has one."""
    if not row.bits:
        return "–"
    text = f"{100 * row.accuracy:.1f} ±{50 * (row.high - row.low):.1f}"
    if pd.isna(row.paper):
        return text
    small = percent(row.paper, 1)
    gap = 100 * (row.accuracy - row.paper)
    return TableCell(text, small, "good" if gap > FAR else "bad" if gap < -FAR else "", "/ {}")


def _mean_cell(pooled: pd.DataFrame) -> str | TableCell:
    """Mean over pairs of one method: ours, and the paper's where it has all of them."""
    small = pooled["paper"].mean(skipna=False)
    text = percent(pooled["accuracy"].mean(), 1)
    return text if pd.isna(small) else TableCell(text, percent(small, 1), beside="/ {}")


def _against_cells(paired: Paired | None) -> list[str | TableCell]:
    """Difference to the reference in points, and errors as a multiple of the reference's."""
    if paired is None:
        return ["–", "–"]
    high = "∞" if paired.ratio_high is None else f"{paired.ratio_high:.2f}"
    told = paired.frames >= MIN_FRAMES and (paired.ratio_low > 0 or paired.ratio_high is not None)
    interval = f"{paired.ratio_low:.2f} – {high}" if told else "–"
    difference = TableCell(f"{paired.difference:+.2f}", difference_interval(paired))
    return [difference, TableCell(number(paired.ratio, 2), interval)]
