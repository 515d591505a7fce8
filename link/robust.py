"""Robust least squares: a few wrong measurements must not pull a fit away from the many right ones.

Iteratively reweighted least squares (Holland & Welsch 1977) solves a weighted problem, looks at the
residuals, gives large ones less weight, and solves again. `reweighted` is that loop. The problem
that it solves in each round may be linear (`ridge_solution`) or any other.
"""

from collections.abc import Callable

import numpy as np

from link.types import Array

MAD_TO_SIGMA = 1.4826
"""Standard deviation of Gaussian numbers, in medians of their absolute values."""


def cauchy_weights(ratio: Array) -> Array:
    """Weights in (0, 1] that fall with the square of the residual (Cauchy's distribution).

    Args:
        ratio: residuals in units of the residual that keeps half its weight.

    >>> cauchy_weights(np.array([0.0, 1.0, 3.0])).tolist()
    [1.0, 0.5, 0.1]
    """
    return 1 / (1 + ratio**2)


def geman_mcclure_weights(ratio: Array) -> Array:
    """Weights in (0, 1] that fall with the fourth power of the residual (Geman & McClure 1987).

    Args:
        ratio: residuals in units of the residual that keeps a quarter of its weight.
    """
    return 1 / (1 + ratio**2) ** 2


def ridge_solution(
    A: Array, b: Array, weights: Array, ridge: Array, pull: Array | None = None
) -> Array:
    """Minimise sum(weights * (b - A x)**2) + x' ridge x - 2 pull' x by the normal equations.

    Args:
        A: (N, P) float64, a row for each measurement.
        b: (N,) float64 measurements.
        weights: (N,) weights, 0 or more.
        ridge: (P, P) positive semidefinite matrix that holds the solution where measurements do
            not determine it.
        pull: (P,) ridge times the solution that is expected beforehand; 0 where absent.

    Returns:
        (P,) float64.
    """
    normal = (A.T * weights) @ A + ridge
    right = A.T @ (weights * b)
    return np.asarray(np.linalg.solve(normal, right if pull is None else right + pull), np.float64)


def reweighted(
    solve: Callable[[Array], Array],
    residuals_of: Callable[[Array], Array],
    scale_of: Callable[[Array], float],
    rounds: int,
    weights: Array,
    weigh: Callable[[Array], Array] = cauchy_weights,
) -> tuple[Array, Array]:
    """Solve a least-squares problem again and again, with less weight on what fits badly.

    Args:
        solve: (N,) weights to the solution of the weighted problem, an array of any shape.
        residuals_of: a solution to the (N,) absolute residuals that it leaves.
        scale_of: (N,) residuals to the unit in which ``weigh`` takes them, greater than 0.
        rounds: number of solutions, at least 1.
        weights: (N,) weights of the first round.
        weigh: residuals in units of the scale to weights.

    Returns:
        the last solution, and the (N,) weights that its residuals give.

    A mean that one wrong measurement in five hardly moves:

    >>> b, A = np.array([1.0, 1.1, 0.9, 1.0, 50.0]), np.ones((5, 1))
    >>> mean, weights = reweighted(
    ...     solve=lambda w: ridge_solution(A, b, w, np.zeros((1, 1))),
    ...     residuals_of=lambda x: np.abs(b - A @ x),
    ...     scale_of=lambda residuals: 3 * float(np.median(residuals)),
    ...     rounds=20,
    ...     weights=np.ones(5),
    ... )
    >>> round(float(mean[0]), 2)
    1.0
    """
    for _ in range(rounds):
        solution = solve(weights)
        residuals = residuals_of(solution)
        weights = weigh(residuals / scale_of(residuals))
    return solution, weights
