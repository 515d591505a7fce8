"""Blocks of README.md and docs/ that show the results of several studies beside each other."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from lab.ablation import STUDY as ABLATION
from lab.study import stored_results
from reports.engine.conditions import SETTINGS
from reports.render.tables import Table, TableCell, percent, share_interval, summary_table
from reports.score.accuracy import read_scores

HARDER = [name for name in SETTINGS if name != "paper"]
"""Names of the ablation's conditions beyond the paper."""
DECODER_ROWS = {"oorc": "oorc", "learned": "learned", "full": "untrained"}
"""Rows of the ablation that are decoders to use, and what the table calls them."""


def main_table(docs: Path) -> str:
    """Show the accuracy of every method in the paper's 36 cells, from docs/metrics.json."""
    scores, meta = read_scores(docs / "metrics.json")
    title = (
        f"Simulated: {scores['pair'].nunique()} camera–display pairs × 0°, 45° × κ 5, 3; "
        f"{scores['frames'].iloc[0]} frame pairs a cell, held-out pictures and channel draws, "
        f"seed {meta['seed']}."
    )
    return summary_table(scores, title).markdown()


def harder_table(docs: Path) -> str:
    """Show wrong bits beyond the paper's conditions, with their intervals, from the ablation."""
    entries = stored_results(ABLATION, docs / ABLATION.name)[ABLATION.name].content.by_place
    rows: list[list[str | TableCell]] = []
    for name in HARDER:
        shown = [entries[row, name] for row in DECODER_ROWS]
        cells = [
            TableCell(percent(each.error), f"{100 * each.ci_low:.1f}–{100 * each.ci_high:.1f}")
            for each in shown
        ]
        rows.append([SETTINGS[name].words, *cells, f"{shown[0].bits:,}"])
    heads = ["bits wrong, % (95 % interval)", *DECODER_ROWS.values(), "of bits"]
    return Table(heads, rows).markdown()


def against_oorc(docs: Path) -> str:
    """Compare `learned` with OORC in the paper's cells, with the command that did it."""
    results = stored_results(ABLATION, docs / ABLATION.name)["paper"]
    entries = results.content.by_place
    ours, theirs = entries["learned", "paper"], entries["oorc", "paper"]
    paired = ours.against["oorc"]
    return (
        f"Of {ours.bits:,} simulated bits in the paper’s cells `learned` reads {ours.errors:,} "
        f"wrong and `oorc` {theirs.errors:,}. That is {percent(paired.ratio, 1)} % of them "
        f"(95 % interval {share_interval(paired.ratio_low, paired.ratio_high or 0.0, 1)}), and "
        f"`learned` is behind in {ours.cells_behind} of 36 cells (`{results.meta['command']}`)."
    )


@dataclass(frozen=True)
class Block:
    """Text between two markers of a page."""

    page: Path
    """Page that holds the markers, relative to the checkout."""
    render: Callable[[Path], str]
    """Makes the text from the folder of stored results."""


README, RESULTS = Path("README.md"), Path("docs/results.md")
"""Pages that hold more than one study's numbers."""
BLOCKS = {
    "harder": Block(README, harder_table),
    "table": Block(RESULTS, main_table),
    "measured": Block(RESULTS, against_oorc),
}
"""Blocks by the name in their markers; those of single studies are written with their results."""
