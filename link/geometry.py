"""The convention of pixels and corners, homographies, and rectification.

Convention: pixel centres lie at integer coordinates (OpenCV), points are (x, y), and the corners of
a picture are the outer corners of its corner pixels. A ``width`` x ``height`` display frame spans
[-0.5, width - 0.5] x [-0.5, height - 0.5]. Corner order: top-left, top-right, bottom-right,
bottom-left of the displayed picture, whatever way up the camera was.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from link.errors import InputError
from link.images import averaged_down
from link.types import Array, Corners, Homography, Image, Map

MIN_AREA_PX = 256.0
"""Smallest area, in square pixels of the image, that a display may cover."""
OUTER_PX = 0.51
"""Distance, in pixels, by which an image reaches beyond the centres of its outermost pixels: half a
pixel, and a hundredth that counts for nothing, as a homography of float32 is no more exact."""
UNDISTORT_STEPS = 8
"""Number of steps of Newton's method that invert a lens's distortion."""
LEAST_FACTOR = 0.7
"""Smallest share of its distance from the centre at which a lens shows a point. It is reached
outside the image; at two thirds, points farther out would begin to come back."""

UNIT_SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
"""Corners of a picture whose sides are 1."""


@dataclass(frozen=True)
class Lens:
    """A lens that bends straight lines, around the centre of the image.

    A point r half diagonals from the centre is seen at r (1 + k r²), or at `LEAST_FACTOR` r where
    that is farther.

    >>> lens = Lens(-0.1, (100, 80))
    >>> lens.distort(np.array([[-0.5, -0.5], [49.5, 39.5]])).round(6).tolist()
    [[4.5, 3.5], [49.5, 39.5]]
    >>> lens.undistort(np.array([[4.5, 3.5]])).round(3).tolist()
    [[-0.5, -0.5]]
    """

    k: float
    """Coefficient of the distortion: 0 for none; below 0 the image bulges like a barrel."""
    size: tuple[float, float]
    """Width and height of the image, pixels."""

    @property
    def middle(self) -> Array:
        """(2,) centre of the image, pixels."""
        return np.asarray((np.array(self.size) - 1) / 2)

    @property
    def half(self) -> float:
        """Half the diagonal of the image, pixels."""
        return float(np.hypot(*self.size)) / 2

    def distort(self, points: Array) -> Array:
        """Move points (N, 2), pixels of an image without distortion, to where the lens shows them.

        Args:
            points: pixels (x, y).
        """
        if self.k == 0:
            return points
        away = points - self.middle
        squares = (away**2).sum(axis=1, keepdims=True) / self.half**2
        return np.asarray(self.middle + away * np.maximum(1 + self.k * squares, LEAST_FACTOR))

    def undistort(self, points: Array) -> Array:
        """Find the points (N, 2) that `distort` moves to given ones, by Newton's method.

        Args:
            points: pixels (x, y).
        """
        if self.k == 0:
            return points
        away = points - self.middle
        seen = np.hypot(*away.T) / self.half
        most = np.sqrt((LEAST_FACTOR - 1) / self.k) if self.k < 0 else np.inf
        found = np.minimum(seen, most)
        for _ in range(UNDISTORT_STEPS):
            found = found - (found + self.k * found**3 - seen) / (1 + 3 * self.k * found**2)
            found = np.minimum(found, most)
        return np.asarray(self.middle + away / (1 + self.k * found**2)[:, None])

    def homography(self, corners: Corners, width: int, height: int) -> Homography:
        """Find the homography from a display to an image without distortion.

        Args:
            corners: pixels where the lens shows the corners of the display.
            width: width of the display frame, pixels.
            height: height of the display frame, pixels.

        Returns:
            ``H_straight_from_display``.
        """
        return homography_from_corners(self.undistort(corners), width, height)

    def seen_at(self, H_straight_from_display: Homography, size: tuple[int, int]) -> list[Map]:
        """Find where the lens shows every pixel of a display, x and y in two maps.

        Args:
            H_straight_from_display: homography that `homography` finds.
            size: width and height of the display frame, pixels.
        """
        x, y = (np.arange(side, dtype=np.float32) for side in size)
        across, down, scale = (
            np.add.outer(row[1] * y + row[2], row[0] * x)
            for row in H_straight_from_display.astype(np.float32)
        )
        away = [cv2.divide(part, scale) for part in (across, down)]
        for part, middle in zip(away, self.middle, strict=True):
            part -= np.float32(middle)
        squares = away[0] ** 2
        squares += away[1] ** 2
        squares *= np.float32(self.k / self.half**2)
        squares += 1
        np.maximum(squares, np.float32(LEAST_FACTOR), out=squares)
        for part, middle in zip(away, self.middle, strict=True):
            part *= squares
            part += np.float32(middle)
        return away


STRAIGHT = Lens(0.0, (1.0, 1.0))
"""A lens that leaves all lines straight, in images of any size."""


def frame_corners(width: int, height: int) -> Corners:
    """List the outer corners of a displayed frame, in corner order.

    Args:
        width: width of the frame, pixels.
        height: height of the frame, pixels.

    Returns:
        (4, 2) float64.

    >>> frame_corners(4, 3).tolist()
    [[-0.5, -0.5], [3.5, -0.5], [3.5, 2.5], [-0.5, 2.5]]
    """
    right, bottom = width - 0.5, height - 0.5
    return np.array([[-0.5, -0.5], [right, -0.5], [right, bottom], [-0.5, bottom]])


def as_corners(corners: ArrayLike) -> Corners:
    """Turn four points of any numeric type into an array.

    Args:
        corners: four points (x, y).

    Returns:
        (4, 2) float64.

    Raises:
        InputError: not four points, or not all of their numbers are finite.
    """
    try:
        given = np.asarray(corners)
        points = given.astype(np.float64) if given.dtype.kind in "iuf" else np.empty(0)
    except (TypeError, ValueError):
        points = np.empty(0)
    if points.shape != (4, 2) or not np.isfinite(points).all():
        told = " ".join(f"{corners!r:.200}".split())  # an array's lines as one
        raise InputError(f"corners: need four finite points x,y, got {told}")
    return points


def check_corners(
    corners: ArrayLike, image_shape: tuple[int, ...], outside: float = 0.0
) -> NDArray[np.float64]:
    """Check that four points can be the corners of a display in an image.

    Args:
        corners: (4, 2) pixels (x, y), in corner order.
        image_shape: (H, W, ...) of the captured image.
        outside: distance by which corners may lie outside the image, as a share of its longer side.

    Returns:
        the points as (4, 2) float64.

    Raises:
        InputError: wrong shape, not finite, too far outside the image, mirrored, not convex, or
            tiny.
    """
    points = as_corners(corners)
    height, width = image_shape[:2]
    slack = outside * max(width, height)
    low, high = -0.5 - slack, np.array([width, height]) - 0.5 + slack
    beyond = ((points < low) | (points > high)).any(axis=1)
    if beyond.any():
        x, y = points[beyond][0]
        raise InputError(f"corners: ({x:g}, {y:g}) lies outside the {width}x{height} image")
    edges = np.roll(points, -1, axis=0) - points
    following = np.roll(edges, -1, axis=0)
    if (edges[:, 0] * following[:, 1] - edges[:, 1] * following[:, 0] <= 0).any():
        raise InputError(
            "corners: not a convex quadrilateral in the order top-left, top-right, bottom-right, "
            "bottom-left of the displayed picture"
        )
    area = cv2.contourArea(points.astype(np.float32))
    if area < MIN_AREA_PX:
        raise InputError(
            f"corners: the display covers only {area:.0f} square pixels; take the image from nearer"
        )
    return points


def corners_apart(one: Array, other: Array) -> float:
    """Tell how far corners are from others along an axis, whichever of them comes first.

    Args:
        one: (4, 2) pixels.
        other: (4, 2) pixels, in the same sense of rotation.

    Returns:
        largest distance of a corner, pixels, in the order in which it is smallest.

    >>> corners = frame_corners(4, 3)
    >>> corners_apart(np.roll(corners, 1, axis=0) + [0, 2], corners)
    2.0
    """
    turned = (np.roll(one, turn, axis=0) for turn in range(4))
    return min(float(np.abs(each - other).max()) for each in turned)


def in_image(points: ArrayLike, image_shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Tell which points, (..., 2) pixels (x, y), lie in an image of a shape (H, W, ...).

    `OUTER_PX` says how far beyond the centres of its outermost pixels an image reaches.

    >>> in_image([[-0.5, 3.0], [-0.6, 3.0]], (4, 8)).tolist()
    [True, False]
    """
    at, (height, width) = np.asarray(points, np.float64), image_shape[:2]
    inside = (at >= -OUTER_PX) & (at <= np.array([width, height]) - 1 + OUTER_PX)
    return np.asarray(inside.all(axis=-1))


