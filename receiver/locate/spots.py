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

from link.geometry import in_image
from link.layout import Layout
from link.ratex import TILES, patch_centres, tile_levels
from link.steps import Steps
from receiver.locate.quads import distinct, is_sound

PATCH_PX = (8, 11, 15, 20, 27, 37, 50)
"""Sides of a patch, in pixels of the small image, that are tried."""
SEEN_PX, WINDOW_PX = 15, 15
"""Sides, in pixels of the resized image, of a patch and of the window that is compared."""
SPOTS = 80
"""Number of steepest places that are compared at each size of a patch."""
SHIFTS = (-4, -2, 0, 2, 4)
"""Shifts, in pixels of the resized image and on each axis, that are tried around such a place."""
TURNS = 24
"""Number of directions of a patch that are tried."""
SHAPES = (
    (1.0, 1.0, 0.0),
    (0.65, 1.0, 0.0),
    (1.0, 0.65, 0.0),
    (0.42, 1.0, 0.0),
    (1.0, 0.42, 0.0),
    (0.75, 0.75, 0.45),
    (0.75, 0.75, -0.45),
)
"""Foreshortenings of a patch's two axes, and shears, that are tried."""
DRAWN_PX, DRAWN_BLUR_PX = 8, 1.6
"""Pixels along each axis of a tile from which templates are sampled, and standard deviation of the
blur before they are."""
MIN_MATCH = 0.55
"""Smallest correlation of a match that is kept."""
KEPT = 16
"""Largest number of matches that are kept for each patch."""
MAX_TURN_DEG, MAX_RATIO = 35.0, 1.8
"""Largest differences of a match's direction, in degrees, and size, as a ratio, from what the
quadrilateral has there."""
MISSING = 0.35
"""Correlation that stands for a patch that is not seen and is put where the three others say."""
MAX_OUTSIDE = 0.35
"""Distance by which a corner of a display that is partly in view may be put outside the image, as a
share of its longer side; `receiver.locate.refine.OUTSIDE` and the error of three patches."""
SUPPORT = 0.15
"""Distance, in sides of the display, within which a further patch supports what three others say;
perspective moves it that far."""
BEND, BENT = 0.2, 9
"""Step of the guessed depths of patches, as a logarithm, and number of guesses."""
SIZE_WORK = 18
"""Units of work (`link.steps`) of the search for patches of one size."""


@dataclass(frozen=True)
class Matches:
    """Where one patch may be; arrays of one length."""

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


def whole_quads(
    found: list[Matches], layout: Layout, size: tuple[int, int], limit: int
) -> NDArray[np.float64]:
    """Make quadrilaterals that lie in the image of the patches in the four corners, or of three.

    Args:
        found: matches of each patch, from `spot_steps`.
        layout: layout with patches in the four corners; else nothing is found.
        size: height and width of the image, pixels.
        limit: largest number returned.

    Returns:
        (N, 4, 2) pixels, top-left of the displayed picture first; the likeliest one first.
    """
    nothing = np.empty((0, 4, 2))
    if not (corners := corner_cells(layout)):
        return nothing
    found = [found[patch] for patch in corners]
    quads, ranks = [], []
    for missing in (None, 0, 1, 2, 3):
        counts = [len(m.match) if i != missing else 1 for i, m in enumerate(found)]
        picked = np.indices(counts).reshape(4, -1).T  # every match with every other
        there = [i for i in range(4) if i != missing]
        if not len(picked):
            continue
        points = np.zeros((len(picked), 4, 2))
        for i in there:
            points[:, i] = found[i].at[picked[:, i]]
        if missing is not None:
            around = [(missing + k) % 4 for k in (1, 2, 3)]
            points[:, missing] = points[:, around[0]] - points[:, around[1]] + points[:, around[2]]
        sound = is_sound(points, size[1], size[0])
        points, picked = points[sound], picked[sound]
        if not len(points):
            continue
        side, turn = _expected(points, layout)
        rank, fits = np.zeros(len(points)), np.ones(len(points), bool)
        for i in there:
            chosen = picked[:, i]
            fits &= _alike(found[i], chosen, side[:, i], turn[:, i])
            rank += found[i].match[chosen]
        quads.append(points[fits])
        ranks.append(rank[fits] + (MISSING if missing is not None else 0))
    if not sum(map(len, quads)):
        return nothing
    points, rank = np.concatenate(quads), np.concatenate(ranks)
    points = points[distinct(points, rank, limit, 4.0)]
    centres = patch_centres(layout)[corners]
    unit = np.array([[[0, 0], [1, 0], [1, 1], [0, 1]]], np.float32)
    grown = [
        cv2.perspectiveTransform(
            unit, cv2.getPerspectiveTransform(centres.astype(np.float32), quad.astype(np.float32))
        )[0]
        for quad in points
    ]
    return np.array(grown, np.float64).reshape(-1, 4, 2)


