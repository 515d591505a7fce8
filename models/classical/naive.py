"""Method 1, naive threshold: no calibration, a 1-D SVM on i_e - i_o (paper, § Results)."""

from dataclasses import dataclass

from link.frames import Rectified, SoftBits
from link.images import intensity
from models.classical.common import (
    Array,
    decode_with_svm,
    decode_with_threshold,
    require_ratex,
)


def difference(i_o: Array, i_e: Array) -> Array:
    """u = [i_e - i_o], shape (..., 1)."""
    return (i_e - i_o)[..., None]


@dataclass(frozen=True)
class Naive:
    """Threshold on the captured difference, learned on this pair's ratex patches."""

    C: float = 10.0
    """Weight of the SVM's loss."""
    pooling: str = "mean"
    """"mean" or "vote"."""
    train_on: str = "tile"
    """"tile" or "pixel"."""
    threshold: float | None = None
    """Fixed, in captured gray levels; None learns it on each pair's ratex patches."""

    def decode(self, pair: Rectified) -> SoftBits:
        """Score every message block; raises `UnsuitedError` without ratex patches."""
        pixels = require_ratex(pair)
        if self.threshold is not None:
            change = intensity(pair.embedded) - intensity(pair.original)
            return decode_with_threshold(pair, change, self.threshold / 255, self.pooling)
        return decode_with_svm(pair, pixels, difference, self.C, self.pooling, self.train_on)
