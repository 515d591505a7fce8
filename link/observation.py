"""What decoders take: rectified frames, what each exposure mixes, and what is known of the bits.

A display shows frame pairs, the two states of each one after the other. An exposure of a camera may
fall into one state, or mix those of up to `SLOTS` frame pairs. With x_p in {-1, 1} the bit of frame
pair p at a block, and s_tp half the difference of the shares that its embedded and its original
state have of the exposure of frame t, the frame shows the block changed by sum_p s_tp x_p times the
strength of the signal. A still frame pair is the case of two frames with shares -1/2 and 1/2.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from link.clock import DisplayClock, exposure_share
from link.errors import UnsuitedError
from link.layout import Layout
from link.pilots import expected_changes
from link.types import Array, Image, Map

SLOTS = 3
"""Largest number of frame pairs that one exposure mixes: two states of the slowest camera that
reads anything, and as much again for rows that are exposed and written one after the other."""


@dataclass(frozen=True)
class Mixture:
    """Which frame pairs each exposure mixes, and in which shares."""

    shares: Map
    """(T, S, rows, cols) float32 half differences of the shares that the embedded and the original
    state of a frame pair have of an exposure, in [-1/2, 1/2]; 0 in slots that no pair fills. A film
    has as many slots as its exposures are long, 2 to `SLOTS`."""
    pair: NDArray[np.int64]
    """(T, S) place among the pairs of the one that fills each slot of a frame; -1 for none."""
    count: int
    """Number P of frame pairs."""


@dataclass(frozen=True)
class Observation:
    """T rectified frames of one display, and all that is known beside them."""

    frames: tuple[Image | Map, ...]
    """T frames of one shape: each an `Image`, or float32 (h, w) gray levels in [0, 255], which may
    lie somewhat outside where the picture moved and is held still."""
    layout: Layout
    """Grid of blocks, ratex patches and pilots that the frames show."""
    mixture: Mixture
    """Frame pairs that each exposure mixes, and their shares."""
    seen: Map | None = None
    """(T, rows, cols) float32, 1 where a frame shows a block, else 0; None where all are seen."""
    kappa: int | None = None
    """Gray levels added where the bit is 1, and in ratex tiles of label 1; None where the receiver
    does not know it."""
    times: tuple[float, ...] = ()
    """T times at which the frames of a film were taken, seconds; none where they are not known."""

    @classmethod
    def still(
        cls,
        original: Image,
        embedded: Image,
        layout: Layout,
        kappa: int | None = None,
    ) -> "Observation":
        """Make the observation of one frame pair, of which each frame shows one state.

        Args:
            original: an `Image`, the rectified original frame.
            embedded: an `Image` of the shape of ``original``.
            layout: grid that the frames show.
            kappa: gray levels added where the bit is 1, if they are known.

        >>> from link.layout import make_layout
        >>> gray = np.zeros((384, 512), np.uint8)
        >>> seen = Observation.still(gray, gray, make_layout())
        >>> seen.mixture.shares[:, 0, 0, 0].tolist(), seen.mixture.count
        ([-0.5, 0.5], 1)
        """
        shares = np.full((2, 1, layout.rows, layout.cols), 0.5, np.float32)
        shares[0] = -0.5
        mixture = Mixture(shares, np.zeros((2, 1), np.int64), 1)
        return cls((original, embedded), layout, mixture, None, kappa)

    @property
    def is_pair(self) -> bool:
        """Whether it is one still frame pair."""
        return len(self.frames) == 2 and self.mixture.count == 1 and self.seen is None

    @property
    def original(self) -> Image:
        """The first frame of a still frame pair.

        Raises:
            UnsuitedError: it is a film.
        """
        return self._frame_of_pair(0)

    @property
    def embedded(self) -> Image:
        """The second frame of a still frame pair.

        Raises:
            UnsuitedError: it is a film.
        """
        return self._frame_of_pair(1)

    def _frame_of_pair(self, number: int) -> Image:
        if not self.is_pair:
            raise UnsuitedError(f"it reads frame pairs, and this is {len(self.frames)} frames")
        frame: Image = np.asarray(self.frames[number], np.uint8)
        return frame

    @property
    def known(self) -> Map:
        """Known bits of the blocks: (rows, cols) float32, -1 or 1 for pilots, 0 for the others."""
        return expected_changes(self.layout).astype(np.float32)

    @property
    def blocks_seen(self) -> Map:
        """(T, rows, cols) float32, 1 where a frame shows a block, else 0."""
        if self.seen is not None:
            return self.seen
        return np.ones((len(self.frames), self.layout.rows, self.layout.cols), np.float32)


def mixture_of_exposures(
    clock: DisplayClock, times: Array, layout: Layout, first: int, count: int
) -> Mixture:
    """Work out what each exposure of a film mixes.

    Args:
        clock: says when the display shows which state.
        times: (T,) times of the frames, seconds.
        layout: grid of the blocks, and the code by which the states of frame pairs are ordered.
        first: number of the first frame pair that is asked for.
        count: number of frame pairs that are asked for.

    >>> from link.layout import make_layout
    >>> layout, clock = make_layout(2, 2, ratex=0), DisplayClock(0.1, 0.0, 0.0, 0.0, 0.1)
    >>> mixture = mixture_of_exposures(clock, np.array([0.0, 0.15]), layout, first=0, count=1)
    >>> mixture.shares[:, 0, 0, 0].round(2).tolist(), mixture.pair[:, 0].tolist()
    ([-0.5, 0.25], [0, 0])
    """
    x, y = ((2 * np.arange(n) + 1) / (2 * n) for n in (layout.cols, layout.rows))
    delays = clock.delay_x * x + clock.delay_y * y[:, None]  # (rows, cols)
    begins = (times[:, None, None] + delays - clock.start) / clock.period  # (T, rows, cols)
    earliest = np.floor(begins.min((1, 2)) / 2).astype(np.int64)
    longest = (clock.latest - clock.earliest) / (2 * clock.period)
    slots = min(int(longest) + 2, SLOTS)
    numbers = earliest[:, None] + np.arange(slots)  # (T, S)
    length = clock.shutter / clock.period
    shares = np.zeros((*numbers.shape, layout.rows, layout.cols), np.float32)
    asked = (numbers >= first) & (numbers < first + count)
    reached = 2 * numbers < begins.max((1, 2))[:, None] + length
    for frame, slot in np.argwhere(asked & reached):
        number = numbers[frame, slot]
        since = begins[frame] - 2 * number
        change = exposure_share(since - 1, length) - exposure_share(since, length)
        shares[frame, slot] = layout.code.signs[number % layout.code.period] / 2 * change
    return Mixture(shares, np.where(asked, numbers - first, -1), count)
