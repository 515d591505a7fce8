"""Follow a display by what lies around it, whatever it shows.

A display may show a film, whose points move by themselves. What surrounds it does not: the bezel
lies in the display's plane, and letterbox bars, desk and wall keep their edges. So a ring around
the display is compared, pixel by pixel, with the same ring in a reference frame, and the eight
numbers of a homography follow by least squares (Lucas & Kanade 1981), with less weight for pixels
that changed in another way (as behind a display that is nearer than the wall, when the hand moves).
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from link.geometry import homography_from_corners, transform
from link.types import Array, Corners, Gray, Homography, Map
from receiver.locate.edges import profiles
from receiver.pilots.motion import UNIT_CORNERS, pixels_from_unit, unit_homography

WIDTH, RING = 160, 0.16
"""Width of a display in pixels of its view, and width of the ring around it as a share of that. The
ring is wide enough for a bezel and for most letterbox bars."""
BORDER_PX = 2
"""Distance, in pixels of the view, from the display's border to the ring: the border's own pixels
show a part of the picture."""
SUPERSAMPLED, BLUR_PX = 2, 0.8
"""Number of samples along each axis of a pixel of the view, and standard deviation, in its pixels,
over which it is smoothed, so that slopes lead back from a pixel or two away."""
ROUNDS, SETTLED = 4, 5e-4
"""Largest number of steps for a frame, and size of a step, in halves of the display, after which
there is no other: less than a twentieth of `receiver.pilots.search.film.APART`, the least distance
that counts."""
LEAST_DEVIATION, OUTLIER = 0.5, 2.0
"""Gray levels that are added to the usual difference of pixels, so that it is never 0, and number
of usual differences at which a pixel counts half."""
DAMPING = 1e-2
"""Mean squared slope, in gray levels for half a display, that is added to that of each number of
the homography. So a number that no pixel tells about stays as it was."""
ALIKE = 0.8
"""Smallest correlation of the ring with that of the reference at which it counts as found."""
CLEAR_PX = 0.3
"""Largest standard error of a corner, in pixels of the view, at which a ring tells where the
display is: a plain wall does not."""
CORRELATED_PX = 9.0
"""Number of pixels of the view whose differences count as one, because light, blur and noise of the
camera change them together."""


PROFILE_PX, ALONG = 8, 32
"""Distance from a side of a quadrilateral, in pixels of the image, up to which its profile shows
edges, and number of places along each side over which it is averaged."""
PROFILE_PLACES = (np.arange(ALONG) + 0.5) / ALONG * 0.8 + 0.1
"""These places, (32,), in lengths of the side from its start: clear of the corners."""
PROFILE_OFFSETS = np.arange(-PROFILE_PX, PROFILE_PX + 1.0)
"""Distances from a side, (17,), in pixels along the inward normal, at which a profile is
measured."""
BETTER = 0.1
"""Correlation by which one place's profiles must be more like the reference's than another's."""


class Border:
    """Tells which of two places is that of a display, by the edges along its border.

    The edges of picture and bezel lie along the border, whatever the picture shows and however far
    the wall is behind. What is compared is the mean steepness across each side, by distance from
    it.

    Args:
        gray: a reference frame.
        corners: pixels of the display in it.
    """

    def __init__(self, gray: Gray, corners: Corners) -> None:
        self._profiles = border_profiles(gray, corners)

    def is_rather(self, gray: Gray, one: Corners, other: Corners) -> bool:
        """Tell whether the display is clearly rather at one place than at another in a frame."""
        first, second = (self._likeness(border_profiles(gray, at)) for at in (one, other))
        return first > second + BETTER

    def _likeness(self, profiles: Array) -> float:
        """Correlate all profiles with the reference's, in [-1, 1]."""
        a, b = (each - each.mean(axis=1, keepdims=True) for each in (profiles, self._profiles))
        return float((a * b).sum() / np.sqrt((a * a).sum() * (b * b).sum() + 1e-9))


