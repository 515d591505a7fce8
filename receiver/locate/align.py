"""Align corners to the ratex patches, to sub-pixels, by least squares on the image itself."""

from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from link.geometry import frame_corners, homography_from_points, in_image, transform
from link.layout import Layout
from link.ratex import TILES, tile_levels
from link.robust import MAD_TO_SIGMA, reweighted, ridge_solution
from link.types import Corners
from receiver.locate.corner_motion import points_by_corners
from receiver.locate.patches import DRAWN_KAPPA, Pyramid, at_level, level_for

PHASES = ((6, 6, False), (6, 2, True))
"""Phases of the alignment: samples along each axis of a tile, largest number of steps, and whether
each tile has a level of its own. Chosen by hand: the second phase
begins where the first one ended, and needs fewer steps."""
MARGIN_PX = 4
"""Pixels around the display that are cut out of the image with it, for the blur and the cubic
interpolation of samples at its edge, which reach 2 to 3 px."""
BLUR = 0.8
"""Standard deviation of the blur of the image and of the drawn tiles, in samples: less lets an edge
fall unseen between two samples, more takes away what tells of places. Chosen by hand."""
LEAST_BLUR_PX = 0.7
"""Smallest standard deviation of the image's blur, in its pixels: the derivatives are taken over
one pixel, which an edge must not cross at once. Chosen by hand."""
DRAWN_BLUR = 1.25
"""Blur of the drawn tiles as a multiple of `BLUR`: variances of blurs add, so the camera's own blur
is taken to be 0.75 of `BLUR`. Chosen by hand."""
HALF_RANGE = 127.5
"""Gray levels that are the unit in which the levels displayed count from the middle of the
range."""
MIN_STEP_PX = 0.01
"""Motion of every corner, in pixels of the image, below which a phase ends: it is small
against the corners' error in the end, which is 0.14 px in the median (docs/answered.md)."""
CORNER_SPREAD = 0.02
"""Expected error of the corners before alignment, as a share of the display's side: a ridge that
holds corners where too few patches determine them. Chosen by hand as half of
`receiver.locate.patches.SEARCH_ERROR`, since patches have moved the corners before."""
RESIDUAL_LEVELS = 8.0
"""Residual, in gray levels, at which the ridge weighs: noise, moire and response that three
coefficients miss. Chosen by hand; only its ratio to the slopes of the patches counts."""
MOST_STEP, MOST_STEP_PX = 0.02, 0.5
"""Largest motion of a corner in one step, as a share of the display's side and in pixels of a
level, which add: about `CORNER_SPREAD`, so that no single step leaves where the patches are
seen."""
LEVEL_RIDGE = 1e-3
"""Ridge of the coefficients of levels, whose unit is a sample: so small that it decides only what
no sample tells."""


def align_corners(
    pyramid: Pyramid,
    corners: Corners,
    layout: Layout,
    spread: float = CORNER_SPREAD,
    used: NDArray[np.bool_] | None = None,
) -> Corners:
    """Move corners, to sub-pixels, so that the image shows the patches as they are drawn.

    Gauss-Newton on the corners, residuals weighted robustly, with a ridge on the corners' motion.
    First each patch is a quadratic of the levels displayed, fitted anew in every step. Then each
    tile has a level of its own: where blur meets the camera's response, an edge lies elsewhere
    than a quadratic puts it.

    Args:
        pyramid: `receiver.locate.patches.image_pyramid` of the image's gray levels.
        corners: pixels of the image, within half a tile.
        layout: layout with patches.
        spread: expected error of the corners, as a share of the display's side.
        used: (patches,) which patches are looked at, where they are in view; None for all.

    Returns:
        pixels of the image.
    """
    used = np.ones(len(layout.ratex), bool) if used is None else used
    for fine, steps, free in PHASES:
        corners = _align_phase(pyramid, corners, layout, spread, used, fine, steps, free)
    return corners


