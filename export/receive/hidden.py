"""Fill in what a frame pair does not show of the display, so that the rest can be decoded.

A decoder fits its calibration to all ratex patches and refines it on all message blocks. Of those
that lie outside the image, or behind a hand, it would learn wrong things. So a hidden message block
takes the pixels of the nearest one that is seen, in both states alike, and the tiles of a hidden
patch take those of patches that are seen: mixed from the two tiles of the same label whose levels
lie next to theirs. The decoder then has nothing to learn there. What it says of filled blocks means
nothing, and the receiver erases it.
"""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from link.layout import Layout
from link.ratex import TILES, match_patches, tile_labels, tile_levels

CLEAR = 0.8
"""Smallest correlation of shown and captured tiles of a patch that nothing covers."""
LEAST_CLEAR = 2
"""Smallest number of patches that must be seen for others to be filled."""

Image = NDArray[np.uint8]


def hidden_blocks(
    original: Image, embedded: Image, purity: NDArray[np.float64], layout: Layout
) -> NDArray[np.bool_]:
    """Tell which blocks of a frame pair are not seen.

    Args:
        original: (height, width) or (height, width, 3) uint8, encoded, rectified.
        embedded: uint8 of the shape of ``original``, of the other state.
        purity: (n, n) largest shares of an exposure in the two states, in [0, 1], over the display;
            0 where no frame holds anything.
        layout: with patches.

    Returns:
        (rows, cols): blocks with a part that no frame holds, and patches that something covers.
    """
    held = (purity > 0).astype(np.float32)
    size = (layout.cols, layout.rows)
    hidden = cv2.resize(held, size, interpolation=cv2.INTER_AREA) < 1 - 1e-6
    hidden = np.asarray(hidden, np.bool_)
    match = [match_patches(image, layout).correlation for image in (original, embedded)]
    for (row, col), seen in zip(layout.ratex, np.minimum(*match), strict=True):
        hidden[row, col] |= seen < CLEAR
    return hidden


def fill_hidden(images: Sequence[Image], hidden: NDArray[np.bool_], layout: Layout) -> list[Image]:
    """Fill the hidden blocks of rectified images that show one picture.

    Args:
        images: (height, width) or (height, width, 3) uint8, encoded, rectified.
        hidden: (rows, cols) blocks that are not seen.
        layout: with patches.

    Returns:
        copies in which the hidden blocks are filled; the images themselves where nothing is hidden,
        no message block is seen, or fewer than `LEAST_CLEAR` patches are.
    """
    seen_patches = [i for i, cell in enumerate(layout.ratex) if not hidden[cell]]
    seen = np.argwhere(layout.message_mask & ~hidden)
    if not hidden.any() or not len(seen) or len(seen_patches) < LEAST_CLEAR:
        return list(images)
    filled = [image.copy() for image in images]
    for row, col in np.argwhere(layout.message_mask & hidden):
        nearest = seen[np.abs(seen - [row, col]).sum(axis=1).argmin()]
        box, source = _box(layout, row, col), _box(layout, *nearest)
        for image in filled:
            image[box] = _fitted(image[source], image[box].shape)
    levels, labels = tile_levels(layout, 0), tile_labels(layout)
    known = [
        (int(levels[i][tile]), int(labels[i][tile]), _tile(layout, i, tile))
        for i in seen_patches
        for tile in np.ndindex(TILES, TILES)
    ]
    known.sort(key=lambda tile: tile[0])
    for i in set(range(len(layout.ratex))) - set(seen_patches):
        for tile in np.ndindex(TILES, TILES):
            level, box = int(levels[i][tile]), _tile(layout, i, tile)
            alike = [(at, source) for at, label, source in known if label == labels[i][tile]]
            below = [(at, source) for at, source in alike if at <= level] or alike[:1]
            above = [(at, source) for at, source in alike if at >= level] or alike[-1:]
            (low, one), (high, two) = below[-1], above[0]
            share = float(np.clip((level - low) / max(high - low, 1), 0, 1))
            for image in filled:
                shape = image[box].shape
                first, second = _fitted(image[one], shape), _fitted(image[two], shape)
                image[box] = cv2.addWeighted(first, 1 - share, second, share, 0).reshape(shape)
    return filled


def _box(layout: Layout, row: int, col: int) -> tuple[slice, slice]:
    top, bottom, left, right = layout.cell_box(row, col)
    return slice(top, bottom), slice(left, right)


def _tile(layout: Layout, patch: int, tile: tuple[int, ...]) -> tuple[slice, slice]:
    """Find the pixels of a tile, (row, column) in its patch."""
    box = []
    for cell, part, count, length in (
        (layout.ratex[patch][0], tile[0], layout.rows, layout.height),
        (layout.ratex[patch][1], tile[1], layout.cols, layout.width),
    ):
        start = TILES * cell + part
        ends = [-(-at * length // (TILES * count)) for at in (start, start + 1)]
        box.append(slice(*ends))
    return box[0], box[1]


def _fitted(pixels: Image, shape: tuple[int, ...]) -> Image:
    """Give pixels the height and width of a shape; blocks of a grid differ by one."""
    if pixels.shape == shape:
        return pixels
    return np.asarray(cv2.resize(pixels, (shape[1], shape[0]), interpolation=cv2.INTER_NEAREST))
