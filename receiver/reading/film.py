"""Decode frame pairs from whole windows of a film, where the picture stands still in them.

Now and then a `FilmDesk` hands a window of the last frames to the film decoder
(`models.film.decoder`), and takes back the scores of all frame pairs that ended in it.
"""

from collections.abc import Sequence

import numpy as np

from link.clock import DisplayClock
from link.code.scores import information_of
from link.layout import Layout
from link.observation import Observation, mixture_of_exposures
from link.types import Array
from receiver.decoders import WindowDecoder
from receiver.seen import SeenFrame, SeenFrames

WINDOW, FINE_WINDOW = 32, 24
"""Largest number of frames in a window, and in one of a fine grid, which takes longer."""
LEAST_FRAMES = 8
"""Smallest number of frames in a window: its mean is the reference."""
MOST_PAIRS = 64
"""Largest number of frame pairs over which a window reaches. Memory and time grow with it, and a
camera that misses frames would let it grow without end."""
FINE_BLOCKS = 8000
"""Number of blocks from which a grid counts as fine."""
STRIDE_S = 0.2
"""Seconds of film from one window to the next, or for which the frame pairs of a window were shown
at least: on slow displays each frame pair is scored as soon as it is over."""
MISSED, FRESH_FRAMES = 1.5, 12
"""Number of nominal frames for each new one from which on frames were missed since the last window,
and number of new frames that the next one then waits for: while windows are scored, a camera that
does not wait gives none."""


class FilmDesk:
    """Has frame pairs of one display scored by windows of the frames in which it was seen.

    Args:
        layout: layout of the display, of which `models.film.window.reads_films` is true.
        decoder: the film decoder.
        seen: the frames.
    """

    def __init__(self, layout: Layout, decoder: WindowDecoder, seen: SeenFrames) -> None:
        self.layout = layout
        self.decoder, self._seen = decoder, seen
        self.read_until = self._scored_at = -np.inf
        """Time of the newest frame that no later window takes, seconds."""
        self._window = FINE_WINDOW if layout.rows * layout.cols > FINE_BLOCKS else WINDOW

    def begin_anew(self) -> None:
        """Leave out all frames so far: what comes shows another place or another picture."""
        self.read_until, self._scored_at = self._seen.newest, -np.inf

    def due(self, fps: float, waiting_s: float) -> bool:
        """Return whether it is time for the next window.

        Args:
            fps: nominal number of frames of the camera in a second.
            waiting_s: time, in seconds, for which the frame pairs that wait were displayed.
        """
        frames = self._seen.after(self.read_until)
        if len(frames) < LEAST_FRAMES:
            return False
        since = frames[-1].time - self._scored_at
        fresh = sum(frame.time > self._scored_at for frame in frames)
        missed = np.isfinite(since) and since * fps > MISSED * fresh
        return max(since, waiting_s) >= STRIDE_S and (fresh >= FRESH_FRAMES or not missed)

    def score(self, clock: DisplayClock, numbers: Sequence[int]) -> dict[int, Array]:
        """Score frame pairs by the window that ends with the last of them that fits into it.

        Args:
            clock: says when the display shows which state.
            numbers: numbers of frame pairs that are over, rising.

        Returns:
            (n_bits,) scores by the number of the frame pair, for at least one of them if frames
            are left; the others wait for the next window.
        """
        frames = self._seen.after(self.read_until)
        spans = [_pairs_shown(clock, frame.time) for frame in frames]
        begin = next((at for at, span in enumerate(spans) if span[1] >= numbers[0]), 0)
        end = min(len(frames), max(begin + self._window, LEAST_FRAMES))
        while spans[end - 1][1] - spans[begin][0] >= MOST_PAIRS:
            end -= 1
        begin = max(0, end - self._window)
        while spans[end - 1][1] - spans[begin][0] >= MOST_PAIRS:
            begin += 1
        now = frames[end - 1].time
        first, last = spans[begin][0], max(span[1] for span in spans[begin:end])
        over = np.inf if end == len(frames) else clock.number(now + clock.earliest) / 2
        done = [number for number in numbers if number <= min(last, over - 1)]
        window = self._cut(frames[begin:end], clock, first, last)
        scores = self.decoder.decode(window).scores.reshape(last + 1 - first, -1)  # (P n_bits,)
        self._scored_at = now
        if end > self._window:
            self.read_until = frames[end - self._window - 1].time
        unread = np.zeros(self.layout.n_bits)
        return {
            number: scores[number - first] if first <= number <= last else unread
            for number in done or numbers[:1]
        }

    def _cut(
        self, frames: Sequence[SeenFrame], clock: DisplayClock, first: int, last: int
    ) -> Observation:
        """Make a window of frames, which show parts of the frame pairs ``first`` to ``last``."""
        times = np.array([frame.time for frame in frames])
        return Observation(
            tuple(frame.shrunk for frame in frames),
            self.layout,
            mixture_of_exposures(clock, times, self.layout, first, last + 1 - first),
            np.stack([frame.blocks_in_view for frame in frames]),
        )


def _pairs_shown(clock: DisplayClock, time: float) -> tuple[int, int]:
    """Give the numbers of the first and the last frame pair of which a frame shows a part."""
    first, last = (clock.number(time + end) / 2 for end in (clock.earliest, clock.latest))
    return int(np.floor(first)), int(np.floor(last))


def information(scores: Array) -> float:
    """Give the information that log-likelihood ratios hold, in bits a block."""
    return information_of(scores.astype(np.float32)) / max(scores.size, 1)