def homography_from_corners(corners: ArrayLike, width: int, height: int) -> NDArray[np.float64]:
    """Find the homography that maps pixels of the displayed picture to pixels of the image.

    Args:
        corners: (4, 2) pixels (x, y) of the image, in corner order.
        width: width of the displayed picture, pixels.
        height: height of the displayed picture, pixels.

    Returns:
        ``H_captured_from_display``, (3, 3) float64.

    >>> H = homography_from_corners([[9.5, 4.5], [29.5, 4.5], [29.5, 14.5], [9.5, 14.5]], 40, 20)
    >>> transform(H, [[0, 0], [39, 19]]).round(6).tolist()
    [[9.75, 4.75], [29.25, 14.25]]
    """
    return homography_from_points(frame_corners(width, height), corners)


def homography_from_points(source: ArrayLike, target: ArrayLike) -> NDArray[np.float64]:
    """Find the (3, 3) homography that maps four points, ``source`` (4, 2), to ``target`` (4, 2)."""
    source, target = np.asarray(source, np.float32), np.asarray(target, np.float32)
    return np.asarray(cv2.getPerspectiveTransform(source, target), np.float64)


def resized_homography(x: float, y: float) -> NDArray[np.float64]:
    """Find where the pixels of an image lie once it is resized: corners go to corners.

    Args:
        x: factor by which the image becomes wider.
        y: factor by which the image becomes taller.

    Returns:
        ``H_resized_from_image``, (3, 3) float64.

    >>> transform(resized_homography(2, 4), [[0, 0], [1, 1]]).tolist()
    [[0.5, 1.5], [2.5, 5.5]]
    """
    return np.array([[x, 0, (x - 1) / 2], [0, y, (y - 1) / 2], [0, 0, 1.0]])


