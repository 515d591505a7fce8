"""Find the ratex patches near a coarse quadrilateral, and align corners to them.

Patches tell which way up the display is and, four of them in the corners, where its corners are,
whatever the picture shows and whatever surrounds it.
"""

from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from link.geometry import frame_corners, homography_from_corners, transform
from link.layout import Layout
from link.ratex import TILES, tile_levels

TILE_PX = 4
"""Pixels of a tile where patches are searched."""
SEARCH = 0.09
"""Reach of the search on each axis, as a share of the display's side."""
SEARCH_ERROR, PLACE_ERROR = 0.04, 0.006
"""Expected errors, as shares of the display's side, of a coarse corner and of a patch found."""
PHASES = ((6, 6, False), (6, 2, True))
"""Of the alignment: samples of a tile and axis, steps, and whether each tile's level is free."""
MARGIN_PX = 4
BLUR = 0.8
"""Of the image and of the drawn tiles, in samples."""
MIN_STEP_PX = 0.01
KAPPA = 3
"""Of the drawn patches; the tiles' levels hardly depend on it."""
CORNER_SPREAD = 0.02
"""Expected error of the corners before alignment, as a share of the display's side: a ridge that
holds corners where too few patches determine them."""
RESIDUAL_LEVELS = 8.0
"""Residual at which the ridge weighs: noise, moire and response that three coefficients miss."""

Pyramid = list[NDArray[np.uint8]]


