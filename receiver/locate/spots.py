"""Quadrilaterals from the ratex patches alone, for a picture whose border shows no edges.

A dark picture in a dark bezel, or one on a page of its own colour, has no edges around it, and its
patches stand out all the more. Where the image is steep at a patch's size, a bank of turned and
foreshortened patches is correlated; patches that fit together make a quadrilateral.
"""

from dataclasses import dataclass
from functools import lru_cache
from itertools import product

import cv2
import numpy as np
from numpy.typing import NDArray

from link.geometry import UNIT_SQUARE, homography_from_points, in_image, transform
from link.layout import Layout
from link.ratex import TILES, patch_centres, tile_levels
from link.steps import Steps
from receiver.locate.quads import distinct, is_sound
from receiver.locate.refine import OUTSIDE

PATCH_PX = (8, 11, 15, 20, 27, 37, 50)
"""Sides of a patch, in pixels of the small image, that are tried: each is about a third more than
the last, so that one is within a sixth of any between 8 and 50."""
SEEN_PX, WINDOW_PX = 15, 15
"""Sides, in pixels of the resized image, of a patch and of the window that is compared.
Nearly four pixels for each of the four tiles along an axis. Chosen by hand."""
SPOTS = 80
"""Number of steepest places that are compared at each size of a patch. It bounds the work; chosen
by hand."""
SHIFTS = (-4, -2, 0, 2, 4)
"""Shifts, in pixels of the resized image and on each axis, that are tried around such a place:
the steepest place of a patch is mostly a corner of tiles, about 4 px from the next one. Chosen by
hand."""
TURNS = 24
"""Number of directions of a patch that are tried, 15 degrees apart: one is within 7.5 degrees of
any, by which the rim of a patch is off by a pixel."""
SHAPES = (
    (1.0, 1.0, 0.0),
    (0.65, 1.0, 0.0),
    (1.0, 0.65, 0.0),
    (0.42, 1.0, 0.0),
    (1.0, 0.42, 0.0),
    (0.75, 0.75, 0.45),
    (0.75, 0.75, -0.45),
)
"""Foreshortenings of a patch's two axes, and shears, that are tried. 0.65 and 0.42 are the cosines
of 49 and 65 degrees; the shears are those of a display that is seen across a corner."""
DRAWN_PX, DRAWN_BLUR_PX = 8, 1.6
"""Pixels along each axis of a tile from which templates are sampled, and standard deviation of the
blur before they are, a fifth of a tile, as of a camera's image. Chosen by hand."""
MIN_MATCH = 0.55
"""Smallest correlation of a match that is kept. A patch between two sizes, turns and shapes of the
templates does not match wholly. Chosen by hand."""
KEPT = 16
"""Largest number of matches that are kept for each patch. Four patches are combined in its fourth
power, 65,536 ways. Chosen by hand."""
MAX_TURN_DEG, MAX_RATIO = 35.0, 1.8
"""Largest differences of a match's direction, in degrees, and size, as a ratio, from what the
quadrilateral has there. Two steps of `TURNS` and of `PATCH_PX`, and the perspective. Chosen by
hand."""
MISSING = 0.35
"""Correlation that stands for a patch that is not seen and is put where the three others say: less
than `MIN_MATCH`, since a patch that is seen speaks for more. Chosen by hand."""
MAX_OUTSIDE = OUTSIDE + 0.1
"""Distance by which a corner of a display that is partly in view may be put outside the image, as a
share of its longer side: as far as it may lie, and the error of three patches, chosen by hand."""
SUPPORT = 0.15
"""Distance, in sides of the display, within which a further patch supports what three others say;
perspective moves it that far. Chosen by hand."""
DEPTH_POWER = -2 / 3
"""Power by which the depth of a patch, the w of a homography, follows from the side that is seen:
an area is seen divided by the cube of its w, so a side by w to the 3/2."""
BEND = 0.2
"""Step of the guesses of a patch's depth, as a logarithm: sides of patches are known to about a
third, between two entries of `PATCH_PX`, and depths, by `DEPTH_POWER`, to about a fifth."""
LEAST_DEPTH = 0.05
"""Smallest depth of a corner, by the same unit as the depths of the patches; one that lies nearer,
or behind the camera, makes no quadrilateral. Chosen by hand."""
WHOLE_QUADS, PARTIAL_QUADS = 30, 8
"""Largest numbers of quadrilaterals that are made from patches alone: of a display that is in view,
and of one that is partly so. They bound the work of a search that finds nothing; chosen by hand."""
SAME_WHOLE_PX, SAME_PARTIAL_PX = 4.0, 6.0
"""Distances, in pixels of the small image, of all corners below which two quadrilaterals count as
one: of four patches, and of three, which put the corners less exactly. Chosen by hand."""
FLAT_NORM = 5.0
"""Gray levels that are added to the norm of a window before it is divided by it, so that noise in
flat places, of a level or less a pixel, does not match. Chosen by hand."""
SAME_MATCH = 0.4
"""Distance, in sides of a patch, below which two matches are of one place: neighbouring `SPOTS` and
`SHIFTS` see the same patch. Chosen by hand."""
STEEP_BLUR_PX, STEEP_DARK, STEEP_APART_PX = 0.8, 4.0, 7
"""Standard deviation of the blur before steep places are sought, which takes off the noise of
single pixels; gray levels added before the logarithm, so that noise in black is not steep; and side
of the square in which a place must be the steepest. In pixels of the resized image, in which a
patch has `SEEN_PX`. Chosen by hand."""
LEAST_STEEPNESS = 1e-6
"""Smallest steepness of a place; it leaves out what is flat, and nothing else."""
SIZE_WORK = 18
"""Units of work (`link.steps`) of the search for patches of one size: about the milliseconds that
it takes of one core."""


