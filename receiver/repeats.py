"""Recognise frames that show again what the frame before showed, because a camera repeated it.

A camera that is late, and a program that evens out the rate of a film, hand over the same image
twice. The second one was not exposed at the time that it bears. It differs from the first far less
than two exposures would: sensor noise alone makes these differ everywhere.

Where frames are free of noise, as in a recording of the screen, equal frames are no repeats: the
display stood still. There is no floor of noise then, and nothing counts as repeated.
"""

from collections import deque

import numpy as np
from numpy.typing import NDArray

from link.types import Image

CELL_PX, CELLS = 8, 24
"""Pixels along each side of the cells that are compared, and number of them along each axis."""
QUANTILES = (0.3, 0.5, 0.9, 1.0)
"""Quantiles, over the cells, of the differences within them. The first tells how noisy the stillest
cells are: in a screen's recording those that no bit changes, about a half. The last is the largest
difference in any cell."""
REPEATED = (1.0, 0.3, 0.55, 0.35)
"""Largest difference of a repeated frame at each of `QUANTILES`, as a share of the usual one; a
codec corrects an image a little when it repeats it."""
MIN_NOISE_LEVELS = 0.2
"""Smallest noise of the stillest cells, in gray levels, at which repeats are sought; with less the
film is free of noise, or a codec copies most of an image from the one before."""
HISTORY, FIRST = 16, 6
"""Number of differences from which the usual one is taken, and number that must be known before a
frame counts as repeated."""


class Repeats:
    """Compares each frame with the one before.

    >>> rng, repeats = np.random.default_rng(0), Repeats()
    >>> film = [rng.integers(90, 110, (96, 128), np.uint8) for _ in range(10)]
    >>> [repeats.is_repeat(film[number]) for number in (0, 1, 2, 3, 4, 5, 6, 7, 7, 8)][-4:]
    [False, False, True, False]
    """

    def __init__(self) -> None:
        self._before: NDArray[np.int16] | None = None
        self._changes: deque[NDArray[np.float64]] = deque(maxlen=HISTORY)

    def is_repeat(self, image: Image) -> bool:
        """Tell whether a frame shows again what the frame before showed.

        Args:
            image: an `Image`; the next frame of the film.
        """
        cells, before = sample_cells(image), self._before
        self._before = cells
        if before is None or before.shape != cells.shape:
            self._changes.clear()
            return False
        # within a cell: a bit, or a change of exposure, moves all of its pixels alike
        spread = (cells - before).astype(np.float32).std(axis=(1, 3))
        change = np.quantile(spread, QUANTILES)
        if len(self._changes) >= FIRST:
            usual = np.median(self._changes, axis=0)
            if usual[0] >= MIN_NOISE_LEVELS and (change <= REPEATED * usual).all():
                return True
        self._changes.append(change)
        return False


def sample_cells(image: Image) -> NDArray[np.int16]:
    """Take small squares of pixels, spread evenly over an image.

    Args:
        image: an `Image`.

    Returns:
        (rows, CELL_PX, columns, CELL_PX) int16 levels, of green where there are colours.
    """
    levels = image if image.ndim == 2 else image[:, :, 1]
    height, width = levels.shape
    down, right = max(1, height // CELLS), max(1, width // CELLS)
    whole = levels[: height // down * down, : width // right * right]
    cells = whole.reshape(height // down, down, width // right, right)
    return cells[:, :CELL_PX, :, :CELL_PX].astype(np.int16)
