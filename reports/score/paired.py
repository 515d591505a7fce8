"""Two methods on identical captures: bootstrap over frame pairs, and McNemar's test over bits.

Errors cluster by frame pair. The bootstrap resamples whole frame pairs and is the one to trust;
McNemar's test takes bits for independent. Both hold for the pictures that were shown.
"""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.stats import binomtest, norm, t

from link.errors import InputError, choose
from reports.engine.checked import Count, Number, Share
from reports.engine.records import CELL, FRAME

KEYS = ["condition", *FRAME]
"""Columns that name a frame pair of a study."""
COUNTS = ["bits", "wrong", "reference_wrong", "both_wrong"]
"""Columns of `tally`: numbers of known bits, and of bits that each or both decide wrong."""
REFERENCES = ("oorc", "hidden_ratex")
"""Methods of the paper with which others are compared."""
RESAMPLES, CHUNK = 10_000, 200
"""Resamples of the bootstrap, and how many of them are drawn at a time."""
MIN_FRAMES = 5
"""Fewer frame pairs than this give no interval: it would rest on a handful of resamples."""

Counts = NDArray[np.int64]


@dataclass(frozen=True)
class Paired:
    """A method against a reference on identical captures; 95 % intervals are over frame pairs."""

    frames: Count
    """Number of frame pairs."""
    bits: Count
    """Number of bits whose truth is known."""
    difference: Number
    """Accuracy of the method less that of the reference, points; positive is better."""
    low: Number
    """Lower end of the interval of the difference, points; -100 for fewer than 5 frame pairs."""
    high: Number
    """Upper end of the interval of the difference, points; 100 for fewer than 5 frame pairs."""
    ratio: Number | None
    """Errors of the method over those of the reference; None where the reference makes none."""
    ratio_low: Number
    """Lower end of the interval of the ratio."""
    ratio_high: Number | None
    """Upper end of the interval of the ratio. It is None where there is no upper bound, because in
    some resamples the reference makes no error."""
    better: Count
    """Number of bits that the method has right and the reference wrong."""
    worse: Count
    """Number of bits that the method has wrong and the reference right."""
    p_bits: Share
    """McNemar's exact two-sided p over discordant bits, as if bits were independent."""


def tally(records: pd.DataFrame, method: str, reference: str) -> pd.DataFrame:
    """Match two methods by frame pair.

    Args:
        records: predictions, as `reports.engine.records.to_records` makes them.
        method: label of one method.
        reference: label of the other.

    Returns:
        `KEYS` and `COUNTS`, a row a frame pair, in the order of the method's predictions.

    Raises:
        InputError: a method is missing or has a frame pair twice, or the two do not have the same
            frame pairs and bits.
    """
    present = {name: name for name in records["method"].unique()}
    sides = []
    for name in (choose(present, method, "method"), choose(present, reference, "method")):
        mine = records[records["method"] == name]
        twice = mine[mine.duplicated(KEYS)]
        if len(twice):
            raise InputError(f"{name}: frame pair {tuple(twice[KEYS].iloc[0])} is there twice")
        sides.append(mine[[*KEYS, "bits", "scores"]])
    both = sides[0].merge(sides[1], on=KEYS, how="outer", suffixes=("", "_"), indicator="side")
    if (both["side"] != "both").any():
        raise InputError(f"{method}, {reference}: not decoded from the same frame pairs")
    both = sides[0][KEYS].merge(both, on=KEYS, how="left")
    counts = []
    for row in both.itertuples(index=False):
        if not np.array_equal(row.bits, row.bits_):
            cell = ", ".join(f"{key} {getattr(row, key)}" for key in CELL)
            raise InputError(f"{method}, {reference}: bits of frame pair ({cell}) differ")
        known = row.bits >= 0
        wrong = ((row.scores > 0) != row.bits)[known]
        other = ((row.scores_ > 0) != row.bits)[known]
        counts.append((wrong.size, wrong.sum(), other.sum(), (wrong & other).sum()))
    return both[KEYS].join(pd.DataFrame(counts, columns=COUNTS, dtype=np.int64))


