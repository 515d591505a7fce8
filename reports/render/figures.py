"""Pictures of a decoded frame pair and of the response that was recovered from it."""

import cv2
import numpy as np
from numpy.typing import NDArray

from link.frames import SoftBits
from link.images import as_rgb
from link.layout import block_index
from link.observation import Observation
from link.overlay import frame_block

GAIN = 8.0
"""Factor by which differences between two frames are enlarged in pictures."""
RIGHT, WRONG, UNKNOWN = (40, 170, 70), (220, 40, 40), (60, 120, 220)
"""Colours, as (R, G, B) of [0, 255], of blocks whose bit is right, wrong, or not known."""
MIN_HEIGHT_PX = 384
"""Smallest height of a picture of a decoded frame pair, pixels."""


def annotate(
    pair: Observation, soft: SoftBits, truth: NDArray[np.intp] | None = None
) -> NDArray[np.uint8]:
    """Set the rectified original, the amplified difference and the decided bits side by side.

    Args:
        pair: the rectified frames.
        soft: scores of the message blocks.
        truth: (n_bits,) true bits, -1 where unknown; None where none is known.

    Returns:
        (H, 3 W, 3) uint8 RGB, encoded, at least 384 pixels high.
    """
    panels = [
        _enlarge(panel, pair.layout.height)
        for panel in (as_rgb(pair.original), difference_panel(pair)[0])
    ]
    return np.hstack([*panels, bits_panel(pair, soft, truth)])


def difference_panel(pair: Observation) -> tuple[NDArray[np.uint8], float]:
    """Amplify the difference of the rectified frames by `GAIN`, less its median.

    Returns:
        (H, W, 3) uint8 RGB, encoded, 128 where the difference is the median; and that median, gray
        levels.
    """
    change = as_rgb(pair.embedded).astype(np.float64) - as_rgb(pair.original)
    offset = float(np.median(change))
    return np.clip(128 + GAIN * (change - offset), 0, 255).astype(np.uint8), offset


def bits_panel(
    pair: Observation, soft: SoftBits, truth: NDArray[np.intp] | None = None
) -> NDArray[np.uint8]:
    """Lay the decided bits over the rectified original: light blocks are 1, dark blocks 0.

    A block's frame is green where the bit is right, red and thick where it is wrong, blue where the
    truth is unknown. Ratex patches are left as they are.

    Args:
        pair: the rectified frames.
        soft: scores of the message blocks.
        truth: (n_bits,) true bits, -1 where unknown; None where none is known.

    Returns:
        (H, W, 3) uint8 RGB, encoded, at least 384 pixels high.
    """
    layout = pair.layout
    panel = _enlarge(as_rgb(pair.original), layout.height)
    factor = panel.shape[0] // layout.height
    bits = np.full((layout.rows, layout.cols), -1)
    known = bits.copy()
    bits[layout.message_mask] = soft.bits
    if truth is not None:
        known[layout.message_mask] = truth
    rows = block_index(panel.shape[0], layout.rows)[:, None]
    cols = block_index(panel.shape[1], layout.cols)
    of_pixel = bits[rows, cols][..., None]
    mixed = 0.45 * panel + 0.55 * 255 * (of_pixel == 1)
    panel = np.where(of_pixel >= 0, mixed, panel).astype(np.uint8)
    for row, col in np.argwhere(bits >= 0):
        top, bottom, left, right = layout.cell_box(int(row), int(col))
        box = (factor * top, factor * bottom, factor * left, factor * right)
        colour = UNKNOWN
        if known[row, col] >= 0:
            colour = RIGHT if known[row, col] == bits[row, col] else WRONG
        frame_block(panel, box, colour, thickness=3 if colour == WRONG else 1, inset=2)
    return panel


def _enlarge(panel: NDArray[np.uint8], height: int) -> NDArray[np.uint8]:
    factor = max(1, -(-MIN_HEIGHT_PX // height))
    enlarged = cv2.resize(panel, None, fx=factor, fy=factor, interpolation=cv2.INTER_NEAREST)
    return np.asarray(enlarged, np.uint8)
