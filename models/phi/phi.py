"""PhiPolynomial: the paper's feature space as a torch layer, numerically conditioned."""

import numpy as np
from numpy.polynomial.legendre import leg2poly
from numpy.typing import NDArray
from torch import Tensor, nn

from models.phi.config import check_degrees


class PhiPolynomial(nn.Module):
    """Differences of polynomials of both intensities, and optionally polynomials of i_o alone.

    Feature k of 1 ... degree is P_k(2 i_o - 1) - P_k(2 i_e - 1), where P_k is the Legendre
    polynomial of degree k. Together they span the paper's
    Phi = [i_o^4 - i_e^4, ..., i_o - i_e] and are conditioned well enough for float32.

    The drift terms P_1 ... P_drift_degree of 2 i_o - 1 follow. A change of exposure between the
    frames adds to i_e an amount that depends on i_o; with these terms it is part of the same
    linear and convex problem.

    Args:
        degree: degree of the inverse response g, 1 to `models.phi.config.MAX_DEGREE`.
        drift_degree: number of drift terms, 0 to ``degree``.

    Raises:
        ParameterError: a degree is out of range.

    >>> import torch
    >>> phi = PhiPolynomial(degree=2, drift_degree=1)
    >>> phi.names
    ['P1(i_o)-P1(i_e)', 'P2(i_o)-P2(i_e)', 'P1(i_o)']
    >>> original, embedded = torch.tensor([0.5]), torch.tensor([0.75])
    >>> [feature.item() for feature in phi(original, embedded)]
    [-0.5, -0.375, 0.0]
    """

    def __init__(self, degree: int = 4, drift_degree: int = 0) -> None:
        super().__init__()
        check_degrees(degree, drift_degree)
        self.degree, self.drift_degree = degree, drift_degree

    @property
    def n_features(self) -> int:
        """Number of features of a pixel, which is ``degree + drift_degree``."""
        return self.degree + self.drift_degree

    @property
    def names(self) -> list[str]:
        """One name for each feature, in the order in which `forward` returns them."""
        differences = [f"P{k}(i_o)-P{k}(i_e)" for k in range(1, self.degree + 1)]
        return differences + [f"P{k}(i_o)" for k in range(1, self.drift_degree + 1)]

    def forward(self, i_o: Tensor, i_e: Tensor) -> list[Tensor]:
        """Compute the feature maps of a frame pair.

        Args:
            i_o: intensity of the captured original, float in [0, 1], encoded, any shape.
            i_e: intensity of the captured embedded frame, with the shape of ``i_o``.

        Returns:
            ``n_features`` tensors, each with the shape of ``i_o``.
        """
        p_o, p_e = legendre_maps(i_o, self.degree), legendre_maps(i_e, self.degree)
        return [o - e for o, e in zip(p_o, p_e, strict=True)] + p_o[: self.drift_degree]


def power_maps(i: Tensor, degree: int) -> list[Tensor]:
    """Compute the powers x, x^2, ..., x^degree of x = 2 i - 1.

    A mean over pixels of a Legendre polynomial is a sum of means of powers, of which a pixel has
    fewer operations (`legendre_from_powers`).

    Args:
        i: intensities in [0, 1], any shape.
        degree: number of powers, at least 1.

    Returns:
        ``degree`` tensors, each with the shape of ``i`` and values in [-1, 1].
    """
    terms = [2 * i - 1]
    for k in range(2, degree + 1):
        terms.append(terms[k // 2 - 1] * terms[k - k // 2 - 1])
    return terms


def legendre_from_powers(degree: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Give the Legendre polynomials P_1 ... P_degree as sums of powers.

    Returns:
        (degree, degree) factors of x, x^2, ..., x^degree in each polynomial, and (degree,) constant
        terms.

    >>> legendre_from_powers(2)
    (array([[1. , 0. ],
           [0. , 1.5]]), array([ 0. , -0.5]))
    """
    factors = np.zeros((degree, degree + 1))
    for k in range(1, degree + 1):
        factors[k - 1, : k + 1] = leg2poly(np.eye(k + 1)[k])
    return factors[:, 1:], factors[:, 0]


def legendre_maps(i: Tensor, degree: int) -> list[Tensor]:
    """Evaluate the Legendre polynomials P_1 ... P_degree at 2 i - 1, by Bonnet's recursion.

    `models.paper.oorc.legendre` evaluates them for numpy arrays. The two order their
    multiplications differently, and stay two functions so that no score changes. A feature's last
    bit changes the head that is fitted to a few tiles, and that moves scores by up to 4e-5 of
    their mean.

    Args:
        i: intensities in [0, 1], any shape.
        degree: number of polynomials, at least 1.

    Returns:
        ``degree`` tensors, each with the shape of ``i`` and values in [-1, 1].
    """
    x = 2 * i - 1
    terms = [x, 1.5 * x * x - 0.5]
    for k in range(2, degree):
        terms.append(((2 * k + 1) / (k + 1)) * x * terms[-1] - (k / (k + 1)) * terms[-2])
    return terms[:degree]
