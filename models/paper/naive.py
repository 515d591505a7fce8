"""Method 1, naive threshold: no calibration, only an SVM on i_e - i_o (paper, section Results)."""

from dataclasses import dataclass

from link.frames import SoftBits
from link.observation import Observation
from models.paper.common import decode_by_difference


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
        threshold = None if self.threshold is None else self.threshold / 255
        return decode_by_difference(pair, lambda i: i, threshold, self.C)
