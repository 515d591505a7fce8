"""Method 4, hidden ratex: the histogram calibrates, no patch is shown (paper, § Hidden Ratex)."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from link.equalise import uniform_mapping
from link.errors import InputError, choose
from link.frames import Rectified, SoftBits
from link.layout import block_mean

SHRINKAGE = 4.0
"""Pseudo-observations that pull each class's variance to the common one (`reports.tune`)."""


def constant_threshold(differences: NDArray[np.float64], kappa: int | None) -> float:
    """The paper's constant: kappa / 2, half of the known difference."""
    if kappa is None:
        raise InputError("hidden_ratex with threshold 'constant' needs kappa; use 'clusters'")
    return kappa / 2


def cluster_threshold(differences: NDArray[np.float64], kappa: int | None) -> float:
    """The cut that splits this frame's differences into two Gaussian classes of least error.

    Kittler & Illingworth (1986) with equally likely bits and shrunk variances: the bits 1 scatter
    more than the bits 0, because the mapping amplifies them differently, so half-way is too high.
    It follows the offset that exposure drift adds to all blocks, and needs no kappa.
    """
    s = np.sort(differences, axis=None)
    n = s.size
    low = np.arange(2, n - 1)
    if low.size == 0:
        return float(s.mean())
    high = n - low
    sums, squares = np.cumsum(s), np.cumsum(s * s)
    mean_low, mean_high = sums[low - 1] / low, (sums[-1] - sums[low - 1]) / high
    scatter_low = squares[low - 1] - low * mean_low**2
    scatter_high = squares[-1] - squares[low - 1] - high * mean_high**2
    common = (scatter_low + scatter_high) / n + 1e-12
    variance_low = (scatter_low + SHRINKAGE * common) / (low + SHRINKAGE)
    variance_high = (scatter_high + SHRINKAGE * common) / (high + SHRINKAGE)
    cut = low[np.argmin(low * np.log(variance_low) + high * np.log(variance_high))]
    return float(s[cut - 1 : cut + 1].mean())


THRESHOLDS = {"clusters": cluster_threshold, "constant": constant_threshold}


@dataclass(frozen=True)
class HiddenRatex:
    """Map the captured original to a uniform histogram, map both frames alike, subtract.

    One mapping serves all colour channels, as one g does in the paper.
    """

    threshold: str = "clusters"
    """"clusters" (found in each frame) or "constant" (kappa / 2, the paper's)."""
    needs_ratex: ClassVar[bool] = False

    def decode(self, pair: Rectified) -> SoftBits:
        """Score every message block, in equalised gray levels above the threshold."""
        threshold = choose(THRESHOLDS, self.threshold, "threshold")
        mapping = uniform_mapping(pair.original)
        change = mapping[pair.embedded] - mapping[pair.original]
        if change.ndim == 3:
            change = change.mean(axis=2)
        layout = pair.layout
        grid = block_mean(change, layout.rows, layout.cols)
        blocks = np.asarray(grid[layout.message_mask], np.float64)
        return SoftBits(blocks - threshold(blocks, pair.kappa))
