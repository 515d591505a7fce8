"""Annotated pictures of what the receiver saw and decided."""

import cv2
import numpy as np
from numpy.typing import NDArray

from link.images import as_rgb
from link.layout import Layout
from link.overlay import GREEN, RED, frame_block, outline_display
from link.types import Image
from receiver.reading.reader import DecodedPair
from receiver.seen import SeenFrame

AMPLIFIED = 12
"""Gain of the shown difference between the frames of a pair."""


def draw_decoded_pair(
    image: Image, seen: SeenFrame, pair: DecodedPair, layout: Layout
) -> NDArray[np.uint8]:
    """Draw four panels: camera frame, rectified original, difference, and decided blocks.

    Args:
        image: an `Image`, the camera frame after which the pair was decoded.
        seen: where the display was seen in it.
        pair: what was decoded.
        layout: layout of the display.

    Returns:
        (2 height, 2 width, 3) uint8 RGB of the layout's size.
    """
    scene = outline_display(image, seen.corners, GREEN)
    scene = np.asarray(cv2.resize(scene, (layout.width, layout.height)), np.uint8)
    original, embedded = map(as_rgb, pair.shown.images)
    difference = embedded.astype(np.float32) - original
    difference -= np.median(difference)
    amplified = np.clip(128 + AMPLIFIED * difference, 0, 255).astype(np.uint8)
    decided = _decided_blocks(pair, layout)
    return np.vstack([np.hstack([scene, original]), np.hstack([amplified, decided])])


def _decided_blocks(pair: DecodedPair, layout: Layout) -> NDArray[np.uint8]:
    """Blocks: light for 1, dark for 0, grayer the less certain; red crosses are erasures."""
    panel = np.full((layout.height, layout.width, 3), 128, np.uint8)
    for (row, col), score in zip(np.argwhere(layout.message_mask), pair.soft.scores, strict=True):
        top, bottom, left, right = layout.cell_box(int(row), int(col))
        level = 255 / (1 + np.exp(-np.clip(score, -6, 6)))
        panel[top + 1 : bottom, left + 1 : right] = round(float(level))
        if score == 0:
            for start, end in ((top, bottom), (bottom, top)):
                cv2.line(panel, (left, start), (right, end), RED, 2, cv2.LINE_AA)
    original = as_rgb(pair.shown.images[0])
    for row, col in layout.ratex:
        box = top, bottom, left, right = layout.cell_box(row, col)
        panel[top:bottom, left:right] = original[top:bottom, left:right]
        frame_block(panel, box, GREEN, 2)
    return panel
