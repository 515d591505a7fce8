"""Ratex patches: the known texture that calibrates the link (paper, § Introduction and Methods).

A patch is ``TILES`` x ``TILES`` flat gray tiles. Its eight intensities span [0, 255 - kappa]
(several patches interleave theirs), and each intensity appears twice: once in a tile of label 1,
which is kappa brighter in the embedded frame, and once in a tile of label 0, which is not. So one
frame pair shows both classes at every intensity. The tile orders below differ from one another
under every rotation (correlation of intensities at most 0.24), so that corner patches also tell
which way up the display is; labels are balanced over rows and columns, so that a small shift
between the frames favours neither class.
"""

from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from link.layout import Layout
from link.types import Image

T = TypeVar("T", bound=Any)

TILES = 4
"""Number of tiles along each axis of a patch."""
LEVELS = TILES * TILES // 2
"""Number of intensities in a patch; each appears in one tile of label 1 and in one of label 0."""
SAMPLES = 6
"""Number of training samples along each axis of a tile, all in its inner half."""
STEPS = 4 * SAMPLES
"""Parts into which a tile is divided along each axis; samples lie at odd multiples of a part."""
TILE_ORDERS = np.array(
    [
        [2, 12, 1, 13, 4, 7, 6, 11, 5, 15, 10, 8, 3, 14, 9, 0],
        [2, 8, 9, 13, 3, 5, 10, 4, 6, 7, 0, 11, 15, 12, 1, 14],
        [12, 1, 2, 5, 13, 14, 7, 4, 6, 8, 9, 15, 3, 11, 10, 0],
        [5, 4, 2, 13, 14, 12, 11, 15, 7, 1, 0, 10, 8, 9, 3, 6],
        [15, 1, 4, 8, 13, 3, 10, 12, 14, 2, 11, 5, 0, 6, 9, 7],
    ]
)
"""Order of the tiles in each of five patches, (5, 16), row-major. A number q says that the tile's
intensity has rank q // 2 in the patch and that its label is q % 2. Further patches begin again."""

CLEAR_MATCH = 0.8
"""Smallest correlation of the displayed and the captured tiles of a patch at which the patch counts
as seen: nothing covers it, and the image does not cut it off."""


@dataclass(frozen=True)
class TrainingPixels:
    """Positions of the training pixels in a frame, and the levels and labels displayed there."""

    y: NDArray[np.intp]
    """(N,) pixel rows."""
    x: NDArray[np.intp]
    """(N,) pixel columns."""
    rho: NDArray[np.float64]
    """(N,) displayed intensity in the original frame, gray levels of [0, 255]."""
    label: NDArray[np.intp]
    """(N,) 1 where the tile changes as a bit 1 does, 0 where as a bit 0 does."""


def patch_centres(layout: Layout) -> NDArray[np.float64]:
    """Give the centres (x, y) of the patches on the display, (patches, 2) in [0, 1].

    >>> from link.layout import make_layout
    >>> patch_centres(make_layout(8, 8, ratex=2)).tolist()
    [[0.0625, 0.0625], [0.9375, 0.9375]]
    """
    cells = np.array(layout.ratex, np.float64).reshape(-1, 2)[:, ::-1] + 0.5  # (row, col) -> (x, y)
    return np.asarray(cells / [layout.cols, layout.rows])


def tile_labels(layout: Layout) -> NDArray[np.intp]:
    """Give each tile's label, 0 or 1, as an array (patches, TILES, TILES)."""
    orders = TILE_ORDERS[np.arange(len(layout.ratex)) % len(TILE_ORDERS)]
    return (orders % 2).reshape(-1, TILES, TILES)  # (patches, 16) -> (patches, 4, 4)


def tile_levels(layout: Layout, kappa: int) -> NDArray[np.intp]:
    """Give each tile's intensity in the darker of the two frames.

    Args:
        layout: says how many patches there are.
        kappa: gray levels by which tiles change between the frames.

    Returns:
        (patches, TILES, TILES) whole gray levels of [0, 255 - kappa].
    """
    patches = len(layout.ratex)
    index = np.arange(patches)
    rank = TILE_ORDERS[index % len(TILE_ORDERS)] // 2
    levels = np.linspace(0, 255 - kappa, max(1, patches * LEVELS)).round().astype(np.intp)
    return levels[rank * patches + index[:, None]].reshape(-1, TILES, TILES)


def shown_levels(layout: Layout, kappa: int, *, embedded: bool) -> NDArray[np.intp]:
    """Give each tile's intensity in one of the two frames, as the layout's modulation toggles it.

    Args:
        layout: says how many patches there are, and how bits change their blocks.
        kappa: gray levels by which tiles change between the frames.
        embedded: which frame of the pair is meant.

    Returns:
        (patches, TILES, TILES) whole gray levels of [0, 255].
    """
    low, high = layout.change_of_bits
    change = kappa * np.where(tile_labels(layout), high, low)
    levels = tile_levels(layout, kappa)
    return np.asarray(levels + np.maximum(change if embedded else -change, 0), np.intp)


