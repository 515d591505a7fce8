"""Who wins, by how much, and where it fails: from the tables of a run, in numbers."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from reports.run import Run, SweepCurve, SweepPoint
from reports.score.accuracy import pool, score
from reports.score.paired import (
    MIN_FRAMES,
    Paired,
    cells_behind,
    compare_methods,
    same_captures,
)

REFERENCES = ("oorc", "hidden_ratex")
"""Methods of the paper with which others are compared: a method's reference is the first of them
that decoded the same captures."""
WELL_READ = 0.95
"""Share of right bits below which a method is said to fail."""


@dataclass(frozen=True)
class Standing:
    """A method over all cells of the main comparison."""

    method: str
    """Label of the method."""
    frames: int
    """Number of frame pairs that it decoded."""
    bits: int
    """Number of bits whose truth is known."""
    errors: int
    """Number of bits that it decided wrong."""
    accuracy: float | None
    """Share of right bits, in [0, 1]; None where no truth is known."""
    low: float
    """Lower end of the 95 % interval of the accuracy, which knows that errors cluster."""
    high: float
    """Upper end of the 95 % interval of the accuracy."""
    paper: float | None
    """Mean accuracy of the paper's cells, in [0, 1]; None where the paper lacks one of them."""
    reference: str | None
    """The first of `REFERENCES`, other than itself, that decoded the same captures, or None."""
    against: Paired | None
    """Comparison with the reference."""
    behind: int | None
    """Number of cells in which it is behind the reference beyond the paired interval; None where a
    cell has too few frame pairs for an interval."""


def standings(run: Run) -> list[Standing]:
    """Compare every method with its reference; the best first, those without known bits last."""
    groups = same_captures(run.records)
    smallest = run.scores.groupby("method")["frames"].min()
    result = []
    for row in pool(run.scores).itertuples():
        method = str(row.method)
        group = next(group for group in groups if method in group)
        reference = next((m for m in REFERENCES if m in group and m != method), None)
        against, behind = None, None
        if reference is not None:
            against = compare_methods(run.records, method, reference, _resamples(run))
        if reference is not None and against is not None and smallest[method] >= MIN_FRAMES:
            behind = len(cells_behind(run.records, method, reference, _resamples(run)))
        result.append(
            Standing(
                method,
                int(row.frames),
                int(row.bits),
                int(row.errors),
                float(row.accuracy) if row.bits else None,
                float(row.low),
                float(row.high),
                None if pd.isna(row.paper) else float(row.paper),
                reference,
                against,
                behind,
            )
        )
    return sorted(result, key=lambda s: 1.0 if s.accuracy is None else -s.accuracy)


def leaders(records: pd.DataFrame, swept: pd.DataFrame) -> list[str]:
    """Find the best method of each group that decoded the same captures, the best of them first.

    Best in the main comparison, and of equals in the sweeps. Where there are sweeps, a method that
    they leave out does not lead. A group without a known bit has no leader.

    Args:
        records: predictions of the main comparison.
        swept: predictions of the sweeps; may be empty.

    Returns:
        labels of methods.
    """
    main, more = (_wrong_shares(table) for table in (records, swept))
    known = set(records.loc[records["known"] > 0, "method"])
    groups = [
        [method for method in group if method in more or not more] or group
        for group in same_captures(records)
        if group[0] in known
    ]

    def wrong(method: str) -> tuple[float, float]:
        return main[method], more.get(method, 1.0)

    return sorted((min(group, key=wrong) for group in groups), key=wrong)


def undecided(run: Run, method: str, ranked: Sequence[Standing]) -> list[str]:
    """Find the methods that the main comparison does not tell apart from ``method``.

    Methods that decoded other captures are not compared with it.

    Args:
        run: what was decoded.
        method: label of the method.
        ranked: standings of all methods of the run.
    """
    names = []
    for other in (standing.method for standing in ranked if standing.method != method):
        paired = compare_methods(run.records, method, other, _resamples(run))
        if paired is not None and paired.low <= 0 <= paired.high:
            names.append(other)
    return names


@dataclass(frozen=True)
class SweptAccuracy:
    """A method at one value of a sweep, over all its camera-display pairs."""

    curve: SweepCurve
    """What is swept."""
    point: SweepPoint
    """The value, and the name of its condition."""
    method: str
    """Label of the method."""
    frames: int
    """Number of frame pairs."""
    bits: int
    """Number of bits whose truth is known, at least 1."""
    errors: int
    """Number of bits that were decided wrong."""
    accuracy: float
    """Share of right bits, in [0, 1]."""
    low: float
    """Lower end of the 95 % interval of the accuracy, which knows that errors cluster."""
    high: float
    """Upper end of the 95 % interval of the accuracy."""

    @property
    def value(self) -> float:
        """Value of the swept quantity, as the axis shows it."""
        return self.curve.scale * self.point.value

    @property
    def words(self) -> str:
        """Value of the swept quantity in words."""
        return self.curve.words(self.point.value)


def swept_accuracies(run: Run) -> list[SweptAccuracy]:
    """Pool the predictions at every value of every sweep, by method; without unknown bits."""
    table = pool(score(run.swept), ["condition", "method"])
    by_condition = {name: group for name, group in table.groupby("condition", sort=False)}
    return [
        SweptAccuracy(
            curve,
            point,
            str(row.method),
            int(row.frames),
            int(row.bits),
            int(row.errors),
            float(row.accuracy),
            float(row.low),
            float(row.high),
        )
        for curve in run.sweeps
        for point in curve.points
        if point.condition in by_condition
        for row in by_condition[point.condition].itertuples()
        if row.bits
    ]


def worst_points(swept: Sequence[SweptAccuracy], method: str) -> list[SweptAccuracy]:
    """Find the values of sweeps that ``method`` reads below `WELL_READ`, the worst first."""
    mine = [entry for entry in swept if entry.method == method and entry.accuracy < WELL_READ]
    return sorted(mine, key=lambda entry: entry.accuracy)


def _resamples(run: Run) -> np.random.Generator:
    """The generator with which every comparison of a run draws its resamples."""
    return np.random.default_rng(run.seed)


def _wrong_shares(records: pd.DataFrame) -> dict[str, float]:
    """Share of wrong bits by method; 1 where no bit is known."""
    sums = records.groupby("method", sort=False)[["known", "correct"]].sum()
    return {
        str(row.Index): 1 - row.correct / row.known if row.known else 1.0
        for row in sums.itertuples()
    }
