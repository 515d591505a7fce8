"""Fill in what a frame pair does not show of the display, so that the rest can be decoded.

A decoder fits its calibration to all ratex patches and refines it on all message blocks. Of those
that lie outside the image, or behind a hand, it would learn wrong things. So an unseen message
block takes the pixels of the nearest one that is seen, in both states alike. The tiles of an unseen
patch take those of patches that are seen: mixed from the two tiles of the same label whose levels
lie next to theirs. The decoder then has nothing to learn there. What it says of filled blocks means
nothing, and the receiver erases it.
"""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from link.layout import Layout
from link.ratex import CLEAR_MATCH, TILES, match_patches, tile_labels, tile_levels
from link.types import Image

LEAST_CLEAR = 2
"""Smallest number of patches that must be seen for others to be filled."""


def unseen_blocks(
    original: Image, embedded: Image, purity: NDArray[np.float64], layout: Layout
) -> NDArray[np.bool_]:
    """Tell which blocks of a frame pair are not seen.

    Args:
        original: an `Image`, rectified.
        embedded: an `Image` of the shape of ``original``, of the other state.
        purity: (n, n) largest shares of an exposure in the two states, in [0, 1], over the display;
            0 where no frame holds anything.
        layout: layout with patches or pilots, or without either.

    Returns:
        (rows, cols): blocks with a part that no frame holds, and patches that something covers.
        Nothing tells whether something covers a pilot.
    """
    held = (purity > 0).astype(np.float32)
    size = (layout.cols, layout.rows)
    unseen = cv2.resize(held, size, interpolation=cv2.INTER_AREA) < 1 - 1e-6
    unseen = np.asarray(unseen, np.bool_)
    if not layout.ratex:
        return unseen
    match = [match_patches(image, layout).correlation for image in (original, embedded)]
    for (row, col), seen in zip(layout.ratex, np.minimum(*match), strict=True):
        unseen[row, col] |= seen < CLEAR_MATCH
    return unseen


def fill_unseen(images: Sequence[Image], unseen: NDArray[np.bool_], layout: Layout) -> list[Image]:
    """Fill the unseen blocks of rectified images that show one picture.

    Args:
        images: rectified frames, an `Image` each.
        unseen: (rows, cols) blocks that are not seen.
        layout: layout with patches or pilots, or without either.

    Returns:
        copies in which the unseen blocks are filled; the images themselves where nothing is unseen,
        no message block is seen, or the layout has patches of which fewer than `LEAST_CLEAR` are
        seen. Pilots stay as they are.
    """
    seen_patches = [i for i, cell in enumerate(layout.ratex) if not unseen[cell]]
    seen_message = layout.message_mask & ~unseen
    few_patches = bool(layout.ratex) and len(seen_patches) < LEAST_CLEAR
    if not unseen.any() or not seen_message.any() or few_patches:
        return list(images)
    filled = [image.copy() for image in images]
    _copy_nearest(filled, unseen, layout)
    _mix_tiles(filled, seen_patches, layout)
    return filled


def _copy_nearest(images: Sequence[Image], unseen: NDArray[np.bool_], layout: Layout) -> None:
    """Give each unseen message block, in place, the pixels of the nearest one that is seen.

    Distances count steps along rows and columns; of blocks equally near the first in reading order
    is taken.

    Args:
        images: rectified frames, an `Image` each.
        unseen: (rows, cols) blocks that are not seen.
        layout: layout of the images.
    """
    from_row, from_col = _nearest(layout.message_mask & ~unseen)
    for block in map(tuple, np.argwhere(layout.message_mask & unseen)):
        box, source = _box(layout, *block), _box(layout, from_row[block], from_col[block])
        for image in images:
            image[box] = _fitted(image[source], image[box].shape)


def _nearest(seen: NDArray[np.bool_]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Find the nearest block that is seen, its row and column, for every block of a grid.

    Args:
        seen: (rows, cols), true somewhere.
    """
    rows, cols = seen.shape
    down, across = (
        np.abs(np.arange(count, dtype=np.int16)[:, None] - np.arange(count, dtype=np.int16))
        for count in (rows, cols)
    )
    apart = np.where(seen[:, None, :], across, np.int16(rows + cols))  # (rows, cols, cols)
    best_col, best = apart.argmin(axis=2), apart.min(axis=2)  # within each row
    from_row = (down[:, :, None] + best).argmin(axis=1)  # (rows, rows, cols) -> (rows, cols)
    return from_row, best_col[from_row, np.arange(cols)]


def _mix_tiles(images: Sequence[Image], seen_patches: Sequence[int], layout: Layout) -> None:
    """Mix the tiles of unseen patches, in place, from those of the patches that are seen."""
    levels, labels = tile_levels(layout, 0), tile_labels(layout)

    def box_of(patch: int, tile: tuple[int, ...]) -> tuple[slice, slice]:
        (row, col), (down, across) = layout.ratex[patch], tile
        return _box(layout, TILES * row + down, TILES * col + across, TILES)

    known = [
        (int(levels[i][tile]), int(labels[i][tile]), box_of(i, tile))
        for i in seen_patches
        for tile in np.ndindex(TILES, TILES)
    ]
    known.sort(key=lambda tile: tile[0])
    for i in set(range(len(layout.ratex))) - set(seen_patches):
        for tile in np.ndindex(TILES, TILES):
            level, box = int(levels[i][tile]), box_of(i, tile)
            alike = [(at, source) for at, label, source in known if label == labels[i][tile]]
            below = [(at, source) for at, source in alike if at <= level] or alike[:1]
            above = [(at, source) for at, source in alike if at >= level] or alike[-1:]
            (low, one), (high, two) = below[-1], above[0]
            share = float(np.clip((level - low) / max(high - low, 1), 0, 1))
            for image in images:
                shape = image[box].shape
                first, second = _fitted(image[one], shape), _fitted(image[two], shape)
                image[box] = cv2.addWeighted(first, 1 - share, second, share, 0).reshape(shape)


def _box(layout: Layout, row: int, col: int, parts: int = 1) -> tuple[slice, slice]:
    """Find the pixels of a block, or of one of the ``parts`` x ``parts`` parts of each block.

    Args:
        layout: layout of the images.
        row: row of the block or part, counted over the whole display.
        col: column of the block or part, counted over the whole display.
        parts: number of parts along each axis of a block.
    """
    rows, cols = (
        [-(-at * length // (parts * count)) for at in (first, first + 1)]
        for first, length, count in (
            (row, layout.height, layout.rows),
            (col, layout.width, layout.cols),
        )
    )
    return slice(*rows), slice(*cols)


def _fitted(pixels: Image, shape: tuple[int, ...]) -> Image:
    """Give pixels the height and width of a shape; blocks of a grid differ by one."""
    if pixels.shape == shape:
        return pixels
    return np.asarray(cv2.resize(pixels, (shape[1], shape[0]), interpolation=cv2.INTER_NEAREST))
