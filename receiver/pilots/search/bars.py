"""Find the picture within the black bars of a display: films are letterboxed, photographs upright.

The edge between a dark part of a picture and a black bar is faint, while that of the panel is
strong. But a whole row or column of a bar is flat, and one of the picture hardly ever is. A bar
that reflects a lamp is flat but for a glow without details, as the sky of a picture may be, so both
are proposed: the picture of what is not flat, and that of what has details.
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
GLOW_PX = 5.0
"""Standard deviation, in pixels of the view, of the Gaussian along a row or column that leaves of
it what may be a reflection's glow: wider than edges, and narrower than the reflection of a lamp."""
MARGIN = 0.12
"""Share of a row, at either end, that is left out, because a quadrilateral may be that of the
bezel, which is seen beside the bars."""
LEAST_BAR, LEAST_PICTURE = 3, 0.2
"""Smallest width of a bar, in pixels of the view, and smallest share of the quadrilateral that the
picture covers. Both were chosen by hand."""


def without_bars(gray: Gray, quad: Corners) -> list[Array]:
    """Find the picture within a quadrilateral that has bars along some of its sides.

    Args:
        gray: (H, W) uint8.
        quad: pixels of it, the outline of a panel or of its bezel.

    Returns:
        (4, 2) pixels each, where bars are flat and where they may glow; none where there are no
        bars, or nothing else.

    >>> gray = np.zeros((120, 160), np.uint8)
    >>> gray[35:85, 20:140] = np.arange(120, dtype=np.uint8)
    >>> panel = np.array([[10.0, 5.0], [149.0, 5.0], [149.0, 114.0], [10.0, 114.0]])
    >>> within, *_ = without_bars(gray, panel)
    >>> bool(np.abs(within[:, 1] - [34.5, 34.5, 84.5, 84.5]).max() < 2)
    True
    """
    H = homography_from_corners(quad, SIDE_PX, SIDE_PX)
    how, size = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP, (SIDE_PX, SIDE_PX)
    view = cv2.warpPerspective(gray, H, size, flags=how, borderMode=cv2.BORDER_REPLICATE)
    smooth = cv2.GaussianBlur(view.astype(np.float32), (0, 0), SMOOTH_PX)
    margin = int(MARGIN * SIDE_PX)
    found = []
    for glows in (False, True):
        rows = _seen(smooth[:, margin : SIDE_PX - margin], glows)
        columns = _seen(smooth[rows[0] : rows[1]].T, glows) if rows else None
        if rows is None or columns is None:
            continue
        (top, bottom), (left, right) = rows, columns
        bar = max(top, left, SIDE_PX - bottom, SIDE_PX - right)
        picture = (bottom - top) * (right - left)
        if bar >= LEAST_BAR and picture >= LEAST_PICTURE * SIDE_PX**2:
            x, y = np.array([left, right]) - 0.5, np.array([top, bottom]) - 0.5
            within = np.array([[x[0], y[0]], [x[1], y[0]], [x[1], y[1]], [x[0], y[1]]])
            found.append(transform(H, within))
    return found


def _seen(lines: NDArray[np.float32], glows: bool) -> tuple[int, int] | None:
    """Give the first line in which something is seen, and the one after the last of them.

    A single line counts for nothing: it may be the edge of the panel.

    Args:
        lines: (lines, pixels) gray levels.
        glows: whether only details count.
    """
    if glows:
        rows = np.ascontiguousarray(lines)
        lines = rows - cv2.GaussianBlur(rows, (0, 0), GLOW_PX, sigmaY=1e-6)
    seen = lines.std(axis=1) > FLAT
    both = np.flatnonzero(seen[:-1] & seen[1:])
    return (int(both[0]), int(both[-1]) + 2) if len(both) else None
