"""The block grid: where bits, pilots and ratex patches lie in the frame, and how bits are shown."""

from dataclasses import dataclass, field, fields
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from link.code.scrambled import splitmix64
from link.errors import InputError, ParameterError, at_least, choose
from link.geometry import frame_corners
from link.outside import read_json
from link.pilot_code import PLAIN, PilotCode
from link.types import Corners

MIN_BLOCK_PX = 4
"""Smallest width and height of a block, in pixels of the displayed frame."""
MAX_SIDE_PX = 8192
"""Largest width and height of a displayed frame, in pixels."""
MAX_PIXELS = 20_000_000
"""Largest number of pixels of a displayed frame."""
MAX_BLOCKS = 16_384
"""Largest number of blocks of a layout."""
MODULATIONS = {"on_off": (0, 1), "antipodal": (-1, 1)}
"""Changes between the two displayed states of a block whose bit is 0 and of one whose bit is 1, in
units of kappa, by the name of the modulation. The paper's is "on_off"."""
LEAST_PILOTS, MOST_PILOT_SHARE = 32, 0.25
"""Smallest number of pilots that "auto" takes, and the share of a small grid's blocks that it does
not exceed for that; docs/answered.md says how many a fit needs."""
PILOT_SHARE = 0.05
"""Share of the blocks that "auto" makes pilots on grids of more than 20 times `LEAST_PILOTS`."""
CODED_PILOT_SHARE = 0.1
"""Share of the blocks that "auto" makes pilots where a display's frame pairs follow a code: many
clocks are tried for it, and each may fit by chance."""


