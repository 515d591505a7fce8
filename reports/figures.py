"""Pictures of a decoded frame pair."""

import cv2
import numpy as np
from numpy.typing import NDArray

from link.frames import Rectified, SoftBits
from link.layout import block_index

GAIN = 8.0
RIGHT, WRONG, UNKNOWN = (40, 170, 70), (220, 40, 40), (60, 120, 220)


def annotate(
    pair: Rectified, soft: SoftBits, truth: NDArray[np.intp] | None = None
) -> NDArray[np.uint8]:
    """Rectified original | amplified difference | decided bits, side by side.

    Decided blocks carry their bit; their frame is green where it is right, red where wrong, blue
    where the truth is unknown. Ratex patches are left as they are.

    Returns:
        (H, 3 W, 3) uint8 RGB, at least 384 pixels high.
    """
    original, embedded = (_rgb(frame) for frame in (pair.original, pair.embedded))
    change = embedded.astype(np.float64) - original
    change = 128 + GAIN * (change - np.median(change))
    difference = np.clip(change, 0, 255).astype(np.uint8)
    layout = pair.layout
    factor = max(1, -(-384 // layout.height))
    panels = [
        cv2.resize(panel, None, fx=factor, fy=factor, interpolation=cv2.INTER_NEAREST)
        for panel in (original, difference, original)
    ]
    bits = np.full((layout.rows, layout.cols), -1)
    bits[layout.message_mask] = soft.bits
    known = np.full(bits.shape, -1)
    if truth is not None:
        known[layout.message_mask] = truth
    decided = panels[2]
    tint = np.where(bits == 1, 255, 0).astype(np.float64)
    rows = block_index(decided.shape[0], layout.rows)[:, None]
    cols = block_index(decided.shape[1], layout.cols)
    message = (bits >= 0)[rows, cols][..., None]
    mixed = 0.45 * decided + 0.55 * tint[rows, cols][..., None]
    decided = np.where(message, mixed, decided).astype(np.uint8)
    for row, col in np.argwhere(bits >= 0):
        top, bottom, left, right = (factor * edge for edge in layout.cell_box(int(row), int(col)))
        colour = UNKNOWN
        if known[row, col] >= 0:
            colour = RIGHT if known[row, col] == bits[row, col] else WRONG
        thickness = 3 if colour == WRONG else 1
        cv2.rectangle(decided, (left + 2, top + 2), (right - 3, bottom - 3), colour, thickness)
    panels[2] = decided
    return np.hstack(panels)


def _rgb(frame: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return frame if frame.ndim == 3 else np.repeat(frame[:, :, None], 3, axis=2)
