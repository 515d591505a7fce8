"""Find the picture within the black bars of a display: films are letterboxed, photographs upright.

The edge between a dark part of a picture and a black bar is faint, while that of the panel is
strong. But a whole row or column of a bar is flat, and one of the picture hardly ever is.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from link.geometry import homography_from_corners, transform
from link.types import Array, Corners, Gray

SIDE_PX, SMOOTH_PX = 192, 1.0
"""Side, in pixels, of the view in which rows and columns are looked at, so that a picture's side is
found to half a per cent of the panel's, and standard deviation, in its pixels, over which the
view's noise is smoothed."""
FLAT = 3.0
"""Standard deviation along a row or column, in gray levels, below which nothing is seen there:
three times that of a camera's noise once it is smoothed."""
MARGIN = 0.12
"""Share of a row, at either end, that is left out, because a quadrilateral may be that of the
bezel, which is seen beside the bars."""
LEAST_BAR, LEAST_PICTURE = 3, 0.2
"""Smallest width of a bar, in pixels of the view, and smallest share of the quadrilateral that the
picture covers. Both were chosen by hand."""


def without_bars(gray: Gray, quad: Corners) -> Array | None:
    """Find the picture within a quadrilateral that has bars along some of its sides.

    Args:
        gray: (H, W) uint8.
        quad: pixels of it, the outline of a panel or of its bezel.

    Returns:
        (4, 2) pixels; None where there are no bars, or nothing else.

    >>> gray = np.zeros((120, 160), np.uint8)
    >>> gray[35:85, 20:140] = np.arange(120, dtype=np.uint8)
    >>> panel = np.array([[10.0, 5.0], [149.0, 5.0], [149.0, 114.0], [10.0, 114.0]])
    >>> within = without_bars(gray, panel)
    >>> bool(np.abs(within[:, 1] - [34.5, 34.5, 84.5, 84.5]).max() < 2)
    True
    """
    H = homography_from_corners(quad, SIDE_PX, SIDE_PX)
    how, size = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP, (SIDE_PX, SIDE_PX)
    view = cv2.warpPerspective(gray, H, size, flags=how, borderMode=cv2.BORDER_REPLICATE)
    smooth = cv2.GaussianBlur(view.astype(np.float32), (0, 0), SMOOTH_PX)
    margin = int(MARGIN * SIDE_PX)
    rows = _seen(smooth[:, margin : SIDE_PX - margin])
    columns = _seen(smooth[rows[0] : rows[1]].T) if rows else None
    if rows is None or columns is None:
        return None
    (top, bottom), (left, right) = rows, columns
    if max(top, left, SIDE_PX - bottom, SIDE_PX - right) < LEAST_BAR:
        return None
    if (bottom - top) * (right - left) < LEAST_PICTURE * SIDE_PX**2:
        return None
    x, y = np.array([left, right]) - 0.5, np.array([top, bottom]) - 0.5
    return transform(H, np.array([[x[0], y[0]], [x[1], y[0]], [x[1], y[1]], [x[0], y[1]]]))


def _seen(lines: NDArray[np.float32]) -> tuple[int, int] | None:
    """Give the first line in which something is seen, and the one after the last of them.

    A single line counts for nothing: it may be the edge of the panel.
    """
    seen = lines.std(axis=1) > FLAT
    both = np.flatnonzero(seen[:-1] & seen[1:])
    return (int(both[0]), int(both[-1]) + 2) if len(both) else None
