"""Say where the display lies in its rectified image, as its decoded blocks tell.

Once a frame pair is decoded, the change of nearly every block is known, and so where the grid must
lie for the change that was seen. Pilots alone tell the corners of a display to about a pixel, a
decoded frame pair to a third of one.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from export.locate.pilots.corners import fine_shift, map_size
from export.locate.pilots.evidence import pilot_signs
from link.layout import Layout

Array = NDArray[np.float64]
Image = NDArray[np.uint8]

FIRST, EVERY = 3, 8
"""Number of frame pairs, at the beginning, each of which moves the corners, and number of frame
pairs from one move to the next after that."""
STRENGTH = 0.4
"""Share of the way that later moves go, so that the noise of one frame pair does not shake the
corners."""
FAR_BLOCKS = 0.6
"""Largest move, in blocks, that is believed."""
STEEP = 4.0
"""Gradient of the picture, in gray levels a pixel of the maps, at which a pixel counts half."""
LEAST_SURE = 0.5
"""Smallest mean certainty of the bits, from 0 to 1, of a frame pair that moves the corners."""


class CornerShift:
    """Compares decoded frame pairs with what was seen.

    Args:
        layout: of the display; without pilots it is never moved.
    """

    def __init__(self, layout: Layout) -> None:
        self.layout = layout
        self._count = 0
        self._shift: Array | None = None

    def take(self, original: Image, embedded: Image, scores: Array) -> None:
        """Take a frame pair and its scores.

        Args:
            original: (height, width) or (height, width, 3) uint8, encoded, rectified.
            embedded: uint8 of the shape of ``original``.
            scores: (n_bits,) log-likelihood ratios.
        """
        layout, number = self.layout, self._count
        if not layout.pilots:
            return
        self._count += 1
        if number >= FIRST and number % EVERY:
            return
        sure = np.tanh(np.clip(scores, -20, 20) / 2)
        if np.abs(sure).mean() < LEAST_SURE:
            return
        low, high = layout.change_of_bits
        blocks = np.zeros((layout.rows, layout.cols))
        blocks[layout.message_mask] = (low + high) / 2 + sure * (high - low) / 2
        signs = pilot_signs(layout)
        blocks.reshape(-1)[layout.pilot_blocks] = (low + high) / 2 + signs * (high - low) / 2
        size = map_size(layout)
        first, second = (
            np.asarray(cv2.resize(_gray(image), size, interpolation=cv2.INTER_AREA), np.float32)
            for image in (original, embedded)
        )
        mean = (first + second) / 2
        steep = cv2.Sobel(mean, -1, 1, 0, scale=1 / 8) ** 2 + (
            cv2.Sobel(mean, -1, 0, 1, scale=1 / 8) ** 2
        )
        change = np.asarray((second - first) / (1 + steep / STEEP**2), np.float32)
        shift = fine_shift(change, blocks, layout)
        if shift is None:
            return
        corners = np.array(
            [[0, 0], [layout.width, 0], [layout.width, layout.height], [0, layout.height]], float
        )
        moved = cv2.perspectiveTransform(corners[:, None], shift)[:, 0]
        far = FAR_BLOCKS * min(layout.width / layout.cols, layout.height / layout.rows)
        if np.linalg.norm(moved - corners, axis=1).max() > far:
            return
        share = 1.0 if number < FIRST else STRENGTH
        self._shift = np.eye(3) + share * (shift / shift[2, 2] - np.eye(3))

    def shift(self) -> Array | None:
        """Return, once, the (3, 3) ``H_old_from_new`` in layout pixels that is known anew."""
        shift, self._shift = self._shift, None
        return shift


def _gray(image: Image) -> Image:
    return image if image.ndim == 2 else np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY))
