"""The block grid: where bits and ratex patches lie in the displayed frame."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from link.errors import InputError, ParameterError
from link.outside import read_json

MIN_BLOCK_PX = 4
"""Smallest width and height of a block, in pixels of the displayed frame."""
MAX_SIDE_PX = 8192
"""Largest width and height of a displayed frame, in pixels."""
MAX_PIXELS = 20_000_000
"""Largest number of pixels of a displayed frame."""
MAX_BLOCKS = 16_384
"""Largest number of blocks of a layout."""


@dataclass(frozen=True)
class Layout:
    """A grid of ``rows`` x ``cols`` blocks over a ``width`` x ``height`` frame.

    Blocks listed in ``ratex`` as (row, col) carry radiometric calibration texture; the others
    carry one message bit each, in row-major order. Pixel (x, y) belongs to block row
    ``y * rows // height`` and block column ``x * cols // width``, so any frame size works.

    Raises:
        InputError: the grid does not fit the frame, or a ratex cell lies outside it or is repeated.
    """

    rows: int
    """Number of blocks from top to bottom."""
    cols: int
    """Number of blocks from left to right."""
    width: int
    """Width of the displayed frame, in pixels."""
    height: int
    """Height of the displayed frame, in pixels."""
    ratex: tuple[tuple[int, int], ...]
    """Blocks, as (row, col) from the top left, that carry ratex patches instead of bits."""

    def __post_init__(self) -> None:
        if self.rows < 1 or self.cols < 1:
            raise InputError(f"layout: rows and cols must be positive, got {self.rows}x{self.cols}")
        if not (self.width <= MAX_SIDE_PX and self.height <= MAX_SIDE_PX):
            raise InputError(
                f"layout: a {self.width}x{self.height} frame is larger than {MAX_SIDE_PX} pixels"
            )
        if self.width * self.height > MAX_PIXELS:
            raise InputError(
                f"layout: a {self.width}x{self.height} frame has more than {MAX_PIXELS} pixels"
            )
        if self.rows * self.cols > MAX_BLOCKS:
            raise InputError(
                f"layout: {self.cols}x{self.rows} blocks are more than {MAX_BLOCKS} in all"
            )
        if self.width < self.cols * MIN_BLOCK_PX or self.height < self.rows * MIN_BLOCK_PX:
            raise InputError(
                f"layout: {self.cols}x{self.rows} blocks need a frame of at least "
                f"{self.cols * MIN_BLOCK_PX}x{self.rows * MIN_BLOCK_PX} pixels, "
                f"got {self.width}x{self.height}"
            )
        for row, col in self.ratex:
            if not (0 <= row < self.rows and 0 <= col < self.cols):
                raise InputError(f"layout: ratex cell ({row}, {col}) lies outside the grid")
        if len(set(self.ratex)) != len(self.ratex):
            raise InputError("layout: a ratex cell is listed twice")
        if len(self.ratex) >= self.rows * self.cols:
            raise InputError("layout: no block is left for the message")

    @cached_property
    def message_mask(self) -> NDArray[np.bool_]:
        """Array (rows, cols) of bool that is true where a block carries a message bit."""
        mask = np.ones((self.rows, self.cols), bool)
        for row, col in self.ratex:
            mask[row, col] = False
        return mask

    @property
    def n_bits(self) -> int:
        """Number of message bits in one frame."""
        return self.rows * self.cols - len(self.ratex)

    def cell_box(self, row: int, col: int) -> tuple[int, int, int, int]:
        """Find the pixels of a block.

        Args:
            row: row of the block, from 0 at the top.
            col: column of the block, from 0 at the left.

        Returns:
            top, bottom, left and right in pixels; bottom and right are exclusive.

        >>> make_layout(rows=4, cols=4, width=64, height=48, ratex=2).cell_box(0, 1)
        (0, 12, 16, 32)
        """
        top, bottom = (-(-r * self.height // self.rows) for r in (row, row + 1))
        left, right = (-(-c * self.width // self.cols) for c in (col, col + 1))
        return top, bottom, left, right

    def to_dict(self) -> dict[str, Any]:
        """Describe the layout in JSON's types: rows, cols, width, height and ratex."""
        return {
            "rows": self.rows,
            "cols": self.cols,
            "width": self.width,
            "height": self.height,
            "ratex": [list(cell) for cell in self.ratex],
        }

    @classmethod
    def from_dict(cls, data: Any) -> "Layout":
        """Make a layout from what `to_dict` wrote.

        Raises:
            InputError: a key is missing, unknown or of the wrong type.
        """
        keys = ("rows", "cols", "width", "height", "ratex")
        if not isinstance(data, dict) or set(data) != set(keys):
            raise InputError(f"layout: need exactly the keys {', '.join(keys)}, got {data!r:.200}")
        for key in keys[:4]:
            if type(data[key]) is not int:
                raise InputError(f"layout: {key} must be a whole number, got {data[key]!r}")
        try:
            cells = tuple((row, col) for row, col in data["ratex"])
        except (TypeError, ValueError):
            cells = ((None, None),)
        if not all(type(number) is int for cell in cells for number in cell):
            raise InputError(
                f"layout: ratex must be a list of whole [row, col], got {data['ratex']!r:.100}"
            )
        return cls(data["rows"], data["cols"], data["width"], data["height"], cells)


