"""Find the lit display in a photograph: candidates first, then the ratex patches decide.

Where the layout has ratex patches, these tell which candidate is the display, which way up it is,
and where its corners are to sub-pixels. Without patches the likeliest candidate is taken.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from link.images import as_gray
from link.layout import Layout
from link.steps import Steps, run_to_end
from link.types import Corners, Image
from receiver.locate.candidates import (
    LINES_WORK,
    WORK_PX,
    Located,
    candidate_steps,
    leaving_quads,
    on_full_image,
    small_copy,
)
from receiver.locate.patches import Pyramid, image_pyramid, search_patches
from receiver.locate.quads import is_sound, upright
from receiver.locate.refine import (
    clipped_to_image,
    corners_on_edges,
    corners_on_patches,
    needed_correlation,
)
from receiver.locate.spots import (
    MAX_OUTSIDE,
    corner_cells,
    partial_quads,
    spot_steps,
    whole_quads,
)

SMALL_ERROR_PX = 2.0
"""Error of a candidate's side, in pixels of the small copy; farther off, another edge may be
stronger. Chosen by hand."""
LIKELY = 6
"""Number of candidates whose patches are sought before quadrilaterals are made from patches alone
(`receiver.locate.spots`): where a display's border shows edges, it is among the first. Chosen by
hand."""


@dataclass(frozen=True)
class Demand:
    """What it takes to find a display by its patches."""

    promise: float
    """Mean correlation of single patches near their places that is worth aligning."""
    aligned: int
    """Largest number of readings of a quadrilateral that are aligned, the most promising ones."""
    sure: float
    """Correlation of the patches at which no further quadrilateral is tried."""


WHOLE = Demand(promise=0.55, aligned=2, sure=0.93)
"""For a whole display, of which the readings are quarter turns. True displays had a promise of 0.69
and more, turned ones up to 0.65; and it is sure above what is needed
(`receiver.locate.refine.FEW_PATCHES_CORRELATION`) for any number of patches. Chosen by hand."""
PARTLY = Demand(promise=0.65, aligned=1, sure=0.0)
"""For a display of which some patches are out of view; the readings are guesses of its perspective.
More promise is wanted, because fewer patches match by chance more easily, and whatever then shows
the patches well enough is taken. Chosen by hand."""
LEAVING_QUADS = 6
"""Largest number of quadrilaterals of lines that leave the image. It bounds the work of a search
that finds nothing; chosen by hand."""
REFINE_WORK, COMBINE_WORK = 20, 15
"""Units of work (`link.steps`) of an alignment, and of combining patches: about the milliseconds
that they take of one core."""
SAME_PLACE = 0.15
"""Mean distance of two displays' corners, as a share of the diagonal, below which they are at one
place: two displays beside one another are farther apart than that. Chosen by hand."""
MAX_ASPECT = 40
"""Largest ratio of an image's longer to its shorter side at which a display is sought; beyond it
the small copy has fewer than 16 rows or columns."""
MIN_SCORE = 0.04
"""Smallest score of a display without patches. Photographs of the training split that show none
score 0.011 at most; nine in ten simulated displays score more. Measured by
`reports.lab.locate_weights` at the tag results-2026-11."""


def locate(image: Image, layout: Layout | None = None) -> Located | None:
    """Find the lit display in an image.

    Args:
        image: an `Image`.
        layout: layout of what is displayed; its ratex patches tell the orientation.

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
    return run_to_end(search_steps(image, layout))


def is_at(corners: Corners, places: Sequence[Corners]) -> bool:
    """Tell whether a display is at about one of some places, the same way up."""
    apart = [np.linalg.norm(corners - place, axis=1).mean() for place in places]
    diagonal = np.linalg.norm(corners[0] - corners[2])
    return bool(min(apart, default=np.inf) < SAME_PLACE * diagonal)


