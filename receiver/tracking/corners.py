"""Say where the display lies in its rectified image, as its decoded blocks tell.

Once a frame pair is decoded, the change of many blocks is known, and so where the grid must lie for
the change that was seen. Each frame pair tells little where the message is faint, so they add up:
the eight numbers of a homography are followed by a Kalman filter, whose measurement is the change
of every pixel, linear in small motions of what should be there (Lucas & Kanade 1981).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from link.images import as_gray
from link.layout import Layout
from link.pilots import expected_changes
from link.types import Array, Homography, Image, Map
from receiver.pilots.motion import (
    UNIT_CORNERS,
    GridMaps,
    MotionEquations,
    map_size,
    pixels_from_unit,
    unit_homography,
    without_slope,
)

FIRST_BLOCKS = 0.4
"""Standard deviation of the corners before anything is decoded, in blocks."""
KEPT = 0.9
"""Share of what is known of the corners that the next frame pair finds still true."""
SPAN = 0.4
"""Standard deviation, in blocks, over which expected changes are smoothed, so that they lead back
from afar."""
STEEP = 4.0
"""Gradient of the picture, in gray levels a pixel of the maps, at which a pixel counts half."""
LEAST_TOGGLING = 1.0
"""Smallest toggling seen with the expected signs, in standard errors, from which corners are moved:
what does not toggle tells of no corner."""
FAR_BLOCKS = 1.0
"""Largest move of a corner, in blocks, that one frame pair may bring."""
DECIMALS = 9
"""Number of decimals of a move, in halves of the display. The last bits of sums over all pixels
change with where memory lies, and without them a film is read alike each time."""


@dataclass(frozen=True, eq=False)
class Placement:
    """Where a display was known to lie when a frame was rectified."""

    shift: "CornerShift"
    """What says where the display lies, and learns from the frame."""
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
        """Where the display is known to lie now."""
        self._maps = GridMaps(layout, map_size(layout))
        block = 2 * max(1 / layout.cols, 1 / layout.rows)
        self._information = np.eye(8) / (FIRST_BLOCKS * block) ** 2

    def take(
        self, original: Image, embedded: Image, scores: Array, placements: Sequence[Placement]
    ) -> None:
        """Take a frame pair and its scores.

        Args:
            original: an `Image`, rectified.
            embedded: an `Image` of the shape of ``original``.
            scores: (n_bits,) log-likelihood ratios.
            placements: those of the pair's frames. What the pair shows to be amiss may have been
                put right since. Nothing is learned of a pair some of whose frames are of a display
                that was found at another time.
        """
        if any(placement.shift is not self for placement in placements):
            return
        layout, maps = self.layout, self._maps
        first, second = (
            cv2.resize(as_gray(image), maps.size, interpolation=cv2.INTER_AREA)
            for image in (original, embedded)
        )
        expected = self._expected(scores)
        change = without_slope(cv2.subtract(second, first, dtype=cv2.CV_32F), maps.block)
        weight = _weight(cv2.addWeighted(first, 0.5, second, 0.5, 0, dtype=cv2.CV_32F))
        weighed = weight * expected
        power = _product(weighed, expected)
        amplitude = _product(weighed, change) / max(power, 1e-9)
        residual = cv2.scaleAdd(expected, -amplitude, change)
        weighed = np.multiply(weight, residual, out=weighed)
        variance = _product(weighed, residual) / float(weight.sum()) * float(maps.block.prod())
        # noise is alike over a block, which so counts once
        if amplitude**2 * power < LEAST_TOGGLING**2 * variance or power == 0:
            return
        equations = MotionEquations(maps, np.float32)
        equations.take(expected, residual, weight, amplitude)
        seen, right = equations.normal()
        sure = 1 / max(variance, 1e-6)
        self._information = KEPT * self._information + sure * seen
        before = np.mean([placement.total for placement in placements], axis=0)
        left = -right - seen @ (self.placement.total - before)
        move = np.asarray(np.linalg.solve(self._information, sure * left), np.float64)
        move = move.round(DECIMALS)
        moved = cv2.perspectiveTransform(UNIT_CORNERS[:, None], unit_homography(move))[:, 0]
        moved -= UNIT_CORNERS
        if (np.abs(moved) < 2 * FAR_BLOCKS / np.array([layout.cols, layout.rows])).all():
            from_unit = pixels_from_unit(layout.width, layout.height)
            shift = from_unit @ unit_homography(move) @ np.linalg.inv(from_unit)
            H = self.placement.H_followed_from_shown @ shift
            self.placement = Placement(self, self.placement.total + move, H / H[2, 2])

    def _expected(self, scores: Array) -> NDArray[np.float32]:
        """Draw the expected change of every block, from -1 to 1, smooth and without slope."""
        blocks = expected_changes(self.layout).copy()
        blocks[self.layout.message_mask] = np.tanh(np.clip(scores, -20, 20) / 2)
        return self._maps.drawn(blocks, SPAN)


def _weight(mean: Map) -> Map:
    """Weigh each pixel of a picture: less where the picture is steep, which motion shows most."""
    x, y = (cv2.Sobel(mean, -1, 1 - axis, axis, scale=1 / (8 * STEEP)) for axis in (0, 1))
    steep = cv2.magnitude(x, y)
    steep *= steep
    steep += 1
    return np.asarray(np.reciprocal(steep, out=steep), np.float32)


def _product(one: Map, other: Map) -> float:
    """Sum the products of the pixels of two maps."""
    return float(np.vdot(one, other))