def _align_phase(
    pyramid: Pyramid,
    corners: NDArray[np.float64],
    layout: Layout,
    spread: float,
    used: NDArray[np.bool_],
    fine: int,
    steps: int,
    free: bool,
) -> NDArray[np.float64]:
    """Go through one of the `PHASES`, which ``fine``, ``steps`` and ``free`` describe."""
    width, height = layout.cols * TILES * fine, layout.rows * TILES * fine
    level = level_for(corners, width, height, len(pyramid))
    scale = 2.0**level
    c = at_level(corners, level)
    left, top = np.floor(c.min(axis=0)).astype(int) - MARGIN_PX
    right, bottom = np.ceil(c.max(axis=0)).astype(int) + MARGIN_PX
    left, top = max(0, left), max(0, top)
    image = pyramid[level][top:bottom, left:right].astype(np.float32)
    if not image.size:  # the corners lie beyond the image
        return corners
    c = c - [left, top]
    # as blurred as the drawn tiles: between samples no edge must go unseen
    apart = np.linalg.norm(np.roll(c, -1, axis=0) - c, axis=1) / [width, height, width, height]
    image = cv2.GaussianBlur(image, (0, 0), max(LEAST_BLUR_PX, BLUR * float(apart.mean())))
    start = c.copy()
    points, basis = _grid(layout, fine, free)
    unit = frame_corners(width, height)
    first = transform(homography_from_points(unit, c), points)
    seen = in_image(first, image.shape) & np.repeat(used, len(points) // len(used))
    if not seen.all():
        points, basis = points[seen], basis[seen]
    if not len(points):
        return corners
    side = float(np.sqrt(cv2.contourArea(c.astype(np.float32)))) + 1e-9
    ridge = (RESIDUAL_LEVELS / (max(spread, 1e-6) * side)) ** 2
    known = basis.shape[1]
    prior = np.diag(np.concatenate([np.full(known, LEVEL_RIDGE), np.full(8, ridge)]))
    A = np.concatenate([basis, np.empty((len(points), 8))], axis=1)
    weight = np.ones(len(points))
    for step in range(steps):
        at, by_corners = points_by_corners(unit, c, points)
        taken, gx, gy = _sample(image, at)
        A[:, known:] = -gx[:, None] * by_corners[:, 0] - gy[:, None] * by_corners[:, 1]
        pull = np.concatenate([np.zeros(known), ridge * (start - c).reshape(-1)])
        rounds = 2 if step == 0 else 1
        solution, weight = _robust_solution(A, taken, prior, pull, weight, rounds)
        most = MOST_STEP * side + MOST_STEP_PX
        move = np.clip(solution[known:].reshape(4, 2), -most, most)
        c = c + move
        if np.abs(move).max() * scale < MIN_STEP_PX and step > 1:
            break
    return np.asarray((c + [left, top] + 0.5) * scale - 0.5)


def _robust_solution(
    A: NDArray[np.float64],
    taken: NDArray[np.float64],
    ridge: NDArray[np.float64],
    pull: NDArray[np.float64],
    weights: NDArray[np.float64],
    rounds: int,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Solve A x = taken, beginning with given weights; the solution and the weights that follow."""
    return reweighted(
        solve=lambda weights: ridge_solution(A, taken, weights, ridge, pull),
        residuals_of=lambda solution: np.abs(taken - A @ solution),
        scale_of=lambda residuals: 2 * MAD_TO_SIGMA * float(np.median(residuals)) + 1e-3,
        rounds=rounds,
        weights=weights,
    )


@lru_cache(maxsize=8)
def _grid(layout: Layout, fine: int, free: bool) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """List the samples of all patches: (N, 2) points of the fine grid, and what may be seen there.

    The second is (N, 3 * patches), powers of the levels displayed, or (N, tiles of all patches).
    Drawn tiles are blurred about as much as a camera does; the outermost samples of a patch, which
    its surroundings reach, are left out.
    """
    size = TILES * fine
    inner = np.arange(2, size - 2)
    y, x = np.meshgrid(inner, inner, indexing="ij")
    tile = np.kron(np.arange(TILES**2).reshape(TILES, TILES), np.ones((fine, fine), int))
    each = np.eye(TILES**2, dtype=np.float32)[tile]  # (size, size, tiles)
    each = cv2.GaussianBlur(each, (0, 0), DRAWN_BLUR * BLUR, borderType=cv2.BORDER_REPLICATE)
    each = each[y, x].reshape(-1, TILES**2).astype(np.float64)
    points = [
        np.column_stack([(x + col * size).ravel(), (y + row * size).ravel()])
        for row, col in layout.ratex
    ]
    if free:
        parts = [each] * len(points)
    else:
        shown = [
            each @ (tiles.ravel() / HALF_RANGE - 1) for tiles in tile_levels(layout, DRAWN_KAPPA)
        ]
        parts = [np.column_stack([np.ones_like(level), level, level**2]) for level in shown]
    width = parts[0].shape[1]
    basis = np.zeros((len(points) * len(each), len(points) * width))
    for i, part in enumerate(parts):
        basis[i * len(each) : (i + 1) * len(each), i * width : (i + 1) * width] = part
    return np.concatenate(points).astype(np.float64), basis


def _sample(
    image: NDArray[np.float32], at: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Sample the image and its two derivatives at (N, 2) points, (N,) each."""
    around = np.array([[0, 0], [0.5, 0], [-0.5, 0], [0, 0.5], [0, -0.5]])
    where = (at[None] + around[:, None]).astype(np.float32)  # -> (5, N, 2)
    taken = cv2.remap(
        image,
        where[..., 0],
        where[..., 1],
        cv2.INTER_CUBIC,
        borderMode=cv2.BORDER_REPLICATE,
    ).astype(np.float64)
    return taken[0], taken[1] - taken[2], taken[3] - taken[4]
