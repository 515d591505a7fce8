"""PhiPolynomial: the paper's feature space as a torch layer, numerically conditioned."""

from torch import Tensor, nn

from link.errors import InputError

MAX_DEGREE = 12


class PhiPolynomial(nn.Module):
    """Polynomial differences, and optionally a polynomial of i_o alone (drift terms).

    Features k = 1 ... degree are P_k(2 i_o - 1) - P_k(2 i_e - 1) with Legendre P_k: the span of the
    paper's Phi = [i_o^4 - i_e^4, ..., i_o - i_e], conditioned well enough for float32. Drift terms
    P_1 ... P_drift_degree of 2 i_o - 1 make a change of exposure between the frames part of the
    same linear, convex problem: it adds to i_e an amount that depends on i_o.

    Raises:
        InputError: a degree is out of range.
    """

    def __init__(self, degree: int = 4, drift_degree: int = 0) -> None:
        super().__init__()
        if not 1 <= degree <= MAX_DEGREE or not 0 <= drift_degree <= degree:
            raise InputError(
                f"--degree: need 1 to {MAX_DEGREE} with 0 <= --drift-degree <= degree, "
                f"got {degree} and {drift_degree}"
            )
        self.degree, self.drift_degree = degree, drift_degree

    @property
    def n_features(self) -> int:
        """Features per pixel: degree + drift_degree."""
        return self.degree + self.drift_degree

    @property
    def names(self) -> list[str]:
        """Name of each feature."""
        differences = [f"P{k}(i_o)-P{k}(i_e)" for k in range(1, self.degree + 1)]
        return differences + [f"P{k}(i_o)" for k in range(1, self.drift_degree + 1)]

    def forward(self, i_o: Tensor, i_e: Tensor) -> list[Tensor]:
        """Feature maps of a frame pair.

        Args:
            i_o: captured original, float in [0, 1], encoded, any shape.
            i_e: captured embedded, the same shape.

        Returns:
            ``n_features`` tensors of that shape.
        """
        p_o, p_e = legendre(i_o, self.degree), legendre(i_e, self.degree)
        return [o - e for o, e in zip(p_o, p_e, strict=True)] + p_o[: self.drift_degree]


def legendre(i: Tensor, degree: int) -> list[Tensor]:
    """P_1 ... P_degree at 2 i - 1, by Bonnet's recursion; each of the shape of ``i``."""
    x = 2 * i - 1
    terms = [x, 1.5 * x * x - 0.5]
    for k in range(2, degree):
        terms.append(((2 * k + 1) / (k + 1)) * x * terms[-1] - (k / (k + 1)) * terms[-2])
    return terms[:degree]
