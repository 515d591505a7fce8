"""Patterns over the blocks of a film: the weights are those of their covariance."""

import numpy as np
import torch
from scipy.linalg import subspace_angles

from models.film.patterns import find_patterns

T, B = 24, 4000
LARGEST_ANGLE = 0.1
"""Largest angle, in radians, between the strengths that are found and those that were drawn."""
LARGEST_ERROR = 0.25
"""Largest relative error of the covariance of the frames, as few steps leave it."""
LARGEST_CHANCE = 0.02
"""Largest share of the power of noise that is taken for patterns."""


def film(strengths, seed=0):
    """Residuals (T, B) of blocks that have the patterns of (T, K) strengths, and noise."""
    rng = np.random.default_rng(seed)
    noise = rng.standard_normal((T, B))
    return noise + strengths @ rng.standard_normal((strengths.shape[1], B))


def fitted(z):
    return find_patterns(torch.from_numpy(z).float())


def covariance(patterns):
    V = patterns.V.double().numpy()
    return V @ V.T + float(patterns.rest) * np.eye(T)


def test_patterns_are_found():
    rng = np.random.default_rng(1)
    strengths = 0.8 * rng.standard_normal((T, 2))
    patterns = fitted(film(strengths))
    found = np.linalg.svd(patterns.V.numpy())[0][:, :2]
    assert subspace_angles(found, strengths).max() < LARGEST_ANGLE
    drawn = np.eye(T) + strengths @ strengths.T
    drawn = drawn * T / np.trace(drawn)  # the power of all is 1
    error = np.linalg.norm(covariance(patterns) - drawn, 2) / np.linalg.norm(drawn, 2)
    assert error < LARGEST_ERROR


def test_noise_has_no_patterns():
    patterns = fitted(film(np.zeros((T, 1))))
    assert float(patterns.rest) > 1 - LARGEST_CHANCE


def test_frames_are_weighed_by_the_inverse_of_their_covariance():
    rng = np.random.default_rng(2)
    patterns = fitted(film(rng.standard_normal((T, 3))))
    values = rng.standard_normal((T, 5))
    given = patterns.weigh(torch.from_numpy(values).float()).numpy()
    np.testing.assert_allclose(
        given, np.linalg.solve(covariance(patterns), values), rtol=1e-3, atol=1e-4
    )


def test_the_energy_of_a_pair_is_that_of_its_weighed_shares():
    rng = np.random.default_rng(3)
    patterns = fitted(film(rng.standard_normal((T, 3))))
    shares = torch.from_numpy(rng.standard_normal((T, 1, 5))).float()
    strengths = patterns.V.unsqueeze(2).expand(-1, -1, 5)
    plain = (shares**2).sum(0)
    energy = patterns.energy(plain, shares, strengths, lambda slots: slots.sum(0))  # of one pair
    weighed = (shares[:, 0] * patterns.weigh(shares[:, 0])).sum(0)
    torch.testing.assert_close(energy[0], weighed, rtol=1e-4, atol=1e-4)
