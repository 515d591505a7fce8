"""Rank the quadrilaterals of a photograph by how likely each is to bound a lit display.

Quadrilaterals come from straight lines and outlines on a small copy of the image, their sides snap
to edges, and a score ranks them by what the image shows along their sides. Ratex patches play no
part here.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from link.images import as_gray, as_rgb
from link.steps import Steps, run_to_end
from link.types import Corners, Image
from receiver.locate.edges import side_features, snap_to_edges
from receiver.locate.quads import (
    SAME_PX,
    distinct,
    from_contours,
    from_lines,
    is_sound,
    nested,
    upright,
)
from receiver.locate.refine import OUTSIDE

WORK_PX = 640
"""Longer side, in pixels, of the small copy on which quadrilaterals are sought: a bezel of half a
per cent of the image is then 3 px wide. Constants in pixels of the copy were chosen with it."""
SNAP_PX = 5.0
"""Distance, in pixels of the small copy, that a side may move onto an edge. Chosen by hand."""
LINE_QUADS = 70
"""Largest number of quadrilaterals that are taken from straight lines. It bounds the work of
measuring their sides; chosen by hand."""
CANDIDATES = 20
"""Largest number of candidates that are looked at more closely. It bounds the work of a search that
finds nothing; chosen by hand."""
LINES_WORK, SIDES_WORK = 45, 25
"""Units of work (`link.steps`) of the quadrilaterals from lines, and of their sides: about
the milliseconds that they take of one core."""
NEAR = 3.0
"""Log-odds by which a picture may be less likely than the outline of its bezel and still be taken
for the display: a light bezel, which is nested in the same way, has more edges than the picture,
but is not taken to be 20 times as likely (e to the 3). Chosen by hand."""
WEIGHTS = np.array([11.0, 1.57, 15.14, 4.98, 1.93, -2.3, 6.83, 5.43, -11.79])
"""Log-odds per unit of each of `receiver.locate.edges.side_features`, fitted on simulated
photographs by reports.lab.locate_weights at the tag results-2026-11."""
BIAS = -22.02
"""Log-odds of a quadrilateral whose features are all 0, fitted with `WEIGHTS`."""


@dataclass(frozen=True)
class Located:
    """A display found in an image."""

    corners: Corners
    """(4, 2) pixels. Where ratex patches told the orientation, the top-left corner of the displayed
    picture comes first; else the corner order is the one nearest to upright in the image."""
    score: float
    """How sure the display is, in [0, 1]. Where ratex patches were sought it is
    `link.ratex.patch_correlation`, else a logistic score of
    `receiver.locate.edges.side_features`."""


def display_candidates(image: Image, limit: int = CANDIDATES) -> list[Located]:
    """List quadrilaterals that may bound a lit display, the likeliest first.

    Args:
        image: an `Image`.
        limit: largest number returned.

    Returns:
        corners to about 2 px of an image of 640, with scores without regard to patches.
    """
    return run_to_end(candidate_steps(image, limit))


def candidate_steps(image: Image, limit: int = CANDIDATES) -> Steps[list[Located]]:
    """List quadrilaterals that may bound a lit display, step by step.

    Args:
        image: an `Image`.
        limit: largest number returned.

    Returns:
        what `display_candidates` returns.
    """
    small, scale = small_copy(image)
    gray = as_gray(small)
    lines = from_lines(gray, LINE_QUADS)
    yield LINES_WORK
    quads = np.concatenate([lines, from_contours(gray)])
    if len(quads):
        smooth = cv2.GaussianBlur(gray, (0, 0), 0.7).astype(np.float32)
        quads = np.concatenate([snap_to_edges(smooth, quads, SNAP_PX), quads])
        quads = upright(quads[is_sound(quads, gray.shape[1], gray.shape[0])])
    if not len(quads):
        yield SIDES_WORK
        return []
    # many snap to the same edges
    quads = quads[np.unique(np.rint(quads / 1.5).reshape(-1, 8), axis=0, return_index=True)[1]]
    odds = side_features(small, quads) @ WEIGHTS + BIAS
    yield SIDES_WORK
    first = top = int(odds.argmax())
    # a light bezel's outline may show more edges than the picture within
    while len(within := np.flatnonzero(nested(quads, quads[first]) & (odds > odds[top] - NEAR))):
        first = int(within[odds[within].argmax()])
    odds[first] = odds[top] + 1e-6
    chosen = distinct(quads, odds, limit, SAME_PX)
    scores = 1 / (1 + np.exp(-odds))
    return [Located(on_full_image(quads[i], scale), float(scores[i])) for i in chosen]


def leaving_quads(image: Image, limit: int) -> list[Corners]:
    """List quadrilaterals of straight lines that may bound a display which is partly in view.

    Args:
        image: an `Image`.
        limit: largest number returned.

    Returns:
        corners, of which at least one lies outside the image, by at most `OUTSIDE` of its longer
        side; those whose sides the lines cover best come first.
    """
    small, scale = small_copy(image)
    return list(on_full_image(from_lines(as_gray(small), limit, OUTSIDE), scale))


def small_copy(image: Image) -> tuple[NDArray[np.uint8], NDArray[np.float64]]:
    """Shrink an image until its longer side has `WORK_PX` pixels; a smaller one keeps its size.

    Args:
        image: an `Image`.

    Returns:
        the copy, (h, w, 3) uint8, and (2,) pixels of the image in one of the copy.
    """
    height, width = image.shape[:2]
    factor = max(1.0, max(height, width) / WORK_PX)
    size = (max(1, round(width / factor)), max(1, round(height / factor)))
    small = cv2.resize(as_rgb(image), size, interpolation=cv2.INTER_AREA)
    return np.asarray(small, np.uint8), np.array([width / size[0], height / size[1]])


def on_full_image(points: NDArray[np.float64], scale: NDArray[np.float64]) -> NDArray[np.float64]:
    """Move (..., 2) points from the small copy to the image; ``scale`` is that of `small_copy`."""
    return np.asarray((points + 0.5) * scale - 0.5)
