"""Say where the display lies in its rectified image, as its decoded blocks tell.

Once a frame pair is decoded, the change of many blocks is known, and so where the grid must lie for
the change that was seen. Each frame pair tells little where the message is faint, so they add up:
the eight numbers of a homography are followed by a Kalman filter, whose measurement is the change
of every pixel, linear in small motions of what should be there (Lucas & Kanade 1981).
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from export.locate.pilots.corners import map_size, without_slope
from export.locate.pilots.evidence import pilot_signs
from link.images import as_gray
from link.layout import Layout

Array = NDArray[np.float64]
Image = NDArray[np.uint8]

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


class CornerShift:
    """Compares decoded frame pairs with what was seen.

    Args:
        layout: of the display; without pilots it is never moved.
    """

    def __init__(self, layout: Layout) -> None:
        self.layout = layout
        self._shift: Array | None = None
        self._size = map_size(layout)
        width, height = self._size
        x, y = np.meshgrid(np.linspace(-1, 1, width), np.linspace(-1, 1, height))
        # motions of a pixel, in maps as wide as 2, by each of the eight numbers
        zero, one = np.zeros_like(x), np.ones_like(x)
        self._motion_x = np.stack([x, y, one, zero, zero, zero, -x * x, -x * y])
        self._motion_y = np.stack([zero, zero, zero, x, y, one, -x * y, -y * y])
        block = 2 * max(1 / layout.cols, 1 / layout.rows)
        self._information = np.eye(8) / (FIRST_BLOCKS * block) ** 2

    def take(self, original: Image, embedded: Image, scores: Array) -> None:
        """Take a frame pair and its scores.

        Args:
            original: (height, width) or (height, width, 3) uint8, encoded, rectified.
            embedded: uint8 of the shape of ``original``.
            scores: (n_bits,) log-likelihood ratios.
        """
        layout, size = self.layout, self._size
        if not layout.pilots:
            return
        first, second = (
            np.asarray(cv2.resize(as_gray(image), size, interpolation=cv2.INTER_AREA), np.float32)
            for image in (original, embedded)
        )
        expected = self._expected(scores)
        block = np.array([size[0] / layout.cols, size[1] / layout.rows])
        change = without_slope(second - first, block)
        mean = np.asarray((first + second) / 2, np.float32)
        weight = 1 / (1 + _squared_gradient(mean) / STEEP**2)
        power = float((weight * expected**2).sum())
        amplitude = float((weight * expected * change).sum()) / max(power, 1e-9)
        residual = change - amplitude * expected
        variance = float((weight * residual**2).sum() / weight.sum()) * float(block.prod())
        # noise is alike over a block, which so counts once
        if amplitude**2 * power < LEAST_TOGGLING**2 * variance or power == 0:
            return
        slope_x = amplitude * cv2.Sobel(expected, -1, 1, 0, scale=size[0] / 16)
        slope_y = amplitude * cv2.Sobel(expected, -1, 0, 1, scale=size[1] / 16)
        columns = (slope_x * self._motion_x + slope_y * self._motion_y).reshape(8, -1)
        weighed = columns * (weight / max(variance, 1e-6)).reshape(-1)  # (h, w) -> (pixels,)
        self._information = KEPT * self._information + weighed @ columns.T
        move = -np.linalg.solve(self._information, weighed @ residual.reshape(-1))
        shift = self._homography(move)
        corners = np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1]])
        moved = cv2.perspectiveTransform(corners[:, None], _matrix(move))[:, 0] - corners
        if (np.abs(moved) < 2 * FAR_BLOCKS / np.array([layout.cols, layout.rows])).all():
            self._shift = shift

    def shift(self) -> Array | None:
        """Return, once, the (3, 3) ``H_old_from_new`` in layout pixels that is known anew."""
        shift, self._shift = self._shift, None
        return shift

    def _expected(self, scores: Array) -> NDArray[np.float32]:
        """Draw the expected change of every block, smooth, without slope, in units of kappa."""
        layout = self.layout
        low, high = layout.change_of_bits
        middle, half = (low + high) / 2, (high - low) / 2
        blocks = np.full(layout.rows * layout.cols, middle)
        sure = np.tanh(np.clip(scores, -20, 20) / 2)
        blocks[layout.message_mask.reshape(-1)] += half * sure
        blocks[layout.pilot_blocks] += half * pilot_signs(layout)
        grid = blocks.reshape(layout.rows, layout.cols).astype(np.float32)  # (blocks,) -> grid
        drawn = cv2.resize(grid, self._size, interpolation=cv2.INTER_NEAREST)
        block = np.array([self._size[0] / layout.cols, self._size[1] / layout.rows])
        smooth = cv2.GaussianBlur(drawn, (0, 0), SPAN * float(block.min()))
        return without_slope(smooth, block)

    def _homography(self, move: Array) -> Array:
        """Express the eight numbers as a homography of layout pixels."""
        x, y = self.layout.width / 2, self.layout.height / 2
        from_unit = np.array([[x, 0, x - 0.5], [0, y, y - 0.5], [0, 0, 1]])
        return np.asarray(from_unit @ _matrix(move) @ np.linalg.inv(from_unit))


def _matrix(move: Array) -> Array:
    """Homography that moves each point by the eight numbers, of a display from -1 to 1."""
    return np.asarray(np.eye(3) + np.append(move, 0.0).reshape(3, 3))  # (9,) -> (3, 3)


def _squared_gradient(image: NDArray[np.float32]) -> NDArray[np.float32]:
    x, y = (cv2.Sobel(image, -1, 1 - axis, axis, scale=1 / 8) for axis in (0, 1))
    return np.asarray(x**2 + y**2, np.float32)
