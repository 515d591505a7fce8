"""Move the corners of a display so that its blocks lie where the grid says they lie.

What toggles in the rectified image is compared with what should toggle: pilots whose signs are
known. Corners may be off by blocks: parts of the display are shifted by themselves, and a transform
is fitted to their shifts (`coarse_shift`). Where corners are off by less than a block, the whole
display is fitted at once (`receiver.pilots.search.all_blocks`).
"""

from bisect import bisect_right
from collections.abc import Sequence
from itertools import pairwise, product
from math import ceil

import cv2
import numpy as np
from numpy.typing import NDArray

from link.layout import Layout
from link.types import Array, Map
from receiver.pilots.motion import without_slope
from receiver.pilots.toggling import CodedToggling, TogglePattern, code_search, over_deviation

PARTS = ((4, 6), (2, 3), (1, 1))
"""Numbers of parts, from top to bottom and from left to right, that are shifted by themselves.
Small parts tell more of the shape; large ones stand out of more noise, and are tried next."""
COARSE_SIZE = (256, 192)
"""Width and height of the maps in which parts are shifted: four pixels a block of the preset
`hidden`, whose grid has 48 x 64 blocks."""
ROUGH_PX = 2
"""Side of a block, in pixels, of the maps in which shifts are tried of a display that may be far
off, and clocks with them. Shifts are then tried in steps of half a block. Chosen by hand."""
REACH_BLOCKS, REACH_SHARE = 3.0, 0.1
"""Largest shift of a part that is looked for, in blocks, or as a share of the display's width, if
that is more. A frame around a display makes edges so far off. Chosen by hand."""
CLEAR = 20.0
"""Height of a part's best match, as a multiple of the mean of its other matches, from which on it
is believed; chance exceeds it once in some hundred thousand parts."""
HALF_REAL = 0.2275
"""Half the median of a squared normal variable: of squared real matches, a median more is so many
times rarer, as a power of e."""
FEW, MANY = 4, 10
"""Number of clear parts from which on an affine transform is fitted, and a homography: they take
three and four, and one or six more that agree by more than chance. Chosen by hand."""
SAME_BLOCKS = 0.6
"""Distance, in blocks, within which parts' shifts agree with a transform: blocks half a block off
still match. Chosen by hand."""


def coarse_shift(
    change: NDArray[np.complex64],
    blocks: NDArray[np.floating],
    layout: Layout,
    *,
    far: bool = False,
) -> tuple[Array, int] | None:
    """Find where the parts of a display lie that toggle as they should.

    Args:
        change: (h, w), such as `COARSE_SIZE`: amplitude at one frequency of the rectified display,
            each pixel divided by its usual deviation; of any phase.
        blocks: (rows, cols) expected change of each block, 0 where it is not known.
        layout: layout of the display.
        far: whether to look farther than `REACH_BLOCKS`.

    Returns:
        H_old_from_new, and the number of parts that clearly match and agree with it; None where
        there are none.
    """
    height, width = change.shape
    block = np.array([width / layout.cols, height / layout.rows])
    reach = _reach(width, block, far=far)
    shown = (change.real, change.imag) if change.imag.any() else (change.real,)
    around = [_bordered(part, block, reach) for part in shown]
    smallest = _match_parts(around, _drawn(blocks, (width, height)), reach, PARTS[0])
    # of the matches that chance makes, so many medians are one e-th as frequent as the median
    unit = np.log(2) if len(shown) == 2 else HALF_REAL
    for parts in PARTS:
        match = (_joined(smallest, parts) ** 2).sum(axis=2)
        fit = _fit_shifts(match, unit, layout, (width, height))
        if fit is not None:
            return fit
    return None


def _match_parts(
    around: Sequence[Map], expected: Map, reach: list[int], parts: tuple[int, int]
) -> NDArray[np.float32]:
    """Match each part with what is expected of it, at every shift.

    Args:
        around: N maps, each with a border of ``reach`` on all sides.
        expected: (h, w) expected changes.
        reach: largest shift along x and y, pixels of the maps.
        parts: number of parts from top to bottom and from left to right.

    Returns:
        (rows, cols, N, y, x) of the parts.
    """
    x, y = reach
    ys, xs = _ends(expected.shape, parts)
    matches = [
        cv2.matchTemplate(
            each[top : bottom + 2 * y, left : right + 2 * x],
            expected[top:bottom, left:right],
            cv2.TM_CCORR,
        )
        for (top, bottom), (left, right) in product(pairwise(ys), pairwise(xs))
        for each in around
    ]
    return np.reshape(matches, (*parts, len(around), 2 * y + 1, 2 * x + 1))


