"""Hide bits in a picture: the original and the embedded frame (paper, § Message Structure).

The display shows the two frames in turn. With the paper's modulation "on_off", a block of the
embedded frame is ``kappa`` gray levels brighter than in the original frame where its bit is 1, and
equal where its bit is 0. With "antipodal" it is ``kappa`` brighter where its bit is 1 and ``kappa``
darker where its bit is 0, and both frames lie around the picture, which is their mean over time.
"""

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from link.errors import InputError, ParameterError
from link.frames import Displayed
from link.layout import Layout, block_index
from link.ratex import draw_patches

MAX_KAPPA = 64
"""Largest number of gray levels that may be added."""
BOTTOM, TOP = 16, 245
"""Darkest and brightest level of an embedded picture; outside them a message would vanish. Displays
may clip the top 4 % of grays (a Samsung SyncMaster 2494 at high contrast does). At black, kappa is
worth a twentieth of what it is at 16, while 16 emits just 0.2 % of white, about an LCD's black."""


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
    picture: NDArray[np.uint8], kappa: int, modulation: str = "on_off"
) -> NDArray[np.uint8]:
    """Scale a picture from [0, 255] to levels from which kappa leads to none outside [BOTTOM, TOP].

    Args:
        picture: uint8 of any shape, encoded.
        kappa: gray levels by which blocks will change.
        modulation: "on_off" needs room for kappa above the picture, "antipodal" for half of it on
            either side.

    Returns:
        uint8 of the same shape.
    """
    half = (kappa + 1) // 2
    below, above = {"on_off": (0, kappa), "antipodal": (half, half)}[modulation]
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


def split_change(change: NDArray[np.intp]) -> NDArray[np.intp]:
    """Split the change of every pixel so that the picture is the mean of the two frames.

    An odd change has no whole half. Half of the pixels, like the white fields of a chessboard, then
    take the larger part before the picture and the others after it.

    Args:
        change: (height, width) whole gray levels, embedded minus original frame.

    Returns:
        (height, width) whole gray levels by which the original frame lies below the picture.

    >>> split_change(np.array([[3, 3], [-1, 2]]))
    array([[1, 2],
           [0, 1]])
    """
    y, x = np.indices(change.shape)
    return np.asarray((change + (y + x) % 2) // 2)


def embed(
    picture: NDArray[np.uint8],
    bits: ArrayLike,
    layout: Layout,
    kappa: int,
    pyramid_level: int = 0,
    ratex_kappa: int | None = None,
) -> Displayed:
    """Hide one frame's bits in a picture.

    Args:
        picture: (height, width) or (height, width, 3) uint8 encoded, of the layout's size.
        bits: (n_bits,) 0 or 1, row-major over the message cells.
        layout: the grid and its ratex patches, which replace the picture there.
        kappa: gray levels by which blocks change, in every colour channel (see the modulation).
        pyramid_level: 0 for blocks with hard edges; L blurs the edges over about 2**L pixels.
        ratex_kappa: gray levels added in ratex tiles of label 1; by default ``kappa``.

    Returns:
        the frame pair, each frame uint8 of the picture's shape.

    Raises:
        InputError: kappa, the bits or the picture's size do not fit.

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
    shown = with_head_room(picture, kappa, layout.modulation)
    change = (kappa * message_mask(bits, layout, pyramid_level)).round().astype(np.intp)
    below = split_change(change) if layout.modulation == "antipodal" else np.zeros_like(change)
    if picture.ndim == 3:
        change, below = change[:, :, None], below[:, :, None]
    original = (shown - below).astype(np.uint8)
    embedded = (original + change).astype(np.uint8)
    toggle = kappa if ratex_kappa is None else check_kappa(ratex_kappa, "ratex_kappa")
    draw_patches(original, layout, toggle, embedded=False)
    draw_patches(embedded, layout, toggle, embedded=True)
    return Displayed(original, embedded, np.asarray(bits, np.intp), layout, kappa, ratex_kappa)


def display_video(
    picture: NDArray[np.uint8],
    messages: ArrayLike,
    layout: Layout,
    kappa: int,
    pyramid_level: int = 0,
) -> list[NDArray[np.uint8]]:
    """Make the paper's display video: each message as an original and then an embedded frame.

    Args:
        picture: (height, width) or (height, width, 3) uint8 encoded, of the layout's size.
        messages: (M, n_bits) 0 or 1; the paper has M = 5, hence 10 frames (§ Results).
        layout: the grid and its ratex patches.
        kappa: gray levels added where the bit is 1.
        pyramid_level: 0 for blocks with hard edges; L blurs the edges over about 2**L pixels.

    Returns:
        2 M frames, uint8 of the picture's shape.

    Raises:
        InputError: kappa, a message or the picture's size do not fit.
    """
    pairs = [embed(picture, bits, layout, kappa, pyramid_level) for bits in np.asarray(messages)]
    return [frame for pair in pairs for frame in (pair.original, pair.embedded)]
