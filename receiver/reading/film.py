"""Decode frame pairs from whole windows of a film, where the picture stands still in them.

A `FilmDesk` keeps the last frames, shrunk. Now and then it hands a window of them to the film
decoder (`models.film.decoder`), and takes back the scores of all frame pairs that ended in it.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from link.clock import DisplayClock
from link.code.scores import information_of
from link.layout import Layout
from link.observation import Observation, mixture_of_exposures
from link.types import Array, Map
from models.film.window import shrunk_gray
from receiver.decoders import WindowDecoder
from receiver.reading.states import RectifiedFrame

WINDOW, FINE_WINDOW = 32, 24
"""Largest number of frames in a window, and in one of a fine grid, which takes longer."""
LEAST_FRAMES = 8
"""Smallest number of frames in a window: its mean is the reference."""
MOST_PAIRS = 64
"""Largest number of frame pairs over which a window reaches. Memory and time grow with it, and a
camera that misses frames would let it grow without end."""
FINE_BLOCKS = 8000
"""Number of blocks from which a grid counts as fine."""
STRIDE_S = 0.13
"""Seconds of film from one window to the next, or for which the frame pairs of a window were shown
at least: on slow displays each frame pair is scored as soon as it is over."""
MISSED, FRESH_FRAMES = 1.5, 12
"""Number of nominal frames for each new one from which on frames were missed since the last window,
and number of new frames that the next one then waits for: while windows are scored, a camera that
does not wait gives none."""
VAGUE = 0.05
"""Information in bits a block below which the film's scores are compared with those of a pair,
which says more where the picture moves."""


@dataclass(frozen=True)
class FilmFrame:
    """What is kept of a camera frame."""

    time: float
    """Seconds of the camera's clock."""
    gray: Map
    """(h, w) float32 gray levels of the rectified display, shrunk."""
    seen: Map
    """(rows, cols) float32, 1 where the whole block lies within the camera frame, else 0."""


class FilmDesk:
    """Keeps frames of one display, and has frame pairs scored by windows of them.

    Args:
        layout: layout of the display, of which `models.film.window.reads_films` is true.
        decoder: the film decoder.
        kept: number of frames that wait at most.
    """

    def __init__(self, layout: Layout, decoder: WindowDecoder, kept: int) -> None:
        self.layout = layout
        self._decoder = decoder
        self._frames: deque[FilmFrame] = deque(maxlen=kept)
        self._scored_at = -np.inf
        self._window = FINE_WINDOW if layout.rows * layout.cols > FINE_BLOCKS else WINDOW

    def prepare(self) -> None:
        """Get ready: frames will soon come."""
        self._decoder.prepare()

    def clear(self) -> None:
        """Forget all frames: what comes shows another place, another picture, or another clock."""
        self._frames.clear()
        self._scored_at = -np.inf

    def add(self, frame: RectifiedFrame) -> None:
        """Keep a frame."""
        layout = self.layout
        seen = np.ones((layout.rows, layout.cols), np.float32)
        if frame.in_view is not None:
            in_view = frame.in_view.astype(np.float32)
            shares = cv2.resize(in_view, (layout.cols, layout.rows), interpolation=cv2.INTER_AREA)
            seen = (shares > 1 - 1e-6).astype(np.float32)
        self._frames.append(FilmFrame(frame.time, shrunk_gray(frame.rectified), seen))

    def due(self, fps: float, waiting_s: float) -> bool:
        """Return whether it is time for the next window.

        Args:
            fps: nominal number of frames of the camera in a second.
            waiting_s: time, in seconds, for which the frame pairs that wait were displayed.
        """
        if len(self._frames) < LEAST_FRAMES:
            return False
        since = self._frames[-1].time - self._scored_at
        fresh = sum(frame.time > self._scored_at for frame in self._frames)
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
        frames = list(self._frames)
        spans = [_pairs_shown(clock, frame.time) for frame in frames]
        begin = next((at for at, span in enumerate(spans) if span[1] >= numbers[0]), 0)
        end = min(len(frames), max(begin + self._window, LEAST_FRAMES))
        while spans[end - 1][1] - spans[begin][0] >= MOST_PAIRS:
            end -= 1
        begin = max(0, end - self._window)
        while spans[end - 1][1] - spans[begin][0] >= MOST_PAIRS:
            begin += 1
        window, now = frames[begin:end], frames[end - 1].time
        first, last = spans[begin][0], max(span[1] for span in spans[begin:end])
        over = np.inf if end == len(frames) else clock.number(now + clock.earliest) / 2
        done = [number for number in numbers if number <= min(last, over - 1)]
        scores = self._decode(window, clock, first, last + 1 - first)
        self._scored_at = now
        for _ in range(max(0, end - self._window)):
            self._frames.popleft()
        unread = np.zeros(self.layout.n_bits)
        return {
            number: scores[number - first] if first <= number <= last else unread
            for number in done or numbers[:1]
        }

    def _decode(
        self, window: Sequence[FilmFrame], clock: DisplayClock, first: int, count: int
    ) -> Array:
        """Decode the ``count`` frame pairs from number ``first`` on: (count, n_bits) scores."""
        times = np.array([frame.time for frame in window])
        observation = Observation(
            tuple(frame.gray for frame in window),
            self.layout,
            mixture_of_exposures(clock, times, self.layout, first, count),
            np.stack([frame.seen for frame in window]),
        )
        return self._decoder.decode(observation).scores.reshape(count, -1)  # (count n_bits,)


def _pairs_shown(clock: DisplayClock, time: float) -> tuple[int, int]:
    """Give the numbers of the first and the last frame pair of which a frame shows a part."""
    first, last = (clock.number(time + end) / 2 for end in (clock.earliest, clock.latest))
    return int(np.floor(first)), int(np.floor(last))


def information(scores: Array) -> float:
    """Give the information that log-likelihood ratios hold, in bits a block."""
    return information_of(scores.astype(np.float32)) / max(scores.size, 1)