def draw_patches(frame: Image, layout: Layout, kappa: int, *, embedded: bool) -> None:
    """Draw the patches into a displayed frame in place.

    Args:
        frame: an `Image` of the layout's size.
        layout: says where the patches lie.
        kappa: gray levels by which tiles change between the frames.
        embedded: which frame of the pair this is.
    """
    shown = shown_levels(layout, kappa, embedded=embedded)
    for (row, col), tiles in zip(layout.ratex, shown, strict=True):
        top, bottom, left, right = layout.cell_box(row, col)
        tile_y = np.arange(top, bottom) * layout.rows * TILES // layout.height - row * TILES
        tile_x = np.arange(left, right) * layout.cols * TILES // layout.width - col * TILES
        patch = tiles[tile_y[:, None], tile_x].astype(np.uint8)
        frame[top:bottom, left:right] = patch if frame.ndim == 2 else patch[:, :, None]


def sample_grid(layout: Layout) -> NDArray[np.intp]:
    """List the training samples of all patches, tile by tile, in the inner half of each tile.

    Where they lie is independent of the frame's size: in tiles, and in steps inside each tile.

    Returns:
        (4, N): tile row and tile column, counted over the whole frame, and position in the tile
        from its top and from its left, in parts of which a tile has `STEPS`.
    """
    cells = np.array(layout.ratex, np.intp).reshape(-1, 2)
    tiles, steps = np.arange(TILES), 2 * np.arange(SAMPLES) + SAMPLES + 1
    shape = (len(cells), TILES, TILES, SAMPLES, SAMPLES)
    tile_y = TILES * cells[:, 0, None, None, None, None] + tiles[:, None, None, None]
    tile_x = TILES * cells[:, 1, None, None, None, None] + tiles[:, None, None]
    parts = (tile_y, tile_x, steps[:, None], steps)
    return np.stack([np.broadcast_to(part, shape).reshape(-1) for part in parts])  # -> (4, N)


def sample_position(tile: T, step: T, tiles: T | int, length: T | int) -> T:
    """Find the pixel of each sample along one axis.

    All numbers are whole, in numpy arrays or torch tensors alike.

    Args:
        tile: (N,) tile of each sample, counted over the whole axis.
        step: (N,) position in the tile, in parts of which a tile has `STEPS`.
        tiles: number of tiles along the axis.
        length: pixels of the axis.

    Returns:
        (N,) pixels.
    """
    start = (tile * length + tiles - 1) // tiles
    stop = ((tile + 1) * length + tiles - 1) // tiles
    position: T = start + step * (stop - start) // STEPS
    return position


def training_pixels(layout: Layout, kappa: int = 0) -> TrainingPixels:
    """Find the training pixels: 36 in the inner half of each tile, away from its edges.

    Args:
        layout: layout with at least one patch; without one the arrays are empty.
        kappa: gray levels that the ratex patches toggle by; they enter the displayed intensities.
    """
    tile_y, tile_x, step_y, step_x = sample_grid(layout)
    per_tile = SAMPLES * SAMPLES
    return TrainingPixels(
        y=sample_position(tile_y, step_y, layout.rows * TILES, layout.height),
        x=sample_position(tile_x, step_x, layout.cols * TILES, layout.width),
        rho=np.repeat(shown_levels(layout, kappa, embedded=False).reshape(-1), per_tile).astype(
            np.float64
        ),
        label=np.repeat(tile_labels(layout).reshape(-1), per_tile),
    )


@dataclass(frozen=True)
class PatchMatch:
    """Captured and displayed intensities of the tiles of each ratex patch in one frame."""

    captured: NDArray[np.float64]
    """(patches, tiles) captured intensity of each tile less the mean of its patch, gray levels."""
    shown: NDArray[np.float64]
    """(patches, tiles) displayed intensity of each tile less the mean of its patch, gray levels."""
    label: NDArray[np.intp]
    """(patches, tiles) 1 where the embedded frame is kappa brighter, else 0."""
    correlation: NDArray[np.float64]
    """(patches,) correlation of ``captured`` and ``shown``, in [-1, 1]; 0 where a patch is even."""


def match_patches(frame: Image, layout: Layout) -> PatchMatch:
    """Compare the ratex patches of a rectified frame with the patches that were displayed.

    Args:
        frame: an `Image`, of any size.
        layout: layout with at least one patch.
    """
    height, width = frame.shape[:2]
    pixels = training_pixels(replace(layout, height=height, width=width))
    samples = frame[pixels.y, pixels.x].astype(np.float64)
    gray = samples if samples.ndim == 1 else samples.mean(axis=1)
    shape = (len(layout.ratex), TILES * TILES, SAMPLES * SAMPLES)
    captured = gray.reshape(shape).mean(axis=2)  # (N,) -> (patches, tiles)
    shown = pixels.rho.reshape(shape)[:, :, 0]
    captured = captured - captured.mean(axis=1, keepdims=True)
    shown = shown - shown.mean(axis=1, keepdims=True)
    scale = np.sqrt((captured**2).sum(axis=1) * (shown**2).sum(axis=1)) + 1e-9
    correlation = (captured * shown).sum(axis=1) / scale
    return PatchMatch(captured, shown, pixels.label.reshape(shape)[:, :, 0], correlation)


def patch_correlation(frame: Image, layout: Layout) -> float:
    """Tell how well a rectified frame shows the ratex patches where the layout has them.

    Args:
        frame: an `Image`, of any size.
        layout: layout with at least one patch.

    Returns:
        mean over the patches of the correlation between displayed and captured tile intensities,
        in [-1, 1]: near 1 with right corners, near 0 without a display, a few tenths at most with
        the display turned.
    """
    return float(match_patches(frame, layout).correlation.mean())
