"""Hold the frames of a film still: where each point of a reference frame lies in a later one."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from link.geometry import resampled, resized_homography
from link.types import Array, Gray, Homography

WIDTH = 640
"""Largest width, in pixels, of the copies on which motion is followed. It bounds the work.
Constants in pixels of the copies were chosen by hand with it."""
POINTS, MIN_POINTS = 400, 12
"""Largest and smallest number of points that are followed. The largest bounds the work; the
smallest is three times the four that a homography takes. Chosen by hand."""
CLEAR, FAINT = 0.005, 0.002
"""Smallest share of how clear the clearest point is at which others are followed: less clear ones
may be noise. The second holds where a picture may move, because the clearest points then are its,
and those of the room count. Chosen by hand."""
APART_PX = 8.0
"""Least distance of points from each other, in pixels of the copies: motion is seen in `FLOW_PX`
pixels. Chosen by hand."""
FLOW_PX = 15
"""Width and height, in pixels of the copies, of what is compared around a point; OpenCV takes 21
unless told otherwise, and fewer cost less. Chosen by hand."""
HALVINGS = 2
"""Number of times that copies are halved, so that points are found that have moved far: motions of
about 30 pixels are then within sight. Chosen by hand."""
FLOW_ENDS = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 5, 0.03)
"""When a point on a copy counts as found, as OpenCV takes it: after five steps, or one of 0.03 px.
Corners then lie within 0.2 px of where its own 30 steps and 0.01 px put them, in half the time."""
PARTS = 8
"""Number of parts of the image along each axis in each of which so many points are followed at
most, so that a display has some where the room has clearer ones. Chosen by hand."""
SAME_PX = 0.7
"""Largest distance, in pixels of the copies, of a point from where the common motion puts it: a few
times the 0.2 px to which `FLOW_ENDS` finds a point."""
AGREEING = 0.5
"""Smallest share of the points within a quadrilateral that must move as one, for them to say how it
moves: most of them."""
TRIES, TRIES_WITHIN = 2000, 200
"""Largest number of motions that are tried by RANSAC, of a whole image and within a quadrilateral:
where half of the points agree, four chosen points miss them in all of 200 tries once in 400,000."""
SPREAD = 0.25
"""Smallest share of a quadrilateral's area over which points within it must be spread, for them to
say how it moves: from points that lie close together nothing follows for the rest. Chosen by
hand."""


@dataclass(frozen=True, eq=False)
class Tracks:
    """Points of a reference frame that were found again in a later one."""

    before: NDArray[np.float32]
    """(n, 1, 2) pixels of the reference."""
    after: NDArray[np.float32]
    """(n, 1, 2) pixels of the later frame."""
    same_px: float
    """`SAME_PX` in pixels of the frames."""

    def motion_within(self, quad: Array) -> Homography | None:
        """Find how what lies within a convex quadrilateral has moved.

        Args:
            quad: (4, 2) pixels of the reference, clockwise.

        Returns:
            homography from the reference to the later frame; None where too few points lie
            within, or too close together, or do not agree.
        """
        inside = _outside(quad, self.before[:, 0, 0], self.before[:, 0, 1]) <= 0
        motions = _motions(self.before[inside], self.after[inside], 1, self.same_px, TRIES_WITHIN)
        if not motions:
            return None
        H, same = motions[0]
        spread = _area(same) >= SPREAD * _area(quad.astype(np.float32))
        return H if spread and len(same) >= AGREEING * inside.sum() else None


class Stabiliser:
    """Follows the camera's motion since a reference frame, by optical flow and one homography.

    Most points move with the camera. But if a display shows a video, its picture moves as well, and
    may have more points than the room. Then those points count that lie farther apart.

    Args:
        gray: the reference frame, (H, W) uint8.
        far_apart: whether, of two motions, that of the points counts which lie farther apart, and
            not that of the most points.
    """

    def __init__(self, gray: Gray, *, far_apart: bool = False) -> None:
        self.tracks: Tracks | None = None
        """Points found again in the last frame; None where pictures in it may move."""
        self._far_apart = far_apart
        height, width = gray.shape
        self.reference = small_gray(gray)
        """Copy of the reference frame."""
        x, y = width / self.reference.shape[1], height / self.reference.shape[0]
        self._H_image_from_copy = resized_homography(x, y)
        self._points = _clear_points(self.reference, FAINT if far_apart else CLEAR)
        self._guess = self._points.copy()

    def follow(self, copy: Gray) -> Array | None:
        """Find the (3, 3) homography from pixels of the reference to pixels of a later frame.

        Args:
            copy: (h, w) uint8, the copy of the frame (`small_gray`), which has the reference's
                size.

        Returns:
            None where the reference's points are lost.
        """
        if len(self._points) < MIN_POINTS:
            return None
        moved, good = found_again(self.reference, copy, self._points, self._guess)
        if good.sum() < MIN_POINTS:
            return None
        motions = _motions(self._points[good], moved[good], 2 if self._far_apart else 1, SAME_PX)
        if not motions:
            return None
        self.tracks = None if self._far_apart else self._tracks(self._points[good], moved[good])
        H, _ = max(motions, key=lambda motion: _area(motion[1]))
        self._guess = np.asarray(cv2.perspectiveTransform(self._points, H), np.float32)
        return np.asarray(self._H_image_from_copy @ H @ np.linalg.inv(self._H_image_from_copy))

    def _tracks(self, before: NDArray[np.float32], after: NDArray[np.float32]) -> Tracks:
        """Move points (n, 1, 2) of both copies to the images."""
        grow = self._H_image_from_copy
        on_images = (cv2.perspectiveTransform(points, grow) for points in (before, after))
        one, other = (np.asarray(points, np.float32) for points in on_images)
        return Tracks(one, other, SAME_PX * float(grow[0, 0]))

    def still(self, copy: Gray, H_image_from_reference: Array) -> Gray:
        """Move the copy of a frame onto the reference's."""
        grow = self._H_image_from_copy
        H = np.linalg.inv(grow) @ H_image_from_reference @ grow
        return resampled(copy, H, copy.shape[1], copy.shape[0])

    def on_copy(self, points: Array) -> Array:
        """Move (N, 2) points from the image to the copy."""
        H = np.linalg.inv(self._H_image_from_copy)
        return np.asarray(cv2.perspectiveTransform(points[:, None], H)[:, 0])

    def on_image(self, points: Array) -> Array:
        """Move (N, 2) points from the copy to the image."""
        return np.asarray(cv2.perspectiveTransform(points[:, None], self._H_image_from_copy)[:, 0])


