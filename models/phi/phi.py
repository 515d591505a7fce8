"""PhiPolynomial: the paper's feature space as a torch layer, numerically conditioned."""

import numpy as np
import torch
from numpy.polynomial.legendre import leg2poly
from numpy.typing import NDArray
from torch import Tensor, nn

from models.onnx_ops import table
from models.phi.config import check_degrees


class PhiPolynomial(nn.Module):
    """Differences of polynomials of both intensities, and polynomials of i_o alone.

    Feature k of 1 ... degree is P_k(2 i_o - 1) - P_k(2 i_e - 1), where P_k is the Legendre
    polynomial of degree k. Together they span the paper's
    Phi = [i_o^4 - i_e^4, ..., i_o - i_e] and are conditioned well enough for float32.

    The moments P_1 ... P_moments of 2 i_o - 1 follow. A head takes the first of them, up to
    ``drift_degree``, as drift terms: a change of exposure between the frames adds to i_e an amount
    that depends on i_o, and with these terms it is part of the same linear and convex problem.
    Others describe the tone of a tile or block.

    Who averages the features of pixels may have their powers in place of the polynomials, which
    take fewer operations: a mean of Legendre polynomials is a sum of means of powers
    (``by_powers``, `of_means`).

    Args:
        degree: degree of the inverse response g, 1 to `models.phi.config.MAX_DEGREE`.
        drift_degree: number of drift terms, 0 to ``degree``.
        moments: number of polynomials of i_o; ``drift_degree`` where it is less.
        by_powers: whether `forward` gives powers x, x^2, ... of x = 2 i - 1 in the places of
            polynomials.

    Raises:
        ParameterError: a degree is out of range.

    >>> phi = PhiPolynomial(degree=2, drift_degree=1)
    >>> phi.names
    ['P1(i_o)-P1(i_e)', 'P2(i_o)-P2(i_e)', 'P1(i_o)']
    >>> original, embedded = torch.tensor([0.5]), torch.tensor([0.75])
    >>> [feature.item() for feature in phi(original, embedded)]
    [-0.5, -0.375, 0.0]
    """

    def __init__(
        self, degree: int = 4, drift_degree: int = 0, moments: int = 0, by_powers: bool = False
    ) -> None:
        super().__init__()
        check_degrees(degree, drift_degree)
        self.degree, self.drift_degree = degree, drift_degree
        self.moments, self.by_powers = max(drift_degree, moments), by_powers
        if by_powers:
            self._tabulate_polynomials()

    def _tabulate_polynomials(self) -> None:
        """Tabulate how the means of changes of powers, then of powers, become polynomials'."""
        factors, constants = legendre_from_powers(max(self.degree, self.moments))
        n, m = self.degree, self.moments
        both = np.zeros((n + m, n + m))
        both[:n, :n], both[n:, n:] = factors[:n, :n], factors[:m, :m]
        self.factors = table(both)
        self.constants = table(np.append(np.zeros(n), constants[:m])[:, None])

    @property
    def n_features(self) -> int:
        """Number of features that a head weighs, which is ``degree + drift_degree``."""
        return self.degree + self.drift_degree

    @property
    def names(self) -> list[str]:
        """One name for each feature that a head weighs, in the order in which they are returned."""
        differences = [f"P{k}(i_o)-P{k}(i_e)" for k in range(1, self.degree + 1)]
        return differences + [f"P{k}(i_o)" for k in range(1, self.drift_degree + 1)]

    def forward(self, i_o: Tensor, i_e: Tensor) -> list[Tensor]:
        """Compute the feature maps of a frame pair.

        Args:
            i_o: intensity of the captured original, float in [0, 1], encoded, any shape.
            i_e: intensity of the captured embedded frame, whose shape broadcasts with ``i_o``'s.

        Returns:
            ``degree`` differences, each with the shape of both, then ``moments`` polynomials of
            i_o, each with its shape.
        """
        evaluate = power_maps if self.by_powers else legendre_maps
        p_o = evaluate(i_o, max(self.degree, self.moments))
        p_e = evaluate(i_e, self.degree)
        return [o - e for o, e in zip(p_o, p_e, strict=False)] + p_o[: self.moments]

    def of_means(self, means: Tensor) -> Tensor:
        """Turn means of what `forward` gives into means of polynomials.

        Args:
            means: (B, F, N) means over pixels, of the features in their order; others may follow.

        Returns:
            (B, F, N) means of Legendre polynomials, and of the others as they are.
        """
        if not self.by_powers:
            return means
        n = self.degree + self.moments
        sums = self.factors.to(means.dtype) @ means[:, :n] + self.constants.to(means.dtype)
        return torch.cat([sums, means[:, n:]], dim=1)


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
    terms = [x]
    for k in range(1, degree):
        before = terms[-2] if k > 1 else 1.0
        terms.append(((2 * k + 1) / (k + 1)) * x * terms[-1] - (k / (k + 1)) * before)
    return terms