@dataclass(frozen=True)
class Matches:
    """The N places at which one ratex patch may lie in the small image."""

    at: NDArray[np.float64]
    """(N, 2) centres, in pixels of the small image."""
    turn: NDArray[np.float64]
    """(N,) direction of the display's x axis in the image, radians."""
    size: NDArray[np.float64]
    """(N,) side of the patch, in pixels of the small image."""
    match: NDArray[np.float64]
    """(N,) correlation with the drawn patch, in [-1, 1]."""


def spot_steps(gray: NDArray[np.uint8], layout: Layout) -> Steps[list[Matches]]:
    """Find where each patch of a layout may be.

    Args:
        gray: (h, w) uint8.
        layout: layout with patches.

    Returns:
        the matches of each patch, one size after the other.
    """
    bank, turns = template_bank(layout)
    rows: list[list[NDArray[np.float64]]] = [[] for _ in layout.ratex]
    for size in PATCH_PX:
        for listed, more in zip(rows, _matches_of_size(gray, size, bank, turns), strict=False):
            listed.append(more)
        yield SIZE_WORK
    return [_best(np.concatenate([np.empty((0, 5)), *listed])) for listed in rows]


def corner_cells(layout: Layout) -> list[int]:
    """List which patches lie in the four corners, in corner order; empty where one has none."""
    last = (layout.rows - 1, layout.cols - 1)
    cells = [(0, 0), (0, last[1]), last, (last[0], 0)]
    return [layout.ratex.index(cell) for cell in cells] if set(cells) <= set(layout.ratex) else []


def whole_quads(found: list[Matches], layout: Layout, size: tuple[int, int]) -> NDArray[np.float64]:
    """Make quadrilaterals that lie in the image of the patches in the four corners, or of three.

    Args:
        found: matches of each patch, from `spot_steps`.
        layout: layout with patches in the four corners.
        size: height and width of the image, pixels.

    Returns:
        (N, 4, 2) pixels, top-left of the displayed picture first; the likeliest one first.
    """
    corners = corner_cells(layout)
    found = [found[patch] for patch in corners]
    quads, ranks = [], []
    for missing in (None, 0, 1, 2, 3):
        there = [i for i in range(4) if i != missing]
        chosen, centres = _combinations(found, there)
        points = np.zeros((len(centres), 4, 2))
        points[:, there] = centres
        if missing is not None:  # as in a parallelogram
            one, opposite, other = ((missing + k) % 4 for k in (1, 2, 3))
            points[:, missing] = points[:, one] - points[:, opposite] + points[:, other]
        sound = is_sound(points, size[1], size[0])
        points, chosen = points[sound], chosen[sound]
        side, turn = _expected(points, layout)
        fits, rank = _fitting(found, there, chosen, side[:, there], turn[:, there])
        quads.append(points[fits])
        ranks.append(rank[fits] + (0 if missing is None else MISSING))
    points, rank = np.concatenate(quads), np.concatenate(ranks)
    points = points[distinct(points, rank, WHOLE_QUADS, SAME_WHOLE_PX)]
    centres = patch_centres(layout)[corners]
    whole = [transform(homography_from_points(centres, quad), UNIT_SQUARE) for quad in points]
    return np.array(whole, np.float64).reshape(-1, 4, 2)


