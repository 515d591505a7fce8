"""Put display states together from rectified camera frames."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import groupby, pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from link.clock import DisplayClock
from link.types import Array, Image
from receiver.seen import MESH, PLACES, SeenFrame

PURE = 0.97
"""Smallest share of an exposure in one state at which a pixel counts as pure."""
APART = 4.0
"""Smallest distance of the toggles' two levels, in standard deviations, at which images without a
clock are told apart by their toggles."""


@dataclass(frozen=True)
class DisplayState:
    """One state of the display, an original or an embedded frame, as camera frames show it."""

    image: Image
    """An `Image`, rectified."""
    purity: NDArray[np.float64]
    """(MESH, MESH) largest share of an exposure that fell into this state, in [0, 1]."""
    frames: int
    """Number of camera frames that were averaged."""


def compose_state(
    frames: Iterable[SeenFrame], clock: DisplayClock, number: int
) -> DisplayState | None:
    """Average what camera frames hold of one state.

    Each point of the display takes the frames whose exposure there is pure; where none is, it takes
    the purest. A frame holds nothing of a point outside it.

    Args:
        frames: frames in any order.
        clock: says when the display shows which state.
        number: number of the state.

    Returns:
        the state, or None where no frame holds any of it.
    """
    near = [
        frame
        for frame in frames
        if clock.number(frame.time + clock.latest) > number
        and clock.number(frame.time + clock.earliest) < number + 1
    ]
    shares = [
        clock.shares(frame.time, PLACES, number).reshape(MESH, MESH)  # (MESH MESH,) -> (MESH, MESH)
        * (1 if frame.in_view is None else frame.in_view)
        for frame in near
    ]
    used = [(frame, share) for frame, share in zip(near, shares, strict=True) if share.max() > 0]
    if not used:
        return None
    purity = np.max([share for _, share in used], axis=0)
    pure = [frame for frame, share in used if share.min() >= PURE]
    if pure:
        images = [frame.rectified for frame in pure]
        return DisplayState(_mean(images), purity, len(images))
    limit = np.minimum(purity, PURE) - 1e-6
    height, width = used[0][0].rectified.shape[:2]
    total = np.zeros(used[0][0].rectified.shape, np.float32)
    weights = np.zeros((height, width), np.float32)
    for frame, share in used:
        chosen = share >= limit
        if not chosen.any():
            continue
        # points count as far as those beside them; states often are put together from bands of rows
        points = np.flatnonzero(chosen.any(axis=1))
        first, last = (points[0] - 0.5) * height / MESH, (points[-1] + 1.5) * height / MESH
        rows = slice(max(0, int(first) - 1), min(height, int(np.ceil(last)) + 1))
        mesh = chosen.astype(np.float32)
        weight = cv2.resize(mesh, (width, height), interpolation=cv2.INTER_LINEAR)[rows]
        pixels = frame.rectified[rows]
        total[rows] += cv2.multiply(pixels, _like(pixels, weight), dtype=cv2.CV_32F)
        weights[rows] += weight
    total /= _like(total, np.maximum(weights, 1e-3, out=weights))
    total += 0.5
    return DisplayState(total.astype(np.uint8), purity, len(used))


def split_by_level(
    frames: Sequence[SeenFrame], levels: Array
) -> list[tuple[list[SeenFrame], list[SeenFrame]]]:
    """Find the frame pairs in frames of one state each, which ends where the level changes.

    Args:
        frames: frames in order.
        levels: (n,) toggles of the frames, high in embedded frames, gray levels.

    Returns:
        frames of the original and of the embedded state of each pair, in order; nothing where the
        levels do not clearly lie about two levels.
    """
    high = levels > (levels.max() + levels.min()) / 2
    if not high.any():  # all have one level
        return []
    spread = max(levels[high].std(), levels[~high].std(), 1e-6)
    if levels[high].mean() - levels[~high].mean() < APART * spread:
        return []
    runs = groupby(zip(high, frames, strict=True), key=lambda each: bool(each[0]))
    states = [(is_high, [frame for _, frame in run]) for is_high, run in runs]
    return [(low, up) for (is_high, low), (_, up) in pairwise(states) if not is_high]


def mean_state(frames: Sequence[SeenFrame]) -> DisplayState:
    """Average frames of one state, all of them pure."""
    mean = np.stack([frame.rectified for frame in frames]).mean(axis=0)
    return DisplayState(np.asarray(mean + 0.5, np.uint8), np.ones((MESH, MESH)), len(frames))


def _like(image: NDArray[np.generic], weights: NDArray[np.float32]) -> NDArray[np.float32]:
    """Give (height, width) weights the channels of an image; numpy would spread them slowly."""
    return weights if image.ndim == 2 else np.asarray(cv2.merge([weights] * image.shape[2]))


def _mean(images: list[NDArray[np.uint8]]) -> NDArray[np.uint8]:
    if len(images) == 1:
        return images[0]
    total = images[0].astype(np.float32)
    for image in images[1:]:
        cv2.accumulate(image, total)
    return np.asarray(cv2.convertScaleAbs(total, alpha=1 / len(images)), np.uint8)


def block_purity(purity: NDArray[np.float64], blocks: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Average the purity of a state over blocks.

    Args:
        purity: (MESH, MESH) in [0, 1].
        blocks: (rows, cols) which blocks are asked for.

    Returns:
        (n,) in [0, 1].
    """
    rows, cols = blocks.shape
    return np.asarray(cv2.resize(purity, (cols, rows), interpolation=cv2.INTER_AREA)[blocks])
