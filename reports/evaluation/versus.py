"""Two runs on the same captures: who is better, by how much, with paired tests."""

from dataclasses import fields
from pathlib import Path

import numpy as np
import pandas as pd

from data_gen.flags import LayoutFlags
from link.errors import InputError
from link.files.lock import locked
from link.images import write_bytes
from reports.evaluation.html import render
from reports.render.charts import look_of
from reports.render.tables import Table, TableCell, difference_interval, number, percent, tint_of
from reports.run import Run, RunFolder
from reports.score.paired import COUNTS, KEYS, Counts, compare, tally

SAME = (
    *("seed", "pictures", "captures", "without", "set"),
    *(field.name for field in fields(LayoutFlags)),
)
"""Settings that decide what was captured."""
COMPARE_PAGE = "compare.html"
"""Name of the page that a comparison writes into the folder of the second run."""
MAIN = "main comparison"
"""Name of what a run compares, where its conditions have no names."""
HEADS = (
    "method", "A right %", "B right %", "B less A, points", "95 % interval", "errors of B / A",
    "bits only B / only A has right", "McNemar p", "frame pairs", "bits",
)  # fmt: skip
"""Heads of the comparison's tables."""


def compare_runs(folder_a: Path, folder_b: Path) -> tuple[str, Path]:
    """Compare run B with run A, and write compare.html into the folder of B.

    Returns:
        Markdown, and the page.

    Raises:
        InputError: a run is not finished or damaged, the two did not decode the same captures, or
            another process writes the folder of B.
    """
    a, b = RunFolder(folder_a).read(), RunFolder(folder_b).read()
    refuse_mismatch(a, b)
    table = match_runs(a, b)
    methods = {str(row[0]) for row in table.rows}
    notes = remarks(a, b, methods)
    colours = {method: look_of(method).colour for method in sorted(methods)}
    text = render(
        "compare.html.j2",
        colours,
        runs={"A": a, "B": b},
        simulated=a.simulated,
        compared=table,
        notes=notes,
        sections={"compared": MAIN.capitalize(), "notes": "Notes"},
    )
    path = folder_b / COMPARE_PAGE
    with locked(folder_b):
        write_bytes(path, text.encode())
    head = f"A: {a.folder}, B: {b.folder}; paired on identical captures"
    return "\n\n".join([head, table.markdown(), *notes]), path


def refuse_mismatch(a: Run, b: Run) -> None:
    """Check that two runs are of the same captures, as far as their settings tell.

    Raises:
        InputError: they are not; it names the first setting by which the captures differ.
    """
    for key in SAME:
        left, right = (run.about.settings.get(key) for run in (a, b))
        if left != right:
            raise InputError(
                f"{a.folder} has {key} {left!s:.100} and {b.folder} has {right!s:.100}; "
                "paired tests need runs on the same captures"
            )
    if a.simulated != b.simulated:
        raise InputError(f"one of {a.folder} and {b.folder} is simulated and the other is not")


def match_runs(a: Run, b: Run) -> Table:
    """Compare every method of both runs.

    Raises:
        InputError: a method was sent other bits in one run, or nothing is shared.
    """
    rows = []
    for method in (name for name in a.methods if name in b.methods):
        counts = _shared_counts(a.records, b.records, method)
        if counts is None:
            raise InputError(
                f"{method} was sent other bits in {a.folder} than in {b.folder}; "
                "the runs are not of the same captures"
            )
        if counts[COUNTS[0]].sum():
            rows.append(_cells(method, counts[COUNTS].to_numpy()))
    if not rows:
        raise InputError(
            f"{a.folder} and {b.folder} share no method on a frame pair with known bits"
        )
    return Table(HEADS, rows, MAIN)


def remarks(a: Run, b: Run, methods: set[str]) -> list[str]:
    """Say what a reader must know: how much the runs share, and what else differs."""
    notes = []
    for run, letter in ((a, "A"), (b, "B")):
        alone = set(run.methods) - methods
        if alone:
            notes.append(f"Only in {letter}: {', '.join(sorted(alone))}.")
    frames_a, frames_b = (set(run.records[KEYS].itertuples(index=False)) for run in (a, b))
    if frames_a != frames_b:
        notes.append(
            f"A has {len(frames_a)} frame pairs in its main comparison, B {len(frames_b)}; "
            f"the {len(frames_a & frames_b)} that both have count."
        )
    notes += [
        f"{key} differs: {left!s:.300}; {right!s:.300}."
        for key, left, right in (
            ("commit", a.about.commit, b.about.commit),
            *(
                (key, a.about.settings.get(key), b.about.settings.get(key))
                for key in ("protocol", "run", "checkpoints")
            ),
        )
        if left != right
    ]
    return notes


def _shared_counts(left: pd.DataFrame, right: pd.DataFrame, method: str) -> pd.DataFrame | None:
    """Counts of run B against run A on the frame pairs of both; None where their bits differ."""
    mine, theirs = (table[table["method"] == method] for table in (left, right))
    shared = mine[KEYS].merge(theirs[KEYS])
    if shared.empty:
        return pd.DataFrame(columns=COUNTS)
    both = [mine.merge(shared).assign(method="A"), theirs.merge(shared).assign(method="B")]
    try:
        return tally(pd.concat(both, ignore_index=True), "B", "A")
    except InputError:
        return None


def _cells(method: str, counts: Counts) -> list[str | TableCell]:
    """Give the row of a method, by its counts in run B against those in run A."""
    _, errors_b, errors_a, _ = (int(total) for total in counts.sum(axis=0))
    paired = compare(counts, np.random.default_rng(0))
    return [
        method,
        percent(1 - errors_a / paired.bits),
        percent(1 - errors_b / paired.bits),
        TableCell(f"{paired.difference:+.2f}", tint=tint_of(paired)),
        difference_interval(paired),
        number(paired.ratio, 2),
        f"{paired.better} / {paired.worse}",
        f"{paired.p_bits:.2g}",
        f"{paired.frames:,}",
        f"{paired.bits:,}",
    ]
