"""Do log-likelihood ratios mean what they say? Bins of confidence, and the calibration error.

`reports.render.reliability` shows them as tables and as a diagram.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.special import expit

from reports.score.intervals import wilson

BINS = 10
"""Number of bins of equal width in which decisions of similar confidence are counted."""
ALL = "all"
"""Name of all conditions together, where their bits are counted beside those of each."""


@dataclass(frozen=True)
class Bin:
    """Bits that were decided with a similar confidence, which is max(p, 1 - p)."""

    low: float
    """Smallest confidence of the bin, in [0.5, 1]."""
    high: float
    """Largest confidence of the bin, in [0.5, 1]."""
    count: int
    """Number of bits, at least 1."""
    correct: int
    """Number of bits that were decided right."""
    confidence: float
    """Mean confidence of the bits, in [0.5, 1]."""
    ci_low: float
    """Lower end of Wilson's 95 % interval of the accuracy, as if bits were independent."""
    ci_high: float
    """Upper end of Wilson's 95 % interval of the accuracy."""

    @property
    def accuracy(self) -> float:
        """Share of the bits that were decided right, in [0, 1]."""
        return self.correct / self.count


Curves = Mapping[str, Mapping[str, Sequence[Bin]]]
"""Bins by method, then by condition, those in which the method decoded known bits."""


def known_scores(records: pd.DataFrame) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Collect the scores of predictions and their true bits, where the truth is known.

    Args:
        records: predictions of a method, as `reports.engine.records.to_records` makes them; at
            least one.

    Returns:
        (bits,) scores and (bits,) bits that are 0 or 1.
    """
    scores, bits = (np.concatenate(records[column].to_list()) for column in ("scores", "bits"))
    return scores[bits >= 0], bits[bits >= 0]


def confidence_bins(scores: NDArray[np.float64], bits: NDArray[np.integer]) -> list[Bin]:
    """Sort decisions into ten bins of confidence of equal width.

    >>> (only,) = confidence_bins(np.array([2.0, -2.1]), np.array([1, 1]))
    >>> only.count, only.correct, round(only.confidence, 2)
    (2, 1, 0.89)

    Args:
        scores: (bits,) natural log-likelihood ratios: p(bit = 1) = 1 / (1 + exp(-score)).
        bits: (bits,) 0 or 1.

    Returns:
        the bins that hold a bit, in ascending order.
    """
    confidence = expit(np.abs(scores))
    correct = (scores > 0) == (bits == 1)
    number = np.minimum(((2 * confidence - 1) * BINS).astype(np.int64), BINS - 1)
    edges = np.linspace(0.5, 1, BINS + 1)
    bins = []
    for i in np.unique(number):
        chosen = number == i
        count, right = int(chosen.sum()), int(correct[chosen].sum())
        mean = float(confidence[chosen].mean())
        bins.append(
            Bin(float(edges[i]), float(edges[i + 1]), count, right, mean, *wilson(right, count))
        )
    return bins


def decided_information(accuracy: float) -> float:
    """Work out the information of a decided bit about the sent one: of a symmetric channel, bits.

    Args:
        accuracy: share of bits that are read right, in [0, 1].

    Returns:
        a number in [0, 1]; 0 where the accuracy is at most 0.5, since nobody knows to turn bits.

    >>> round(decided_information(0.9), 3), decided_information(0.4), decided_information(1.0)
    (0.531, 0.0, 1.0)
    """
    if accuracy <= 0.5 or accuracy == 1:
        return float(accuracy == 1)
    shares = np.array([accuracy, 1 - accuracy])
    return float(1 + (shares * np.log2(shares)).sum())


def scored_information(scores: NDArray[np.float64], bits: NDArray[np.integer]) -> float:
    """Work out how much scores say, in bits of information for each bit that was sent.

    Decisions of a bin of confidence say what `decided_information` gives for its accuracy; bits of
    score 0 were erased and say nothing.

    >>> scored_information(np.array([9.0, 9.0, 0.0, 0.0]), np.array([1, 1, 0, 1]))
    0.5

    Args:
        scores: (bits,) log-likelihood ratios.
        bits: (bits,) what was sent, 0 or 1.
    """
    bins = confidence_bins(scores[scores != 0], bits[scores != 0])
    said = sum(each.count * decided_information(each.accuracy) for each in bins)
    return said / max(1, bits.size)


def told(records: pd.DataFrame) -> tuple[float, float]:
    """Work out what a method's scores tell, by how often bits of like scores are right.

    Args:
        records: predictions of the method, as `reports.engine.records.to_records` makes them, of
            whose bits at least one is known.

    Returns:
        the share of the known bits that were not erased, in [0, 1], and the bits of information in
        each, erased ones included.
    """
    scores, bits = known_scores(records)
    return float((scores != 0).mean()), scored_information(scores, bits)


def calibration_error(bins: Sequence[Bin]) -> float:
    """Mean |accuracy - confidence| over bins, weighted by count, in [0, 1] (Naeini et al. 2015).

    It is NaN where no bit was decided.
    """
    total = sum(b.count for b in bins)
    missed = sum(b.count * abs(b.accuracy - b.confidence) for b in bins)
    return missed / total if total else float("nan")


def reliability_curves(
    records: pd.DataFrame, methods: Sequence[str]
) -> dict[str, dict[str, list[Bin]]]:
    """Sort the decisions of methods into bins of confidence.

    Args:
        records: predictions of all conditions.
        methods: labels of methods whose scores are log-likelihood ratios.

    Returns:
        bins by method, then by those conditions in which the method decoded known bits.
    """
    known = records[(records["known"] > 0) & records["method"].isin(methods)]
    curves: dict[str, dict[str, list[Bin]]] = {}
    for (name, method), mine in known.groupby(["condition", "method"], sort=False):
        curves.setdefault(str(method), {})[str(name)] = confidence_bins(*known_scores(mine))
    return curves
