"""Take frame pairs apart into pictures and changes, so that a page computes all states from them.

A state is a picture plus the offset of each pixel. An offset depends on three things alone: on
which frame of the pair is shown, on the change of the pixel's block between both, and on where the
pixel lies among the 4 x 4 pixels over which `link.embed.split_change` dithers. So a loop of many
frame pairs over one picture is this picture, a short table of offsets, and a few bits a frame pair.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from link.embed import BEFORE, THRESHOLDS, message_mask, split_change, with_head_room
from link.layout import Layout, block_index
from link.ratex import draw_patches
from link.types import Image

TILE = len(THRESHOLDS)
"""Number of pixels, along either axis, after which the dither repeats."""


@dataclass(frozen=True)
class Compact:
    """The rule by which a page computes the states of a loop.

    Changes between the frames of a pair are numbered. Cells of one number change alike: blocks
    where edges are hard, single pixels where they are soft. Pixels of ratex patches have numbers of
    their own, which are the same in every pair.

    >>> from link.embed import embed
    >>> from link.layout import make_layout
    >>> layout = make_layout(4, 4, 64, 48, modulation="antipodal", ratex=2)
    >>> picture, bits = np.full((48, 64), 128, np.uint8), [0, 1] * 7
    >>> pair, rule = embed(picture, bits, layout, kappa=3), Compact(layout, kappa=3)
    >>> original, embedded = rule.states(rule.picture(picture), rule.cells(bits))
    >>> bool((original == pair.original).all() and (embedded == pair.embedded).all())
    True
    """

    layout: Layout
    """Grid, modulation, patches and colour direction of the loop."""
    kappa: int
    """Gray levels by which blocks change."""
    pyramid_level: int = 0
    """Softness of the blocks' edges, as in `link.embed.message_mask`."""

    @property
    def soft(self) -> bool:
        """Whether blocks have soft edges, so that cells are pixels."""
        return self.pyramid_level > 0

    @cached_property
    def changes(self) -> NDArray[np.intp]:
        """Array (C,) of the changes of cells between the two frames, in gray levels, by number."""
        low, high = (self.kappa * change for change in self.layout.change_of_bits)
        return np.arange(low, high + 1) if self.soft else np.array([low, high])

    @cached_property
    def offsets(self) -> NDArray[np.intp]:
        """Array (2, N, 4, 4, 3) of the levels that are added to the picture.

        The axes are: original or embedded frame; number of the change, where those of ratex patches
        come after the cells' own; row and column of the pixel in its tile; red, green and blue.
        """
        parts = []
        for change in self.changes:
            levels = np.full((TILE, TILE, 3), change) * np.array(self.layout.direction)
            below, above = split_change(levels, BEFORE[self.layout.modulation])
            parts.append([-below, above])
        if self.layout.ratex:
            still = np.zeros((TILE, TILE, 3), np.intp)
            parts += [[still, still + change] for change in (-self.kappa, 0, self.kappa)]
        return np.array(parts, np.intp).swapaxes(0, 1)

    @cached_property
    def patches(self) -> NDArray[np.uint8]:
        """Array (height, width) of the numbers of changes in ratex patches; 0 outside them."""
        shape = self.layout.height, self.layout.width
        shown = []
        for embedded in (False, True):
            frame = np.zeros(shape, np.uint8)
            draw_patches(frame, self.layout, self.kappa, embedded=embedded)
            shown.append(frame.astype(np.intp))
        still = len(self.changes) + 1
        numbers = np.zeros(shape, np.uint8)
        for row, col in self.layout.ratex:
            top, bottom, left, right = self.layout.cell_box(row, col)
            box = slice(top, bottom), slice(left, right)
            numbers[box] = still + (shown[1][box] - shown[0][box]) // self.kappa
        return numbers

    def cells(self, bits: ArrayLike) -> NDArray[np.uint8]:
        """Number the changes of a frame pair's cells.

        Args:
            bits: (n_bits,) 0 or 1 that the pair carries.

        Returns:
            (rows, cols) 0 or 1 where edges are hard, (height, width) where they are soft.
        """
        mask = message_mask(bits, self.layout, self.pyramid_level)
        if self.soft:
            return np.asarray((self.kappa * mask).round() - self.changes[0], np.uint8)
        top = [self.layout.cell_box(row, 0)[0] for row in range(self.layout.rows)]
        left = [self.layout.cell_box(0, col)[2] for col in range(self.layout.cols)]
        return np.asarray(mask[np.ix_(top, left)] > 0, np.uint8)

    def picture(self, picture: Image) -> Image:
        """Prepare a picture, to which the offsets are added: with room for them, and with patches.

        Args:
            picture: an `Image` of the layout's size.

        Returns:
            an `Image` of the same shape.
        """
        layout = self.layout
        shown = with_head_room(picture, self.kappa, layout.modulation, layout.colour)
        draw_patches(shown, layout, self.kappa, embedded=False)
        return shown

    def states(
        self, picture: NDArray[np.uint8], cells: NDArray[np.uint8]
    ) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
        """Compute the original and the embedded frame, as a page does.

        Args:
            picture: (height, width) or (height, width, 3), as `picture` returns it.
            cells: numbers of changes, as `cells` returns them.
        """
        original, embedded = (
            np.asarray(picture + self._pixel_offsets(frame, cells, picture.ndim), np.uint8)
            for frame in (0, 1)
        )
        return original, embedded

    def _pixel_offsets(
        self, frame: int, cells: NDArray[np.uint8], dimensions: int
    ) -> NDArray[np.intp]:
        """Array (height, width) or (height, width, 3) of the levels that a frame adds."""
        rows, cols = np.arange(self.layout.height), np.arange(self.layout.width)
        numbers = cells
        if not self.soft:
            numbers = cells[
                block_index(self.layout.height, self.layout.rows)[:, None],
                block_index(self.layout.width, self.layout.cols),
            ]
        numbers = np.where(self.patches > 0, self.patches, numbers)
        offsets = self.offsets[frame] if dimensions == 3 else self.offsets[frame, ..., 0]
        return np.asarray(offsets[numbers, rows[:, None] % TILE, cols % TILE])
