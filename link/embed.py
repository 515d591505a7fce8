"""Hide bits in a picture: the original and the embedded frame (paper, § Message Structure).

The display shows the two frames in turn. With the paper's modulation "on_off", a block of the
embedded frame is ``kappa`` gray levels brighter than in the original frame where its bit is 1, and
equal where its bit is 0. With "antipodal" it is ``kappa`` brighter where its bit is 1 and ``kappa``
darker where its bit is 0, and both frames lie around the picture, which is their mean over time.

Red, green and blue change alike. What is no whole number of gray levels is dithered over the pixels
(`split_change`), and from frame pair to frame pair, so that the mean over time of antipodal frames
is the picture in every pixel.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from link.errors import InputError, ParameterError
from link.frames import Displayed
from link.layout import Layout, block_grid
from link.ratex import draw_patches
from link.strength import FACTORS
from link.types import Image

MAX_KAPPA = 64
"""Largest number of gray levels that may be added."""
BOTTOM, TOP = 16, 245
"""Darkest and brightest level of a picture that carries the paper's modulation; outside them a
message would vanish. Displays may clip the top 4 % of grays (a Samsung SyncMaster 2494 at high
contrast does). At black, kappa is worth a twentieth of what it is at 16, while 16 emits just 0.2 %
of white, about an LCD's black."""

BLACK = 5
"""Levels to which the knee of antipodal pictures lifts black, times kappa; at most `BOTTOM`. With a
kappa of 1 that is about 0.9 CIEDE2000, and a change gives a quarter of the light that it gives over
`BOTTOM`, where over level 1 it gives a thirtieth. A larger kappa is seen anyway."""
WHITE = 5
"""Levels by which the knee lowers white, times kappa less 1; at most to `TOP`."""
BEFORE = {"on_off": 0.0, "antipodal": 0.5}
"""Share of a block's change by which the original frame lies below the picture, by the name of the
modulation; the embedded frame lies above the picture by the rest."""
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
    picture: NDArray[np.uint8],
    kappa: int,
    modulation: str = "on_off",
    levels: NDArray[np.floating] | None = None,
) -> NDArray[np.uint8]:
    """Change a picture so that no change of its blocks leads out of the levels of a display.

    With "on_off" all levels are scaled to those from which kappa leads to none outside
    [BOTTOM, TOP]. With "antipodal" a soft knee bends the ends alone: let m be half the change,
    rounded up; a level v below 2 m becomes m + v² / 4 m, levels near white likewise, and all others
    stay as they are. Near black, where displays emit next to nothing, m is at least `BLACK` κ; near
    white, where some displays clip, at least `WHITE` (κ - 1).

    Args:
        picture: (height, width) or (height, width, 3) uint8, encoded.
        kappa: gray levels by which blocks will change, at least.
        modulation: a key of `link.layout.MODULATIONS`.
        levels: (height, width) by which each pixel's block will change, which "antipodal" alone
            allows; None where all change by ``kappa``.

    Returns:
        uint8 of the same shape.

    >>> with_head_room(np.array([[0, 2, 128, 255]], np.uint8), 3, "antipodal").tolist()
    [[15, 15, 128, 245]]
    """
    if modulation == "on_off":
        scaled = np.linspace(BOTTOM, TOP - kappa, 256).round().astype(np.uint8)
        return scaled[picture]
    room = np.ceil(np.asarray(kappa if levels is None else levels) / 2).astype(np.intp)
    black, white = min(BOTTOM, BLACK * kappa), min(255 - TOP, WHITE * (kappa - 1))
    knees = np.stack([_knee(max(m, black), max(m, white)) for m in range(int(room.max()) + 1)])
    wide = room[..., None] if room.ndim and picture.ndim == 3 else room
    return np.asarray(knees[wide, picture])


def _knee(black: int, white: int) -> NDArray[np.uint8]:
    """Array (256,) of levels that keep distances, up to 64 levels, from black and from white."""
    levels = np.arange(128)
    dark, bright = (
        np.where(levels < 2 * m, m + levels**2 / (4 * max(m, 1)), levels).round().astype(np.uint8)
        for m in (black, white)
    )
    return np.concatenate([dark, 255 - bright[::-1]])


