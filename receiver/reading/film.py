"""Read the frame pairs of a display by windows of the film in which it was seen.

Now and then a `FilmReader` hands a window of the last frames to the film decoder
(`models.film.decoder`), and takes the scores of all frame pairs that ended in it.
"""

from collections import deque
from collections.abc import Iterator, Sequence
from itertools import accumulate

import numpy as np

from link.clock import DisplayClock
from link.frames import SoftBits
from link.layout import Layout
from link.observation import Observation, mixture_of_exposures
from link.pilots import changes_of_bits
from link.types import Array, Map
from receiver.decoders import WindowDecoder
from receiver.pilots.compensate import MovingPicture
from receiver.reading.shown import InWindow, ReadPair
from receiver.seen import SeenFrame, SeenFrames
from receiver.sight import StageTimes

WINDOW, FINE_WINDOW = 32, 24
"""Largest number of frames in a window, and in one of a fine grid, which takes longer."""
LEAST_FRAMES = 8
"""Smallest number of frames in a window: its mean is the reference."""
LEARNT, FINE_LEARNT = 12, 6
"""Largest number of frames of a window that tell where the corners lie, and of one of a fine grid,
whose frames tell more and take longer. It bounds the work; frames of a window that were not learned
from tell little that its newest do not."""
MOST_WAITING = 36
"""Largest number of frame pairs that are read by one window."""
MOST_PAIRS = 64
"""Largest number of frame pairs over which a window reaches. Memory and time grow with it, and a
camera that misses frames would let it grow without end."""
FINE_BLOCKS = 8000
"""Number of blocks from which a grid counts as fine."""
STRIDE_S, LATER_STRIDE_S, HURRIED = 0.2, 0.3, 3
"""Seconds of film from one window to the next, or for which the frame pairs of a window were shown
at least: on slow displays each frame pair is scored as soon as it is over. The first stride
holds for `HURRIED` windows, in which a short message is complete; the second one for later windows,
of which fewer then say as much."""
MISSED, FRESH_FRAMES = 1.5, 12
"""A camera that does not wait gives no frames while a window is scored. Frames count as missed if
there are more than `MISSED` nominal frames for each new one since the last window. The next window
then waits for `FRESH_FRAMES` new ones."""


