"""Small motions of a display, as the eight numbers of a homography of a display from -1 to 1.

Where a display that changes lies a little off, each pixel is off by the motion there times the
slope of the change (Lucas & Kanade 1981). Each of the eight numbers moves a point by powers of its
place. So the least squares that find them need only moments: sums of a few maps times powers of x
and y.

All motions of a display are homographies ``H_old_from_new``: where a point of the display, as it
should have been rectified, lies in the image as it was.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import DTypeLike, NDArray

from link.geometry import STRAIGHT, Lens, frame_corners, resized_homography, transform
from link.layout import Layout
from link.types import Array, Corners, Homography, Map

MAP_PX = 4.0
"""Smallest side of a block, in pixels, in maps of a display without what lies around it: the slope
of a block's change at its borders, by which motion is seen, needs two pixels on either side."""

UNIT_CORNERS = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
"""Corners of a display from -1 to 1."""
POWERS = 5
"""Number of powers of a place, from 0 on, that the products of two motions need."""
MOTIONS = (
    ((0, 1, 1, 0),),
    ((0, 1, 0, 1),),
    ((0, 1, 0, 0),),
    ((1, 1, 1, 0),),
    ((1, 1, 0, 1),),
    ((1, 1, 0, 0),),
    ((0, -1, 2, 0), (1, -1, 1, 1)),
    ((0, -1, 1, 1), (1, -1, 0, 2)),
)
"""Effect of each of the eight numbers of a homography on a point (x, y) of a display from -1 to 1,
to first order. Each entry is an axis, 0 for x and 1 for y, a sign, and powers of x and of y. The
last two numbers move the point along both axes."""


def map_size(layout: Layout) -> tuple[int, int]:
    """Width and height of the maps of what toggles, for a layout.

    >>> from link.layout import make_layout
    >>> map_size(make_layout(48, 64, pilots=8)), map_size(make_layout())
    ((256, 192), (128, 96))
    """
    side = min(layout.width / layout.cols, layout.height / layout.rows)
    factor = min(4, max(1, int(side / MAP_PX)))
    return layout.width // factor, layout.height // factor


def without_slope(change: NDArray[np.floating], block: Array) -> Map:
    """Take off the mean around each pixel, over three blocks.

    Args:
        change: (h, w) by how much the pixels of the rectified display changed.
        block: (2,) width and height of a block, in pixels of ``change``.

    Returns:
        (h, w) in the units of ``change``.
    """
    change = np.ascontiguousarray(change, np.float32)
    return np.asarray(change - cv2.blur(change, slope_span(block)), np.float32)


def slope_span(block: Array) -> tuple[int, int]:
    """Give the width and height of three blocks, whose sides are given in pixels: odd numbers."""
    width, height = (int(3 * side) | 1 for side in block)
    return width, height


