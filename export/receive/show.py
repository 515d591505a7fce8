"""Annotated pictures of what the receiver saw and decided."""

import cv2
import numpy as np
from numpy.typing import NDArray

from export.receive.receiver import Pair
from export.receive.track import Tracked
from link.images import as_rgb
from link.layout import Layout

GREEN, RED, WHITE = (60, 220, 90), (230, 70, 60), (255, 255, 255)
AMPLIFIED = 12
"""Gain of the shown difference between the frames of a pair."""


def draw_corners(image: NDArray[np.uint8], corners: NDArray[np.float64]) -> NDArray[np.uint8]:
    """The image with the quadrilateral, its top side red and a dot at the top-left corner."""
    canvas = as_rgb(image).copy()
    thick = max(1, round(max(canvas.shape) / 500))
    points = corners.round().astype(np.int32)
    cv2.polylines(canvas, [points], True, GREEN, thick, cv2.LINE_AA)
    cv2.line(canvas, points[0].tolist(), points[1].tolist(), RED, thick, cv2.LINE_AA)
    cv2.circle(canvas, points[0].tolist(), 3 * thick, RED, -1, cv2.LINE_AA)
    return canvas


def draw_pair(
    image: NDArray[np.uint8], tracked: Tracked, pair: Pair, layout: Layout
) -> NDArray[np.uint8]:
    """Four panels: the camera frame, the rectified original, the difference, the decided blocks.

    Args:
        image: (H, W) or (H, W, 3) uint8, the camera frame after which the pair was decoded.
        tracked: the display in it.
        pair: what was decoded.
        layout: of the display.

    Returns:
        (2 height, 2 width, 3) uint8 RGB of the layout's size.
    """
    width, height = layout.width, layout.height
    scene = cv2.resize(draw_corners(image, tracked.corners), (width, height))
    original, embedded = (as_rgb(state.image) for state in (pair.original, pair.embedded))
    difference = embedded.astype(np.float32) - original
    difference -= np.median(difference)
    amplified = np.clip(128 + AMPLIFIED * difference, 0, 255).astype(np.uint8)
    return np.vstack(
        [
            np.hstack([scene, original]),
            np.hstack([amplified, _decided(pair, layout)]),
        ]
    )


def _decided(pair: Pair, layout: Layout) -> NDArray[np.uint8]:
    """Blocks: light for 1, dark for 0, grayer the less certain; red crosses are erasures."""
    panel = np.full((layout.height, layout.width, 3), 128, np.uint8)
    for (row, col), score in zip(np.argwhere(layout.message_mask), pair.soft.scores, strict=True):
        top, bottom, left, right = layout.cell_box(int(row), int(col))
        level = 255 / (1 + np.exp(-np.clip(score, -6, 6)))
        panel[top + 1 : bottom, left + 1 : right] = round(float(level))
        if score == 0:
            cv2.line(panel, (left, top), (right, bottom), RED, 2, cv2.LINE_AA)
            cv2.line(panel, (left, bottom), (right, top), RED, 2, cv2.LINE_AA)
    for row, col in layout.ratex:
        top, bottom, left, right = layout.cell_box(row, col)
        panel[top:bottom, left:right] = pair.original.image[top:bottom, left:right].reshape(
            bottom - top, right - left, -1
        )
        cv2.rectangle(panel, (left, top), (right - 1, bottom - 1), GREEN, 2)
    return panel
