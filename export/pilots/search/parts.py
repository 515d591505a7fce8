"""Move the corners of a display so that its blocks lie where the grid says they lie.

What toggles in the rectified image is compared with what should toggle: pilots whose signs are
known. Corners may be off by blocks: parts of the display are shifted by themselves, and a transform
is fitted to their shifts (`coarse_shift`). Where corners are off by less than a block, the whole
display is fitted at once (`export.pilots.search.all_blocks`).
"""

from collections.abc import Sequence
from itertools import pairwise, product
from math import ceil

import cv2
import numpy as np
from numpy.typing import NDArray

from export.pilots.motion import without_slope
from export.pilots.toggling import CodedToggling, TogglePattern, code_search, over_deviation
from link.layout import Layout
from link.types import Array, Map

PARTS = ((4, 6), (2, 3), (1, 1))
"""Numbers of parts, from top to bottom and from left to right, that are shifted by themselves.
Small parts tell more of the shape; large ones stand out of more noise, and are tried next."""
COARSE_SIZE = (256, 192)
"""Width and height of the maps in which parts are shifted."""
ROUGH_PX = 2
"""Side of a block, in pixels, of the maps in which clocks and shifts are tried together."""
REACH_BLOCKS, REACH_SHARE = 3.0, 0.1
"""Largest shift of a part that is looked for, in blocks, or as a share of the display's width, if
that is more."""
CLEAR = 20.0
"""Height of a part's best match, as a multiple of the mean of its other matches, from which on it
is believed; chance exceeds it once in some hundred thousand parts."""
HALF_REAL = 0.2275
"""Half the median of a squared normal variable: of squared real matches, a median more is so many
times rarer, as a power of e."""
FEW, MANY = 4, 10
"""Number of clear parts from which on an affine transform is fitted, and a homography."""
SAME_BLOCKS = 0.6
"""Distance, in blocks, within which parts' shifts agree with a transform."""


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
    expected = _drawn(blocks, (width, height))
    reach = _reach(width, block, far=far)
    around = [_bordered(part, block, reach) for part in (change.real, change.imag)]
    for parts in PARTS:
        fit = _shift_of_parts(around, expected, layout, parts, reach)
        if fit is not None:
            return fit
    return None


def _shift_of_parts(
    around: Sequence[Map], expected: Map, layout: Layout, parts: tuple[int, int], reach: list[int]
) -> tuple[Array, int] | None:
    """Shift each of some parts by itself, and fit a transform to the shifts.

    Args:
        around: real and imaginary amplitude, with a border of ``reach`` on all sides.
        expected: (h, w) expected changes.
        layout: layout of the display.
        parts: their number from top to bottom, and from left to right.
        reach: largest shift along x and y, pixels of the maps.

    Returns:
        as `coarse_shift`.
    """
    height, width = expected.shape
    reach_x, reach_y = reach
    scale = np.array([layout.width / width, layout.height / height])
    same = SAME_BLOCKS * min(layout.width / layout.cols, layout.height / layout.rows)
    # of the matches that chance makes, so many medians are one e-th as frequent as the median
    unit = np.log(2) if around[1].any() else HALF_REAL
    ys = np.linspace(0, height, parts[0] + 1).astype(int)
    xs = np.linspace(0, width, parts[1] + 1).astype(int)
    places, seen, heights = [], [], []
    for top, bottom in pairwise(ys):
        for left, right in pairwise(xs):
            match = np.zeros(1, np.float32)
            for part in around:
                window = part[top : bottom + 2 * reach_y, left : right + 2 * reach_x]
                found = cv2.matchTemplate(window, expected[top:bottom, left:right], cv2.TM_CCORR)
                match = match + found**2
            y, x = np.unravel_index(int(match.argmax()), match.shape)
            heights.append(unit * float(match[y, x]) / (float(np.median(match)) + 1e-12))
            place = np.array([(left + right - 1) / 2, (top + bottom - 1) / 2])
            shift = [
                x - reach_x + _peak(match[y], int(x)),
                y - reach_y + _peak(match[:, x], int(y)),
            ]
            places.append((place + 0.5) * scale - 0.5)
            seen.append((place + shift + 0.5) * scale - 0.5)
    clear = np.array(heights) > CLEAR
    old, new = np.array(seen)[clear], np.array(places)[clear]
    count = len(old)
    if count and (count < FEW or len(heights) == 1):
        best = int(np.argmax(np.array(heights)[clear]))
        agree = (np.linalg.norm((old - new) - (old - new)[best], axis=1) < same).sum()
        if len(heights) > 1 and agree < 2:
            return None
        H = np.eye(3)
        H[:2, 2] = old[best] - new[best]
        return H, int(agree)
    if count == 0:
        return None
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


def shifted_togglings(
    views: Map, blocks: NDArray[np.floating], layout: Layout, at: Sequence[float], fps: float
) -> list[TogglePattern]:
    """Find how a coded display may toggle of which it is not known where it lies.

    What a frame shows at each shift of the display, less the mean of all frames, is compared with
    the expected changes. Only then are the clocks tried, all at once. The display may lie shifted
    as a whole, or its parts each by itself.

    Args:
        views: (T, h, w) maps of the display, such as `COARSE_SIZE`.
        blocks: (rows, cols) expected change of each block, 0 where it is not known.
        layout: layout of the display.
        at: (T,) positions of the frames.
        fps: nominal number of frames of the camera in a second.
    """
    width, height = size = ROUGH_PX * layout.cols, ROUGH_PX * layout.rows
    block = np.full(2, float(ROUGH_PX))
    right, down = reach = _reach(width, block, far=True)
    expected = _drawn(blocks, size)
    rough = [cv2.resize(view, size, interpolation=cv2.INTER_AREA) for view in views]
    around = [_bordered(view, block, reach) for view in over_deviation(np.array(rough))]
    search = code_search(layout, layout.code, tuple(at), fps)
    found: list[TogglePattern] = []
    for rows, cols in PARTS[1:]:
        ys, xs = (np.linspace(0, s, n + 1).astype(int) for s, n in ((height, rows), (width, cols)))
        matches = []
        for (top, bottom), (left, end) in product(pairwise(ys), pairwise(xs)):
            part = expected[top:bottom, left:end]
            windows = [each[top : bottom + 2 * down, left : end + 2 * right] for each in around]
            seen = [cv2.matchTemplate(each, part, cv2.TM_CCORR) for each in windows]
            matches.append(np.array(seen).reshape(len(seen), -1))  # (T, y, x) -> (T, shifts)
        found.append(CodedToggling(search.highest(matches), layout.code))
    return found
