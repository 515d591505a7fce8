"""Find the blocks that something in front of the display covers; they become erasures."""

from collections import deque
from collections.abc import Iterable

import cv2
import numpy as np
from numpy.typing import NDArray

from link.images import as_gray
from link.layout import Layout
from link.types import Image

BLOCK_PX, ROWS_PX = 6, 96
"""Pixels of a block, along each axis, in the thumbnails that are compared: the first number, or
fewer where the rows of blocks would then take more than the second; a hand covers many blocks of a
fine grid."""
HISTORY = 9
"""Number of original frames whose median shows the picture without what passes by."""
STANDS_OUT = 5.0
"""Residual at which a block is covered, in medians over all blocks."""
MIN_LEVELS = 8.0
"""Smallest residual of a covered block, in gray levels, after exposure is matched."""
MAX_COVERED = 0.5
"""Share of blocks above which the picture has changed, and nothing is covered."""


class Occlusion:
    """Compares each original frame with the median of the last ones.

    Args:
        layout: layout of the display.
    """

    def __init__(self, layout: Layout) -> None:
        self.layout = layout
        self._side = max(1, min(BLOCK_PX, ROWS_PX // layout.rows))
        self._history: deque[NDArray[np.float32]] = deque(maxlen=HISTORY)

    def covered(self, original: Image) -> NDArray[np.bool_]:
        """Tell which message blocks are covered in the next original frame.

        Args:
            original: an `Image`, rectified.

        Returns:
            (n_bits,) bool.
        """
        rows, cols, side = self.layout.rows, self.layout.cols, self._side
        size = cols * side, rows * side
        small = np.asarray(
            cv2.resize(as_gray(original), size, interpolation=cv2.INTER_AREA), np.float32
        )
        self._history.append(small)
        usual = median_image(self._history)
        gain = np.median(small) / max(float(np.median(usual)), 1.0)
        residual = np.abs(small - gain * usual).reshape(rows, side, cols, side)
        blocks = residual.mean(axis=(1, 3))  # (rows, side, cols, side) -> (rows, cols)
        limit = max(MIN_LEVELS, STANDS_OUT * float(np.median(blocks)))
        covered = blocks > limit
        if covered.mean() > MAX_COVERED:
            self._history.clear()
            self._history.append(small)
            covered[:] = False
        return np.asarray(covered[self.layout.message_mask])


def median_image(images: Iterable[NDArray[np.float32]]) -> NDArray[np.float32]:
    """Take the median of images, pixel by pixel.

    Images are put into order by comparing whole images with each other, which for a few of them
    takes a tenth of the time of `numpy.median`.

    Args:
        images: one or more of the same shape.

    >>> median_image([np.full((1, 2), level, np.float32) for level in (9, 1, 4, 2)])
    array([[3., 3.]], dtype=float32)
    """
    levels = list(images)
    for turn in range(len(levels)):
        for at in range(turn % 2, len(levels) - 1, 2):
            pair = levels[at], levels[at + 1]
            levels[at], levels[at + 1] = np.minimum(*pair), np.maximum(*pair)
    low, high = levels[(len(levels) - 1) // 2], levels[len(levels) // 2]
    return np.asarray((low + high) / 2, np.float32)
