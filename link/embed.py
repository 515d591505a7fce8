"""Hide bits in a picture: the original and the embedded frame (paper, § Message Structure).

The display shows the two frames in turn. With the paper's modulation "on_off", a block of the
embedded frame is ``kappa`` gray levels brighter than in the original frame where its bit is 1, and
equal where its bit is 0. With "antipodal" it is ``kappa`` brighter where its bit is 1 and ``kappa``
darker where its bit is 0, and both frames lie around the picture, which is their mean over time.

Blocks change along the layout's colour direction: all channels alike, or red against green. What is
no whole number of gray levels is dithered over the pixels (`split_change`).
"""

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from link.errors import InputError, ParameterError
from link.frames import Displayed
from link.layout import COLOURS, MODULATIONS, Layout, block_index
from link.ratex import draw_patches
from link.types import Image

MAX_KAPPA = 64
"""Largest number of gray levels that may be added."""
BOTTOM, TOP = 16, 245
"""Darkest and brightest level of an embedded picture; outside them a message would vanish. Displays
may clip the top 4 % of grays (a Samsung SyncMaster 2494 at high contrast does). At black, kappa is
worth a twentieth of what it is at 16, while 16 emits just 0.2 % of white, about an LCD's black."""

BEFORE = {"on_off": 0.0, "antipodal": 0.5}
"""By the name of a modulation the share of a block's change by which the original frame lies below
the picture; the embedded frame lies above the picture by the rest."""
THRESHOLDS = np.array([[0, 8, 2, 10], [12, 4, 14, 6], [3, 11, 1, 9], [15, 7, 13, 5]]) / 16 + 1 / 32
"""Thresholds in (0, 1) of an ordered dither over each 4 x 4 pixels (Bayer, "An optimum method for
two-level rendition of continuous-tone pictures", IEEE ICC 1973). The upper half of them lies on the
black fields of a chessboard."""


def check_kappa(kappa: int, name: str = "kappa") -> int:
    """Check the number of gray levels that are added where a bit is 1.

    Args:
        kappa: a whole number from 1 to `MAX_KAPPA`, of any numeric type.
        name: the parameter that the error names, or the flag of a command.

    Returns:
        ``kappa`` as an int.

    Raises:
        ParameterError: ``kappa`` is no whole number in range.
    """
    if not 1 <= kappa <= MAX_KAPPA or int(kappa) != kappa:
        raise ParameterError(name, f"need 1 to {MAX_KAPPA} whole gray levels, got {kappa}")
    return int(kappa)


def with_head_room(
    picture: NDArray[np.uint8], kappa: int, modulation: str = "on_off", colour: str = "gray"
) -> NDArray[np.uint8]:
    """Scale a picture from [0, 255] to levels from which kappa leads to none outside [BOTTOM, TOP].

    All channels get the room that the one with the largest change needs, so that grays stay gray.

    Args:
        picture: uint8 of any shape, encoded.
        kappa: gray levels by which blocks will change.
        modulation: "on_off" needs room for kappa above the picture, "antipodal" for half of it on
            either side; a key of `link.layout.MODULATIONS`.
        colour: key of `link.layout.COLOURS`; where it darkens a channel, that needs room as well.

    Returns:
        uint8 of the same shape.
    """
    changes = kappa * np.outer(MODULATIONS[modulation], COLOURS[colour])
    before = BEFORE[modulation]
    offsets = np.array([0 * changes, -before * changes, (1 - before) * changes])
    below, above = (int(np.ceil(offset)) for offset in (-offsets.min(), offsets.max()))
    levels = np.linspace(BOTTOM + below, TOP - above, 256).round().astype(np.uint8)
    return levels[picture]


