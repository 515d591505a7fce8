"""Score frame pairs in order: by windows of film, or each by its own two states.

A window of film says more of a frame pair than its two states do, unless the picture moves.
"""

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from link.clock import DisplayClock
from link.frames import SoftBits
from models.film.window import reads_films
from models.pairwise import trust_of_purity
from receiver.decoders import PairDecoder, WindowDecoder
from receiver.reading.film import FilmDesk, information
from receiver.reading.occlusion import Occlusion
from receiver.reading.states import DisplayState, block_purity, unseen_state
from receiver.reading.unseen import fill_unseen, unseen_blocks
from receiver.seen import SeenFrames
from receiver.sight import StageTimes
from receiver.tracking.corners import Placement

PAIRS_A_FRAME = 2
"""Largest number of frame pairs that are scored one by one with one camera frame. Many wait when
the clock has just been found; the next frames take the rest, so that no frame takes long."""
MOST_WAITING = 36
"""Largest number of frame pairs that wait for the film decoder."""
VAGUE = 0.05
"""Information in bits a block below which the film's scores are compared with those of a pair,
which says more where the picture moves."""


@dataclass(eq=False)
class ComposedPair:
    """A frame pair that is over on the display, and waits to be decoded."""

    number: int
    """Number of the frame pair."""
    original: DisplayState
    """First state of the pair."""
    embedded: DisplayState
    """Second state of the pair."""
    placements: Sequence[Placement] = ()
    """Placements of its frames; none where no more frames come, or patches tell the corners."""
    soft: SoftBits | None = None
    """Its scores, 0 for erased blocks; None until it is scored."""
    alone: bool = False
    """Whether its own two states say more of it than a window of film."""


class PairScorer:
    """Scores the frame pairs of one display in the order in which they were shown.

    Args:
        decoder: scores a frame pair by its two states.
        film: scores windows of film; None where all is read by frame pairs.
        seen: the frames of which windows are cut.
        fps: nominal number of frames of the camera in a second.
        timing: takes the time spent in scoring.
    """

    def __init__(
        self,
        decoder: PairDecoder,
        film: WindowDecoder | None,
        seen: SeenFrames,
        fps: float,
        timing: StageTimes,
    ) -> None:
        self._decoder, self._layout = decoder, decoder.layout
        self._fps, self._timing = fps, timing
        self._occlusion = Occlusion(decoder.layout)
        self.film = (
            FilmDesk(decoder.layout, film, seen)
            if film is not None and reads_films(decoder.layout)
            else None
        )
        """Scores windows of film; None where all is read by frame pairs."""
        self.waiting: deque[ComposedPair] = deque()
        """Frame pairs that wait, in order; the first of them may be scored already."""

    @property
    def is_full(self) -> bool:
        """Whether no further frame pair should wait before some are scored."""
        waiting = sum(pair.soft is None for pair in self.waiting)
        return waiting >= (PAIRS_A_FRAME if self.film is None else MOST_WAITING)

    def put(
        self,
        number: int,
        original: DisplayState | None,
        embedded: DisplayState | None,
        placements: Sequence[Placement],
    ) -> None:
        """Take the next frame pair, whose states are None where no frame holds any of them."""
        if self.film is not None:  # which reads what a slow camera sees of one state alone
            original, embedded = (
                original or unseen_state(embedded),
                embedded or unseen_state(original),
            )
        if original is not None and embedded is not None:
            self.waiting.append(ComposedPair(number, original, embedded, placements))

    def scored(self, clock: DisplayClock, *, over: bool) -> Iterator[tuple[ComposedPair, SoftBits]]:
        """Score frame pairs that wait, as many as one camera frame leaves time for.

        Args:
            clock: says when the display shows which state.
            over: whether the frames have ended, and all pairs are scored.

        Yields:
            the next pair and its scores.
        """
        alone = 0
        while self.waiting:
            pair = self.waiting[0]
            if self.film is not None and pair.soft is None and not pair.alone:
                waiting_s = 2 * clock.period * len(self.waiting)
                if not (over or self.film.due(self._fps, waiting_s)):
                    return
                self._score_window(self.film, clock)
            if pair.soft is None:
                if alone >= PAIRS_A_FRAME and not over:
                    return
                alone += 1
                pair.soft = self.score(pair)
            self.waiting.popleft()
            yield pair, pair.soft

    def trust(self, pair: ComposedPair) -> NDArray[np.float64]:
        """Say how far each block's states are pure enough to be told apart: (n_bits,) in [0, 1]."""
        purity = np.minimum(pair.original.purity, pair.embedded.purity)
        pure = block_purity(purity, self._layout)
        return trust_of_purity(pure)

    def _score_window(self, film: FilmDesk, clock: DisplayClock) -> None:
        """Score the first pairs that wait by a window, or leave them to their own two states."""
        start = perf_counter()
        scores = film.score(clock, [pair.number for pair in self.waiting])
        self._timing.add("film", start)
        done = [self.waiting[at] for at in range(len(scores))]
        known = np.mean([information(scores[pair.number]) for pair in done])
        alone = information(self._score_states(done[-1]).scores) if known < VAGUE else 0.0
        for pair in done:
            pair.alone = bool(known < alone)
            if not pair.alone:
                pair.soft = self._without_covered(pair, SoftBits(scores[pair.number]))

    def score(self, pair: ComposedPair) -> SoftBits:
        """Decode the two states of a pair, and erase what is covered or impure."""
        return self._without_covered(pair, self._score_states(pair))

    def _score_states(self, pair: ComposedPair) -> SoftBits:
        """Decode the two states of a pair, whatever covers them, and erase what is impure."""
        start = perf_counter()
        purity = np.minimum(pair.original.purity, pair.embedded.purity)
        images = [pair.original.image, pair.embedded.image]
        unseen = unseen_blocks(images[0], images[1], purity, self._layout)
        soft = self._decoder.decode(*fill_unseen(images, unseen, self._layout))
        trusted = soft.scores * self.trust(pair)
        self._timing.add("decode", start)
        return SoftBits(trusted, soft.head)

    def _without_covered(self, pair: ComposedPair, soft: SoftBits) -> SoftBits:
        """Erase what something in front of the display covers; a pair is asked about once."""
        return SoftBits(soft.scores * ~self._occlusion.covered(pair.original.image), soft.head)