def partial_quads(
    found: list[Matches], layout: Layout, size: tuple[int, int], limit: int
) -> NDArray[np.float64]:
    """Make quadrilaterals of three patches, for a display that is partly in view or covered.

    Three corners, or two neighbouring ones and a patch between, tell an affine map of the display;
    what the other patches show where it puts them ranks it. Perspective is then guessed from the
    sizes of the three, in `BENT` ways: the homography of three points, and of their depths.

    Args:
        found: matches of each patch, from `spot_steps`.
        layout: layout with patches in the four corners; else nothing is found.
        size: height and width of the image, pixels.
        limit: largest number returned.

    Returns:
        (N, `BENT`, 4, 2) pixels, top-left of the displayed picture first; the likeliest one first.
    """
    corners = corner_cells(layout)
    centres = patch_centres(layout)
    inner = [patch for patch in range(len(centres)) if patch not in corners]
    neighbours = list(zip(corners, corners[1:] + corners[:1], strict=True))
    triples = [tuple(corners[:i] + corners[i + 1 :]) for i in range(len(corners))]
    triples += [(*pair, patch) for pair in neighbours for patch in inner[:1]]
    square = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 1.0], [1.0, 1.0, 1.0], [0.0, 1.0, 1.0]])
    quads, bent, ranks = [np.empty((0, 4, 2))], [np.empty((0, BENT, 4, 2))], [np.empty(0)]
    for triple in triples:
        picked = np.indices([len(found[patch].match) for patch in triple]).reshape(3, -1).T
        if not len(picked):
            continue
        shown = np.column_stack([centres[list(triple)], np.ones(3)])  # (3, 3)
        points = np.stack([found[p].at[picked[:, k]] for k, p in enumerate(triple)], axis=1)
        maps = np.linalg.inv(shown) @ points  # (N, 3, 2): x, y and 1 of the display to pixels
        area = maps[:, 0, 0] * maps[:, 1, 1] - maps[:, 0, 1] * maps[:, 1, 0]
        side = np.sqrt(np.maximum(area, 1e-9) / (layout.rows * layout.cols))
        turn = np.arctan2(maps[:, 0, 1], maps[:, 0, 0])
        quad = square @ maps
        fits = (area > 0) & is_sound(quad, size[1], size[0], MAX_OUTSIDE)
        for k, patch in enumerate(triple):
            fits &= _alike(found[patch], picked[:, k], side, turn)
        if not fits.any():
            continue
        picked, points, maps = picked[fits], points[fits], maps[fits]
        quad, side = quad[fits], side[fits]
        rank = np.zeros(len(picked))
        for k, patch in enumerate(triple):
            rank += found[patch].match[picked[:, k]]
        for patch in set(range(len(centres))) - set(triple):
            there = np.append(centres[patch], 1.0) @ maps  # (N, 2)
            apart = np.linalg.norm(found[patch].at[None] - there[:, None], axis=2)
            reach = SUPPORT * np.sqrt(layout.rows * layout.cols) * side[:, None]
            support = np.where(apart < reach, found[patch].match, 0).max(axis=1, initial=0)
            rank = rank + np.where(in_image(there, size), support, MISSING)
        depth = np.stack([found[p].size[picked[:, k]] for k, p in enumerate(triple)], axis=1) ** (
            -2 / 3
        )
        variants = []
        for one in (-BEND, 0.0, BEND):
            for two in (-BEND, 0.0, BEND):
                w = depth * np.exp([0.0, one, two])
                weighted = np.concatenate([points, np.ones((len(points), 3, 1))], axis=2)
                H = np.linalg.inv(shown) @ (weighted * w[..., None])  # (N, 3, 3), for rows
                at = square @ H
                variants.append(at[..., :2] / np.where(at[..., 2:] > 0.05, at[..., 2:], np.nan))
        quads.append(quad)
        bent.append(np.stack(variants, axis=1))
        ranks.append(rank)
    every = np.concatenate(quads)
    return np.concatenate(bent)[distinct(every, np.concatenate(ranks), limit, 6.0)]


