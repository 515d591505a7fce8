"""Follow the display from frame to frame; find it again when it was lost."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from export.locate.find import locate
from link.errors import InputError
from link.geometry import (
    check_corners,
    frame_corners,
    homography_from_corners,
    rectify,
    transform,
)
from link.layout import Layout
from link.ratex import visibility

FEATURES = 160
"""Number of points that are followed, half of them on the ratex patches. At half the resolution, or
with half as many, errors are three times as large."""
MIN_INLIERS = 12
"""Smallest number of points that must move as one for the display to count as followed."""
INLIER_PX = 1.0
"""Largest distance, in pixels of the layout, of a point from where the common motion puts it."""
MIN_VISIBILITY = 0.7
"""Smallest `link.ratex.visibility` of a followed display; some patches may be covered."""
SEARCH_EVERY = 4
"""Number of frames from one search for a lost display to the next; a search takes the time of many
frames."""


@dataclass(frozen=True)
class Tracked:
    """The display in one camera frame."""

    corners: NDArray[np.float64]
    """(4, 2) pixels of the camera frame, in corner order."""
    rectified: NDArray[np.uint8]
    """(height, width) or (height, width, 3) uint8, encoded, of the layout's size."""
    visibility: float
    """Mean correlation of the ratex patches with those displayed, in [-1, 1]."""


class Tracker:
    """Follows the display by optical flow to a rectified reference, so that errors do not add up.

    The reference is the frame in which the display was found, and is taken anew where the picture
    has changed (a video): points on the ratex patches then hold the geometry.

    Args:
        layout: with at least one ratex patch.

    Raises:
        InputError: the layout has none; without them nothing tells which way up the display is.
    """

    def __init__(self, layout: Layout) -> None:
        if not layout.ratex:
            found = "pilots in place of" if layout.pilots else "no"
            raise InputError(
                f"the model's layout has {found} ratex patches; a receiver needs patches to find "
                "and follow the display"
            )
        self.layout = layout
        self.corners: NDArray[np.float64] | None = None
        self._motion = np.zeros((4, 2))
        self._reference: NDArray[np.uint8] | None = None
        self._points = np.zeros((0, 1, 2), np.float32)
        self._missed = 0

    def follow(self, image: NDArray[np.uint8]) -> Tracked | None:
        """Find the display in the next frame.

        Args:
            image: (H, W) or (H, W, 3) uint8, encoded RGB.

        Returns:
            the display, or None where it is not in view.
        """
        if self.corners is not None:
            found = self._track(image)
            if found is not None:
                return found
            self.corners, self._missed = None, 0
        self._missed += 1
        if self._missed % SEARCH_EVERY != 1:
            return None
        whole = frame_corners(image.shape[1], image.shape[0])  # a screenshot, or a rectified frame
        found = self._accept(image, whole, moved=False, fresh=True)
        if found is not None:
            return found
        located = locate(image, self.layout)
        if located is None:
            return None
        return self._accept(image, located.corners, moved=False, fresh=True)

    def _accept(
        self, image: NDArray[np.uint8], corners: NDArray[np.float64], *, moved: bool, fresh: bool
    ) -> Tracked | None:
        try:
            check_corners(corners, image.shape)
        except InputError:
            return None
        H = homography_from_corners(corners, self.layout.width, self.layout.height)
        rectified = rectify(image, H, self.layout.width, self.layout.height)
        seen = visibility(rectified, self.layout)
        if seen < MIN_VISIBILITY:
            return None
        if self.corners is not None and moved:
            self._motion = 0.5 * (corners - self.corners)
        else:
            self._motion = np.zeros((4, 2))
        self.corners = corners
        if fresh:
            self._take_reference(_equalised(rectified))
        return Tracked(corners, rectified, seen)

    def _take_reference(self, reference: NDArray[np.uint8]) -> None:
        self._reference = reference
        height, width = reference.shape
        mask = np.zeros_like(reference)
        for row, col in self.layout.ratex:
            top, bottom, left, right = self.layout.cell_box(row, col)
            mask[top:bottom, left:right] = 255
        on_ratex = cv2.goodFeaturesToTrack(reference, FEATURES // 2, 0.05, 4, mask=mask)
        elsewhere = cv2.goodFeaturesToTrack(reference, FEATURES // 2, 0.02, 8, mask=255 - mask)
        found = [points for points in (on_ratex, elsewhere) if points is not None]
        points = np.concatenate(found) if found else np.zeros((0, 1, 2))
        inside = (
            np.abs(points[:, 0] - [width / 2, height / 2]) < [width / 2 - 3, height / 2 - 3]
        ).all(1)
        self._points = np.asarray(points[inside], np.float32)

    def _track(self, image: NDArray[np.uint8]) -> Tracked | None:
        assert self.corners is not None and self._reference is not None
        width, height = self.layout.width, self.layout.height
        guess = self.corners + self._motion
        H_captured_from_guess = homography_from_corners(guess, width, height)
        view = _equalised(rectify(image, H_captured_from_guess, width, height))
        if len(self._points) < MIN_INLIERS:
            return None
        moved, status, _ = cv2.calcOpticalFlowPyrLK(
            self._reference, view, self._points, self._points.copy(), winSize=(13, 13), maxLevel=2
        )
        good = status[:, 0] == 1
        if good.sum() < MIN_INLIERS:
            return None
        H_guess_from_reference, inliers = cv2.findHomography(
            self._points[good], moved[good], cv2.RANSAC, INLIER_PX
        )
        if H_guess_from_reference is None or inliers.sum() < MIN_INLIERS:
            return None
        corners = transform(
            H_captured_from_guess @ H_guess_from_reference, frame_corners(width, height)
        )
        changed = inliers.mean() < 0.5
        return self._accept(image, corners, moved=True, fresh=bool(changed))


def _equalised(rectified: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Give gray levels a mean of 128 and a deviation of 50: a change of exposure is no motion."""
    gray = rectified if rectified.ndim == 2 else cv2.cvtColor(rectified, cv2.COLOR_RGB2GRAY)
    mean, deviation = cv2.meanStdDev(gray)
    gain = 50 / max(float(deviation[0, 0]), 1.0)
    stretched = cv2.convertScaleAbs(gray, alpha=gain, beta=128 - gain * float(mean[0, 0]))
    return np.asarray(stretched, np.uint8)
