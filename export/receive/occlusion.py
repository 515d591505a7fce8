"""Find the blocks that something in front of the display covers; they become erasures."""

from collections import deque

import cv2
import numpy as np
from numpy.typing import NDArray

from link.images import as_gray
from link.layout import Layout

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
        layout: of the display.
    """

    def __init__(self, layout: Layout) -> None:
        self.layout = layout
        self._side = max(1, min(BLOCK_PX, ROWS_PX // layout.rows))
        self._history: deque[NDArray[np.float32]] = deque(maxlen=HISTORY)

    def covered(self, original: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """Tell which message blocks are covered in the next original frame.

        Args:
            original: (height, width) or (height, width, 3) uint8, encoded, rectified.

        Returns:
            (n_bits,) bool.
        """
        rows, cols, side = self.layout.rows, self.layout.cols, self._side
        size = cols * side, rows * side
        small = np.asarray(
            cv2.resize(as_gray(original), size, interpolation=cv2.INTER_AREA), np.float32
        )
        self._history.append(small)
        usual = np.median(np.stack(self._history), axis=0)
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
