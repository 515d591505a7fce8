"""Method 2, two-step: calibrate, then threshold the calibrated difference.

The paper describes it in its section Results.
"""

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Legendre

from link.errors import UnsuitedError
from link.frames import SoftBits
from link.images import intensity
from link.observation import Observation
from link.ratex import TrainingPixels
from models.paper.common import decode_by_difference, require_ratex


def fit_inverse_response(pair: Observation, pixels: TrainingPixels, degree: int) -> Legendre:
    """Fit the inverse response g by least squares, with g(i) = rho on the ratex pixels.

    Args:
        pair: rectified frames, both of which are used.
        pixels: the ratex pixels of the pair's layout, with what they displayed.
        degree: degree of the polynomial g.

    Returns:
        g: captured intensity in [0, 1] -> displayed intensity in gray levels of [0, 255].

    Raises:
        UnsuitedError: kappa is unknown, so the displayed intensities are.
    """
    if pair.kappa is None:
        raise UnsuitedError("it needs kappa, to know what the ratex patches displayed")
    captured = [intensity(frame)[pixels.y, pixels.x] for frame in (pair.original, pair.embedded)]
    low, high = pair.layout.change_of_bits
    change = pair.kappa * np.where(pixels.label, high, low)
    displayed = [pixels.rho, pixels.rho + change]
    return Legendre.fit(np.concatenate(captured), np.concatenate(displayed), degree, domain=[0, 1])


@dataclass(frozen=True)
class TwoStep:
    """Fit the inverse response g first, then an SVM on the one feature g(i_e) - g(i_o)."""

    degree: int = 4
    """Degree of the polynomial g; the paper's is 4."""
    C: float = 100.0
    """Weight of the SVM's squared hinge loss."""
    threshold: float | None = None
    """Fixed threshold in displayed gray levels; None learns one on each pair's ratex patches."""

    def decode(self, pair: Observation) -> SoftBits:
        """Score every message block of a frame pair.

        Raises:
            UnsuitedError: the layout has no ratex patch, or kappa is not known.
        """
        g = fit_inverse_response(pair, require_ratex(pair), self.degree)
        return decode_by_difference(pair, g, self.threshold, self.C)
