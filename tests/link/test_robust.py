"""Iteratively reweighted least squares: one helper for registration, edges, patches and corners."""

import numpy as np
import pytest
from tolerances import FLOAT64

from link.robust import cauchy_weights, geman_mcclure_weights, reweighted, ridge_solution


def test_without_a_ridge_the_solution_is_that_of_weighted_least_squares() -> None:
    rng = np.random.default_rng(0)
    A, b, weights = rng.normal(size=(40, 3)), rng.normal(size=40), rng.uniform(0, 2, 40)
    root = np.sqrt(weights)
    expected = np.linalg.lstsq(A * root[:, None], b * root, rcond=None)[0]
    found = ridge_solution(A, b, weights, np.zeros((3, 3)))
    np.testing.assert_allclose(found, expected, rtol=1e3 * FLOAT64, atol=1e3 * FLOAT64)


def test_a_strong_ridge_holds_the_solution_where_it_is_pulled() -> None:
    rng = np.random.default_rng(1)
    A, b, ridge, expected = (
        rng.normal(size=(40, 3)),
        rng.normal(size=40),
        1e9 * np.eye(3),
        [1, -2, 5],
    )
    held = ridge_solution(A, b, np.ones(40), ridge)
    pulled = ridge_solution(A, b, np.ones(40), ridge, pull=ridge @ expected)
    np.testing.assert_allclose(held, 0, atol=1e-6)
    np.testing.assert_allclose(pulled, expected, atol=1e-6)


@pytest.mark.parametrize("weigh", [cauchy_weights, geman_mcclure_weights])
def test_a_line_is_found_though_three_points_in_ten_lie_elsewhere(weigh: object) -> None:
    assert callable(weigh)
    rng = np.random.default_rng(2)
    A = np.column_stack([np.ones(100), np.linspace(0, 1, 100)])
    b = A @ [2.0, -3.0] + rng.normal(0, 0.01, 100)
    b[::10] += 40
    b[1::10] += 20
    b[2::10] += 30
    plain = ridge_solution(A, b, np.ones(100), np.zeros((2, 2)))
    found, weights = reweighted(
        solve=lambda w: ridge_solution(A, b, w, np.zeros((2, 2))),
        residuals_of=lambda x: np.abs(b - A @ x),
        scale_of=lambda residuals: 3 * float(np.median(residuals)) + 1e-9,
        rounds=50,
        weights=np.ones(100),
        weigh=weigh,
    )
    assert np.abs(plain - [2, -3]).max() > 5
    np.testing.assert_allclose(found, [2, -3], atol=0.02)
    assert weights[::10].max() < 0.01 < 0.4 < np.median(weights[3::10])


def test_weights_of_the_first_round_are_those_given() -> None:
    seen = []
    reweighted(
        solve=lambda w: seen.append(w) or w,
        residuals_of=lambda _: np.array([0.0, 2.0]),
        scale_of=lambda residuals: float(residuals.max()),
        rounds=2,
        weights=np.array([7.0, 8.0]),
    )
    assert [w.tolist() for w in seen] == [[7, 8], [1, 0.5]]