def block_changes(bits: ArrayLike, layout: Layout) -> NDArray[np.float32]:
    """Work out by which share of kappa each block changes between the two frames.

    Args:
        bits: (n_bits,) 0 or 1.
        layout: the grid; its pilots get their known bits, its ratex cells 0.

    Returns:
        (rows, cols) float32, the shares of `Layout.change_of_bits`.

    Raises:
        InputError: wrong number or values of bits.
    """
    values = np.asarray(bits)
    if values.shape != (layout.n_bits,) or not np.isin(values, (0, 1)).all():
        raise InputError(f"message: need {layout.n_bits} bits of 0 or 1, got {values.shape}")
    low, high = layout.change_of_bits
    grid = np.zeros((layout.rows, layout.cols), np.float32)
    grid[layout.message_mask] = np.where(values, high, low)
    grid.reshape(-1)[layout.pilot_blocks] = np.where(layout.pilot_bits, high, low)
    return grid


def split_change(
    change: NDArray[np.float64], before: float, turned: bool = False
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Split the change of every pixel into whole levels below and above the picture.

    What is no whole level is dithered: within each 4 x 4 pixels of one change, the mean of either
    part is right to 1/32 level. Both parts round at opposite thresholds, so that halves are equal
    on average, and that a whole change stays as it is in every pixel. Of an odd change, half of the
    pixels, like the white fields of a chessboard, take the larger part above the picture and the
    others below it. The opposite change gives the same parts in the other order. With turned
    thresholds those that are equal halves change places, so that the mean of both is the picture.

    Args:
        change: (height, width, ...) levels, embedded minus original frame, not always whole.
        before: share of the change that lies below the picture, 0 or 0.5.
        turned: whether to take the opposite threshold at each pixel.

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
    tiled = 1 - tiled if turned else tiled
    threshold = tiled.reshape(height, width, *[1] * (change.ndim - 2))
    below = np.floor(before * change + threshold)
    above = np.floor((1 - before) * change + (1 - threshold))
    return below.astype(np.intp), above.astype(np.intp)


def levels_by_step(kappa: int) -> NDArray[np.float64]:
    """Array (steps,) of the gray levels, at most `MAX_KAPPA`, by which blocks of a step change.

    Args:
        kappa: gray levels of step 0.
    """
    return np.minimum(kappa * FACTORS, MAX_KAPPA)


def levels_of_steps(
    kappa: int, steps: NDArray[np.uint8] | None, layout: Layout
) -> NDArray[np.float64] | None:
    """Turn steps of strength into gray levels by which each pixel's block changes.

    Args:
        kappa: gray levels of step 0.
        steps: (rows, cols) as `link.strength.block_steps` returns them; None for ``kappa`` alone.
        layout: grid of the blocks.

    Returns:
        (height, width) levels of at most `MAX_KAPPA`, or None where there are no steps.
    """
    return None if steps is None else levels_by_step(kappa)[steps][block_grid(layout)]


def embed(
    picture: Image,
    bits: ArrayLike,
    layout: Layout,
    kappa: int,
    *,
    steps: NDArray[np.uint8] | None = None,
    turned: bool = False,
) -> Displayed:
    """Hide one frame's bits in a picture.

    Args:
        picture: an `Image`, of the layout's size.
        bits: (n_bits,) 0 or 1, row-major over the message cells.
        layout: the grid and its ratex patches, which replace the picture there.
        kappa: gray levels by which blocks, and ratex tiles of label 1, change.
        steps: (rows, cols) steps of strength, as `link.strength.block_steps` chooses them for
            "antipodal" blocks; None where all blocks change by ``kappa``.
        turned: whether the dither takes its opposite thresholds, as in every second frame pair.

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
    levels = levels_of_steps(kappa, steps, layout)
    shown = with_head_room(picture, kappa, layout.modulation, levels)
    shares = block_changes(bits, layout).astype(np.float64)[block_grid(layout)]
    change = shares * (kappa if levels is None else levels)
    if picture.ndim == 3:
        change = change[:, :, None]
    below, above = split_change(change, BEFORE[layout.modulation], turned)
    original, embedded = (
        np.add(shown, part, dtype=np.int16, casting="unsafe").astype(np.uint8)
        for part in (-below, above)
    )
    draw_patches(original, layout, kappa, embedded=False)
    draw_patches(embedded, layout, kappa, embedded=True)
    return Displayed(original, embedded, np.asarray(bits, np.intp), layout, kappa)
