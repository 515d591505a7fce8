"""Pilots, the blocks whose bits the receiver knows: where they lie, and how they change.

From one state of the display to the next, all pilots of bit 1 change one way and all of bit 0 the
other way.
"""

from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from link.images import as_gray, intensity
from link.layout import Layout
from link.types import Array, Image, Real

OUTLIER = 2.5
"""Largest change of a pilot from one photograph to another that counts, in medians over the pilots,
so that a few edges of a picture that moved do not hide the others."""


def pilot_signs(layout: Layout) -> Array:
    """Signs with which the pilots toggle, (pilots,) of 1 and -1.

    >>> from link.layout import make_layout
    >>> pilot_signs(make_layout(4, 4, modulation="antipodal", pilots=4)).sum()
    np.float64(0.0)
    """
    return np.asarray(2.0 * layout.pilot_bits - 1)


@lru_cache(maxsize=16)
def expected_changes(layout: Layout) -> Array:
    """Expected changes of the blocks, (rows, cols): the pilots' signs, 0 elsewhere."""
    blocks = np.zeros(layout.rows * layout.cols)
    blocks[layout.pilot_blocks] = pilot_signs(layout)
    return blocks.reshape(layout.rows, layout.cols)  # (blocks,) -> (rows, cols)


def changes_of_bits(scores: Real, layout: Layout) -> Array:
    """Say how blocks change from the first state of frame pairs to the second, as is known of them.

    Args:
        scores: (..., n_bits) log-likelihood ratios.
        layout: layout of the display.

    Returns:
        (..., rows, cols) expected values of signs, in [-1, 1]; those of pilots are certain.
    """
    shape = *scores.shape[:-1], layout.rows, layout.cols
    blocks = np.broadcast_to(expected_changes(layout), shape).copy()
    blocks[..., layout.message_mask] = np.tanh(np.clip(scores, -20, 20) / 2)
    return blocks


def pilot_centres(layout: Layout) -> Array:
    """Give the centres (x, y) of the pilots on the display, (pilots, 2) in [0, 1]."""
    rows, cols = np.divmod(layout.pilot_blocks, layout.cols)
    return np.stack([(cols + 0.5) / layout.cols, (rows + 0.5) / layout.rows], axis=1)


def standing_out(gray: NDArray[np.generic], layout: Layout) -> NDArray[np.float32]:
    """Measure by how much each block is brighter than its neighbourhood of 3 x 3 blocks.

    Args:
        gray: (H, W) of any type and size, the rectified display.
        layout: says how many blocks there are.

    Returns:
        (rows, cols) in the levels of ``gray``.
    """
    blocks = cv2.resize(
        np.asarray(gray, np.float32), (layout.cols, layout.rows), interpolation=cv2.INTER_AREA
    )
    return np.asarray(blocks - cv2.blur(blocks, (3, 3)), np.float32)


def pilot_values(view: Image, layout: Layout) -> NDArray[np.float32]:
    """Measure by how much each pilot is brighter than its neighbourhood of 3 x 3 blocks.

    Args:
        view: an `Image`, the rectified display.
        layout: layout with pilots.

    Returns:
        (pilots,) gray levels.
    """
    blocks = standing_out(as_gray(view), layout)
    return blocks.reshape(-1)[layout.pilot_blocks]  # (rows, cols) -> (blocks,)


def pilots_toggled(original: Image, embedded: Image, layout: Layout) -> float:
    """Tell how surely the pilots of one frame pair changed as their bits say.

    Args:
        original: an `Image`, the rectified display.
        embedded: an `Image` of the shape of ``original``.
        layout: layout with pilots.

    Returns:
        mean change along the pilots' signs, in its standard errors: by chance within 3 of 0 but for
        one pair in a few hundred; below 0 where the frames are in the other order.

    >>> from link.embed import embed
    >>> from link.layout import make_layout
    >>> layout = make_layout(16, 16, modulation="antipodal", pilots=40)
    >>> gray = np.full((layout.height, layout.width, 3), 128, np.uint8)
    >>> shown = embed(gray, np.arange(layout.n_bits) % 2, layout, kappa=3)
    >>> pilots_toggled(shown.original, shown.embedded, layout) > 10
    True
    """
    change = 255 * (intensity(embedded) - intensity(original))
    changes = standing_out(change, layout).reshape(-1)[layout.pilot_blocks]
    most = OUTLIER * float(np.median(np.abs(changes)))
    along = np.clip(changes, -most, most) * pilot_signs(layout)
    return float(along.mean() / (along.std() / np.sqrt(along.size) + 1e-9))