def _alike(
    matches: Matches, chosen: NDArray[np.intp], side: NDArray[np.float64], turn: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Tell which (N,) matches have about the (N,) sides and turns that are expected of them."""
    off = np.angle(np.exp(1j * (matches.turn[chosen] - turn)))
    ratio = np.abs(np.log(matches.size[chosen] / side))
    return np.asarray((np.abs(off) < np.radians(MAX_TURN_DEG)) & (ratio < np.log(MAX_RATIO)))


def _expected(
    points: NDArray[np.float64], layout: Layout
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Work out the sizes and turns, (N, 4), of patches whose centres are (N, 4, 2) points.

    By the homography of the unit square to the quadrilateral (Heckbert 1989): its area element
    falls with the cube of w.
    """
    p0, p1, p2, p3 = (points[:, i] for i in range(4))
    bend, one, two = p0 - p1 + p2 - p3, p1 - p2, p3 - p2
    below = one[:, 0] * two[:, 1] - two[:, 0] * one[:, 1]
    g = (bend[:, 0] * two[:, 1] - two[:, 0] * bend[:, 1]) / below
    h = (one[:, 0] * bend[:, 1] - bend[:, 0] * one[:, 1]) / below
    w = np.stack([np.ones_like(g), 1 + g, 1 + g + h, 1 + h], axis=1)
    right, down = p1 - p0 + g[:, None] * p1, p3 - p0 + h[:, None] * p3
    H = np.stack(
        [
            np.column_stack([right, g]),
            np.column_stack([down, h]),
            np.column_stack([p0, np.ones_like(g)]),
        ],
        axis=2,
    )
    element = np.abs(np.linalg.det(H))[:, None] / np.maximum(np.abs(w), 1e-3) ** 3
    size = np.sqrt(element / ((layout.rows - 1) * (layout.cols - 1)))
    top, bottom = p1 - p0, p2 - p3
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
    seen /= np.linalg.norm(seen, axis=1, keepdims=True) + 5
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
        rows = rows[np.linalg.norm(rows[:, :2] - rows[0, :2], axis=1) > 0.4 * rows[0, 3]]
    table = np.array(kept).reshape(-1, 5)
    return Matches(table[:, :2], table[:, 2], table[:, 3], table[:, 4])


def _steepest(image: NDArray[np.float32]) -> NDArray[np.intp]:
    """Find (N, 2) places y, x where the logarithm of the image is steep in all directions."""
    light = np.log(cv2.GaussianBlur(image, (0, 0), 0.8) + 4)
    steep = cv2.cornerMinEigenVal(light, WINDOW_PX)
    y, x = np.nonzero((steep >= cv2.dilate(steep, np.ones((7, 7), np.uint8))) & (steep > 1e-6))
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