def partial_quads(
    found: list[Matches], layout: Layout, size: tuple[int, int]
) -> NDArray[np.float64]:
    """Make quadrilaterals of three patches, for a display that is partly in view or covered.

    Three patches tell an affine map of the display; what the other patches show where it puts them
    ranks it. Perspective is then guessed from the sizes of the three, in M ways.

    Args:
        found: matches of each patch, from `spot_steps`.
        layout: layout with patches in the four corners.
        size: height and width of the image, pixels.

    Returns:
        (N, M, 4, 2) pixels, top-left of the displayed picture first, NaN where a guess puts a
        corner behind the camera; the likeliest quadrilateral first.
    """
    quads, bent, ranks = [], [], []
    for triple in _triples(layout):
        chosen, centres = _combinations(found, triple)
        shown = np.column_stack([patch_centres(layout)[triple], np.ones(3)])  # (3, 3)
        maps = np.linalg.inv(shown) @ centres  # (N, 3, 2): x, y and 1 of the display to pixels
        area = maps[:, 0, 0] * maps[:, 1, 1] - maps[:, 0, 1] * maps[:, 1, 0]
        side = np.sqrt(np.maximum(area, 1e-9) / (layout.rows * layout.cols))
        turn = np.arctan2(maps[:, 0, 1], maps[:, 0, 0])
        quad = _with_one(UNIT_SQUARE) @ maps
        fits, rank = _fitting(found, triple, chosen, side[:, None], turn[:, None])
        fits &= (area > 0) & is_sound(quad, size[1], size[0], MAX_OUTSIDE)
        sizes = np.stack([found[p].size[chosen[fits, k]] for k, p in enumerate(triple)], axis=1)
        quads.append(quad[fits])
        bent.append(_in_perspective(centres[fits], sizes, shown))
        ranks.append(_supported(rank[fits], found, triple, maps[fits], side[fits], layout, size))
    rank = np.concatenate(ranks)
    best = distinct(np.concatenate(quads), rank, PARTIAL_QUADS, SAME_PARTIAL_PX)
    return np.asarray(np.concatenate(bent)[best])


def _triples(layout: Layout) -> list[list[int]]:
    """List which three patches tell a display: three corners, or two beside and one between."""
    corners = corner_cells(layout)
    inner = [patch for patch in range(len(layout.ratex)) if patch not in corners]
    neighbours = zip(corners, corners[1:] + corners[:1], strict=True)
    triples = [corners[:i] + corners[i + 1 :] for i in range(len(corners))]
    return triples + [[*pair, patch] for pair in neighbours for patch in inner[:1]]


