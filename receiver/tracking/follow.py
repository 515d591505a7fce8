"""Follow a display from frame to frame by optical flow, once its corners are known."""

import cv2
import numpy as np

from link.errors import InputError
from link.geometry import (
    Lens,
    check_corners,
    frame_corners,
    homography_from_corners,
    in_image,
    rectify,
    transform,
)
from link.images import as_gray
from link.layout import Layout
from link.types import Array, Corners, Image
from receiver.locate.refine import OUTSIDE
from receiver.pilots.motion import moved_corners
from receiver.pilots.outline import Border, Outline
from receiver.seen import SeenFrame, points_in_view
from receiver.tracking.corners import CornerShift

FEATURES = 160
"""Number of points that are followed, half of them on ratex patches where there are any. At half
the resolution, or with half as many, errors are three times as large."""
COMPARED_PX, HALVINGS = 13, 2
"""Width and height, in pixels of the layout, of what is compared around a point, and number of
times that images are halved, so that points are followed from afar."""
EVEN_MEAN, EVEN_DEVIATION = 128, 50
"""Mean and standard deviation of the gray levels that are compared."""
MIN_INLIERS = 12
"""Smallest number of points that must move as one for the display to count as followed."""
INLIER_PX = 1.0
"""Largest distance, in pixels of the layout, of a point from where the common motion puts it."""
CHECKED, APART_BLOCKS = 3, 0.25
"""Number of frames from one look at what surrounds the display to the next, and distance in blocks
from which on the picture then counts as one that moves by itself: from there on bits are lost."""
EDGE_PX = 9
"""Distance, in pixels of the layout, of a followed point from where the image ends."""


