"""Find the lit display in a photograph: candidates first, then the ratex patches decide.

Where the layout has ratex patches, these tell which candidate is the display, which way up it is,
and where its corners are to sub-pixels. Without patches the likeliest candidate is taken.
"""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from export.locate.candidates import (
    WORK_PX,
    Located,
    display_candidates,
    on_full_image,
    small_copy,
)
from export.locate.patches import Pyramid, image_pyramid, search_patches
from export.locate.quads import upright
from export.locate.refine import (
    as_gray,
    clipped_to_image,
    corners_on_edges,
    corners_on_patches,
    needed_visibility,
)
from export.locate.spots import from_spots
from link.layout import Layout

SMALL_ERROR_PX = 2.0
"""Error of a candidate's side, in pixels of the small copy; farther off, another edge may be
stronger."""
LIKELY = 6
"""Number of candidates whose patches are sought before quadrilaterals are made from patches alone
(`export.locate.spots`)."""
SPOT_QUADS = 30
"""Largest number of quadrilaterals that are made from patches alone."""
ALL_TURNS = (0, 1, 2, 3)
"""Quarter turns by which a quadrilateral's corner order may differ from the displayed picture's."""
SURE_VISIBILITY = 0.93
"""Visibility of the patches at which no further candidate is tried."""
PROMISING = 0.55
"""Mean correlation of single patches near their places that is worth aligning: true displays had
0.69 and more, turned ones up to 0.65."""
MAX_ASPECT = 40
"""Largest ratio of an image's longer to its shorter side at which a display is sought; beyond it
the small copy has fewer than 16 rows or columns."""
MIN_SCORE = 0.04
"""Smallest score of a display without patches. Photographs of the training split that show none
score 0.011 at most; nine in ten simulated displays score more (reports.lab.locate_weights)."""


def locate(image: NDArray[np.uint8], layout: Layout | None = None) -> Located | None:
    """Find the lit display in an image.

    Args:
        image: (H, W) or (H, W, 3) uint8, encoded RGB.
        layout: of what is displayed; its ratex patches tell the orientation.

    Returns:
        corners and score; None where nothing looks like a display, or shows the patches.

    >>> photo = np.full((240, 320, 3), 100, np.uint8)
    >>> photo[55:185, 75:245] = 20  # a black bezel
    >>> photo[60:180, 80:240] = 200  # a lit display
    >>> expected = [[79.5, 59.5], [239.5, 59.5], [239.5, 179.5], [79.5, 179.5]]
    >>> bool(np.abs(locate(photo).corners - expected).max() < 0.5)
    True
    >>> locate(np.full((240, 320, 3), 100, np.uint8)) is None
    True
    """
    if max(image.shape[:2]) > MAX_ASPECT * min(image.shape[:2]):
        return None
    candidates = display_candidates(image)
    if layout is None or not layout.ratex:
        return _likeliest(image, candidates)
    pyramid = image_pyramid(as_gray(image))
    corners = [candidate.corners for candidate in candidates]
    found = _best_on_patches(image, pyramid, layout, corners[:LIKELY], ALL_TURNS)
    if found is None:
        small, scale = small_copy(image)
        spots = from_spots(cv2.cvtColor(small, cv2.COLOR_RGB2GRAY), layout, SPOT_QUADS)
        quads = [on_full_image(quad, scale) for quad in spots]
        found = _best_on_patches(image, pyramid, layout, quads, ALL_TURNS[:1])
    if found is None:
        found = _best_on_patches(image, pyramid, layout, corners[LIKELY:], ALL_TURNS)
    return found


def _likeliest(image: NDArray[np.uint8], candidates: Sequence[Located]) -> Located | None:
    """The first candidate, with its corners moved onto edges, or None where it is too unlikely."""
    if not candidates or candidates[0].score < MIN_SCORE:
        return None
    gray = as_gray(image)
    reach = SMALL_ERROR_PX * max(1.0, max(gray.shape) / WORK_PX)
    corners = corners_on_edges(gray, candidates[0].corners, reach)
    corners = clipped_to_image(corners, gray.shape)
    return Located(upright(corners[None])[0], candidates[0].score)


def _best_on_patches(
    image: NDArray[np.uint8],
    pyramid: Pyramid,
    layout: Layout,
    quads: Sequence[NDArray[np.float64]],
    turns: tuple[int, ...],
) -> Located | None:
    """Where the patches are seen best, or the first place where they surely are, or None."""
    best: Located | None = None
    for quad in quads:
        turned = [np.roll(quad, -turn, axis=0) for turn in turns]
        promise = [search_patches(pyramid, corners, layout)[0] for corners in turned]
        for turn in np.argsort(promise)[::-1][:2]:
            if promise[turn] < PROMISING:
                continue
            corners, seen = corners_on_patches(image, pyramid, turned[turn], layout)
            if seen >= needed_visibility(layout) and (best is None or seen > best.score):
                best = Located(corners, min(1.0, seen))
        if best is not None and best.score >= SURE_VISIBILITY:
            break
    return best
