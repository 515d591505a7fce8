"""OORC on windows of film: the paper's convex problem with many frames in place of two.

One linear head is fitted to the pilots of a window. Its target is the share of the bit in each
exposure, in [-1/2, 1/2], and its features are
    Phi(i_r, i_t) = [i_r^4 - i_t^4, i_r^3 - i_t^3, i_r^2 - i_t^2, i_r - i_t]
of the reference i_r, which is the mean of the window, and the frame i_t. So calibration and
decision stay one convex problem. The scores of a frame pair add up over all frames.
"""

import numpy as np

from link.errors import UnsuitedError
from link.frames import SoftBits
from link.layout import block_mean
from link.observation import Observation
from link.types import Array, Real

RIDGE = 1e-6
"""Weight of the head's squared norm beside the mean squared error, for features as they are."""


def smooth_terms(tone: Real) -> Array:
    """Make what changes smoothly with place and tone: 1, x, y, their squares, and the tone's.

    Args:
        tone: (rows, cols) mean intensity of the blocks in [0, 1].

    Returns:
        (11, B) terms.
    """
    y, x = ((2 * np.indices(tone.shape)[k] + 1) / tone.shape[k] - 1 for k in (0, 1))
    i = tone.astype(np.float64)
    terms = [np.ones_like(x), x, y, x * x, x * y, y * y, i, i * i, i**3, i * x, i * y]
    return np.stack(terms).reshape(len(terms), -1)


def decode_window(observation: Observation, features: Real, terms: Array, own: bool) -> SoftBits:
    """Fit a linear head to the pilots of a window, and score the message blocks of all its pairs.

    Args:
        observation: T frames of a layout with pilots, of B blocks.
        features: (T, B, D) features of the frames' blocks.
        terms: (n, B) what is taken out of each frame's features first, by least squares.
        own: whether each block has its own noise over time; else all blocks have the same.

    Returns:
        natural log-likelihood ratios, and the (D,) weights of the head.

    Raises:
        UnsuitedError: the layout has no pilots.
    """
    if not observation.layout.pilots:
        raise UnsuitedError("in films it trains on pilots and the layout has none")
    frames = len(features)
    seen = observation.blocks_seen.reshape(frames, -1).astype(np.float64)  # (T, B)
    known = observation.known.reshape(-1)  # (B,)
    mixture = observation.mixture
    # (T, S, rows, cols) -> (T, S, B)
    shares = mixture.shares.reshape(*mixture.pair.shape, -1) * seen[:, None]
    target = shares.sum(1) * known  # (T, B) what the exposures mix of known bits
    features = _without(features.astype(np.float64), terms, seen)
    pilots = (known != 0) & (seen > 0)  # (T, B)
    X, y = features[pilots], target[pilots]
    normal = X.T @ X / max(1, len(X)) + RIDGE * np.eye(X.shape[1])
    head = np.linalg.solve(normal, X.T @ y / max(1, len(X)))
    found = (features @ head) * seen
    noise = np.array(((found - target)[pilots] ** 2).mean() if len(X) else 1.0)
    if own:
        power = (found**2).sum(0) / np.maximum(seen.sum(0), 1)
        noise = noise * power / max(float(power[known != 0].mean()), 1e-12)
    sums = np.zeros((mixture.count, seen.shape[1]))
    for frame, slot in np.argwhere(mixture.pair >= 0):
        sums[mixture.pair[frame, slot]] += shares[frame, slot] * found[frame]
    llr = 2 * sums / np.maximum(noise, 1e-9)
    return SoftBits(llr[:, observation.layout.message_mask.reshape(-1)].reshape(-1), head)


def block_features(maps: Real, rows: int, cols: int) -> Real:
    """Average (T, D, h, w) features of pixels over blocks: (T, B, D)."""
    means = block_mean(maps, rows, cols)  # (T, D, rows, cols)
    return np.moveaxis(means.reshape(*means.shape[:2], -1), 1, 2)


def _without(features: Array, terms: Array, seen: Array) -> Array:
    """Take the least-squares fit of (n, B) terms out of each frame's (T, B, D) features."""
    used = terms * seen[:, None]  # (T, n, B)
    normal = used @ terms.T + RIDGE * np.eye(len(terms))
    return features - terms.T @ np.linalg.solve(normal, used @ features)