@dataclass(frozen=True)
class GridMaps:
    """Geometry of maps of a display's changes, in which the motion of its grid is seen."""

    layout: Layout
    """Layout of the display."""
    inner: tuple[int, int]
    """Width and height of the display, in pixels of the maps."""
    margin: tuple[int, int] = (0, 0)
    """Width and height of what lies on each side of the display, in pixels of the maps."""

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the maps, pixels."""
        (width, height), (left, top) = self.inner, self.margin
        return width + 2 * left, height + 2 * top

    @property
    def block(self) -> Array:
        """Width and height of a block, (2,), in pixels of the maps."""
        return np.array(self.inner) / [self.layout.cols, self.layout.rows]

    def places(self) -> tuple[Array, Array]:
        """Tell x of each column and y of each row of the maps, of a display from -1 to 1."""
        each = zip(self.size, self.margin, self.inner, strict=True)
        x, y = ((np.arange(n) - before + 0.5) / side * 2 - 1 for n, before, side in each)
        return x, y

    def to_layout(self) -> Array:
        """Find the (3, 3) homography from pixels of the maps to pixels of the layout."""
        (width, height), (left, top) = self.inner, self.margin
        H = resized_homography(self.layout.width / width, self.layout.height / height)
        return np.asarray(H @ [[1.0, 0, -left], [0, 1, -top], [0, 0, 1]])

    def within(self, change: Map) -> Map:
        """Cut the display out of (h, w) maps, or out of (K, h, w) of them."""
        (width, height), (left, top) = self.inner, self.margin
        return change[..., top : top + height, left : left + width]

    def smooth(self, change: NDArray[np.floating], span: float) -> Map:
        """Smooth an (h, w) map over ``span`` blocks, and take off the mean around each pixel."""
        block = self.block
        return without_slope(cv2.GaussianBlur(change, (0, 0), span * float(block.min())), block)

    def drawn(self, blocks: NDArray[np.floating], span: float) -> Map:
        """Draw the (rows, cols) changes of blocks, with nothing around them, and `smooth` them."""
        width, height = self.size
        map_ = np.zeros((height, width), np.float32)
        fine = cv2.resize(blocks.astype(np.float32), self.inner, interpolation=cv2.INTER_NEAREST)
        self.within(map_)[:] = fine
        return self.smooth(map_, span)


class MotionEquations:
    """Adds up what maps of a change tell of the eight numbers.

    Args:
        maps: geometry of the maps.
        dtype: type in which rows are summed; a short one is quicker.
    """

    def __init__(self, maps: GridMaps, dtype: DTypeLike = np.float64) -> None:
        self._size = maps.inner
        self._x, self._y = (np.vander(place, POWERS, increasing=True) for place in maps.places())
        self._x = self._x.astype(dtype)
        self._squares: list[Map | float] = [0.0, 0.0, 0.0]
        self._products: list[Map | float] = [0.0, 0.0]

    def take(
        self, expected: Map, residual: Map, weight: Map | None = None, amplitude: float = 1.0
    ) -> None:
        """Take a map of an expected change.

        Args:
            expected: (h, w) change.
            residual: (h, w) change that was seen, less ``amplitude`` times the expected one.
            weight: (h, w) weight of each pixel; None where all weigh alike.
            amplitude: of what is seen, in the expected changes.
        """
        slopes = [
            cv2.Sobel(expected, -1, 1 - axis, axis, scale=amplitude * self._size[axis] / 16)
            for axis in (0, 1)
        ]
        for axis, slope in enumerate(slopes):
            weighed = slope if weight is None else weight * slope
            self._products[axis] += weighed * residual
            for other in range(axis, 2):
                self._squares[axis + other] += weighed * slopes[other]

    def normal(self, further: Map | None = None) -> tuple[Array, Array]:
        """Write the normal equations of the eight numbers, or of these and of a further motion.

        Args:
            further: (2, h, w) the further motion along x and along y, of a display from -1 to 1.

        Returns:
            the (8, 8) matrix and the (8,) right-hand side, or (9, 9) and (9,).
        """
        squares = [self._moments(each) for each in self._squares]
        right = self._right(self._products)
        matrix = np.zeros((8, 8))
        for i, changes in enumerate(MOTIONS):
            for axis, sign, x, y in changes:
                for j, others in enumerate(MOTIONS):
                    for other, other_sign, more_x, more_y in others:
                        both = squares[axis + other][y + more_y, x + more_x]
                        matrix[i, j] += sign * other_sign * both
        if further is None:
            return matrix, right
        xx, xy, yy = self._squares
        along = further[0] * xx + further[1] * xy, further[0] * xy + further[1] * yy
        both = self._right(along)
        alone, left = (
            float((further * np.array(maps)).sum(axis=0).sum()) for maps in (along, self._products)
        )
        matrix = np.block([[matrix, both[:, None]], [both[None], np.array(alone)]])
        return matrix, np.append(right, left)

    def _right(self, maps: Sequence[Map | float]) -> Array:
        """Sum what two maps, of slopes times something, tell of each number: (8,)."""
        moments = [self._moments(each) for each in maps]
        return np.array(
            [sum(sign * moments[axis][y, x] for axis, sign, x, y in each) for each in MOTIONS]
        )

    def _moments(self, pixels: Map | float) -> Array:
        """Sum a map (h, w) times powers of y and of x: (`POWERS`, `POWERS`)."""
        return np.asarray(self._y.T @ (pixels @ self._x).astype(np.float64))


def moved_corners(
    corners: Corners, H_old_from_new: Homography, layout: Layout, lens: Lens = STRAIGHT
) -> Array:
    """Corners, in the image, of a display that lies elsewhere in its own rectified image.

    Args:
        corners: pixels of the image, by which the display was rectified.
        H_old_from_new: in layout pixels.
        layout: layout of the display.
        lens: lens through which the display was rectified.
    """
    size = layout.width, layout.height
    H_straight_from_old = lens.homography(corners, *size)
    return lens.distort(transform(H_straight_from_old @ H_old_from_new, frame_corners(*size)))


def unit_homography(numbers: Array) -> Array:
    """Make the (3, 3) homography that moves each point by the eight numbers.

    >>> unit_homography(np.zeros(8)).tolist()
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    """
    return np.asarray(np.eye(3) + np.append(numbers, 0.0).reshape(3, 3))  # (9,) -> (3, 3)


def pixels_from_unit(width: int, height: int) -> Array:
    """Find the (3, 3) homography from a display from -1 to 1 to its pixels, whole at centres.

    >>> pixels_from_unit(8, 6) @ [1, 1, 1]
    array([7.5, 5.5, 1. ])
    """
    x, y = width / 2, height / 2
    return np.array([[x, 0, x - 0.5], [0, y, y - 0.5], [0, 0, 1]])
