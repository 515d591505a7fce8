"""Scores of bits that a channel has disturbed, for the tests of codes and of collectors."""

import numpy as np
from numpy.typing import NDArray

from link.code.collect import Message, make_collector
from link.code.collect_coarse import CoarseCollector
from link.code.collect_fine import FineCollector
from link.types import Array

Bits = NDArray[np.integer]
"""(frames, n_bits) or any other shape, 0 or 1."""
Random = np.random.Generator


def noisy(bits: Bits, ber: float, rng: Random) -> Array:
    """Log-likelihood ratios of a binary symmetric channel."""
    signs = (2.0 * bits - 1) * np.where(rng.random(bits.shape) < ber, -1, 1)
    return np.asarray(np.log((1 - ber) / ber) * signs)


def shown(
    bits: Bits, rng: Random, frames: int, at: int = 0, ber: float = 0.02, erased: float = 0.0
) -> Array:
    """Scores of a display that shows a loop from frame ``at`` on, a share of them erased."""
    rows = noisy(bits[np.arange(at, at + frames) % len(bits)], ber, rng)
    rows[rng.random(rows.shape) < erased] = 0
    return rows


def listen(
    bits: Bits, rng: Random, *, ber: float, loss: float = 0.0, start: int = 0, loops: float = 6
) -> tuple[Message | None, int, int]:
    """The message of a loop, and the numbers of frames that were shown and received until then."""
    collector, received = make_collector(bits.shape[1]), 0
    for step in range(int(loops * len(bits)) + 4):
        if rng.random() < loss:
            continue
        received += 1
        message = collector.add(noisy(bits[(start + step) % len(bits)], ber, rng), 1000 + step)
        if message is not None:
            return message, step + 1, received
    return None, 0, 0


def keeps_scores(collector: CoarseCollector | FineCollector) -> bool:
    """Whether scores are kept that may be those of a message not returned yet."""
    return collector._loop is not None or collector.decoding
