"""Method 1, naive threshold: no calibration, only an SVM on i_e - i_o (paper, section Results)."""

from dataclasses import dataclass

from link.frames import SoftBits
from link.images import intensity
from link.observation import Observation
from link.types import Real
from models.paper.common import decode_with_svm, decode_with_threshold


def difference(i_o: Real, i_e: Real) -> Real:
    """Compute the one feature u = [i_e - i_o], with the shape (..., 1)."""
    return (i_e - i_o)[..., None]


@dataclass(frozen=True)
class Naive:
    """Decide by the captured difference, with a threshold that ratex patches or pilots teach."""

    C: float = 10.0
    """Weight of the SVM's squared hinge loss."""
    threshold: float | None = None
    """Fixed threshold in captured gray levels; None learns one on each pair's ratex patches or
    pilots."""

    def decode(self, pair: Observation) -> SoftBits:
        """Score every message block of a frame pair.

        Raises:
            UnsuitedError: the layout has neither ratex patches nor pilots to learn a threshold on.
        """
        if self.threshold is not None:
            change = intensity(pair.embedded) - intensity(pair.original)
            return decode_with_threshold(pair, change, self.threshold / 255)
        return decode_with_svm(pair, difference, self.C)