def pyramid(gray: NDArray[np.uint8]) -> Pyramid:
    """The gray image at 1, 1/2, 1/4, ... of its size, down to about 80 px."""
    levels = [gray]
    while min(levels[-1].shape) >= 160:
        height, width = levels[-1].shape
        even = levels[-1][: height // 2 * 2, : width // 2 * 2]
        levels.append(
            np.asarray(
                cv2.resize(even, (width // 2, height // 2), interpolation=cv2.INTER_AREA), np.uint8
            )
        )
    return levels


def _at_level(corners: NDArray[np.float64], level: int) -> NDArray[np.float64]:
    """Corners in pixels of a level: centres at whole numbers at every level."""
    return np.asarray((corners + 0.5) / 2**level - 0.5)


def _level(corners: NDArray[np.float64], width: float, height: float, levels: int) -> int:
    """The level whose pixels are at most as fine as half of a ``width`` x ``height`` grid's."""
    side = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
    ratio = min(side[[0, 2]].min() / width, side[[1, 3]].min() / height)
    return int(np.clip(np.floor(np.log2(max(ratio, 1e-3) / 1.2) + 0.5), 0, levels - 1))


def search(
    images: Pyramid, corners: NDArray[np.float64], layout: Layout, reach: float = SEARCH
) -> tuple[float, NDArray[np.float64]]:
    """Look for each patch around its place.

    Args:
        images: of `pyramid`.
        corners: (4, 2) coarse, in the corner order to be tried.
        layout: with patches.
        reach: of the search on each axis, as a share of the display's side.

    Returns:
        mean over patches of the best correlation in reach, in [-1, 1], and (patches, 3): where its
        centre was found (x, y in display units, [0, 1]) and that correlation.
    """
    width, height = layout.cols * TILES * TILE_PX, layout.rows * TILES * TILE_PX
    reach_x, reach_y = max(3, round(reach * width)), max(3, round(reach * height))
    level = _level(corners, width, height, len(images))
    H = homography_from_corners(_at_level(corners, level), width, height)
    shift = np.array([[1, 0, -reach_x], [0, 1, -reach_y], [0, 0, 1.0]])
    seen = cv2.warpPerspective(
        images[level],
        H @ shift,
        (width + 2 * reach_x, height + 2 * reach_y),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_REPLICATE,
    )
    size = TILES * TILE_PX
    found = np.empty((len(layout.ratex), 3))
    for i, ((row, col), tiles) in enumerate(
        zip(layout.ratex, tile_levels(layout, KAPPA), strict=True)
    ):
        template = np.kron(tiles, np.ones((TILE_PX, TILE_PX))).astype(np.uint8)
        window = seen[
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
    return float(found[:, 2].mean()), found


def place(
    corners: NDArray[np.float64], found: NDArray[np.float64], layout: Layout
) -> NDArray[np.float64]:
    """Corners moved so that the patches lie where they were found.

    Least squares on the corners' motion in the display's frame, with a ridge: patches of low
    correlation count little, and a corner that no patch tells about stays.
    """
    cells = np.array(layout.ratex, np.float64)
    nominal = np.column_stack(
        [(cells[:, 1] + 0.5) / layout.cols, (cells[:, 0] + 0.5) / layout.rows]
    )
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    moved = found[:, :2].copy()
    weight = np.clip(found[:, 2], 0.05, 1) ** 8 / PLACE_ERROR**2
    robust = np.ones(len(moved))
    for _ in range(4):
        at = square.copy()
        for _ in range(2):
            H = _perspective(square, at)
            predicted, J = _by_corners(H, square, at, nominal)
            A = J.reshape(-1, 8)
            w = np.repeat(weight * robust, 2)
            ridge = np.eye(8) / SEARCH_ERROR**2
            right = A.T @ (w * (moved - predicted).reshape(-1)) - ridge @ (at - square).reshape(-1)
            at = at + np.linalg.solve((A.T * w) @ A + ridge, right).reshape(4, 2)
        misfit = np.linalg.norm(moved - transform(_perspective(square, at), nominal), axis=1)
        robust = 1 / (1 + (misfit / (2 * PLACE_ERROR)) ** 2)
    return transform(_perspective(square, corners), at)


def _perspective(source: NDArray[np.float64], target: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3, 3) homography of four points, from ``source`` to ``target``."""
    return np.asarray(
        cv2.getPerspectiveTransform(source.astype(np.float32), target.astype(np.float32)),
        np.float64,
    )


def _by_corners(
    H: NDArray[np.float64],
    source: NDArray[np.float64],
    target: NDArray[np.float64],
    points: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Where ``H``, of ``source`` to ``target`` corners, maps points, and how corners change that.

    Returns:
        (N, 2) and (N, 2, 8): derivatives by x, y of the target's four corners.
    """
    bump = 1e-2 * float(np.abs(target - target.mean(axis=0)).max())
    homographies = [H]
    for k in range(8):
        other = target.copy()
        other[k // 2, k % 2] += bump
        homographies.append(_perspective(source, other))
    mapped = np.stack(homographies) @ np.stack([*points.T, np.ones(len(points))])  # (9, 3, N)
    mapped = mapped[:, :2] / mapped[:, 2:]
    return mapped[0].T, np.asarray((mapped[1:] - mapped[0]).transpose(2, 1, 0) / bump)


def align(
    images: Pyramid,
    corners: NDArray[np.float64],
    layout: Layout,
    spread: float = CORNER_SPREAD,
) -> NDArray[np.float64]:
    """Corners at which the image shows the patches as drawn, to sub-pixels.

    Gauss-Newton on the corners, residuals weighted robustly, with a ridge on the corners' motion.
    First each patch is a quadratic of the levels displayed, fitted anew in every step. Then each
    tile has a level of its own: where blur meets the camera's response, an edge lies elsewhere
    than a quadratic puts it.

    Args:
        images: of `pyramid`.
        corners: (4, 2), within half a tile.
        layout: with patches.
        spread: expected error of the corners, as a share of the display's side.
    """
    for fine, steps, free in PHASES:
        corners = _align(images, corners, layout, spread, fine, steps, free)
    return corners


def _align(
    images: Pyramid,
    corners: NDArray[np.float64],
    layout: Layout,
    spread: float,
    fine: int,
    steps: int,
    free: bool,
) -> NDArray[np.float64]:
    """One phase of `align`: samples of a tile and axis, steps, and whether tiles are free."""
    width, height = layout.cols * TILES * fine, layout.rows * TILES * fine
    level = _level(corners, width, height, len(images))
    scale = 2.0**level
    c = _at_level(corners, level)
    left, top = np.floor(c.min(axis=0)).astype(int) - MARGIN_PX
    right, bottom = np.ceil(c.max(axis=0)).astype(int) + MARGIN_PX
    left, top = max(0, left), max(0, top)
    image = images[level][top:bottom, left:right].astype(np.float32)
    c = c - [left, top]
    # as blurred as the drawn tiles: between samples no edge must go unseen
    apart = np.linalg.norm(np.roll(c, -1, axis=0) - c, axis=1) / [width, height, width, height]
    image = cv2.GaussianBlur(image, (0, 0), max(0.7, BLUR * float(apart.mean())))
    start = c.copy()
    points, basis = _grid(layout, fine, free)
    side = float(np.sqrt(cv2.contourArea(c.astype(np.float32)))) + 1e-9
    unit = frame_corners(width, height)
    ridge = (RESIDUAL_LEVELS / (max(spread, 1e-6) * side)) ** 2
    known = basis.shape[1]
    prior = np.concatenate([np.full(known, 1e-3), np.full(8, ridge)])
    A = np.concatenate([basis, np.empty((len(points), 8))], axis=1)
    weight = np.ones(len(points))
    for step in range(steps):
        at, by_corners = _by_corners(_perspective(unit, c), unit, c, points)
        taken, gx, gy = _sample(image, at)
        A[:, known:] = -gx[:, None] * by_corners[:, 0] - gy[:, None] * by_corners[:, 1]
        pull = np.concatenate([np.zeros(known), ridge * (start - c).reshape(-1)])
        for _ in range(2 if step == 0 else 1):
            weighted = A.T * weight
            solution = np.linalg.solve(weighted @ A + np.diag(prior), weighted @ taken + pull)
            residual = np.abs(taken - A @ solution)
            weight = 1 / (1 + (residual / (2 * 1.4826 * np.median(residual) + 1e-3)) ** 2)
        move = np.clip(solution[known:].reshape(4, 2), -0.02 * side - 0.5, 0.02 * side + 0.5)
        c = c + move
        if np.abs(move).max() * scale < MIN_STEP_PX and step > 1:
            break
    return np.asarray((c + [left, top] + 0.5) * scale - 0.5)


@lru_cache(maxsize=8)
def _grid(layout: Layout, fine: int, free: bool) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Samples of all patches: (N, 2) points of the fine grid, and what the image may be there.

    The second is (N, 3 * patches), powers of the levels displayed, or (N, tiles of all patches).
    Drawn tiles are blurred about as much as a camera does; the outermost samples of a patch, which
    its surroundings reach, are left out.
    """
    size = TILES * fine
    inner = np.arange(2, size - 2)
    y, x = np.meshgrid(inner, inner, indexing="ij")
    tile = np.kron(np.arange(TILES**2).reshape(TILES, TILES), np.ones((fine, fine), int))
    each = np.eye(TILES**2, dtype=np.float32)[tile]  # (size, size, tiles)
    each = cv2.GaussianBlur(each, (0, 0), 1.25 * BLUR, borderType=cv2.BORDER_REPLICATE)
    each = each[y, x].reshape(-1, TILES**2).astype(np.float64)
    points = [
        np.column_stack([(x + col * size).ravel(), (y + row * size).ravel()])
        for row, col in layout.ratex
    ]
    if free:
        parts = [each] * len(points)
    else:
        shown = [each @ (tiles.ravel() / 127.5 - 1) for tiles in tile_levels(layout, KAPPA)]
        parts = [np.column_stack([np.ones_like(level), level, level**2]) for level in shown]
    width = parts[0].shape[1]
    basis = np.zeros((len(points) * len(each), len(points) * width))
    for i, part in enumerate(parts):
        basis[i * len(each) : (i + 1) * len(each), i * width : (i + 1) * width] = part
    return np.concatenate(points).astype(np.float64), basis


def _sample(
    image: NDArray[np.float32], at: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """The image and its two derivatives at (N, 2) points, (N,) each."""
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