def make_layout(
    rows: int = 8, cols: int = 8, width: int = 512, height: int = 384, ratex: int = 5
) -> Layout:
    """Make the usual layout: ratex patches in the corners and the centre.

    Two patches lie on a diagonal; one is the top-left corner, where it disturbs least.

    Args:
        rows: number of blocks from top to bottom.
        cols: number of blocks from left to right.
        width: of the displayed frame, pixels.
        height: of the displayed frame, pixels.
        ratex: number of ratex patches: 0, 1, 2, 3 or 5.

    Raises:
        InputError: ``ratex`` is another number, or the grid does not fit the frame.

    >>> layout = make_layout()
    >>> (layout.n_bits, layout.ratex)
    (59, ((0, 0), (7, 7), (0, 7), (7, 0), (4, 4)))
    """
    bottom, right = rows - 1, cols - 1
    cells = ((0, 0), (bottom, right), (0, right), (bottom, 0), (rows // 2, cols // 2))
    if ratex not in (0, 1, 2, 3, 5):
        raise ParameterError("ratex", f"choose 0, 1, 2, 3 or 5 patches, got {ratex}")
    if len(set(cells[:ratex])) < ratex:
        raise ParameterError("ratex", f"a {cols}x{rows} grid has no room for {ratex} patches")
    return Layout(rows, cols, width, height, cells[:ratex])


def read_layout(file: Path) -> Layout:
    """Read a layout from a JSON file with the keys rows, cols, width, height and ratex.

    Raises:
        InputError: the file cannot be read, or holds no layout.
    """
    try:
        return Layout.from_dict(read_json(file))
    except InputError as error:
        raise InputError(f"{file}: no layout there ({error})") from None


def block_index(length: int, count: int) -> NDArray[np.intp]:
    """Number the block of each pixel along one axis.

    Args:
        length: pixels of the axis.
        count: blocks of the axis.

    Returns:
        (length,) whole numbers from 0 to ``count`` - 1.

    >>> block_index(7, 3).tolist()
    [0, 0, 0, 1, 1, 2, 2]
    """
    return np.arange(length) * count // length


def block_mean(maps: NDArray[np.floating[Any]], rows: int, cols: int) -> NDArray[np.floating[Any]]:
    """Average over each block.

    Args:
        maps: (..., H, W).
        rows: number of blocks from top to bottom.
        cols: number of blocks from left to right.

    Returns:
        (..., rows, cols) in the dtype of ``maps``.
    """
    height, width = maps.shape[-2:]
    counts_y = np.bincount(block_index(height, rows), minlength=rows)
    counts_x = np.bincount(block_index(width, cols), minlength=cols)
    starts_y, starts_x = np.cumsum(counts_y) - counts_y, np.cumsum(counts_x) - counts_x
    sums = np.add.reduceat(np.add.reduceat(maps, starts_y, axis=-2), starts_x, axis=-1)
    return np.asarray(sums / (counts_y[:, None] * counts_x), maps.dtype)
