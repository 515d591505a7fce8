"""Follow the display from frame to frame; find it again when it was lost.

A part of the display may lie outside the image. A search for a lost display takes the time of many
frames, so it goes in steps (`export.locate.steps`), of which each frame takes some. What it finds
in the frame with which it began is then looked for once more in the frame at hand.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from export.locate.candidates import Located
from export.locate.find import search_steps
from export.locate.patches import image_pyramid, patches_in_view, seen_visibility
from export.locate.refine import OUTSIDE, as_gray, corners_on_patches, needed_visibility
from export.locate.steps import Steps
from link.errors import InputError
from link.geometry import (
    check_corners,
    frame_corners,
    homography_from_corners,
    in_image,
    rectify,
    transform,
)
from link.layout import Layout
from link.ratex import match_patches

FEATURES = 160
"""Number of points that are followed, half of them on the ratex patches. At half the resolution, or
with half as many, errors are three times as large."""
MIN_INLIERS = 12
"""Smallest number of points that must move as one for the display to count as followed."""
INLIER_PX = 1.0
"""Largest distance, in pixels of the layout, of a point from where the common motion puts it."""
MIN_VISIBILITY = 0.7
"""Smallest `export.locate.patches.seen_visibility` of a followed display."""
FIRST_WORK, WORK, SLOW_WORK = 100, 55, 8
"""Units of work (`export.locate.steps`) after which a frame takes no further step of a search: in
the frames of the first search for a display, of the next ones, and of those after `PATIENCE`
searches in vain, while the image stays as it is."""
PATIENCE = 3
"""Number of searches in vain after which the image must change for the search to be quick."""
THUMBNAIL_PX = 32
"""Width and height, in pixels, of the thumbnails that tell whether the image has changed."""
CHANGED_LEVELS, CHANGED_SHARE = 16.0, 0.03
"""Gray levels by which a thumbnail's pixel differs where something has changed, and share of such
pixels at which the image counts as changed: the smallest display that is found covers as much."""
EDGE_PX = 9
"""Distance, in pixels of the layout, of a followed point from where the image ends."""


@dataclass(frozen=True)
class Tracked:
    """The display in one camera frame."""

    corners: NDArray[np.float64]
    """(4, 2) pixels of the camera frame, in corner order."""
    rectified: NDArray[np.uint8]
    """(height, width) or (height, width, 3) uint8, encoded, of the layout's size."""
    visibility: float
    """How well the ratex patches are seen, in [-1, 1]; patches that are out of view or covered are
    left out as `export.locate.patches.seen_visibility` says."""


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
        self._search: Steps[Located | None] | None = None
        self._vain = 0
        self._thumbnail: NDArray[np.float32] | None = None

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
            self.corners, self._search, self._vain = None, None, 0
        return self._look(image)

    def _look(self, image: NDArray[np.uint8]) -> Tracked | None:
        """Take some steps of a search, and begin one where none is under way."""
        fresh = self._search is None
        if self._search is None:
            whole = frame_corners(image.shape[1], image.shape[0])  # a screenshot, or rectified
            found = self._accept(image, whole, moved=False, fresh=True)
            if found is not None:
                return found
            self._search = search_steps(image.copy(), self.layout)
        limit, work = self._work_limit(image), 0
        try:
            while work < limit:
                work += next(self._search)
        except StopIteration as end:
            located: Located | None = end.value
            self._search = None
            self._vain += 1
            if located is None:
                return None
            corners = located.corners
            if not fresh:  # the camera has moved since
                pyramid = image_pyramid(as_gray(image))
                corners, seen = corners_on_patches(image, pyramid, corners, self.layout)
                if seen < needed_visibility(self.layout):
                    return None
            return self._accept(image, corners, moved=False, fresh=True)
        return None

    def _work_limit(self, image: NDArray[np.uint8]) -> int:
        """Say after how many units of work this frame takes no further step of the search."""
        if self._vain == 0:
            return FIRST_WORK
        if self._vain <= PATIENCE:
            self._thumbnail = None
            return WORK
        gray = as_gray(image[::4, ::4])
        small = cv2.resize(gray, (THUMBNAIL_PX, THUMBNAIL_PX), interpolation=cv2.INTER_AREA)
        thumbnail = np.asarray(small, np.float32)
        before, self._thumbnail = self._thumbnail, thumbnail
        if before is None:
            return SLOW_WORK
        changed = float((np.abs(thumbnail - before) > CHANGED_LEVELS).mean())
        if changed < CHANGED_SHARE:
            self._thumbnail = before
            return SLOW_WORK
        # what was looked at is no longer what is seen
        self._search, self._vain = search_steps(image.copy(), self.layout), 1
        return WORK

    def _accept(
        self, image: NDArray[np.uint8], corners: NDArray[np.float64], *, moved: bool, fresh: bool
    ) -> Tracked | None:
        try:
            check_corners(corners, image.shape, OUTSIDE)
        except InputError:
            return None
        H = homography_from_corners(corners, self.layout.width, self.layout.height)
        rectified = rectify(image, H, self.layout.width, self.layout.height)
        in_view = patches_in_view(corners, self.layout, image.shape)
        seen = seen_visibility(match_patches(rectified, self.layout).correlation, in_view)
        if seen < MIN_VISIBILITY:
            return None
        if self.corners is not None and moved:
            self._motion = 0.5 * (corners - self.corners)
        else:
            self._motion = np.zeros((4, 2))
        self.corners = corners
        if fresh:
            self._take_reference(_equalised(rectified), self._view_mask(H, image.shape))
        return Tracked(corners, rectified, seen)

    def _view_mask(
        self, H_captured_from_display: NDArray[np.float64], shape: tuple[int, ...]
    ) -> NDArray[np.uint8]:
        """Mark, by 255, the pixels of the layout that lie in the image, and not at its border."""
        width, height = self.layout.width, self.layout.height
        whole = np.full((height, width), 255, np.uint8)
        corners = transform(H_captured_from_display, frame_corners(width, height))
        if in_image(corners, shape).all():
            return whole
        seen = cv2.warpPerspective(
            np.full(shape[:2], 255, np.uint8),
            H_captured_from_display,
            (width, height),
            flags=cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP,
        )
        near = np.ones((2 * EDGE_PX + 1,) * 2, np.uint8)
        eroded = cv2.erode(seen, near, borderType=cv2.BORDER_CONSTANT, borderValue=255)
        return np.asarray(eroded, np.uint8)

    def _take_reference(self, reference: NDArray[np.uint8], seen: NDArray[np.uint8]) -> None:
        """Choose the points that are followed, all of them where ``seen`` is 255."""
        self._reference = reference
        height, width = reference.shape
        mask = np.zeros_like(reference)
        for row, col in self.layout.ratex:
            top, bottom, left, right = self.layout.cell_box(row, col)
            mask[top:bottom, left:right] = 255
        patches, rest = mask & seen, (255 - mask) & seen
        on_ratex = cv2.goodFeaturesToTrack(reference, FEATURES // 2, 0.05, 4, mask=patches)
        elsewhere = cv2.goodFeaturesToTrack(reference, FEATURES // 2, 0.02, 8, mask=rest)
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
        if not in_image(guess, image.shape).all():
            good &= in_image(transform(H_captured_from_guess, moved[:, 0]), image.shape)
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
