"""Method 4, hidden ratex: the histogram calibrates, and no patch is shown.

The paper describes it in its section Hidden Ratex.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from link.embed import BOTTOM, TOP
from link.errors import UnsuitedError, choose
from link.frames import SoftBits
from link.images.equalise import uniform_mapping
from link.layout import block_mean
from link.observation import Observation


def cluster_threshold(differences: NDArray[np.float64], shrinkage: float) -> float:
    """Find the cut that splits a frame's differences into two Gaussian classes of least error.

    This is minimum error thresholding (Kittler & Illingworth 1986) with equally likely bits and
    shrunk variances. The bits 1 scatter more than the bits 0, because the mapping amplifies them
    differently, so a cut half-way between the means would be too high. The cut follows the offset
    that exposure drift adds to all blocks, and needs no kappa.

    Args:
        differences: mean difference of each block, equalised gray levels, any shape.
        shrinkage: number of pseudo-observations that pull each class's variance to the common one.

    Returns:
        the cut, in equalised gray levels.

    >>> cluster_threshold(np.array([0.0, 0.1, 0.2, 4.8, 5.0, 5.2]), shrinkage=1.0)
    2.5
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
    variance_low = (scatter_low + shrinkage * common) / (low + shrinkage)
    variance_high = (scatter_high + shrinkage * common) / (high + shrinkage)
    cut = low[np.argmin(low * np.log(variance_low) + high * np.log(variance_high))]
    return float(s[cut - 1 : cut + 1].mean())


@dataclass(frozen=True)
class HiddenRatex:
    """Decide by the difference of both frames after a mapping from the captured original.

    The mapping gives the captured original a uniform histogram, as the display's picture had. One
    mapping serves all colour channels, as one g does in the paper.
    """

    threshold: str = "clusters"
    """Rule for the threshold. "clusters" finds it in each frame; "constant" is the paper's,
    half-way between the changes of bit 0 and bit 1, which is half of kappa for on-off."""
    shrinkage: float = 1.0
    """Number of pseudo-observations that pull the variance of each class to the common one. 0 is as
    good (docs/tuning.md at the tag results-2026-11), but then two equal blocks make a class."""

    def decode(self, pair: Observation) -> SoftBits:
        """Score every message block of a frame pair, in equalised gray levels above the threshold.

        Raises:
            UnsuitedError: the threshold is "constant" and kappa is not known.
        """
        choose({"clusters": 0, "constant": 0}, self.threshold, "threshold")
        if self.threshold == "constant" and pair.kappa is None:
            raise UnsuitedError("threshold 'constant' needs kappa, which is not known")
        mapping = uniform_mapping(pair.original)
        change = mapping[pair.embedded] - mapping[pair.original]
        layout = pair.layout
        if change.ndim == 3:
            change = change.mean(axis=2)
        grid = block_mean(change, layout.rows, layout.cols)
        blocks = np.asarray(grid[layout.message_mask], np.float64)
        if self.threshold == "constant" and pair.kappa is not None:
            # equalising stretched the picture's range, and kappa with it, to [0, 255]
            stretch = 255 / (TOP - BOTTOM - pair.kappa)
            half = pair.kappa * sum(layout.change_of_bits) / 2
            return SoftBits(blocks - stretch * half)
        return SoftBits(blocks - cluster_threshold(blocks, self.shrinkage))
