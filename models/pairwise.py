"""Frame pairs put together from the frames of a film, for decoders that take no more than two."""

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from link.frames import SoftBits
from link.layout import block_index
from link.observation import Observation
from link.types import Array, Image, Map, Real
from models import BlockDecoder
from models.film.window import gray_frames

PURE_FROM, PURE_TO = 0.6, 0.95
"""Purities of a block's exposure at which its score begins to count, and counts in full: of less, a
state is mixed with as much of its neighbours."""
PURITY_POWER = 4
"""Exponent by which frames whose exposure is purer count more where a state is put together."""


def trust_of_purity(purity: Real) -> Array:
    """Say how far states of some purity are told apart, in [0, 1], of the shape of ``purity``."""
    return np.asarray(np.clip((purity - PURE_FROM) / (PURE_TO - PURE_FROM), 0, 1), np.float64)


def decode_by_pairs(decoder: BlockDecoder, film: Observation) -> SoftBits:
    """Decode the frame pairs of a film one by one, each put together from the frames.

    Args:
        decoder: a decoder of frame pairs.
        film: frames that show more than one frame pair, or mix them.

    Returns:
        scores of all pairs; 0 at blocks of which no frame shows both states purely enough.

    Raises:
        UnsuitedError: the layout lacks what the decoder needs.
    """
    layout = film.layout
    film = replace(film, frames=tuple(gray_frames(film)))  # shrunk once for all pairs
    scores = []
    for number in range(film.mixture.count):
        original, embedded, purity = compose_pair(film, number)
        trust = trust_of_purity(purity)[layout.message_mask]
        if number and not trust.any():  # the first pair always shows whether the layout is suited
            scores.append(np.zeros(layout.n_bits))
            continue
        pair = Observation.still(original, embedded, layout, film.kappa)
        scores.append(decoder.decode(pair).scores * trust)
    return SoftBits(np.concatenate(scores))


def compose_pair(film: Observation, number: int) -> tuple[Image, Image, Map]:
    """Put the two states of a frame pair together from the frames that show most of them.

    Args:
        film: frames of which each mixes states in known shares.
        number: place of the frame pair among those of the film.

    Returns:
        the original and the embedded state, (height, width) uint8 gray of the layout's size, and
        the (rows, cols) purity of the less pure one in [0, 1], at each block.
    """
    layout, mixture = film.layout, film.mixture
    frames = gray_frames(film)
    own = (mixture.pair == number)[:, :, None, None]
    shares = (2 * mixture.shares * own).sum(1) * film.blocks_seen  # (T, rows, cols) in [-1, 1]
    states, purities = [], []
    for sign in (-1, 1):
        purity = np.clip(sign * shares, 0, 1)
        states.append(_weighted_mean(frames, purity**PURITY_POWER, layout.height, layout.width))
        purities.append(purity.max(0))
    return states[0], states[1], np.minimum(*purities)


def _weighted_mean(
    frames: NDArray[np.float32], weights: NDArray[np.float32], height: int, width: int
) -> Image:
    """Average (T, h, w) frames by the (T, rows, cols) weights of their blocks; enlarge the mean."""
    h, w = frames.shape[1:]
    rows, cols = weights.shape[1:]
    total = weights.sum(0, keepdims=True)
    weights = np.where(total > 0, weights / np.maximum(total, 1e-12), 1 / len(frames))
    at_pixels = weights[:, block_index(h, rows)][:, :, block_index(w, cols)]
    mean = (frames * at_pixels).sum(0)
    large = cv2.resize(mean, (width, height), interpolation=cv2.INTER_CUBIC)
    return np.asarray(np.clip(np.rint(large), 0, 255), np.uint8)
