"""Draw on pictures: the outline of a display, and frames on its blocks.

Needs OpenCV alone. Colours are (R, G, B) of [0, 255]; pictures are drawn on in place or copied, as
each function says.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from link.images import as_rgb
from link.types import Corners, Image

Colour = tuple[int, int, int]
"""Red, green and blue of [0, 255]."""
GREEN, RED, YELLOW = (60, 220, 90), (230, 70, 60), (255, 255, 0)
"""Colours that show on most pictures."""
CORNER_NAMES = ("TL", "TR", "BR", "BL")
"""Short names of the corners, in corner order, as they are written beside an outline."""


def outline_display(
    image: Image, corners: Corners | None, colour: Colour = RED
) -> NDArray[np.uint8]:
    """Draw the outline of a display, and the names of its corners, on a copy of an image.

    Args:
        image: an `Image`.
        corners: (4, 2) pixels in corner order, or None where no display was found.
        colour: colour of the outline.

    Returns:
        (H, W, 3) uint8 RGB; an unchanged copy where ``corners`` is None.

    >>> photo = np.zeros((60, 80), np.uint8)
    >>> seen = outline_display(photo, np.array([[20, 10], [60, 10], [60, 40], [20, 40.0]]))
    >>> red, green, blue = seen[10, 40].tolist()  # on the upper side
    >>> red > 3 * green
    True
    """
    canvas = as_rgb(image).copy()
    if corners is None:
        return canvas
    thick = max(1, round(max(canvas.shape) / 640))
    points = (corners * 16).round().astype(np.int32)  # 4 binary places
    cv2.polylines(canvas, [points], True, colour, thick, cv2.LINE_AA, 4)
    for name, (x, y) in zip(CORNER_NAMES, corners, strict=True):
        at = round(float(x)), round(float(y))
        cv2.putText(canvas, name, at, cv2.FONT_HERSHEY_SIMPLEX, 0.6 * thick, YELLOW, thick)
    return canvas


def frame_block(
    canvas: NDArray[np.uint8],
    box: tuple[int, int, int, int],
    colour: Colour,
    thickness: int = 1,
    inset: int = 0,
) -> None:
    """Draw a rectangle along the border of a block, in place.

    Args:
        canvas: (H, W, 3) uint8 RGB.
        box: top, bottom, left and right, as `link.layout.Layout.cell_box` gives them.
        colour: colour of the rectangle.
        thickness: thickness of its lines, pixels.
        inset: pixels between the border and the rectangle.
    """
    top, bottom, left, right = box
    start, end = (left + inset, top + inset), (right - 1 - inset, bottom - 1 - inset)
    cv2.rectangle(canvas, start, end, colour, thickness)