def search_steps(
    image: Image, layout: Layout | None = None, avoid: Sequence[Corners] = ()
) -> Steps[Located | None]:
    """Find the lit display in an image step by step.

    Args:
        image: an `Image`; it must stay as it is until the end.
        layout: layout of what is displayed; its ratex patches tell the orientation.
        avoid: pixels of displays with patches that are not to be found.

    Returns:
        what `locate` returns.
    """
    if max(image.shape[:2]) > MAX_ASPECT * min(image.shape[:2]):
        return None
    candidates = yield from candidate_steps(image)
    if layout is None or not layout.ratex:
        return _likeliest(image, candidates)
    best_match = partial(_best_match, image, image_pyramid(as_gray(image)), layout, avoid)
    corners = [candidate.corners for candidate in candidates]
    found = yield from best_match(map(_turned, corners[:LIKELY]))
    if found is None and corner_cells(layout):
        small, scale = small_copy(image)
        gray = as_gray(small)
        spots = yield from spot_steps(gray, layout)
        quads = on_full_image(whole_quads(spots, layout, gray.shape), scale)
        yield COMBINE_WORK
        found = yield from best_match(quads[:, None])
        if found is None:
            bent = on_full_image(partial_quads(spots, layout, gray.shape), scale)
            yield COMBINE_WORK
            found = yield from best_match(map(partial(_sound, image), bent), PARTLY)
    if found is None:
        found = yield from best_match(map(_turned, corners[LIKELY:]))
    if found is None:
        leaving = leaving_quads(image, LEAVING_QUADS)
        yield LINES_WORK
        found = yield from best_match(map(_turned, leaving))
    return found


def _sound(image: Image, guesses: NDArray[np.float64]) -> list[Corners]:
    """List those of (M, 4, 2) guesses that a display which is partly in view may have."""
    guesses = guesses[np.isfinite(guesses).all(axis=(1, 2))]
    return list(guesses[is_sound(guesses, image.shape[1], image.shape[0], MAX_OUTSIDE)])


def _likeliest(image: NDArray[np.uint8], candidates: Sequence[Located]) -> Located | None:
    """Move the corners of the first candidate onto edges; None where it is too unlikely."""
    if not candidates or candidates[0].score < MIN_SCORE:
        return None
    gray = as_gray(image)
    reach = SMALL_ERROR_PX * max(1.0, max(gray.shape) / WORK_PX)
    corners = corners_on_edges(gray, candidates[0].corners, reach)
    corners = clipped_to_image(corners, gray.shape)
    return Located(upright(corners[None])[0], candidates[0].score)


def _turned(quad: Corners) -> list[Corners]:
    """List the corner orders of a quadrilateral that differ by quarter turns."""
    return [np.roll(quad, -turn, axis=0) for turn in range(4)]


def _best_match(
    image: Image,
    pyramid: Pyramid,
    layout: Layout,
    avoid: Sequence[Corners],
    places: Iterable[Sequence[Corners]],
    demand: Demand = WHOLE,
) -> Steps[Located | None]:
    """Find where the image shows the patches best, or the first certain place; None for none.

    Args:
        image: an `Image`.
        pyramid: `receiver.locate.patches.image_pyramid` of its gray levels.
        layout: layout with patches.
        avoid: pixels of displays that are not to be found.
        places: corners by which each place may show the display, the most promising of which are
            aligned.
        demand: what it takes to find the display.
    """
    best: Located | None = None
    for readings in places:
        promise = [search_patches(pyramid, corners, layout)[0] for corners in readings]
        work = len(promise)
        for number in np.argsort(promise)[::-1][: demand.aligned]:
            if promise[number] < demand.promise:
                continue
            corners, seen = corners_on_patches(image, pyramid, readings[number], layout)
            work += REFINE_WORK
            better = seen >= needed_correlation(layout) and (best is None or seen > best.score)
            if better and not is_at(corners, avoid):
                best = Located(corners, min(1.0, seen))
        yield work
        if best is not None and best.score >= demand.sure:
            break
    return best