def message_mask(bits: ArrayLike, layout: Layout, pyramid_level: int = 0) -> NDArray[np.float32]:
    """Work out by which share of kappa each pixel changes between the two frames.

    Adding kappa at level L of a Laplacian pyramid and collapsing it is, since both are linear, the
    same as adding kappa times the block mask reduced L times and expanded L times (Burt & Adelson).

    Args:
        bits: (n_bits,) 0 or 1.
        layout: the grid; its pilots get their known bits, its ratex cells 0.
        pyramid_level: 0 for plain blocks; L blurs block edges over about 2**L pixels.

    Returns:
        (height, width) float32 in [0, 1], or in [-1, 1] where the modulation is "antipodal".

    Raises:
        InputError: wrong number or values of bits, or a level too coarse for the blocks.
    """
    values = np.asarray(bits)
    if values.shape != (layout.n_bits,) or not np.isin(values, (0, 1)).all():
        raise InputError(f"message: need {layout.n_bits} bits of 0 or 1, got {values.shape}")
    block_px = min(layout.width // layout.cols, layout.height // layout.rows)
    if not 0 <= pyramid_level < (block_px // 4).bit_length():  # 2**pyramid_level <= block_px // 4
        raise ParameterError(
            "pyramid_level",
            f"{pyramid_level} does not fit blocks of {block_px} pixels; "
            f"2**level may be at most a quarter of the block",
        )
    low, high = layout.change_of_bits
    grid = np.zeros((layout.rows, layout.cols), np.float32)
    grid[layout.message_mask] = np.where(values, high, low)
    grid.reshape(-1)[layout.pilot_blocks] = np.where(layout.pilot_bits, high, low)
    mask = grid[
        block_index(layout.height, layout.rows)[:, None], block_index(layout.width, layout.cols)
    ]
    sizes = []
    for _ in range(pyramid_level):
        sizes.append(mask.shape[::-1])
        mask = cv2.pyrDown(mask, borderType=cv2.BORDER_REPLICATE)
    for size in reversed(sizes):
        mask = cv2.pyrUp(mask, dstsize=size)
    for row, col in layout.ratex:
        top, bottom, left, right = layout.cell_box(row, col)
        mask[top:bottom, left:right] = 0
    return np.asarray(np.clip(mask, low, high), np.float32)


def split_change(
    change: NDArray[np.float64], before: float
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Split the change of every pixel into whole levels below and above the picture.

    What is no whole level is dithered: within each 4 x 4 pixels of one change, the mean of either
    part is right to 1/32 level. Both parts round at opposite thresholds, so that halves are equal
    on average, and that a whole change stays as it is in every pixel. Of an odd change, half of the
    pixels, like the white fields of a chessboard, take the larger part above the picture and the
    others below it. The opposite change gives the same parts in the other order.

    Args:
        change: (height, width, ...) levels, embedded minus original frame, not always whole.
        before: share of the change that lies below the picture, 0 or 0.5.

    Returns:
        below: whole levels by which the original frame lies below the picture, as ``change``.
        above: whole levels by which the embedded frame lies above the picture, as ``change``.

    >>> below, above = split_change(np.array([[3, 3], [-1, 2]]), 0.5)
    >>> below
    array([[1, 2],
           [0, 1]])
    >>> above
    array([[ 2,  1],
           [-1,  1]])
    """
    height, width = change.shape[:2]
    tiled = np.tile(THRESHOLDS, (-(-height // 4), -(-width // 4)))[:height, :width]
    threshold = tiled.reshape(height, width, *[1] * (change.ndim - 2))
    below = np.floor(before * change + threshold)
    above = np.floor((1 - before) * change + (1 - threshold))
    return below.astype(np.intp), above.astype(np.intp)


def embed(
    picture: Image,
    bits: ArrayLike,
    layout: Layout,
    kappa: int,
    pyramid_level: int = 0,
    ratex_kappa: int | None = None,
) -> Displayed:
    """Hide one frame's bits in a picture.

    Args:
        picture: an `Image`, of the layout's size.
        bits: (n_bits,) 0 or 1, row-major over the message cells.
        layout: the grid and its ratex patches, which replace the picture there.
        kappa: gray levels by which blocks change, times the layout's direction in each channel.
        pyramid_level: 0 for blocks with hard edges; L blurs the edges over about 2**L pixels.
        ratex_kappa: gray levels added in ratex tiles of label 1; by default ``kappa``.

    Returns:
        the frame pair, each frame uint8 of the picture's shape.

    Raises:
        InputError: kappa, the bits or the picture's size do not fit, or the layout's colour needs
            three channels and the picture has one.

    >>> from link.layout import make_layout
    >>> layout = make_layout(rows=4, cols=4, width=64, height=48, ratex=2)
    >>> gray = np.full((48, 64), 128, np.uint8)
    >>> pair = embed(gray, [1] * layout.n_bits, layout, kappa=3)
    >>> top, bottom, left, right = layout.cell_box(0, 1)  # the first block that carries a bit
    >>> np.unique(pair.embedded[top:bottom, left:right] - pair.original[top:bottom, left:right])
    array([3], dtype=uint8)
    """
    kappa = check_kappa(kappa)
    if picture.shape[:2] != (layout.height, layout.width):
        raise InputError(
            f"picture is {picture.shape[1]}x{picture.shape[0]}, "
            f"the layout needs {layout.width}x{layout.height}"
        )
    if picture.ndim == 2 and layout.colour != "gray":
        raise InputError(
            f"picture has one channel, colour {layout.colour!r} needs three; give an RGB picture"
        )
    shown = with_head_room(picture, kappa, layout.modulation, layout.colour)
    change = (kappa * message_mask(bits, layout, pyramid_level)).round().astype(np.float64)
    if picture.ndim == 3:
        change = change[:, :, None] * ((1.0,) if layout.colour == "gray" else layout.direction)
    below, above = split_change(change, BEFORE[layout.modulation])
    original, embedded = ((shown + part).astype(np.uint8) for part in (-below, above))
    toggle = kappa if ratex_kappa is None else check_kappa(ratex_kappa, "ratex_kappa")
    draw_patches(original, layout, toggle, embedded=False)
    draw_patches(embedded, layout, toggle, embedded=True)
    return Displayed(original, embedded, np.asarray(bits, np.intp), layout, kappa, ratex_kappa)
