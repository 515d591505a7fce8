"""Metrics -> Markdown tables, beside the paper's numbers."""

import re
from collections.abc import Sequence
from pathlib import Path

from link.errors import InputError
from link.images import write_bytes
from reports.score.metrics import Row, clustered_interval
from reports.score.paper import paper_accuracy


def summary_table(rows: Sequence[Row], title: str) -> str:
    """Methods x accuracy over all cells, with the interval that knows clusters, and the paper's."""
    lines = [
        title,
        "",
        "| method | accuracy % | 95 % interval | bits | paper % |",
        "|---|---:|---:|---:|---:|",
    ]
    for method in dict.fromkeys(row.method for row in rows):
        mine = [row for row in rows if row.method == method]
        bits, correct = sum(row.bits for row in mine), sum(row.correct for row in mine)
        low, high = clustered_interval(mine)
        printed = [p for row in mine if (p := _paper(row)) is not None]
        paper = f"{100 * sum(printed) / len(printed):.2f}" if len(printed) == len(mine) else "–"
        accuracy = f"{100 * correct / bits:.2f}" if bits else "–"
        interval = f"{100 * low:.2f} – {100 * high:.2f}" if bits else "–"
        lines.append(f"| {method} | {accuracy} | {interval} | {bits} | {paper} |")
    return "\n".join(lines)


def paper_tables(rows: Sequence[Row]) -> str:
    """One table a (kappa, view), pairs x methods: ours ± half the interval / the paper's."""
    methods = list(dict.fromkeys(row.method for row in rows))
    blocks = []
    for kappa, view in dict.fromkeys((row.kappa, row.view_deg) for row in rows):
        cell_rows = [row for row in rows if (row.kappa, row.view_deg) == (kappa, view)]
        lines = [
            f"κ = {kappa}, {view:g}°: accuracy %, ± half the 95 % interval / the paper's",
            "",
            f"| pair | {' | '.join(methods)} |",
            f"|---|{'---:|' * len(methods)}",
        ]
        for pair in dict.fromkeys(row.pair for row in cell_rows):
            entries = {row.method: _cell(row) for row in cell_rows if row.pair == pair}
            lines.append(f"| {pair} | {' | '.join(entries.get(m, '–') for m in methods)} |")
        blocks.append("\n".join(lines))
    return "\n\n".join(blocks)


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


def _paper(row: Row) -> float | None:
    if row.view_deg is None:
        return None
    return paper_accuracy(row.pair, row.view_deg, row.kappa, row.method)


def _cell(row: Row) -> str:
    if row.accuracy is None:
        return "–"
    low, high = clustered_interval([row])
    text = f"{100 * row.accuracy:.1f} ±{50 * (high - low):.1f}"
    paper = _paper(row)
    return text if paper is None else f"{text} / {100 * paper:.1f}"