def _combinations(
    found: list[Matches], patches: list[int]
) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Combine every match of each of K patches with every one of the others.

    Returns:
        (N, K) numbers of the matches, and (N, K, 2) their centres.
    """
    chosen = np.indices([len(found[patch].match) for patch in patches])
    chosen = chosen.reshape(len(patches), -1).T
    centres = [found[patch].at[chosen[:, k]] for k, patch in enumerate(patches)]
    return chosen, np.stack(centres, axis=1)


def _fitting(
    found: list[Matches],
    patches: list[int],
    chosen: NDArray[np.intp],
    side: NDArray[np.float64],
    turn: NDArray[np.float64],
) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
    """Tell which combinations of matches have about the sides and turns expected of them.

    Args:
        found: matches of each patch.
        patches: K patches that are combined.
        chosen: (N, K) numbers of their matches.
        side: (N, K) or (N, 1) sides that are expected.
        turn: (N, K) or (N, 1) turns that are expected.

    Returns:
        (N,) whether all of them do, and (N,) the sum of their correlations.
    """
    side, turn = (np.broadcast_to(expected, chosen.shape) for expected in (side, turn))
    fits, rank = np.ones(len(chosen), bool), np.zeros(len(chosen))
    for k, patch in enumerate(patches):
        matches, picked = found[patch], chosen[:, k]
        off = np.angle(np.exp(1j * (matches.turn[picked] - turn[:, k])))
        ratio = np.abs(np.log(matches.size[picked] / side[:, k]))
        fits &= (np.abs(off) < np.radians(MAX_TURN_DEG)) & (ratio < np.log(MAX_RATIO))
        rank += matches.match[picked]
    return fits, rank


def _supported(
    rank: NDArray[np.float64],
    found: list[Matches],
    triple: list[int],
    maps: NDArray[np.float64],
    side: NDArray[np.float64],
    layout: Layout,
    size: tuple[int, int],
) -> NDArray[np.float64]:
    """Add to (N,) ranks what the other patches show where (N, 3, 2) maps of three put them."""
    reach = SUPPORT * np.sqrt(layout.rows * layout.cols) * side[:, None]
    for patch in set(range(len(layout.ratex))) - set(triple):
        there = _with_one(patch_centres(layout)[patch]) @ maps  # (N, 2)
        apart = np.linalg.norm(found[patch].at[None] - there[:, None], axis=2)
        support = np.where(apart < reach, found[patch].match, 0).max(axis=1, initial=0)
        rank = rank + np.where(in_image(there, size), support, MISSING)
    return rank


def _in_perspective(
    centres: NDArray[np.float64], sizes: NDArray[np.float64], shown: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Guess where the corners of a display lie of which three patches are seen.

    A homography follows from three points and their depths. Depths follow from the sides of the
    patches, which are known roughly; so two of the three are tried a little nearer and farther.

    Args:
        centres: (N, 3, 2) places of the patches, pixels.
        sizes: (N, 3) sides of the patches, pixels.
        shown: (3, 3) x, y and 1 of the patches on the display.

    Returns:
        (N, M, 4, 2) pixels; NaN where a corner is nearer than `LEAST_DEPTH`.
    """
    guesses = []
    for one, two in product((-BEND, 0.0, BEND), repeat=2):
        depth = sizes**DEPTH_POWER * np.exp([0.0, one, two])
        H = np.linalg.inv(shown) @ (_with_one(centres) * depth[..., None])  # (N, 3, 3), for rows
        at = _with_one(UNIT_SQUARE) @ H
        guesses.append(at[..., :2] / np.where(at[..., 2:] > LEAST_DEPTH, at[..., 2:], np.nan))
    return np.stack(guesses, axis=1)


