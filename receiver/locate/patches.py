"""Seek the ratex patches near a coarse quadrilateral, and move its corners to where they are.

Patches tell which way up the display is and, four of them in the corners, where its corners are,
whatever the picture shows and whatever surrounds it.
"""

from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from link.geometry import (
    UNIT_SQUARE,
    homography_from_corners,
    homography_from_points,
    in_image,
    resampled,
    transform,
)
from link.images import averaged_down
from link.layout import Layout
from link.ratex import TILES, patch_centres, tile_levels
from link.robust import reweighted, ridge_solution
from link.types import Corners
from receiver.locate.corner_motion import points_by_corners

TILE_PX = 4
"""Pixels along each axis of a tile where patches are sought: places are found to whole pixels, and
the alignment goes on from within half a tile. Chosen by hand."""
SEARCH = 0.09
"""Reach of the search on each axis, as a share of the display's side: some two deviations of a
coarse corner (`SEARCH_ERROR`)."""
SEARCH_ERROR, PLACE_ERROR = 0.04, 0.006
"""Expected errors, as shares of the display's side, of a coarse corner and of a patch found:
standard deviations by which the least squares weigh the one against the other. Chosen by hand."""
LEAST_WEIGHED, WEIGHT_POWER = 0.05, 8
"""Smallest correlation that a patch in view is weighed by, and the power of it that is the weight:
a patch of correlation 0.9 weighs 100 times as much as one of 0.5, which is mostly a wrong place.
The smallest keeps weights off 0. Chosen by hand."""
LEAST_HALVED_PX = 160
"""Smallest side of an image, in pixels, that is halved for a pyramid. Chosen by hand."""
FINEST_PX = 1.2
"""Distance of samples, in pixels of a level of a pyramid, in whose middle the levels change:
samples lie between 0.85 and 1.7 px apart, so that little of the level goes unseen."""
DRAWN_KAPPA = 3
"""Gray levels by which drawn patches toggle, the κ of the preset `paper`; the levels of the tiles
hardly depend on it."""
LEAST_PATCHES, MISSED_PATCHES = 3, 2
"""Smallest number of patches that must be seen where a layout has so many, and largest number that
may be out of view or covered. Three are the fewest that tell an affine map."""
CLEAR_KEPT = 0.9
"""Smallest correlation of each patch that is counted where others are left out: with corners that
may lie anywhere, something else looks like the third of three patches, and reaches 0.85."""
COVERED_LOSS = 0.08
"""Correlation that is taken off where patches that are not seen are left out of the mean: the best
of several ways of leaving out matches better by chance. Chosen by hand."""

Pyramid = list[NDArray[np.uint8]]
"""Gray levels of an image at 1, 1/2, 1/4, ... of its size, (H, W) uint8 each."""


def image_pyramid(gray: NDArray[np.uint8]) -> Pyramid:
    """Halve a gray image, (H, W) uint8, again and again, until it has about 80 px on a side."""
    levels = [gray]
    while min(levels[-1].shape) >= LEAST_HALVED_PX:
        levels.append(averaged_down(levels[-1], 2))
    return levels


def at_level(corners: NDArray[np.float64], level: int) -> NDArray[np.float64]:
    """Express corners, in pixels of the image, in pixels of a level of its pyramid."""
    return np.asarray((corners + 0.5) / 2**level - 0.5)


def level_for(corners: Corners, width: float, height: float, levels: int) -> int:
    """Choose the level of a pyramid on which a display is looked at.

    Args:
        corners: pixels of the image.
        width: samples across the display.
        height: samples down the display.
        levels: number of levels in the pyramid.

    Returns:
        the level whose pixels are about as fine as the samples, or up to half as fine again.
    """
    side = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
    ratio = min(side[[0, 2]].min() / width, side[[1, 3]].min() / height)
    return int(np.clip(np.floor(np.log2(max(ratio, 1e-3) / FINEST_PX) + 0.5), 0, levels - 1))


@lru_cache(maxsize=8)
def _templates(layout: Layout) -> list[NDArray[np.uint8]]:
    """Draw each patch with `TILE_PX` pixels along each axis of a tile."""
    whole = np.ones((TILE_PX, TILE_PX), np.intp)
    return [np.kron(tiles, whole).astype(np.uint8) for tiles in tile_levels(layout, DRAWN_KAPPA)]


def patches_in_view(
    corners: Corners, layout: Layout, image_shape: tuple[int, ...]
) -> NDArray[np.bool_]:
    """Tell which patches lie wholly in the image.

    Args:
        corners: pixels of the image.
        layout: layout with patches.
        image_shape: (H, W, ...) of the image.

    Returns:
        (patches,) bool.
    """
    H = homography_from_corners(corners, layout.width, layout.height)
    boxes = np.array([layout.cell_box(row, col) for row, col in layout.ratex]) - 0.5
    top, bottom, left, right = boxes.T
    ends = np.stack([left, top, right, top, right, bottom, left, bottom], axis=-1)
    there = transform(H, ends.reshape(-1, 2)).reshape(-1, 4, 2)
    return np.asarray(in_image(there, image_shape).all(axis=1))


