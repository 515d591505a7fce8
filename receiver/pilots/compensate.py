"""What frames show beyond what has only moved: motion compensation.

A picture that moves changes its pixels by far more than the message does. But what moves was there
in the frame before, only elsewhere. So each frame is compared with an earlier one whose parts are
moved to where they now lie. What is left is what toggles, noise, and what has come into sight. The
motion is found on a grid of points by optical flow (Lucas & Kanade 1981 on pyramids, Bouguet 2000).
"""

from collections import deque
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from link.types import Gray, Map
from receiver.pilots.stabilise import found_again

SPACING_PX = 12
"""Distance of the grid's points, in pixels: less than the width of what is compared around a point,
`receiver.pilots.stabilise.FLOW_PX`, so that all of the image is. Chosen by hand: with 8, evidence
is some 5 % larger, and the work twice as large."""
EARLIER_S = 1 / 30
"""Time, in seconds, from the earlier frame to the one that is compared with it, at least one frame:
most displays show another state by then, and most things have moved little. Chosen by hand."""
NOTHING, STEPS = 128, 4
"""Level of an image of changes where nothing is left, and number of its levels for each gray level
that is left. So 32 gray levels either way fit into 8 bits, and small views of the image, which are
rounded to its levels, keep quarters of a gray level. Chosen by hand."""

AROUND_PX = 13
"""Width and height, in pixels, of what is looked at around a pixel to tell whether motion explains
its change: as much as a point of the grid stands for. Chosen by hand."""
MOST_LEFT = 0.5
"""Largest share of the squared change of a frame that may be left where motion explains it. With
0.7, moving pictures are read slightly better, and messages in still ones begin to count as motion.
"""
NEWEST, MOST_APART = 0.3, 2.0
"""Share of each frame in a `MovingPicture`, and largest number of gray levels by which that may lie
apart from the frame. The first was chosen by hand; the second is what toggling and noise may make,
and parts that lie no farther apart are not followed, which takes less than half the time."""


class Compensator:
    """Compares frames with earlier ones whose parts are moved to where they now lie.

    Args:
        fps: number of frames in a second.

    >>> compensator, frame = Compensator(30.0), np.zeros((48, 64), np.uint8)
    >>> frame[10:30, 10:30] = np.arange(20) * 10  # what moves to the right
    >>> _ = compensator.take(frame)
    >>> changes = compensator.take(np.roll(frame, 2, axis=1))
    >>> int(changes[14:26, 16:26].max() - NOTHING) <= STEPS  # one gray level; pixels differ by 10
    True
    """

    def __init__(self, fps: float) -> None:
        self._earlier = deque[Gray](maxlen=max(1, round(EARLIER_S * fps)))

    def take(self, gray: Gray) -> Gray:
        """Take the next frame, and show what is left of it.

        Args:
            gray: (h, w) uint8, of the size of those before.

        Returns:
            (h, w) uint8: `NOTHING`, plus `STEPS` for each gray level by which a pixel is brighter
            than it was. The first frame, which nothing comes before, shows nothing.
        """
        moved = moved_onto(gray, self._earlier[0]) if self._earlier else gray
        self._earlier.append(gray)
        left = cv2.subtract(gray, moved, dtype=cv2.CV_16S)
        return np.asarray(np.clip(STEPS * left + NOTHING, 0, 255), np.uint8)


class MovingPicture:
    """Tells how much of what changes in a display has only moved: the motion of its picture.

    What is moved is not the frame before, whose message would be moved with it, but the picture:
    the mean of the frames so far, each of which is moved to where its parts lie in the next.

    >>> picture, frame = MovingPicture(), np.full((48, 64), 40, np.float32)
    >>> frame[10:30, 10:30] += np.arange(20) * 10  # what moves to the right
    >>> _ = picture.take(frame)
    >>> change = np.roll(frame, 2, axis=1) - frame
    >>> left = change - picture.take(frame + change)
    >>> bool(abs(left[14:26, 19:26]).max() <= 1), float(change[20, 20])  # gray levels
    (True, -20.0)
    """

    def __init__(self) -> None:
        self._frame: Map | None = None
        self._picture = np.zeros((0, 0), np.uint8)

    def take(self, frame: Map) -> Map:
        """Take the next frame, and tell by how much motion has changed it since the one before.

        Args:
            frame: (h, w) float32 gray levels in [0, 255], of the size of those before.

        Returns:
            (h, w) float32 gray levels; 0 where motion does not explain most of the change, and
            everywhere in the first frame.
        """
        before, self._frame = self._frame, frame
        if before is None:
            self._picture = _rounded(frame)
            return np.zeros_like(frame)
        rounded = _rounded(frame)
        followed = _points_apart(rounded, self._picture)
        moved = moved_onto(rounded, self._picture, followed).astype(np.float32)
        change, motion = frame - before, moved - self._picture
        left = _around((change - motion) ** 2)
        explained = (left < MOST_LEFT * _around(change**2)).astype(np.float32)
        apart = (1 - NEWEST) * (moved - frame)
        self._picture = _rounded(frame + np.clip(apart, -MOST_APART, MOST_APART))
        return np.asarray(_around(explained) * motion)


def _rounded(frame: Map) -> Gray:
    return np.asarray(np.clip(frame.round(), 0, 255), np.uint8)


def _around(values: Map) -> Map:
    """Average `AROUND_PX` by `AROUND_PX` pixels around each one."""
    return np.asarray(cv2.blur(values, (AROUND_PX, AROUND_PX)))


def _points_apart(gray: Gray, earlier: Gray) -> NDArray[np.bool_]:
    """Choose the grid's points around which frames differ by `MOST_APART` or more: (rows, cols)."""
    height, width = gray.shape
    apart = cv2.subtract(gray, earlier, dtype=cv2.CV_32F)
    size = _grid(width, height).shape[1::-1]
    return np.asarray(
        cv2.resize(apart * apart, size, interpolation=cv2.INTER_AREA) >= MOST_APART**2
    )


def moved_onto(gray: Gray, earlier: Gray, followed: NDArray[np.bool_] | None = None) -> Gray:
    """Move the parts of an earlier frame to where they lie in a frame; both are (h, w) uint8.

    Args:
        gray: the frame.
        earlier: the earlier one.
        followed: (rows, cols) the grid's points that are followed, as the others stand still; None
            to follow all.
    """
    height, width = gray.shape
    grid = _grid(width, height)
    followed = np.ones(grid.shape[:2], bool) if followed is None else followed
    if not followed.any():
        return earlier
    motion, points = np.zeros_like(grid), grid[followed][:, None]  # (rows, cols, 2), (n, 1, 2)
    moved, is_found = found_again(gray, earlier, points, points)
    motion[followed] = np.where(is_found[:, None], (moved - points)[:, 0], 0)
    x, y = np.moveaxis(cv2.resize(motion, (width, height)), 2, 0)
    return np.asarray(
        cv2.remap(
            earlier,
            x + np.arange(width, dtype=np.float32),
            y + np.arange(height, dtype=np.float32)[:, None],
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_REPLICATE,
        )
    )


@lru_cache(maxsize=4)
def _grid(width: int, height: int) -> NDArray[np.float32]:
    """Lay the grid's points into an image, (rows, cols, 2), x and y, so that `resize` fits them."""
    cols, rows = (max(1, round(side / SPACING_PX)) for side in (width, height))
    x = (np.arange(cols) + 0.5) * width / cols - 0.5
    y = (np.arange(rows) + 0.5) * height / rows - 0.5
    return np.stack(np.meshgrid(x, y), axis=2).astype(np.float32)
