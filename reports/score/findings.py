"""Who wins, by how much, why, and where it fails: from a stored run, in numbers."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from link.errors import InputError
from reports.run import Run, SweepPoint
from reports.score.metrics import Row, clustered_interval
from reports.score.paired import MIN_FRAMES, Outcomes, Paired, behind, compare, outcomes, tally
from reports.score.paper import paper_accuracy

REFERENCES = ("oorc", "hidden_ratex")
"""Methods that saw the same captures as one of them are compared with it."""
WELL_READ = 0.95
"""Share of right bits below which a method is said to fail."""


@dataclass(frozen=True)
class Standing:
    """A method over all cells of the main comparison."""

    method: str
    frames: int
    bits: int
    errors: int
    accuracy: float | None
    """In [0, 1]; None where no truth is known."""
    low: float
    """95 % interval that knows that errors cluster by frame pair."""
    high: float
    paper: float | None
    """Mean of the paper's cells, where it has them all."""
    reference: str | None
    """Of `REFERENCES`, another method that saw the same captures."""
    against: Paired | None
    """Against the reference."""
    behind: int | None
    """Cells in which it is behind the reference beyond the paired interval; None where a cell has
    too few frame pairs for an interval."""


def standing(rows: Sequence[Row], method: str) -> tuple[int, int, int, float | None, float, float]:
    """Frame pairs, bits, errors, accuracy and its interval over all rows of a method."""
    mine = [row for row in rows if row.method == method]
    bits, correct = sum(row.bits for row in mine), sum(row.correct for row in mine)
    low, high = clustered_interval(mine)
    accuracy = correct / bits if bits else None
    return sum(row.frames for row in mine), bits, bits - correct, accuracy, low, high


def standings(run: Run) -> list[Standing]:
    """Every method, best first, those without known bits last."""
    found = outcomes(run.predictions)
    together = groups(found)
    seed = int(run.about["meta"]["seed"])
    result = []
    for method in run.methods:
        mine = [row for row in run.rows if row.method == method]
        printed = [_printed(row) for row in mine]
        known = [value for value in printed if value is not None]
        paper = sum(known) / len(known) if len(known) == len(printed) and known else None
        group = next(group for group in together if method in group)
        reference = next((m for m in REFERENCES if m in group and m != method), None)
        against, late = None, None
        if reference is not None:
            against = paired(found, method, reference, seed)
        enough = min(row.frames for row in mine) >= MIN_FRAMES  # else no cell can be behind
        if reference is not None and against is not None and enough:
            late = len(behind(found, method, reference, np.random.default_rng(seed)))
        found_here = standing(run.rows, method)
        result.append(Standing(method, *found_here, paper, reference, against, late))
    return sorted(result, key=lambda s: -1.0 if s.accuracy is None else -s.accuracy)


def paired(found: Outcomes, method: str, reference: str, seed: int) -> Paired | None:
    """The comparison on identical captures, or None where the two saw different ones."""
    try:
        _, counts = tally(found, method, reference)
    except InputError:
        return None
    if not counts[:, 0].sum():
        return None
    return compare(counts, np.random.default_rng(seed))


def groups(found: Outcomes) -> list[list[str]]:
    """Methods in groups that decoded the same captures, so can be paired."""
    together: dict[bytes, list[str]] = {}
    for method, frames in found.items():
        key = repr(sorted(map(str, frames))).encode()
        key += b"".join(bits.tobytes() for bits, _ in frames.values())
        together.setdefault(key, []).append(method)
    return list(together.values())


def leaders_of(predictions: Sequence[dict[str, Any]], swept: Sequence[Sequence[Row]]) -> list[str]:
    """The best method of each of `groups` that has a known bit, the best of them first.

    Best in the main comparison, and of equals in the sweeps; where there are sweeps, a method that
    they leave out does not lead.
    """
    found = outcomes(predictions)
    swept_rows = [row for point in swept for row in point]
    names = {row.method for row in swept_rows}

    def wrong(method: str) -> tuple[float, float]:
        wrongs = [wrong for _, wrong in found[method].values()]
        bits = sum(each.size for each in wrongs)
        mine = [row for row in swept_rows if row.method == method]
        more = sum(row.bits for row in mine)
        return (
            sum(int(each.sum()) for each in wrongs) / bits if bits else 1.0,
            1 - sum(row.correct for row in mine) / more if more else 1.0,
        )

    known = [
        [m for m in group if m in names or not names] or group
        for group in groups(found)
        if any(bits.size for bits, _ in found[group[0]].values())
    ]
    return sorted((min(group, key=wrong) for group in known), key=wrong)


def leaders(run: Run) -> list[str]:
    """`leaders_of` a stored run."""
    return leaders_of(run.predictions, [point.rows for point in run.sweeps])


def undecided(run: Run, method: str, table: Sequence[Standing]) -> list[str]:
    """Methods that the main comparison does not tell apart from ``method``.

    By the paired interval where both saw the same captures, else by overlap of their intervals.
    """
    found = outcomes(run.predictions)
    mine = next(s for s in table if s.method == method)
    names = []
    for other in table:
        if other.method == method or other.accuracy is None:
            continue
        result = paired(found, method, other.method, int(run.about["meta"]["seed"]))
        if result is not None:
            same = result.low <= 0 <= result.high
        else:
            same = other.low <= mine.high and mine.low <= other.high
        if same:
            names.append(other.method)
    return names


def worst_points(run: Run, method: str) -> list[tuple[SweepPoint, float, float, float]]:
    """Points that ``method`` reads below `WELL_READ`, with accuracy and interval; worst first."""
    found = []
    for point in run.sweeps:
        _, _, _, accuracy, low, high = standing(point.rows, method)
        if accuracy is not None and accuracy < WELL_READ:
            found.append((point, accuracy, low, high))
    return sorted(found, key=lambda entry: entry[1])


def parts_that_pay(ablation: dict[str, Any], count: int) -> list[tuple[str, str, dict[str, Any]]]:
    """(part, condition, paired difference to the full decoder): the largest losses without it."""
    losses = [
        (entry["row"].removeprefix("full-"), entry["condition"], entry["against"]["full"])
        for entry in ablation["entries"]
        if entry["row"].startswith("full-") and entry["against"]["full"]["high"] < 0
    ]
    losses.sort(key=lambda loss: float(loss[2]["difference"]))
    first: dict[str, tuple[str, str, dict[str, Any]]] = {}
    for loss in losses:
        first.setdefault(loss[0], loss)
    return list(first.values())[:count]


def _printed(row: Row) -> float | None:
    if row.view_deg is None:
        return None
    return paper_accuracy(row.pair, row.view_deg, row.kappa, row.method)