def _outside(quad: Array, x: NDArray[np.float32], y: NDArray[np.float32]) -> NDArray[np.float32]:
    """Tell how far points lie outside of the nearest lines of a convex quadrilateral, clockwise.

    Returns:
        an array of the shape of ``x``, in its unit; negative within.
    """
    outside = np.full(x.shape, -np.inf, np.float32)
    for start, end in zip(quad, np.roll(quad, -1, axis=0), strict=True):
        along = (end - start) / max(float(np.linalg.norm(end - start)), 1e-9)
        outside = np.maximum(outside, along[1] * (x - start[0]) - along[0] * (y - start[1]))
    return outside


def _clear_points(gray: Gray, least: float) -> NDArray[np.float32]:
    """Choose the clearest points of an image, but only so many in each of its parts, (n, 1, 2).

    Args:
        gray: (h, w) uint8.
        least: smallest share of how clear the clearest point is.
    """
    points = cv2.goodFeaturesToTrack(gray, 0, least, APART_PX)
    if points is None:
        return np.zeros((0, 1, 2), np.float32)
    x, y = (PARTS * points[:, 0] // gray.shape[::-1]).astype(int).T
    room = np.full((PARTS, PARTS), POINTS // PARTS**2)
    kept = []
    for number, part in enumerate(zip(y, x, strict=True)):  # the clearest comes first
        if room[part] > 0:
            room[part] -= 1
            kept.append(number)
    return np.asarray(points[kept], np.float32)


def _motions(
    points: NDArray[np.float32],
    moved: NDArray[np.float32],
    most: int,
    same_px: float,
    tries: int = TRIES,
) -> list[tuple[Array, NDArray[np.float32]]]:
    """Find motions that points share, that of the most points first.

    Args:
        points: (n, 1, 2) pixels of the reference.
        moved: (n, 1, 2) pixels of the frame, where these points are found.
        most: number of motions that are looked for.
        same_px: largest distance, in pixels, of a point from where its motion puts it.
        tries: largest number of motions that are tried for each one found.

    Returns:
        (3, 3) homographies, each with the points that share it, at least `MIN_POINTS`.
    """
    found: list[tuple[Array, NDArray[np.float32]]] = []
    while len(found) < most and len(points) >= MIN_POINTS:
        H, inliers = cv2.findHomography(points, moved, cv2.USAC_FAST, same_px, maxIters=tries)
        if H is None or inliers.sum() < MIN_POINTS:
            break
        same = inliers[:, 0] > 0
        H, _ = cv2.findHomography(points[same], moved[same])  # by least squares
        found.append((H, points[same]))
        points, moved = points[~same], moved[~same]
    return found


def _area(points: NDArray[np.float32]) -> float:
    """Area, in square pixels, of the smallest convex region that holds (n, 1, 2) points."""
    return float(cv2.contourArea(cv2.convexHull(points)))


def found_again(
    reference: Gray, copy: Gray, points: NDArray[np.float32], guess: NDArray[np.float32]
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Find points of one copy in another by optical flow.

    Args:
        reference: (h, w) uint8, the copy that has the points.
        copy: (h, w) uint8, the copy in which they are looked for.
        points: (n, 1, 2) pixels of ``reference``.
        guess: (n, 1, 2) pixels of ``copy`` near which they may be.

    Returns:
        (n, 1, 2) pixels of ``copy``, and which of the points (n,) were found there.
    """
    moved, status, _ = cv2.calcOpticalFlowPyrLK(
        reference,
        copy,
        points,
        guess.copy(),
        winSize=(FLOW_PX, FLOW_PX),
        maxLevel=HALVINGS,
        criteria=FLOW_ENDS,
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )
    return np.asarray(moved, np.float32), np.asarray(status[:, 0] == 1)


def small_gray(gray: Gray) -> Gray:
    """Shrink a frame to the copy on which motion is followed, at most `WIDTH` pixels wide."""
    height, width = gray.shape
    factor = max(1.0, width / WIDTH)
    size = round(width / factor), max(1, round(height / factor))
    return np.asarray(cv2.resize(gray, size, interpolation=cv2.INTER_AREA), np.uint8)
