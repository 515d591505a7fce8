"""Method 3, OORC: calibration and bit decision in one convex SVM (paper, § mainalgorithm).

With g(i) = sum a_k i^k, the decision w (g(i_o) - g(i_e)) + b is linear in
    Phi(i_o, i_e) = [i_o^4 - i_e^4, i_o^3 - i_e^3, i_o^2 - i_e^2, i_o - i_e],
so an SVM in that space finds g and the threshold together. The differences of Legendre polynomials
P_k(2 i - 1) span the same space and keep the problem well conditioned; `paper_coefficients`
turns their weights into the paper's a_k. Since bit 1 makes i_e brighter, weights come out negative.
"""

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Legendre, Polynomial
from numpy.typing import NDArray

from link.frames import Rectified, SoftBits
from models.classical.common import Array, decode_with_svm, require_ratex


def legendre(i: Array, degree: int) -> Array:
    """P_1 ... P_degree at 2 i - 1, for intensities i in [0, 1]: (...) -> (..., degree)."""
    x = 2 * i - 1
    terms = [np.ones_like(x), x]
    for k in range(1, degree):
        terms.append(((2 * k + 1) * x * terms[k] - k * terms[k - 1]) / (k + 1))
    return np.stack(terms[1 : degree + 1], axis=-1)


def explicit_map(i_o: Array, i_e: Array, degree: int = 4) -> Array:
    """Phi in the Legendre basis: (...) and (...) in [0, 1] -> (..., degree)."""
    return np.asarray(legendre(i_o, degree) - legendre(i_e, degree))


def kernel(a: Array, b: Array, degree: int = 4) -> Array:
    """The equivalent kernel K = Phi(a) . Phi(b), from the Legendre Gram matrix.

    With S(x, y) = sum_k P_k(x) P_k(y), K expands into S(o, o') - S(o, e') - S(e, o') + S(e, e').
    Fit for ``SVC(kernel=kernel)``.

    Args:
        a: (N, 2) columns i_o, i_e in [0, 1].
        b: (M, 2) likewise.
        degree: of g.

    Returns:
        (N, M).
    """
    left, right = legendre(np.asarray(a), degree), legendre(np.asarray(b), degree)
    gram = np.einsum("nik,mjk->nmij", left, right)
    return np.asarray(gram[:, :, 0, 0] - gram[:, :, 0, 1] - gram[:, :, 1, 0] + gram[:, :, 1, 1])


def inverse_response(weights: NDArray[np.float64]) -> Legendre:
    """g up to scale and offset, from the weights of Phi: increasing where the CDTF is.

    Args:
        weights: (degree,) of the Legendre features.

    Returns:
        g over captured intensities in [0, 1].
    """
    return Legendre(np.concatenate([[0.0], -weights]), domain=[0, 1])


def paper_coefficients(weights: NDArray[np.float64]) -> NDArray[np.float64]:
    """a_0 ... a_degree of g(i) = sum a_k i^k for i in [0, 1], up to a common scale."""
    return np.asarray(inverse_response(weights).convert(kind=Polynomial, domain=[-1, 1]).coef)


@dataclass(frozen=True)
class OORC:
    """Optimal online radiometric calibration."""

    degree: int = 4
    """Of the inverse response g."""
    C: float = 1.0
    """Weight of the SVM's loss."""
    pooling: str = "mean"
    """"mean" or "vote"."""
    train_on: str = "tile"
    """"tile" or "pixel"."""

    def decode(self, pair: Rectified) -> SoftBits:
        """Score every message block; raises `UnsuitedError` without ratex patches."""
        pixels = require_ratex(pair)

        def phi(i_o: Array, i_e: Array) -> Array:
            return explicit_map(i_o, i_e, self.degree)

        return decode_with_svm(pair, pixels, phi, self.C, self.pooling, self.train_on)