def _with_one(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Append a 1 to the coordinates of (..., 2) points."""
    return np.concatenate([points, np.ones((*points.shape[:-1], 1))], axis=-1)


def _expected(
    points: NDArray[np.float64], layout: Layout
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Work out the sizes and turns, (N, 4), of patches whose centres are (N, 4, 2) points.

    The depth w of a corner of a square goes with the area of the triangle that the others are seen
    to make, and the square's area element is seen divided by the cube of w.
    """

    def twice_area(i: int, j: int, k: int) -> NDArray[np.float64]:
        (x, y), (u, v) = (points[:, at].T - points[:, i].T for at in (j, k))
        return np.asarray(x * v - y * u)

    w = np.stack([twice_area(*others) for others in ((1, 2, 3), (0, 2, 3), (0, 1, 3), (0, 1, 2))])
    w = (w / w[0]).T
    element = np.abs(w[:, 1] * w[:, 3] * twice_area(0, 1, 3))[:, None] / np.maximum(w, 1e-3) ** 3
    size = np.sqrt(element / ((layout.rows - 1) * (layout.cols - 1)))
    top, bottom = points[:, 1] - points[:, 0], points[:, 2] - points[:, 3]
    turns = [np.arctan2(side[:, 1], side[:, 0]) for side in (top, top, bottom, bottom)]
    return size, np.stack(turns, axis=1)


def _matches_of_size(
    gray: NDArray[np.uint8], size: float, bank: NDArray[np.float32], turns: NDArray[np.float64]
) -> list[NDArray[np.float64]]:
    """Compare an image with all templates at one size: (N, 5) x, y, turn, size, match a patch."""
    factor = SEEN_PX / size
    how = cv2.INTER_AREA if factor < 1 else cv2.INTER_LINEAR
    image = cv2.resize(gray, None, fx=factor, fy=factor, interpolation=how).astype(np.float32)
    if min(image.shape) < 3 * WINDOW_PX:
        return []
    spots = _steepest(image)
    if not len(spots):
        return []
    shifts = np.array(list(product(SHIFTS, SHIFTS)))  # (T, 2): y, x
    corner = spots[:, None] + shifts - WINDOW_PX // 2  # (N, T, 2)
    corner = np.clip(corner, 0, np.array(image.shape) - WINDOW_PX)
    windows = np.lib.stride_tricks.sliding_window_view(image, (WINDOW_PX, WINDOW_PX))
    seen = windows[corner[..., 0], corner[..., 1]].reshape(-1, WINDOW_PX * WINDOW_PX)
    seen = seen - seen.mean(axis=1, keepdims=True)
    seen /= np.linalg.norm(seen, axis=1, keepdims=True) + FLAT_NORM
    match = (seen @ bank.T).reshape(len(spots), len(shifts), -1, len(turns))
    which, rows = np.arange(len(spots)), []
    for i in range(match.shape[2]):
        flat = match[:, :, i].reshape(len(spots), -1)
        best = flat.argmax(axis=1)
        shift, shape = np.divmod(best, len(turns))
        y, x = (corner[which, shift] + WINDOW_PX // 2 + 0.5).T / factor - 0.5
        rows.append(np.column_stack([x, y, turns[shape], np.full(len(x), size), flat[which, best]]))
    return rows


def _best(rows: NDArray[np.float64]) -> Matches:
    """Keep the `KEPT` best of (N, 5) rows x, y, turn, size, match that are not at one place."""
    rows = rows[rows[:, 4] >= MIN_MATCH]
    rows = rows[np.argsort(-rows[:, 4])]
    kept: list[NDArray[np.float64]] = []
    while len(rows) and len(kept) < KEPT:
        kept.append(rows[0])
        rows = rows[np.linalg.norm(rows[:, :2] - rows[0, :2], axis=1) > SAME_MATCH * rows[0, 3]]
    table = np.array(kept).reshape(-1, 5)
    return Matches(table[:, :2], table[:, 2], table[:, 3], table[:, 4])


def _steepest(image: NDArray[np.float32]) -> NDArray[np.intp]:
    """Find (N, 2) places y, x where the logarithm of the image is steep in all directions."""
    light = np.log(cv2.GaussianBlur(image, (0, 0), STEEP_BLUR_PX) + STEEP_DARK)
    steep = cv2.cornerMinEigenVal(light, WINDOW_PX)
    around = cv2.dilate(steep, np.ones((STEEP_APART_PX, STEEP_APART_PX), np.uint8))
    y, x = np.nonzero((steep >= around) & (steep > LEAST_STEEPNESS))
    best = np.argsort(-steep[y, x])[:SPOTS]
    return np.column_stack([y[best], x[best]])


@lru_cache(maxsize=8)
def template_bank(layout: Layout) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
    """Draw templates (patches * shapes, WINDOW_PX**2) of mean 0 and norm 1; (shapes,) turns."""
    half = WINDOW_PX // 2
    y, x = np.mgrid[-half : half + 1, -half : half + 1].astype(np.float64)
    levels = tile_levels(layout, 3).astype(np.float64)
    templates, turns = [], []
    for i in range(len(levels)):
        fine = cv2.resize(levels[i], (DRAWN_PX * TILES,) * 2, interpolation=cv2.INTER_NEAREST)
        fine = cv2.GaussianBlur(fine, (0, 0), DRAWN_BLUR_PX, borderType=cv2.BORDER_REPLICATE)
        fine -= fine.mean()
        for turn in np.arange(TURNS) * 2 * np.pi / TURNS:
            for wide, high, shear in SHAPES:
                across = np.cos(turn) * x + np.sin(turn) * y
                down = -np.sin(turn) * x + np.cos(turn) * y
                u = (across - shear * down) / (SEEN_PX * wide)
                v = (down - shear * across) / (SEEN_PX * high)
                at = [((t + 0.5) * DRAWN_PX * TILES - 0.5).astype(np.float32) for t in (u, v)]
                drawn = cv2.remap(fine, at[0], at[1], cv2.INTER_LINEAR, borderValue=0)
                drawn = drawn - drawn.mean()
                templates.append(drawn.ravel() / np.linalg.norm(drawn))
                if i == 0:
                    turns.append(turn)
    return np.array(templates, np.float32), np.array(turns)