class Follower:
    """Follows the display by optical flow to a rectified reference, so that errors do not add up.

    The reference is the frame in which the display was found, and is taken anew where the picture
    has changed (a video): points on ratex patches then hold the geometry. A display without them is
    followed by what surrounds it (`receiver.pilots.outline`) once its picture moves.

    Args:
        layout: layout of the display.
        k: coefficient of the lens.
        picture_moves: whether the picture is known to move. If not, the follower notices.
    """

    def __init__(self, layout: Layout, k: float = 0.0, *, picture_moves: bool = False) -> None:
        self.layout, self._k = layout, k
        self._picture_moves = picture_moves
        self._shift = CornerShift(layout) if layout.pilots else None
        self._outline: Outline | None = None
        self._border: Border
        self.corners: Array | None = None
        """(4, 2) pixels of the last frame, in corner order, or None where nothing is followed."""
        self._motion = np.zeros((4, 2))
        self._steps, self._blocks = 0, layout.rows * layout.cols
        self._reference: Image | None = None
        self._points = np.zeros((0, 1, 2), np.float32)

    def lens(self, image: Image) -> Lens:
        """Give the lens through which an image was taken."""
        return Lens(self._k, (image.shape[1], image.shape[0]))

    def rectified(self, image: Image, corners: Corners) -> Image | None:
        """Rectify the display in an image, or return None where the corners are not sound.

        Args:
            image: an `Image`.
            corners: pixels of the image.
        """
        try:
            check_corners(corners, image.shape, OUTSIDE)
        except InputError:
            return None
        size, lens = (self.layout.width, self.layout.height), self.lens(image)
        return rectify(image, lens.homography(corners, *size), *size, lens)

    def see(self, image: Image, time: float, corners: Corners) -> SeenFrame | None:
        """Rectify the display where it lies, or return None where the corners are not sound.

        Args:
            image: an `Image`.
            time: time of the frame, seconds.
            corners: pixels of the image, as followed. Decoded blocks may have told meanwhile that
                the display lies elsewhere (`CornerShift`), as seen from there.
        """
        placement = None if self._shift is None else self._shift.placement
        if placement is not None:
            H, lens = placement.H_followed_from_shown, self.lens(image)
            corners = moved_corners(corners, H, self.layout, lens)
        rectified = self.rectified(image, corners)
        if rectified is None:
            return None
        in_view = points_in_view(corners, image.shape)
        return SeenFrame(self.layout, time, corners, rectified, in_view, placement)

    def begin(self, image: Image, corners: Array, rectified: Image) -> None:
        """Take a frame, and the display rectified by its corners, as the reference."""
        if self.corners is None:
            self._motion = np.zeros((4, 2))
        self.corners = corners
        if self._outline is None and self.layout.pilots:
            gray = as_gray(image)
            self._outline, self._border = Outline(gray, corners), Border(gray, corners)
        H = homography_from_corners(corners, self.layout.width, self.layout.height)
        self._take_reference(_equalised(rectified), self._view_mask(H, image.shape))

    def advance(self, corners: Array) -> None:
        """Take the corners in the next frame, which `step` found."""
        if self.corners is not None:
            self._motion = 0.5 * (corners - self.corners)
        self.corners = corners

    def step(self, image: Image) -> tuple[Array, bool] | None:
        """Find the display in the next frame.

        Args:
            image: an `Image`.

        Returns:
            (4, 2) pixels of the image, and whether the picture has changed so much that the
            reference should be taken anew; None where the display is lost.
        """
        if self.corners is None:
            return None
        outline = self._outline if self._outline is not None and self._outline.is_clear else None
        if outline is not None and self._picture_moves:
            around = outline.follow(as_gray(image))
            return self._by_picture(image) if around is None else (around, False)
        step = self._by_picture(image)
        self._steps += 1
        if outline is None or (step is not None and self._steps % CHECKED):
            return step
        gray = as_gray(image)
        around = outline.follow(gray, None if step is None else step[0])
        if around is None:
            return step
        if step is not None:
            block = np.sqrt(cv2.contourArea(self.corners.astype(np.float32)) / self._blocks)
            near = np.abs(around - step[0]).max() <= APART_BLOCKS * block
            if near or not self._border.is_rather(gray, around, step[0]):
                return step
        self._picture_moves = True
        return around, False

    def _by_picture(self, image: Image) -> tuple[Array, bool] | None:
        """Find the display by what it shows, or by its patches; returns as `step` does."""
        assert self.corners is not None
        if self._reference is None or len(self._points) < MIN_INLIERS:
            return None
        width, height = self.layout.width, self.layout.height
        guess = self.corners + self._motion
        lens = self.lens(image)
        H_straight_from_guess = lens.homography(guess, width, height)
        view = _equalised(rectify(image, H_straight_from_guess, width, height, lens))
        moved, status, _ = cv2.calcOpticalFlowPyrLK(
            self._reference,
            view,
            self._points,
            self._points.copy(),
            winSize=(COMPARED_PX, COMPARED_PX),
            maxLevel=HALVINGS,
        )
        good = status[:, 0] == 1
        if not in_image(guess, image.shape).all():
            there = lens.distort(transform(H_straight_from_guess, moved[:, 0]))
            good &= in_image(there, image.shape)
        if good.sum() < MIN_INLIERS:
            return None
        H_guess_from_reference, inliers = cv2.findHomography(
            self._points[good], moved[good], cv2.RANSAC, INLIER_PX
        )
        if H_guess_from_reference is None or inliers.sum() < MIN_INLIERS:
            return None
        straight = transform(
            H_straight_from_guess @ H_guess_from_reference, frame_corners(width, height)
        )
        return lens.distort(straight), bool(inliers.mean() < 0.5)

    def _view_mask(self, H_captured_from_display: Array, shape: tuple[int, ...]) -> Image:
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

    def _take_reference(self, reference: Image, seen: Image) -> None:
        """Choose the points that are followed, all of them where ``seen`` is 255."""
        self._reference = reference
        height, width = reference.shape
        mask = np.zeros_like(reference)
        for row, col in self.layout.ratex:
            top, bottom, left, right = self.layout.cell_box(row, col)
            mask[top:bottom, left:right] = 255
        patches, rest = mask & seen, (255 - mask) & seen
        if self.layout.ratex:
            parts = [(patches, FEATURES // 2, 0.05, 4), (rest, FEATURES // 2, 0.02, 8)]
        else:
            parts = [(rest, FEATURES, 0.02, 8)]
        found = [
            cv2.goodFeaturesToTrack(reference, count, quality, apart, mask=part)
            for part, count, quality, apart in parts
        ]
        kept = [points for points in found if points is not None]
        points = np.concatenate(kept) if kept else np.zeros((0, 1, 2))
        inside = (
            np.abs(points[:, 0] - [width / 2, height / 2]) < [width / 2 - 3, height / 2 - 3]
        ).all(1)
        self._points = np.asarray(points[inside], np.float32)


def _equalised(rectified: Image) -> Image:
    """Give gray levels `EVEN_MEAN` and `EVEN_DEVIATION`: a change of exposure is no motion."""
    gray = as_gray(rectified)
    mean, deviation = cv2.meanStdDev(gray)
    gain = EVEN_DEVIATION / max(float(deviation[0, 0]), 1.0)
    stretched = cv2.convertScaleAbs(gray, alpha=gain, beta=EVEN_MEAN - gain * float(mean[0, 0]))
    return np.asarray(stretched, np.uint8)
