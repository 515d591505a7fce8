"""The level and noise of blocks over a film: recursions beside the covariances they stand for."""

import numpy as np
import pytest
import torch

from models.film.background import UNKNOWN, background_of
from models.film.decoder import shares_seen

T, B = 12, 3


@pytest.fixture(scope="module")
def drawn():
    """Noise and drift (T, B) of blocks: one stands still, one drifts, one is cut and passed by."""
    rng = np.random.default_rng(0)
    noise, drift = rng.uniform(0.5, 2, (T, B)), np.zeros((T, B))
    drift[:, 1] = 0.3
    drift[5, 2], noise[8, 2] = 1000.0, 50.0
    return noise, drift


def covariances(noise, drift):
    """(B, T, T) covariances of what a block shows, and of its level alone."""
    steps = np.concatenate([UNKNOWN * noise[:1], drift[:-1]])
    below = np.tril(np.ones((T, T)))
    level = np.array([below @ np.diag(each) @ below.T for each in steps.T])
    return level + np.array([np.diag(each) for each in noise.T]), level


def in_torch(*arrays):
    return [torch.from_numpy(each) for each in arrays]


def test_white_values_have_the_inverse_covariance(drawn):
    model = background_of(*in_torch(*drawn))
    unit = torch.eye(T, dtype=torch.float64).unsqueeze(2).expand(-1, -1, B)  # (T, T, B)
    white = model.whiten(unit)
    both, _ = covariances(*drawn)
    for block in range(B):
        U = white[:, :, block].numpy()
        np.testing.assert_allclose(U.T @ U, np.linalg.inv(both[block]), rtol=1e-6, atol=1e-9)
        back = model.unwhiten(unit)[:, :, block].numpy()
        np.testing.assert_allclose(back, U.T, rtol=1e-9, atol=1e-12)


def test_levels_are_those_of_a_gaussian_process(drawn):
    model = background_of(*in_torch(*drawn))
    values = np.random.default_rng(1).standard_normal((T, B))
    left, spread = model.left(*in_torch(values)).numpy(), model.spread()
    both, level = covariances(*drawn)
    for block in range(B):
        weight = level[block] @ np.linalg.inv(both[block])
        posterior = level[block] - weight @ level[block]
        expected = values[:, block] - weight @ values[:, block]
        np.testing.assert_allclose(left[:, block], expected, rtol=1e-5, atol=1e-6)
        variance = spread.variance[:, block].numpy()
        np.testing.assert_allclose(variance, np.diag(posterior), rtol=1e-4)
        ahead = spread.carry[:-1, block].numpy() * variance[1:]
        np.testing.assert_allclose(ahead, np.diag(posterior, 1), rtol=1e-4, atol=1e-6)


def test_a_cut_costs_no_more_than_the_frames_between_which_it_lies(drawn):
    noise, drift = drawn
    values = np.where(np.arange(T)[:, None] > 5, 100.0, 0.0) + np.zeros((T, B))
    left = background_of(*in_torch(noise, drift)).left(*in_torch(values)).numpy()
    assert np.abs(left[:, 2]).max() < 1 < np.abs(left[:, 0]).max()


def test_energies_of_pairs_are_those_of_the_inverse_covariance(drawn):
    """Pairs of three frames, two of which overlap in each frame, each in a slot that changes."""
    rng = np.random.default_rng(2)
    pair = np.stack([np.arange(T) // 2, np.arange(T) // 2 + 1], axis=1)
    pairs = pair.max() + 1
    shares = rng.uniform(-0.5, 0.5, (T, 2, 1, B))
    mixture = shares_seen(
        *in_torch(shares.astype(np.float32), pair, np.arange(pairs)), torch.ones(T, B)
    )
    noise, drift = (each.float() for each in in_torch(*drawn))
    energy = mixture.energy(background_of(noise, drift)).numpy()
    both, _ = covariances(*drawn)
    for block in range(B):
        inverse = np.linalg.inv(both[block])
        for number in range(pairs):
            s = (shares[:, :, 0, block] * (pair == number)).sum(1)
            assert energy[number, block] == pytest.approx(s @ inverse @ s, rel=1e-2, abs=1e-3)
