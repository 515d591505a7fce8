"""Scores as both collectors use them: cut to a range, and what they know and agree with."""

import numpy as np
from numpy.typing import NDArray

from link.code.message import MAX_SCORE


def cut_scores(scores: NDArray[np.floating]) -> NDArray[np.float64]:
    """Cut log-likelihood ratios to ±`MAX_SCORE`; NaN becomes 0, which says nothing about a bit."""
    return np.asarray(np.clip(np.nan_to_num(scores), -MAX_SCORE, MAX_SCORE), np.float64)


def information_of(llr: NDArray[np.floating]) -> float:
    """Add up the information that log-likelihood ratios hold, in bits.

    Args:
        llr: log-likelihood ratios of bits, natural logarithm, of any shape.
    """
    size = np.abs(llr)
    entropy = np.log1p(np.exp(-size)) + size / (1 + np.exp(size))
    return float(llr.size - entropy.sum(dtype=np.float64) / np.log(2))


def agreement_of(scores: NDArray[np.floating], bits: NDArray[np.uint8]) -> float:
    """Return the share of the scores' weight, in [0, 1], that agrees with bits of their shape."""
    weight = np.abs(scores)
    return float(weight[(scores > 0) == (bits == 1)].sum() / weight.sum())
