"""Read frame pairs by their two states, each put together from camera frames."""

from collections import deque
from collections.abc import Iterator

import numpy as np

from link.clock import DisplayClock
from link.frames import SoftBits
from models.pairwise import trust_of_purity
from receiver.decoders import PairDecoder
from receiver.reading.occlusion import Occlusion
from receiver.reading.shown import ReadPair, States
from receiver.reading.states import compose_state
from receiver.reading.unseen import fill_unseen, unseen_blocks
from receiver.seen import SeenFrames
from receiver.sight import StageTimes

PAIRS_A_FRAME = 2
"""Largest number of frame pairs that are read with one camera frame. Many wait when the clock has
just been found; the next frames take the rest, so that no frame takes long."""


class PairReader:
    """Reads the frame pairs of one display in the order in which they were shown.

    Args:
        decoder: scores a frame pair by its two states.
        seen: the frames of which states are put together.
        timing: takes the time spent in each stage.
    """

    def __init__(self, decoder: PairDecoder, seen: SeenFrames, timing: StageTimes) -> None:
        self._decoder, self._layout = decoder, decoder.layout
        self._seen, self._timing = seen, timing
        self._occlusion = Occlusion(decoder.layout)
        self.read_until = -np.inf
        """Time of the newest frame that is needed no more, seconds."""
        self._waiting: deque[tuple[int, States]] = deque()
        self._next: int | None = None

    def begin_anew(self) -> None:
        """Nothing is to be done: a frame pair that shows two places is erased as covered."""

    def start_run(self) -> None:
        """Begin to count frame pairs anew."""
        self._next = None
        self._waiting.clear()

    def read(self, clock: DisplayClock, now: float) -> Iterator[ReadPair]:
        """Read the next frame pairs, as many as one camera frame leaves time for.

        Args:
            clock: says when the display shows which state.
            now: time of the newest frame, seconds; infinite where the frames have ended, and all
                pairs are read.
        """
        over, end = bool(np.isinf(now)), self._seen.end(clock, now)
        self._compose(clock, end, over=over)
        for _ in range(len(self._waiting) if over else PAIRS_A_FRAME):
            if not self._waiting:
                return
            yield self.decode(*self._waiting.popleft())

    def decode(self, number: int, shown: States) -> ReadPair:
        """Decode the two states of the pair of a number, and erase what is covered or impure."""
        with self._timing.stage("decode"):
            purity = np.minimum(shown.original.purity, shown.embedded.purity)
            unseen = unseen_blocks(*shown.images, purity, self._layout)
            soft = self._decoder.decode(*fill_unseen(shown.images, unseen, self._layout))
            trust = trust_of_purity(shown.purity)
            scores = soft.scores * trust * ~self._occlusion.covered(shown.original.image)
        return ReadPair(number, SoftBits(scores, soft.head), shown, 1 - float(trust.mean()))

    def _compose(self, clock: DisplayClock, end: float, *, over: bool) -> None:
        """Put the two states of frame pairs together.

        Args:
            clock: says when the display shows which state.
            end: number of the state that is shown when the frame pairs are over.
            over: whether the frames have ended, and all pairs are put together.
        """
        frames = deque(self._seen.after(self.read_until))
        while frames and frames[0].rectified.shape != frames[-1].rectified.shape:
            frames.popleft()  # they were gray, and now have colours, or the other way round
        if self._next is None and frames:
            self._next = int(np.ceil(clock.number(frames[0].time) / 2))
        while (
            self._next is not None
            and end >= 2 * self._next + 2
            and (over or len(self._waiting) < PAIRS_A_FRAME)
        ):
            states = self._layout.code.states_of(self._next)
            with self._timing.stage("compose"):
                original, embedded = (compose_state(frames, clock, state) for state in states)
            self._next += 1
            while frames and clock.number(frames[0].time + clock.latest) < 2 * self._next:
                self.read_until = frames.popleft().time  # no other pair needs it
            if original is not None and embedded is not None:
                shown = States(original, embedded, self._layout.message_mask)
                self._waiting.append((self._next - 1, shown))