def transform(H: NDArray[np.float64], points: ArrayLike) -> NDArray[np.float64]:
    """Apply a homography to points.

    Args:
        H: (3, 3).
        points: (N, 2).

    Returns:
        (N, 2) float64.
    """
    points = np.asarray(points, np.float64)
    mapped = np.column_stack([points, np.ones(len(points))]) @ H.T
    return np.asarray(mapped[:, :2] / mapped[:, 2:])


def whole_factor(corners: Array, width: int, height: int) -> int:
    """Say how many whole pixels, 1 at least, make one of a display with these (4, 2) corners."""
    top, right, bottom, left = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
    return max(1, int(min(min(top, bottom) / width, min(left, right) / height)))


def rectify(
    image: Image,
    H_captured_from_display: Homography,
    width: int,
    height: int,
    lens: Lens = STRAIGHT,
) -> Image:
    """Resample a captured image to the display's frame.

    Bilinear; a capture finer than twice the display grid is first averaged down (INTER_AREA) by a
    whole factor, so that every captured pixel counts and nothing aliases.

    Args:
        image: an `Image`.
        H_captured_from_display: homography, such as `homography_from_corners` finds.
        width: width of the display frame, pixels.
        height: height of the display frame, pixels.
        lens: shows where in the image the points lie to which the homography leads.

    Returns:
        an `Image`.

    >>> photo = np.zeros((24, 48), np.uint8)
    >>> photo[5:15, 10:30] = 200  # a display that shows an even gray
    >>> H = homography_from_corners([[9.5, 4.5], [29.5, 4.5], [29.5, 14.5], [9.5, 14.5]], 10, 5)
    >>> np.unique(rectify(photo, H, 10, 5)).tolist()
    [200]
    """
    H = np.asarray(H_captured_from_display, np.float64)
    factor = whole_factor(transform(H, frame_corners(width, height)), width, height)
    if factor >= 2:
        lens = Lens(lens.k, (image.shape[1] / factor, image.shape[0] / factor))
        image = averaged_down(image, factor)
        H = np.linalg.inv(resized_homography(factor, factor)) @ H
    if lens.k:
        across, down = lens.seen_at(H, (width, height))
        border = cv2.BORDER_REPLICATE
        return np.asarray(
            cv2.remap(image, across, down, cv2.INTER_LINEAR, borderMode=border), np.uint8
        )
    return resampled(image, H, width, height)


def resampled(image: Image, H_image_from_frame: ArrayLike, width: int, height: int) -> Image:
    """Show what lies in an image where a homography puts the pixels of a frame.

    Args:
        image: an `Image`, whose border goes on beyond it.
        H_image_from_frame: homography from pixels of the frame to those of the image.
        width: width of the frame, pixels.
        height: height of the frame, pixels.
    """
    H, how = np.asarray(H_image_from_frame), cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    size, border = (width, height), cv2.BORDER_REPLICATE
    return np.asarray(cv2.warpPerspective(image, H, size, flags=how, borderMode=border), np.uint8)