def compare(counts: Counts, rng: np.random.Generator) -> Paired:
    """Pool frame pairs.

    Args:
        counts: (frames, 4), the columns `COUNTS` of `tally`, with at least one known bit.
        rng: draws the resamples.
    """
    n = len(counts)
    total, method, reference, both = (int(value) for value in counts.sum(axis=0))
    (low, high), (ratio_low, ratio_high) = (-1.0, 1.0), (0.0, np.inf)
    if n >= MIN_FRAMES:
        draws = (rng.integers(0, n, (CHUNK, n)) for _ in range(RESAMPLES // CHUNK))
        drawn = np.concatenate([counts[draw].sum(axis=1) for draw in draws]).T
        low, high = bootstrap_interval(drawn[2] - drawn[1], drawn[0], n)
        if reference:
            ratio_low, ratio_high = bootstrap_interval(drawn[1], drawn[2], n)
    better, worse = reference - both, method - both
    return Paired(
        frames=n,
        bits=total,
        difference=100 * (reference - method) / total,
        low=100 * low,
        high=100 * high,
        ratio=method / reference if reference else None,
        ratio_low=ratio_low,
        ratio_high=ratio_high if np.isfinite(ratio_high) else None,
        better=better,
        worse=worse,
        p_bits=float(binomtest(better, better + worse).pvalue) if better + worse else 1.0,
    )


def bootstrap_interval(top: Counts, bottom: Counts, n: int) -> tuple[float, float]:
    """95 % percentile interval of top / bottom over the (resamples,) of ``n`` frame pairs.

    Its tails are expanded for small ``n`` as by Student's t (Hesterberg 2015, "What teachers should
    know about the bootstrap"). 0 / 0 counts as anything from 0 to infinity. Where all frame pairs
    have the same ratio, as without any discordant bit, the width is 0: absence of evidence.
    """
    beyond = np.where(top == 0, [[0.0], [np.inf]], np.inf)
    lowest, highest = np.divide(top, bottom, out=beyond, where=bottom > 0)
    tail = norm.sf(np.sqrt(n / (n - 1)) * t.ppf(0.975, n - 1))
    low = np.quantile(lowest, tail, method="lower")
    return float(low), float(np.quantile(highest, 1 - tail, method="higher"))


def compare_methods(
    records: pd.DataFrame, method: str, reference: str, rng: np.random.Generator
) -> Paired | None:
    """Compare two methods of a study; None where they saw different captures or no bit is known.

    Args:
        records: predictions of both.
        method: label of one method.
        reference: label of the other.
        rng: draws the resamples.
    """
    try:
        counts = tally(records, method, reference)[COUNTS].to_numpy()
    except InputError:
        return None
    return compare(counts, rng) if counts[:, 0].sum() else None


def cells_behind(counts: pd.DataFrame, rng: np.random.Generator) -> int:
    """Count the cells in which a method is behind the reference beyond the paired 95 % interval.

    No allowance is made for their number: of 36 cells with equal methods 0.9 are expected by
    chance. A cell of fewer than 5 frame pairs never counts.

    Args:
        counts: what `tally` returns of both.
        rng: draws the resamples.
    """
    cells = counts.groupby(["condition", *CELL], sort=False, dropna=False)
    return sum(compare(group[COUNTS].to_numpy(), rng).high < 0 for _, group in cells)


def against_references(records: pd.DataFrame, seed: int) -> dict[str, Paired | None]:
    """Compare every method with the first of `REFERENCES` that decoded the same captures.

    Args:
        records: predictions.
        seed: seed of the resamples.

    Returns:
        comparisons by method, and None for a method without a reference or a known bit.
    """
    methods = [str(name) for name in records["method"].unique()]
    found: dict[str, Paired | None] = {}
    for method in methods:
        rivals = [name for name in REFERENCES if name in methods and name != method]
        compared = (
            compare_methods(records, method, rival, np.random.default_rng(seed)) for rival in rivals
        )
        found[method] = next((paired for paired in compared if paired), None)
    return found
