"""Say where the display lies in its rectified image, as its decoded blocks tell.

Once frame pairs are decoded, it is known how each block changed from frame to frame, and so where
the grid must lie for the changes that were seen. Each frame tells little where the message is
faint, so they add up: the eight numbers of a homography are followed by a Kalman filter, whose
measurement is the change of every pixel, linear in small motions of what should be there (Lucas &
Kanade 1981). A picture that moves changes, too; where it does, pixels weigh less.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from link.images import as_gray
from link.layout import Layout
from link.types import Array, Gray, Homography, Image, Map, Real
from receiver.pilots.motion import (
    UNIT_CORNERS,
    GridMaps,
    MotionEquations,
    map_size,
    pixels_from_unit,
    slope_span,
    unit_homography,
    without_slope,
)

FIRST_BLOCKS = 0.4
"""Standard deviation of the corners before anything is decoded, in blocks."""
KEPT = 0.8
"""Share of what is known of the corners that still holds when the next frames are taken."""
SPAN = 0.4
"""Standard deviation, in blocks, over which expected changes are smoothed, so that they lead back
from afar."""
LEAST_VARIANCE = 0.1
"""Variance that is added to that of the changes around a pixel, as a share of the whole display's,
so that no pixel weighs more than all others."""
LEAST_TOGGLING = 1.0
"""Smallest toggling seen with the expected signs, in standard errors, from which corners are moved:
what does not toggle tells of no corner."""
FAR_BLOCKS = 1.0
"""Largest move of a corner, in blocks, that the frames taken at once may bring."""
DECIMALS = 9
"""Number of decimals of a move, in halves of the display. The last bits of sums over all pixels
change with where memory lies, and without them a film is read alike each time."""


@dataclass(frozen=True, eq=False)
class Placement:
    """Prediction of where a display lies, with which a frame was rectified."""

    shift: "CornerShift"
    """Tracker that made the prediction, and that learns from the frame."""
    total: Array
    """(8,) sum of all moves by then, numbers of a homography of a display from -1 to 1."""
    H_followed_from_shown: Homography
    """Homography, in layout pixels, to the display as it is followed from where it lies."""


class CornerShift:
    """Says where a display that was found lies, as its decoded frame pairs tell.

    Args:
        layout: layout of the display, with pilots.
    """

    def __init__(self, layout: Layout) -> None:
        self.layout = layout
        self.placement = Placement(self, np.zeros(8), np.eye(3))
        """The display's place in the newest frame."""
        self._maps = GridMaps(layout, map_size(layout))
        block = 2 * max(1 / layout.cols, 1 / layout.rows)
        self._information = np.eye(8) / (FIRST_BLOCKS * block) ** 2

    def take(
        self, images: Sequence[Image], expected: Real, placements: Sequence[Placement]
    ) -> None:
        """Take successive frames and the changes of their blocks.

        Args:
            images: two or more, an `Image` each, rectified. Each of them but the first is compared
                with the mean of the one before and the one after it, or with one if that is all.
            expected: (T, rows, cols) by how much each image should show each block changed, in
                shares of the message's strength.
            placements: those of the images. What they show to be amiss may have been put right
                since. Nothing is learned where some are of a display that was found at another
                time.
        """
        if any(placement.shift is not self for placement in placements):
            return
        seen, right = self._equations(images, expected)
        if not seen.any():
            return
        self._information = KEPT * self._information + seen
        before = np.mean([placement.total for placement in placements[1:]], axis=0)
        left = -right - seen @ (self.placement.total - before)
        move = np.asarray(np.linalg.solve(self._information, left), np.float64).round(DECIMALS)
        moved = cv2.perspectiveTransform(UNIT_CORNERS[:, None], unit_homography(move))[:, 0]
        moved -= UNIT_CORNERS
        layout = self.layout
        if (np.abs(moved) < 2 * FAR_BLOCKS / np.array([layout.cols, layout.rows])).all():
            from_unit = pixels_from_unit(layout.width, layout.height)
            shift = from_unit @ unit_homography(move) @ np.linalg.inv(from_unit)
            H = self.placement.H_followed_from_shown @ shift
            self.placement = Placement(self, self.placement.total + move, H / H[2, 2])

    def _equations(self, images: Sequence[Image], expected: Real) -> tuple[Array, Array]:
        """Write the normal equations of the eight numbers: (8, 8) and (8,), 0 without evidence."""
        maps, block = self._maps, float(self._maps.block.prod())
        grays = [cv2.resize(as_gray(i), maps.size, interpolation=cv2.INTER_AREA) for i in images]
        frames, power, amplitude = [], 0.0, 0.0
        for change, blocks in zip(_from_neighbours(grays), _from_neighbours(expected), strict=True):
            own, change = maps.drawn(blocks, SPAN), without_slope(change, maps.block)
            weight = self._weight(change)
            weighed = weight * own
            power += float(np.vdot(weighed, own))
            amplitude += float(np.vdot(weighed, change))
            frames.append((own, change, weight))
        amplitude /= max(power, 1e-9)
        # noise is alike over a block, which so counts once
        if amplitude**2 * power < LEAST_TOGGLING**2 * block or power == 0:
            return np.zeros((8, 8)), np.zeros(8)
        equations = MotionEquations(maps, np.float32)
        for own, change, weight in frames:
            equations.take(own, cv2.scaleAdd(own, -amplitude, change), weight, amplitude)
        seen, right = equations.normal()
        return seen / block, right / block

    def _weight(self, change: Map) -> Map:
        """Weigh the pixels of a frame by its change, without slope, around them."""
        variance = cv2.blur(change * change, slope_span(self._maps.block))
        variance += LEAST_VARIANCE * float(variance.mean()) + 1e-6
        return np.asarray(1 / variance, np.float32)


def _from_neighbours(frames: Sequence[Gray] | Real) -> Iterator[Map]:
    """Take from each frame but the first the mean of the frames before and after it."""
    half = np.float32(0.5)  # half a byte takes 32 bits
    for before, frame, after in zip(frames, frames[1:], [*frames[2:], frames[-2]], strict=False):
        yield frame - (half * before + half * after)
