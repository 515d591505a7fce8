"""Two methods on identical captures: bootstrap over frame pairs, and McNemar's test over bits.

Errors cluster by frame pair. The bootstrap resamples whole frame pairs and is the one to trust;
McNemar's test takes bits for independent. Both hold for the pictures that were shown.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binomtest, norm, t

from link.errors import InputError, choose

FIELDS = ("condition", "pair", "view_deg", "kappa", "index")
"""Of a prediction: what names a frame pair; all but the last name its cell."""
RESAMPLES, CHUNK = 10_000, 200
MIN_FRAMES = 5
"""Fewer frame pairs than this give no interval: it would rest on a handful of resamples."""

Counts = NDArray[np.int64]
Frame = tuple[Any, ...]
Outcomes = dict[str, dict[Frame, tuple[Counts, NDArray[np.bool_]]]]
"""By method and frame pair: the known bits, and whether each was decided wrong; both (bits,)."""


@dataclass(frozen=True)
class Paired:
    """A method against a reference on identical captures; 95 % intervals are over frame pairs."""

    frames: int
    bits: int
    difference: float
    """Accuracy of the method less that of the reference, points; positive is better."""
    low: float
    """Interval of the difference, points; -100 to 100 for fewer than 5 frame pairs."""
    high: float
    ratio: float | None
    """Errors of the method over those of the reference; None where the reference makes none."""
    ratio_low: float
    """Interval of the ratio."""
    ratio_high: float | None
    """None for no upper bound: in some resamples the reference makes no error."""
    better: int
    """Discordant bits: the method right, the reference wrong."""
    worse: int
    p_bits: float
    """McNemar's exact two-sided p over discordant bits, as if bits were independent."""


def outcomes(predictions: Iterable[Mapping[str, Any]]) -> Outcomes:
    """Decided bits against the truth.

    Args:
        predictions: lines of predictions.jsonl with method, those of `FIELDS` (condition may be
            left out), scores (n_bits,), and bits (n_bits,) where -1 is unknown.

    Raises:
        InputError: a method has a frame pair twice.
    """
    found: Outcomes = {}
    for line in predictions:
        frames, frame = found.setdefault(line["method"], {}), tuple(map(line.get, FIELDS))
        if frame in frames:
            raise InputError(f"{line['method']}: frame pair {frame} is there twice")
        truth, decided = np.array(line["bits"], np.int64), np.array(line["scores"]) > 0
        known = truth >= 0
        frames[frame] = truth[known], (decided != truth)[known]
    return found


def tally(found: Outcomes, method: str, reference: str) -> tuple[list[Frame], Counts]:
    """Match two methods by frame pair.

    Returns:
        the frame pairs, and for each (frames, 4) the number of known bits, wrong bits of the
        method, of the reference, and of both at once.

    Raises:
        InputError: a method is missing, or the two do not have the same frame pairs and bits.
    """
    mine, other = (choose(found, name, "method") for name in (method, reference))
    if mine.keys() != other.keys():
        raise InputError(f"{method}, {reference}: not decoded from the same frame pairs")
    counts = []
    for frame, (bits, wrong) in mine.items():
        reference_bits, reference_wrong = other[frame]
        if not np.array_equal(bits, reference_bits):
            raise InputError(f"{method}, {reference}: bits of frame pair {frame} differ")
        both = wrong & reference_wrong
        counts.append((bits.size, wrong.sum(), reference_wrong.sum(), both.sum()))
    return list(mine), np.array(counts, np.int64)


def compare(counts: Counts, rng: np.random.Generator) -> Paired:
    """Pool the frame pairs of `tally`'s counts, which must hold a bit; ``rng`` resamples them."""
    n = len(counts)
    total, method, reference, both = (int(value) for value in counts.sum(axis=0))
    (low, high), (ratio_low, ratio_high) = (-1.0, 1.0), (0.0, np.inf)
    if n >= MIN_FRAMES:
        draws = (rng.integers(0, n, (CHUNK, n)) for _ in range(RESAMPLES // CHUNK))
        drawn = np.concatenate([counts[draw].sum(axis=1) for draw in draws]).T
        low, high = interval(drawn[2] - drawn[1], drawn[0], n)
        if reference:
            ratio_low, ratio_high = interval(drawn[1], drawn[2], n)
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


def interval(top: Counts, bottom: Counts, n: int) -> tuple[float, float]:
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


def behind(
    found: Outcomes, method: str, reference: str, rng: np.random.Generator
) -> dict[Frame, Paired]:
    """Cells in which ``method`` is behind ``reference`` beyond the paired 95 % interval.

    No allowance is made for their number: of 36 cells with equal methods 0.9 are expected by
    chance. A cell of fewer than 5 frame pairs is never listed. Errors as of `tally`.
    """
    frames, counts = tally(found, method, reference)
    cells = [frame[:-1] for frame in frames]
    member = {cell: [other == cell for other in cells] for cell in dict.fromkeys(cells)}
    compared = {cell: compare(counts[rows], rng) for cell, rows in member.items()}
    return {cell: result for cell, result in compared.items() if result.high < 0}
