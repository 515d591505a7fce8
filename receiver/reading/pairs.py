"""Score frame pairs one by one: each has two states, put together from camera frames."""

from collections.abc import Sequence
from dataclasses import dataclass
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from link.frames import SoftBits
from receiver.decoders import PairDecoder
from receiver.reading.occlusion import Occlusion
from receiver.reading.states import DisplayState, block_purity
from receiver.reading.unseen import fill_unseen, unseen_blocks
from receiver.sight import StageTimes

PURE_FROM, PURE_TO = 0.6, 0.95
"""Purities of a block's exposure at which its score begins to count, and counts in full."""


@dataclass(frozen=True)
class ComposedPair:
    """A frame pair that is over on the display, and waits to be decoded."""

    number: int
    """Number of the frame pair."""
    original: DisplayState
    """First state of the pair."""
    embedded: DisplayState
    """Second state of the pair."""
    moved: Sequence[NDArray[np.float64] | None] = ()
    """`BufferedFrame.moved` of the pair's frames; none where no more frames come."""


class PairScorer:
    """Scores the frame pairs of one display by their two states.

    Args:
        decoder: decoder of the display's layout.
        timing: takes the time spent in decoding.
    """

    def __init__(self, decoder: PairDecoder, timing: StageTimes) -> None:
        self._decoder, self._layout, self._timing = decoder, decoder.layout, timing
        self._occlusion = Occlusion(decoder.layout)

    def score(self, pair: ComposedPair) -> SoftBits:
        """Decode the two states of a pair, and erase what is covered or impure."""
        return self.without_covered(pair, self.score_states(pair))

    def score_states(self, pair: ComposedPair) -> SoftBits:
        """Decode the two states of a pair, whatever covers them, and erase what is impure."""
        start = perf_counter()
        purity = np.minimum(pair.original.purity, pair.embedded.purity)
        images = [pair.original.image, pair.embedded.image]
        unseen = unseen_blocks(images[0], images[1], purity, self._layout)
        soft = self._decoder.decode(*fill_unseen(images, unseen, self._layout))
        trusted = soft.scores * self.trust(pair)
        self._timing.add("decode", start)
        return SoftBits(trusted, soft.head)

    def trust(self, pair: ComposedPair) -> NDArray[np.float64]:
        """Say how far each block's states are pure enough to be told apart: (n_bits,) in [0, 1]."""
        purity = np.minimum(pair.original.purity, pair.embedded.purity)
        pure = block_purity(purity, self._layout)
        return np.asarray(np.clip((pure - PURE_FROM) / (PURE_TO - PURE_FROM), 0, 1))

    def without_covered(self, pair: ComposedPair, soft: SoftBits) -> SoftBits:
        """Erase what something in front of the display covers; a pair is asked about once."""
        return SoftBits(soft.scores * ~self._occlusion.covered(pair.original.image), soft.head)