class FilmReader:
    """Reads the frame pairs of one display in the order in which they were shown.

    Args:
        layout: layout of the display, of which `models.film.window.reads_films` is true.
        decoder: the film decoder.
        seen: the frames of which windows are cut.
        fps: nominal number of frames of the camera in a second.
        timing: takes the time spent in each stage.
    """

    def __init__(
        self,
        layout: Layout,
        decoder: WindowDecoder,
        seen: SeenFrames,
        fps: float,
        timing: StageTimes,
    ) -> None:
        self._layout, self._decoder, self._seen = layout, decoder, seen
        self._fps, self._timing = fps, timing
        self.read_until = -np.inf
        """Time of the newest frame that no later window takes, seconds."""
        self._scored_at = self._told_until = -np.inf
        is_fine = layout.rows * layout.cols > FINE_BLOCKS
        self._window, self._learnt = (FINE_WINDOW, FINE_LEARNT) if is_fine else (WINDOW, LEARNT)
        self._scored: deque[ReadPair] = deque()
        self._next: int | None = None
        self._picture, self._motions = MovingPicture(), dict[float, Map]()
        self._scored_windows = 0

    def begin_anew(self) -> None:
        """Leave out all frames so far: what comes shows another place or another picture."""
        self.read_until, self._scored_at = self._seen.newest, -np.inf
        self._picture, self._motions = MovingPicture(), {}
        self._scored_windows = 0

    def start_run(self) -> None:
        """Begin to count frame pairs anew."""
        self._next = None
        self._scored.clear()

    def read(self, clock: DisplayClock, now: float) -> Iterator[ReadPair]:
        """Read the next frame pairs, where it is time for a window.

        Args:
            clock: says when the display shows which state.
            now: time of the newest frame, seconds; infinite where the frames have ended, and all
                pairs are read.
        """
        over, end = bool(np.isinf(now)), self._seen.end(clock, now)
        yield from self._take_scored()
        waiting = self._waiting(clock, int(end // 2))
        while waiting and (over or self._is_due(2 * clock.period * len(waiting))):
            self._score(clock, waiting[:MOST_WAITING])
            yield from self._take_scored()
            waiting = self._waiting(clock, int(end // 2))

    def _take_scored(self) -> Iterator[ReadPair]:
        while self._scored:
            yield self._scored.popleft()

    def _waiting(self, clock: DisplayClock, end: int) -> list[int]:
        """List the numbers, below ``end``, of frame pairs that were seen and are not read yet."""
        frames = self._seen.after(max(self.read_until, self._told_until))
        if self._next is None:
            if not frames:
                return []
            self._next = int(np.ceil(clock.number(frames[0].time) / 2))
        spans = [pairs_shown(clock, frame.time) for frame in frames]
        seen = {number for first, last in spans for number in range(first, last + 1)}
        return sorted(number for number in seen if self._next <= number < end)

    def _is_due(self, waiting_s: float) -> bool:
        """Tell whether it is time for the next window.

        Args:
            waiting_s: time, in seconds, for which the frame pairs that wait were displayed.
        """
        frames = self._seen.after(self.read_until)
        if len(frames) < LEAST_FRAMES:
            return False
        since = frames[-1].time - self._scored_at
        fresh = sum(frame.time > self._scored_at for frame in frames)
        missed = np.isfinite(since) and since * self._fps > MISSED * fresh
        stride = STRIDE_S if self._scored_windows < HURRIED else LATER_STRIDE_S
        return max(since, waiting_s) >= stride and (fresh >= FRESH_FRAMES or not missed)

    def _score(self, clock: DisplayClock, numbers: Sequence[int]) -> None:
        """Score frame pairs by the window that ends with the last of them that fits into it.

        Args:
            clock: says when the display shows which state.
            numbers: numbers of frame pairs that are over, rising. At least one of them is scored
                if frames are left; the others wait for the next window.
        """
        frames = self._seen.after(self.read_until)
        spans = [pairs_shown(clock, frame.time) for frame in frames]
        begin = next((at for at, span in enumerate(spans) if span[1] >= numbers[0]), 0)
        end = min(len(frames), max(begin + self._window, LEAST_FRAMES))
        while spans[end - 1][1] - spans[begin][0] >= MOST_PAIRS:
            end -= 1
        begin = max(0, end - self._window)
        while spans[end - 1][1] - spans[begin][0] >= MOST_PAIRS:
            begin += 1
        now, last = frames[end - 1].time, max(span[1] for span in spans[begin:end])
        first = spans[begin][0]
        over = np.inf if end == len(frames) else clock.number(now + clock.earliest) / 2
        done = [number for number in numbers if number <= min(last, over - 1)] or numbers[:1]
        with self._timing.stage("film"):
            self._follow(frames[:end])
            window = self._cut(frames[begin:end], clock, first, last)
            scores = self._decoder.decode(window).scores  # (P n_bits,)
        scores = scores.reshape(last + 1 - first, -1)
        for number in done:
            if first <= number <= last:
                soft = SoftBits(scores[number - first])
                self._scored.append(ReadPair(number, soft, InWindow(window, number - first)))
        self._next = done[-1] + 1
        old = sum(frame.time <= self._scored_at for frame in frames[begin:end])
        learnt_from = max(0, old - 1, end - begin - self._learnt)
        self._correct(frames[begin:end], window, scores, learnt_from)
        self._scored_at = now
        self._scored_windows += 1
        told = [f.time for f in frames if clock.number(f.time + clock.latest) < 2 * self._next]
        self._told_until = max([self._told_until, *told])
        if end > self._window:
            self.read_until = frames[end - self._window - 1].time

    def _follow(self, frames: Sequence[SeenFrame]) -> None:
        """Find how the picture moves in frames, if that is not known, and forget all others.

        The first frame alone would be a picture with its message. So it is made of the frames that
        follow, backwards.
        """
        known = self._motions
        for frame in [] if known else reversed(frames[:LEAST_FRAMES]):
            self._picture.take(frame.shrunk)
        self._motions = {
            frame.time: known[frame.time]
            if frame.time in known
            else self._picture.take(frame.shrunk)
            for frame in frames
        }

    def _cut(
        self, frames: Sequence[SeenFrame], clock: DisplayClock, first: int, last: int
    ) -> Observation:
        """Make a window of frames, which show parts of the frame pairs ``first`` to ``last``.

        The picture is held still in it: what has only moved since the middle frame is taken off.
        """
        times = np.array([frame.time for frame in frames])
        moved = list(accumulate(self._motions[time] for time in times))  # (h, w) each
        middle = moved[len(moved) // 2]
        return Observation(
            tuple(frame.shrunk - (own - middle) for frame, own in zip(frames, moved, strict=True)),
            self._layout,
            mixture_of_exposures(clock, times, self._layout, first, last + 1 - first),
            np.stack([frame.blocks_in_view for frame in frames]),
            times=tuple(times.tolist()),
        )

    def _correct(
        self, frames: Sequence[SeenFrame], window: Observation, scores: Array, begin: int
    ) -> None:
        """Learn from the frames of a window, from the one at ``begin`` on, where corners lie."""
        placements = [frame.placement for frame in frames[begin:] if frame.placement is not None]
        if len(placements) < 2 or len(placements) < len(frames) - begin:
            return
        with self._timing.stage("correct"):
            changes = changes_of_bits(scores, self._layout)  # (P, rows, cols)
            shares, pair = window.mixture.shares[begin:], window.mixture.pair[begin:]
            expected = (shares * changes[pair]).sum(1)  # (T, S, rows, cols)
            images = [frame.rectified for frame in frames[begin:]]
            placements[-1].shift.take(images, expected, placements)


def pairs_shown(clock: DisplayClock, time: float) -> tuple[int, int]:
    """Give the numbers of the first and the last frame pair of which a frame shows a part."""
    first, last = (clock.number(time + end) / 2 for end in (clock.earliest, clock.latest))
    return int(np.floor(first)), int(np.floor(last))