def border_profiles(gray: Gray, corners: Corners) -> Array:
    """Measure how steep a frame is across the sides of a quadrilateral.

    Args:
        gray: the frame.
        corners: (4, 2) pixels.

    Returns:
        (4, 2 `PROFILE_PX`) mean size of the step between neighbouring places, gray levels, from
        outside to inside.
    """
    levels = profiles(gray, corners[None], PROFILE_OFFSETS, PROFILE_PLACES)[0]  # (4, 32, 17)
    return np.asarray(np.abs(np.diff(levels, axis=2)).mean(axis=1, dtype=np.float64))


class Outline:
    """Follows what surrounds a display, from a reference frame on.

    Args:
        gray: the reference frame.
        corners: pixels of the display in it.
        width: width of the display, pixels of its view; fewer cost less.
    """

    def __init__(self, gray: Gray, corners: Corners, width: int = WIDTH) -> None:
        across = np.linalg.norm(corners[1] - corners[0]) + np.linalg.norm(corners[2] - corners[3])
        down = np.linalg.norm(corners[3] - corners[0]) + np.linalg.norm(corners[2] - corners[1])
        inner = width, max(8, round(width * float(down) / max(float(across), 1.0)))
        margin = round(RING * width)
        self._inner, self._size = inner, (inner[0] + 2 * margin, inner[1] + 2 * margin)
        self._view_from_unit = pixels_from_unit(*inner)
        self._view_from_unit[:2, 2] += margin
        self._first = transform(self._view_from_unit, UNIT_CORNERS)
        self.corners = corners
        """(4, 2) pixels of the display in the newest frame."""
        self._motion = np.zeros((4, 2))
        x, y = (np.arange(side, dtype=np.float64) for side in self._size)
        outside = np.maximum(
            _beyond(x, margin, inner[0])[None, :], _beyond(y, margin, inner[1])[:, None]
        )
        rows, cols = np.nonzero(outside >= BORDER_PX)
        self._places = np.stack([cols, rows], axis=1).astype(np.float64)
        H = self._homography(corners)
        kept = _inside(H, self._places, gray.shape)
        self._places, self._picked = self._places[kept], (rows[kept], cols[kept])
        reference = self._view(gray, H)
        self._reference = reference[self._picked]
        self._slopes = self._slopes_of(reference)
        self.is_clear = self._is_clear()
        """Whether the ring tells where the display is; a plain wall does not."""

    def follow(self, gray: Gray, guess: Corners | None = None) -> Corners | None:
        """Find the display in the next frame.

        Args:
            gray: the frame, of the reference's size.
            guess: corners from which to begin; None for where the display was, moved on.

        Returns:
            (4, 2) pixels, or None where the ring is not found.
        """
        H = self._homography(self.corners + self._motion if guess is None else guess)
        values, weight = self._compared(gray, H)
        for _ in range(ROUNDS):
            step = np.asarray(np.linalg.solve(*self._equations(values, weight)), np.float64)
            moved = np.linalg.inv(unit_homography(step)) @ np.linalg.inv(self._view_from_unit)
            H = np.asarray(H @ self._view_from_unit @ moved)
            values, weight = self._compared(gray, H)
            if np.abs(step).max() < SETTLED:
                break
        if not _correlation(values + self._reference, self._reference, weight) >= ALIKE:
            return None
        corners = transform(np.asarray(H / H[2, 2]), self._first)
        if not cv2.isContourConvex(corners.astype(np.float32)):
            return None
        self._motion, self.corners = 0.5 * (corners - self.corners), corners
        return corners

    def _homography(self, corners: Corners) -> Homography:
        H_captured_from_inner = homography_from_corners(corners, *self._inner)
        margin = self._first[0] + 0.5
        H_inner_from_view = np.array([[1, 0, -margin[0]], [0, 1, -margin[1]], [0, 0, 1]])
        return np.asarray(H_captured_from_inner @ H_inner_from_view)

    def _view(self, gray: Gray, H: Homography) -> Map:
        """Show the display with its ring, smoothed, (h, w)."""
        width, height = self._size
        half = (SUPERSAMPLED - 1) / 2 / SUPERSAMPLED
        finer = np.diag([1 / SUPERSAMPLED, 1 / SUPERSAMPLED, 1.0])
        finer[:2, 2] = -half
        view = cv2.warpPerspective(
            gray,
            H @ finer,
            (SUPERSAMPLED * width, SUPERSAMPLED * height),
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_REPLICATE,
        )
        small = cv2.resize(view, (width, height), interpolation=cv2.INTER_AREA)
        return np.asarray(cv2.GaussianBlur(np.float32(small), (0, 0), BLUR_PX), np.float32)

    def _slopes_of(self, view: Map) -> Map:
        """Give the slopes of the ring's pixels along the eight numbers of a motion: (n, 8)."""
        gx, gy = (
            cv2.Sobel(view, cv2.CV_32F, 1 - axis, axis, scale=side / 16)[self._picked]
            for axis, side in enumerate(self._inner)
        )
        unit_from_view = np.asarray(np.linalg.inv(self._view_from_unit))
        x, y = transform(unit_from_view, self._places).T
        away = x * gx + y * gy
        columns = [x * gx, y * gx, gx, x * gy, y * gy, gy, -x * away, -y * away]
        return np.stack(columns, axis=1).astype(np.float32)

    def _compared(
        self, gray: Gray, H: Homography
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Give differences of the ring from the reference, at equal exposure, and weights."""
        shown = self._view(gray, H)[self._picked]
        gain = self._reference.std() / max(float(shown.std()), 1e-3)
        apart = gain * (shown - shown.mean()) - (self._reference - self._reference.mean())
        usual = 1.4826 * float(np.median(np.abs(apart))) + LEAST_DEVIATION
        weight = 1 / (1 + (apart / (OUTLIER * usual)) ** 2)
        seen = _inside(H, self._places, gray.shape)
        return apart.astype(np.float32), (weight * seen).astype(np.float32)

    def _equations(
        self, apart: NDArray[np.float32], weight: NDArray[np.float32]
    ) -> tuple[Array, Array]:
        weighed = self._slopes * weight[:, None]
        matrix = np.asarray(weighed.T @ self._slopes, np.float64)
        return matrix + DAMPING * len(apart) * np.eye(8), np.asarray(weighed.T @ apart, np.float64)

    def _is_clear(self) -> bool:
        """Tell whether noise alone would move no corner by much."""
        if len(self._reference) < 8:
            return False
        matrix, _ = self._equations(self._reference, np.ones_like(self._reference))
        covariance = np.linalg.inv(matrix) * CORRELATED_PX * (LEAST_DEVIATION * 2) ** 2
        variances = []
        for x, y in UNIT_CORNERS:
            for axis, side in enumerate(self._inner):
                along = np.zeros(8)
                along[3 * axis : 3 * axis + 3] = x, y, 1
                along[6:] = -(x, y)[axis] * x, -(x, y)[axis] * y
                variances.append((side / 2) ** 2 * (along @ covariance @ along))
        # slopes all along one line make the inverse so inexact that variances may be negative
        return bool(min(variances) >= 0 and max(variances) <= CLEAR_PX**2)


def _beyond(at: Array, margin: int, side: int) -> Array:
    """Tell how many pixels positions lie beyond the two ends of a side; below 1 within."""
    return np.maximum(margin - at, at - (margin + side - 1))


def _inside(H: Homography, points: Array, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Tell which (n, 2) points of a view H moves to within an image, some pixels from its border.

    OpenCV moves thousands of points in a fifth of the time of `link.geometry.transform`.
    """
    height, width = shape[:2]
    x, y = cv2.perspectiveTransform(points[:, None], H)[:, 0].T
    return np.asarray((x > 3) & (y > 3) & (x < width - 4) & (y < height - 4))


def _correlation(
    one: NDArray[np.float32], other: NDArray[np.float32], weight: NDArray[np.float32]
) -> float:
    """Correlate values with weights, in [-1, 1]."""
    total = float(weight.sum()) + 1e-9
    a, b = (each - float(each @ weight) / total for each in (one, other))
    return float((weight * a) @ b / np.sqrt(((weight * a) @ a) * ((weight * b) @ b) + 1e-9))
