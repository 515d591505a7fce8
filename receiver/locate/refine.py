"""Move corners that are a few per cent off onto the ratex patches, or onto the display's edges."""

import cv2
import numpy as np
from numpy.typing import NDArray

from link.geometry import homography_from_corners, rectify
from link.layout import Layout
from link.ratex import CLEAR_MATCH, match_patches
from link.types import Corners, Image
from receiver.locate.align import align_corners
from receiver.locate.edges import fit_edges
from receiver.locate.patches import (
    SEARCH,
    Pyramid,
    corners_from_patches,
    patches_in_view,
    search_patches,
    seen_correlation,
)
from receiver.locate.quads import SLACK, is_sound

SEARCHES = (SEARCH, SEARCH, SEARCH / 3)
"""Reach of each of the searches for patches before corners are aligned to them, as a share of the
display's side: what is found first brings the others into reach. The last one looks near, so that
what is alike farther off draws nothing away. Chosen by hand."""
FEW_PATCHES_CORRELATION = {1: 0.88, 2: 0.85}
"""Smallest `link.ratex.patch_correlation` of a display that shows one patch, and two: fewer patches
match by chance more easily. Chosen by hand above `USUAL_CORRELATION`."""
OUTSIDE = 0.25
"""Distance by which a corner of a display that is partly in view may lie outside the image, as a
share of the image's longer side. Chosen by hand."""
PARTLY_SPREADS = (0.1, 0.1)
"""Expected errors of the corners, as shares of the display's side, in the further alignments of a
display that is partly in view: what lies beyond the patches is known less well. Chosen by hand."""
USUAL_CORRELATION = 0.8
"""Smallest `link.ratex.patch_correlation` of a display that shows three patches or more. It lies
between what aligned displays have and what wrong turns reach by chance, most of all with few
patches. Chosen by hand."""
EDGE_BLUR_PX, FINE_REACH_PX = 1.0, 4.0
"""Standard deviation of the blur before edges are fitted, and largest reach of the second fit,
which starts from the edges that the first one found. In pixels of the image; chosen by hand."""


def needed_correlation(layout: Layout) -> float:
    """Say how visible a layout's patches must be, in [0, 1], for corners to be believed."""
    return FEW_PATCHES_CORRELATION.get(len(layout.ratex), USUAL_CORRELATION)


def corners_on_patches(
    image: Image, pyramid: Pyramid, corners: Corners, layout: Layout
) -> tuple[NDArray[np.float64], float]:
    """Move corners so that the image shows the ratex patches where the layout has them.

    Patches may be out of view, or covered, as `receiver.locate.patches.seen_correlation` allows.

    Args:
        image: an `Image`.
        pyramid: `receiver.locate.patches.image_pyramid` of its gray levels.
        corners: pixels within about 9 % of the side, in the corner order to be tried.
        layout: layout with patches.

    Returns:
        (4, 2), and `receiver.locate.patches.seen_correlation` there; -1 where the corners make no
        display.
    """
    for reach in SEARCHES:
        found = search_patches(pyramid, corners, layout, reach)[1]
        corners = corners_from_patches(corners, found, layout)
    corners = align_corners(pyramid, corners, layout)
    corners, match, seen = _judged(image, corners, layout)
    clear = match >= CLEAR_MATCH
    if seen >= needed_correlation(layout) and not clear.all():
        # a patch that is cut off or covered must not hold the corners
        for spread in PARTLY_SPREADS:
            corners = align_corners(pyramid, corners, layout, spread, clear)
        corners, match, seen = _judged(image, corners, layout)
    return corners, seen


def _judged(
    image: NDArray[np.uint8], corners: NDArray[np.float64], layout: Layout
) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """Clip corners that lie a little outside; they, what each patch and what all are seen by."""
    height, width = image.shape[:2]
    clipped = clipped_to_image(corners, image.shape)
    if np.abs(clipped - corners).max() <= SLACK * max(width, height):
        corners = clipped
    if not is_sound(corners[None], width, height, OUTSIDE)[0]:
        return corners, np.zeros(len(layout.ratex)), -1.0
    H = homography_from_corners(corners, layout.width, layout.height)
    match = match_patches(rectify(image, H, layout.width, layout.height), layout).correlation
    in_view = patches_in_view(corners, layout, image.shape)
    return corners, match, seen_correlation(match, in_view)


def corners_on_edges(
    gray: NDArray[np.uint8], corners: NDArray[np.float64], reach: float
) -> Corners:
    """Move corners so that the sides lie on edges of the image, first coarsely and then finely.

    Args:
        gray: (H, W) uint8.
        corners: (4, 2) px, clockwise.
        reach: pixels that a side may move at either end.

    Returns:
        in pixels; a side without an edge in reach stays.
    """
    smooth = cv2.GaussianBlur(gray, (0, 0), EDGE_BLUR_PX).astype(np.float32)
    for pixels in (reach, min(reach, FINE_REACH_PX)):
        corners = fit_edges(smooth, corners, pixels)
    return corners


def clipped_to_image(corners: NDArray[np.float64], shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Move corners that lie outside an image of a shape (H, W, ...) to its border."""
    return np.clip(corners, -0.5, [shape[1] - 0.5, shape[0] - 0.5])