@dataclass(frozen=True)
class Layout:
    """A grid of ``rows`` x ``cols`` blocks over a ``width`` x ``height`` frame.

    Blocks listed in ``ratex`` as (row, col) carry radiometric calibration texture. ``pilots``
    blocks at pseudo-random places carry bits that sender and receiver know. The other blocks carry
    one message bit each, in row-major order. Pixel (x, y) belongs to block row
    ``y * rows // height`` and block column ``x * cols // width``, so any frame size works.

    Raises:
        InputError: the grid does not fit the frame, a ratex cell lies outside it or is repeated,
            the modulation is unknown, there are ratex patches beside pilots, or there is a code
            without pilots.
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
    modulation: str = "on_off"
    """How a bit changes its block between the two displayed states; a key of `MODULATIONS`."""
    pilots: int = 0
    """Number of blocks that carry known bits, from which decoders learn what ratex patches would
    tell them; such a layout has no ratex patches."""
    code: PilotCode = field(default=PLAIN, compare=False)
    """Code of the order in which a display with pilots shows the two states of its frame pairs.
    Layouts that differ in it alone count as equal, as a frame pair by itself does not show it."""

    def __post_init__(self) -> None:
        choose(MODULATIONS, self.modulation, "modulation")
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
        if self.pilots and self.ratex:
            raise InputError("layout: has pilots beside ratex patches; choose one of them")
        if self.code != PLAIN and not self.pilots:
            raise InputError("layout: has a code and no pilots that would show it")
        if self.pilots < 0 or self.pilots == 1:
            raise InputError(f"layout: need 2 pilots, so that both bits occur, got {self.pilots}")
        if len(self.ratex) + self.pilots >= self.rows * self.cols:
            raise InputError("layout: no block is left for the message")

    @cached_property
    def message_mask(self) -> NDArray[np.bool_]:
        """Array (rows, cols) of bool that is true where a block carries a message bit."""
        mask = np.ones((self.rows, self.cols), bool)
        for row, col in self.ratex:
            mask[row, col] = False
        mask.reshape(-1)[self.pilot_blocks] = False
        return mask

    @cached_property
    def pilot_blocks(self) -> NDArray[np.intp]:
        """(pilots,) row-major numbers of the blocks that are pilots, at pseudo-random places.

        A grid's blocks always come in the same order, so that a layout of more pilots keeps those
        of a layout of fewer.
        """
        return np.argsort(splitmix64(0, self.rows * self.cols))[: self.pilots]

    @cached_property
    def pilot_bits(self) -> NDArray[np.intp]:
        """(pilots,) known bits of the pilots, which alternate from pilot to pilot in reading order.

        Both bits so occur in all parts of the frame.
        """
        return np.asarray(np.argsort(np.argsort(self.pilot_blocks)) % 2, np.intp)

    @property
    def n_bits(self) -> int:
        """Number of message bits in one frame."""
        return self.rows * self.cols - len(self.ratex) - self.pilots

    @property
    def change_of_bits(self) -> tuple[int, int]:
        """Change of a block between the two states for bit 0 and for bit 1, in units of kappa."""
        return MODULATIONS[self.modulation]

    @property
    def corners(self) -> Corners:
        """Outer corners of the frame, (4, 2) pixels, in the order of `link.geometry`."""
        return frame_corners(self.width, self.height)

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
        """Describe the layout in JSON's types: its fields, those that have a default if need be.

        >>> make_layout(rows=4, cols=4, modulation="antipodal", pilots=4).to_dict()["pilots"]
        4
        """
        described: dict[str, Any] = {
            "rows": self.rows,
            "cols": self.cols,
            "width": self.width,
            "height": self.height,
            "ratex": [list(cell) for cell in self.ratex],
        }
        if self.modulation != "on_off":
            described["modulation"] = self.modulation
        if self.pilots:
            described["pilots"] = self.pilots
        if self.code != PLAIN:
            described["code"] = self.code.to_dict()
        return described

    @classmethod
    def from_dict(cls, data: Any) -> "Layout":
        """Make a layout from what `to_dict` wrote.

        Raises:
            InputError: a key is missing, unknown or of the wrong type.
        """
        keys = [field.name for field in fields(cls)]
        if not isinstance(data, dict) or not set(keys[:5]) <= set(data) <= set(keys):
            raise InputError(
                f"layout: need the keys {', '.join(keys[:5])}, and perhaps "
                f"{', '.join(keys[5:-1])} and {keys[-1]}, got {data!r:.200}"
            )
        for key in (*keys[:4], "pilots"):
            if key in data and type(data[key]) is not int:
                raise InputError(f"layout: {key} must be a whole number, got {data[key]!r:.60}")
        if not isinstance(data.get("modulation", ""), str):
            raise InputError(f"layout: modulation must be text, got {data['modulation']!r:.60}")
        try:
            cells = tuple((row, col) for row, col in data["ratex"])
        except (TypeError, ValueError):
            cells = ((None, None),)
        if not all(type(number) is int for cell in cells for number in cell):
            raise InputError(
                f"layout: ratex must be a list of whole [row, col], got {data['ratex']!r:.100}"
            )
        code = PilotCode.from_dict(data["code"]) if "code" in data else PLAIN
        return cls(**{**data, "ratex": cells, "code": code})


def count_pilots(pilots: str, rows: int, cols: int, code: PilotCode = PLAIN) -> int:
    """Work out the number of pilots that a command's ``--pilots`` asks for.

    Args:
        pilots: "auto", or a share of the blocks from 0 to below 1; 0 gives none.
        rows: number of blocks from top to bottom.
        cols: number of blocks from left to right.
        code: code of the order of the two states of frame pairs.

    Raises:
        ParameterError: ``pilots`` is no such share, or gives a single pilot or none.

    >>> [count_pilots(pilots, 24, 32) for pilots in ("0", "auto", "0.1")]
    [0, 38, 77]
    """
    blocks = rows * cols
    if pilots == "auto":
        few = min(LEAST_PILOTS, round(MOST_PILOT_SHARE * blocks))
        return max(few, round((PILOT_SHARE if code == PLAIN else CODED_PILOT_SHARE) * blocks))
    try:
        share = float(pilots)
    except ValueError:
        share = -1.0
    if not 0 <= share < 1:
        problem = f"need auto, or a share from 0 to below 1, got {pilots!r:.60}"
        raise ParameterError("pilots", problem)
    if share > 0 and round(share * blocks) < 2:
        problem = f"{share:g} of {cols}x{rows} blocks is less than 2 pilots; give a larger share"
        raise ParameterError("pilots", problem)
    return round(share * blocks)


def make_layout(
    rows: int = 8,
    cols: int = 8,
    width: int = 512,
    height: int = 384,
    ratex: int | None = None,
    modulation: str = "on_off",
    pilots: int | str = 0,
    code: PilotCode = PLAIN,
) -> Layout:
    """Make the usual layout: pilots, or ratex patches in the corners and the centre.

    Two patches lie on a diagonal; one is the top-left corner, where it disturbs least.

    Args:
        rows: number of blocks from top to bottom.
        cols: number of blocks from left to right.
        width: width of the displayed frame, pixels.
        height: height of the displayed frame, pixels.
        ratex: number of ratex patches: 0, 1, 2, 3 or 5; by default 5, or 0 beside pilots.
        modulation: a key of `MODULATIONS`.
        pilots: number of blocks that carry known bits, or text for `count_pilots`, such as "auto".
        code: changes the order of the two states of frame pairs; there is none without pilots.

    Raises:
        InputError: ``ratex`` is another number, or the layout is impossible (`Layout`).

    >>> layout = make_layout()
    >>> (layout.n_bits, layout.ratex)
    (59, ((0, 0), (7, 7), (0, 7), (7, 0), (4, 4)))
    """
    at_least(1, rows=rows, cols=cols)
    if isinstance(pilots, str):
        pilots = count_pilots(pilots, rows, cols, code)
    if ratex is None:
        ratex = 0 if pilots else 5
    bottom, right = rows - 1, cols - 1
    cells = ((0, 0), (bottom, right), (0, right), (bottom, 0), (rows // 2, cols // 2))
    if ratex not in (0, 1, 2, 3, 5):
        raise ParameterError("ratex", f"choose 0, 1, 2, 3 or 5 patches, got {ratex}")
    if len(set(cells[:ratex])) < ratex:
        raise ParameterError("ratex", f"a {cols}x{rows} grid has no room for {ratex} patches")
    return Layout(
        rows,
        cols,
        width,
        height,
        cells[:ratex],
        modulation,
        pilots,
        code if pilots else PLAIN,
    )


def read_layout(file: Path) -> Layout:
    """Read a layout from a JSON file, as `Layout.to_dict` describes it, or under its key "layout".

    So a `sent.json` of `sender` is a layout, too.

    Raises:
        InputError: the file cannot be read, or holds no layout.
    """
    try:
        data = read_json(file)
        within = isinstance(data, dict) and isinstance(data.get("layout"), dict)
        return Layout.from_dict(data["layout"] if within else data)
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


def block_grid(layout: Layout) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Index an array of blocks so that each pixel of a layout gets its block's value.

    Returns:
        (height, 1) rows and (width,) columns of blocks: ``blocks[block_grid(layout)]`` has the
        layout's height and width, for (rows, cols, ...) ``blocks``.
    """
    rows = block_index(layout.height, layout.rows)[:, None]
    return rows, block_index(layout.width, layout.cols)


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