def _match_blocks(
    around: Sequence[Map],
    blocks: NDArray[np.floating],
    reach: list[int],
    parts: tuple[int, int],
) -> NDArray[np.float32]:
    """Match each part of rough maps (`ROUGH_PX`) by its known blocks, of which there are few.

    Args:
        around: T maps, each with a border of ``reach`` on all sides.
        blocks: (rows, cols) expected change of each block, 0 where it is not known.
        reach: largest shift along x and y, pixels of the maps.
        parts: number of parts from top to bottom and from left to right.

    Returns:
        (rows, cols, T, y, x) of the parts.
    """
    x, y = (2 * each + 1 for each in reach)
    square = ROUGH_PX, ROUGH_PX
    sums = [cv2.boxFilter(each, -1, square, anchor=(0, 0), normalize=False) for each in around]
    frames_last = np.ascontiguousarray(np.moveaxis(np.array(sums), 0, -1))
    matches = np.zeros((*parts, y, x, len(around)), np.float32)
    ys, xs = _ends([ROUGH_PX * count for count in blocks.shape], parts)
    for top, left in ROUGH_PX * np.argwhere(blocks):
        match = matches[bisect_right(ys, top) - 1, bisect_right(xs, left) - 1]
        add = np.add if blocks[top // ROUGH_PX, left // ROUGH_PX] > 0 else np.subtract
        add(match, frames_last[top : top + y, left : left + x], out=match)
    return np.moveaxis(matches, -1, 2)


def _joined(smallest: NDArray[np.float32], parts: tuple[int, int]) -> NDArray[np.float32]:
    """Add up the matches of small parts to those of larger ones, whose number is given."""
    (rows, cols, *rest), (down, across) = smallest.shape, parts
    split = smallest.reshape(down, rows // down, across, cols // across, *rest)
    return np.asarray(split.sum(axis=(1, 3)))  # the rows and the columns in each larger part


def _ends(size: Sequence[int], parts: tuple[int, int]) -> list[list[int]]:
    """List where parts begin and end from top to bottom, and from left to right."""
    return [
        [number * side // count for number in range(count + 1)]
        for side, count in zip(size, parts, strict=True)
    ]


def _fit_shifts(
    match: NDArray[np.float32], unit: float, layout: Layout, size: tuple[int, int]
) -> tuple[Array, int] | None:
    """Shift each part by itself to where it matches best, and fit a transform to the shifts.

    Args:
        match: (rows, cols, y, x) how well each part matches, at every shift; not negative.
        unit: power of e by which a match of a median more is rarer.
        layout: layout of the display.
        size: width and height of the maps.

    Returns:
        as `coarse_shift`.
    """
    scale = np.array([layout.width, layout.height]) / size
    same = SAME_BLOCKS * min(layout.width / layout.cols, layout.height / layout.rows)
    parts, shifts = match.shape[:2], match.shape[2:]
    ys, xs = _ends(size[::-1], parts)
    flat = match.reshape(*parts, -1)  # (rows, cols, y, x) -> (rows, cols, shifts)
    heights = (unit * flat.max(axis=2) / (np.median(flat, axis=2) + 1e-12)).ravel()
    clear = np.flatnonzero(heights > CLEAR)
    places, seen = [], []
    for row, col in zip(*np.unravel_index(clear, parts), strict=True):
        here = match[row, col]
        y, x = (int(at) for at in np.unravel_index(int(here.argmax()), shifts))
        place = np.array([(xs[col] + xs[col + 1] - 1) / 2, (ys[row] + ys[row + 1] - 1) / 2])
        shift = [
            x - shifts[1] // 2 + _peak(here[y], x),
            y - shifts[0] // 2 + _peak(here[:, x], y),
        ]
        places.append((place + 0.5) * scale - 0.5)
        seen.append((place + shift + 0.5) * scale - 0.5)
    old, new = np.array(seen), np.array(places)
    count = len(old)
    if count == 0:
        return None
    if count < FEW or len(heights) == 1:
        best = int(np.argmax(heights[clear]))
        agree = (np.linalg.norm((old - new) - (old - new)[best], axis=1) < same).sum()
        if len(heights) > 1 and agree < 2:
            return None
        H = np.eye(3)
        H[:2, 2] = old[best] - new[best]
        return H, int(agree)
    if count < MANY:
        affine, inliers = cv2.estimateAffine2D(new, old, ransacReprojThreshold=same)
        fitted = None if affine is None else np.vstack([affine, [0, 0, 1]])
    else:
        fitted, inliers = cv2.findHomography(new, old, cv2.RANSAC, same)
    if fitted is None or inliers.sum() < FEW:
        return None
    return np.asarray(fitted), int(inliers.sum())


def _reach(width: int, block: Array, *, far: bool) -> list[int]:
    """Choose the largest shift, along x and y, in pixels of maps of a width and of blocks."""
    least = REACH_SHARE * width if far else 0.0
    return [ceil(max(REACH_BLOCKS * side, least)) for side in block]


def _bordered(image: NDArray[np.floating], block: Array, reach: list[int]) -> Map:
    """Take the slope out of an image, and put zeros around it, as far as shifts reach."""
    x, y = reach
    flat = without_slope(image, block)
    return np.asarray(cv2.copyMakeBorder(flat, y, y, x, x, cv2.BORDER_CONSTANT), np.float32)


def _drawn(blocks: NDArray[np.floating], size: tuple[int, int]) -> Map:
    """Draw the (rows, cols) expected changes of the blocks as an image of (width, height)."""
    drawn = cv2.resize(np.asarray(blocks, np.float32), size, interpolation=cv2.INTER_NEAREST)
    return np.asarray(drawn, np.float32)


def _peak(values: NDArray[np.floating], at: int) -> float:
    """Offset, within half a step, of the top of a parabola through a maximum and its neighbours."""
    if not 0 < at < len(values) - 1:
        return 0.0
    before, here, after = (float(values[at + k]) for k in (-1, 0, 1))
    bend = before - 2 * here + after
    return 0.5 * (before - after) / bend if bend < 0 else 0.0


def rough_series(views: Map, layout: Layout) -> NDArray[np.float32]:
    """Shrink maps (T, h, w) of a display to `ROUGH_PX` pixels a block, over their deviation."""
    size = ROUGH_PX * layout.cols, ROUGH_PX * layout.rows
    rough = [cv2.resize(view, size, interpolation=cv2.INTER_AREA) for view in views]
    return over_deviation(np.array(rough))


def shifted_togglings(
    series: Map, blocks: NDArray[np.floating], layout: Layout, at: Sequence[float], fps: float
) -> list[TogglePattern]:
    """Find how a coded display may toggle of which it is not known where it lies.

    What a frame shows at each shift of the display, less the mean of all frames, is compared with
    the expected changes. Only then are the clocks tried, all at once. The display may lie shifted
    as a whole, or its parts each by itself.

    Args:
        series: (T, h, w) maps of the display, such as `rough_series`.
        blocks: (rows, cols) expected change of each block, 0 where it is not known.
        layout: layout of the display.
        at: (T,) positions of the frames.
        fps: nominal number of frames of the camera in a second.
    """
    height, width = series.shape[1:]
    block = np.array([width / layout.cols, height / layout.rows])
    reach = _reach(width, block, far=True)
    around = [_bordered(view, block, reach) for view in series]
    smallest = _match_blocks(around, blocks, reach, PARTS[1])
    search = code_search(layout, layout.code, tuple(at), fps)
    found: list[TogglePattern] = []
    for parts in PARTS[1:]:
        matches = _joined(smallest, parts)
        shifts = matches.reshape(-1, len(around), matches[0, 0, 0].size)  # -> (parts, T, shifts)
        found.append(CodedToggling(search.highest(list(shifts)), layout.code))
    return found