def seen_correlation(match: NDArray[np.float64], in_view: NDArray[np.bool_]) -> float:
    """Tell how well a rectified frame shows the patches, some of which may be covered.

    Args:
        match: (patches,) correlations of the patches, from `link.ratex.match_patches`.
        in_view: (patches,) which patches the image holds, as `patches_in_view` tells.

    Returns:
        mean correlation of all patches; or, where that is more, that of the patches that are seen
        best, less `COVERED_LOSS`, if each of them has `CLEAR_KEPT`. At most `MISSED_PATCHES` are
        left out, and `LEAST_PATCHES` must be in view, or the value is -1.
    """
    needed = min(len(match), max(LEAST_PATCHES, len(match) - MISSED_PATCHES))
    if in_view.sum() < needed:
        return -1.0
    kept = np.sort(match[in_view])[-needed:]
    best = kept.mean() - COVERED_LOSS if kept[0] >= CLEAR_KEPT else -1.0
    return float(max(match.mean(), best) if in_view.all() else best)


def search_patches(
    pyramid: Pyramid, corners: Corners, layout: Layout, reach: float = SEARCH
) -> tuple[float, NDArray[np.float64]]:
    """Look for each patch around the place where the corners put it.

    Args:
        pyramid: `image_pyramid` of the image's gray levels.
        corners: (4, 2) coarse, in the corner order to be tried.
        layout: layout with patches.
        reach: distance on each axis that is searched, as a share of the display's side.

    Returns:
        mean over the patches in view of the best correlation in reach, in [-1, 1], or -1 where too
        few are in view; and (patches, 3): where its centre was found (x, y in display units,
        [0, 1]) and that correlation, 0 for a patch out of view.
    """
    width, height = layout.cols * TILES * TILE_PX, layout.rows * TILES * TILE_PX
    reach_x, reach_y = max(3, round(reach * width)), max(3, round(reach * height))
    level = level_for(corners, width, height, len(pyramid))
    H = homography_from_corners(at_level(corners, level), width, height)
    shift = np.array([[1, 0, -reach_x], [0, 1, -reach_y], [0, 0, 1.0]])
    view = resampled(pyramid[level], H @ shift, width + 2 * reach_x, height + 2 * reach_y)
    size = TILES * TILE_PX
    found = np.empty((len(layout.ratex), 3))
    for i, ((row, col), template) in enumerate(zip(layout.ratex, _templates(layout), strict=True)):
        window = view[
            row * size : (row + 1) * size + 2 * reach_y, col * size : (col + 1) * size + 2 * reach_x
        ]
        match = cv2.matchTemplate(window, template, cv2.TM_CCOEFF_NORMED)
        match[~np.isfinite(match)] = 0
        y, x = np.unravel_index(int(match.argmax()), match.shape)
        found[i] = (
            ((col + 0.5) * size + x - reach_x) / width,
            ((row + 0.5) * size + y - reach_y) / height,
            match[y, x],
        )
    if in_image(corners, pyramid[0].shape).all():
        return float(found[:, 2].mean()), found
    half = 0.5 / np.array([layout.cols, layout.rows])
    around = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half
    ends = (found[:, None, :2] + around) * [width, height] - 0.5  # (patches, 4, 2)
    there = transform(H, ends.reshape(-1, 2)).reshape(ends.shape)
    seen = np.asarray(in_image(there, pyramid[level].shape).all(axis=1))
    found[~seen, :2], found[~seen, 2] = patch_centres(layout)[~seen], 0
    if seen.sum() < min(LEAST_PATCHES, len(found)):
        return -1.0, found
    return float(found[seen, 2].mean()), found


def corners_from_patches(corners: Corners, found: NDArray[np.float64], layout: Layout) -> Corners:
    """Move corners so that the patches lie where they were found.

    Least squares on the corners' motion in the display's frame, with a ridge: patches of low
    correlation count little, and a corner that no patch tells about stays. A patch that was found
    in a wrong place disagrees with the others and counts little, too.

    Args:
        corners: pixels of the image.
        found: (patches, 3) places and correlations, as `search_patches` returns them.
        layout: layout with patches.

    Returns:
        pixels of the image.
    """
    nominal = patch_centres(layout)
    moved = found[:, :2].copy()
    weight = np.clip(found[:, 2], LEAST_WEIGHED, 1) ** WEIGHT_POWER / PLACE_ERROR**2
    weight = weight * (found[:, 2] != 0)  # a patch out of view is not weighed
    ridge = np.eye(8) / SEARCH_ERROR**2

    def solve(robust: NDArray[np.float64]) -> NDArray[np.float64]:
        """Two Gauss-Newton steps from the unit square."""
        at = UNIT_SQUARE.copy()
        for _ in range(2):
            predicted, by_corners = points_by_corners(UNIT_SQUARE, at, nominal)
            step = ridge_solution(
                by_corners.reshape(-1, 8),
                (moved - predicted).reshape(-1),
                np.repeat(weight * robust, 2),
                ridge,
                pull=-ridge @ (at - UNIT_SQUARE).reshape(-1),
            )
            at = at + step.reshape(4, 2)
        return at

    def misfit(at: NDArray[np.float64]) -> NDArray[np.float64]:
        there = transform(homography_from_points(UNIT_SQUARE, at), nominal)
        return np.asarray(np.linalg.norm(moved - there, axis=1))

    at, _ = reweighted(solve, misfit, lambda _: 2 * PLACE_ERROR, 4, np.ones(len(moved)))
    return transform(homography_from_points(UNIT_SQUARE, corners), at)
