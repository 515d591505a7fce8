"""Where in the image something toggles: a map that separates a display from the room around it.

Frames are held still by the camera's motion first. At each frequency the amplitude of every pixel
is summed up as the frames come; a display that shows a message has far more of it at its toggling
rate than at the frequencies beside it, and a room has not.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from export.locate.quads import upright

Array = NDArray[np.float64]
Map = NDArray[np.float32]

SLOWEST = 3
"""Number of periods in a window below which no display is looked for: motion and exposure drift
slowly, displays do not."""
BESIDE = (2, 3, 4)
"""Numbers of periods by which the frequencies differ whose power tells what is usual: a wave that
does not fit the window leaks into the next ones."""
FINE_PX, COARSE_PX = 1.0, 4.0
"""Standard deviations, in pixels of the maps, of the band of sizes that is looked at."""
SMOOTH_PX = 7.0
"""Standard deviation, in pixels of the maps, over which power is averaged."""
CEILING = 1.5
"""Logarithm of power over the usual, above which more does not count."""
EVEN_PX = 9.0
"""Standard deviation, in pixels of the maps, over which that logarithm is averaged."""
LEAST_EXCESS = 0.25
"""Smallest averaged logarithm at which a place toggles; half of what the clearest places have is
needed as well."""
CLOSED_PX, OPENED_PX = 45, 31
"""Size, in pixels of the maps, of holes that are closed, and of specks that are dropped."""
FIT_PX = 4
"""Number of pixels of the map, along each axis, in one of the copy to which outlines are fitted."""
FIT_STEPS = (24.0, 12.0, 6.0, 3.0)
"""Distances, in pixels of the map, by which corners are tried to be moved."""
MOVES = np.array([[x, y] for x in (-1, 0, 1) for y in (-1, 0, 1) if x or y], float)
"""Directions in which corners are tried to be moved."""
FAINT = 0.12
"""Averaged logarithm above the usual one at which a place speaks for lying within the outline."""
LEAST_SHARE = 0.01
"""Smallest share of the image that a toggling display covers."""


class ToggleMap:
    """Sums up how much each pixel toggles at each frequency of a window of frames.

    Args:
        shape: height and width of the frames that will come.
        frames: number of frames in the window.
    """

    def __init__(self, shape: tuple[int, int], frames: int) -> None:
        self.frames = frames
        self._taken = 0
        self._numbers = np.arange(1, frames // 2 + 1)
        self._sums = np.zeros((len(self._numbers), 2, *shape), np.float32)
        self._logs: dict[int, Map] = {}

    def add(self, still: NDArray[np.uint8]) -> None:
        """Take the next frame, (h, w) uint8, aligned with those before."""
        image = np.asarray(still, np.float32)
        band = cv2.GaussianBlur(image, (0, 0), FINE_PX) - cv2.GaussianBlur(image, (0, 0), COARSE_PX)
        turns = 2 * np.pi * self._numbers * self._taken / self.frames
        for sums, turn in zip(self._sums, turns, strict=True):
            cv2.scaleAdd(band, float(np.cos(turn)), sums[0], dst=sums[0])
            cv2.scaleAdd(band, float(-np.sin(turn)), sums[1], dst=sums[1])
        self._taken += 1

    def outline(self, frequency: float) -> Array | None:
        """Outline what toggles at a frequency, in periods for each frame.

        Returns:
            (4, 2) pixels of the map, in corner order nearest to upright; None where nothing toggles
            there, or the window is not full.
        """
        at = round(frequency * self.frames) - 1
        if self._taken < self.frames or not SLOWEST - 1 <= at < len(self._sums):
            return None
        beside = {at + sign * step for step in BESIDE for sign in (-1, 1)}
        usual = np.mean(
            [self._power(number) for number in beside if 1 <= number < len(self._sums)], axis=0
        )
        over = np.clip(self._power(at) - usual, 0, CEILING)
        excess = cv2.GaussianBlur(over, (0, 0), EVEN_PX)
        usual_excess = float(np.median(excess))
        clear = max(LEAST_EXCESS, 0.5 * float(np.quantile(excess, 0.98)))
        gain = np.clip(excess - usual_excess - FAINT, -FAINT, 2 * FAINT)
        fits = [_fitted(start, gain) for start in _outlines(excess > clear)]
        if not fits:
            return None
        best, _ = max(fits, key=lambda fit: fit[1])
        return np.asarray(upright(best[None])[0])

    def _power(self, number: int) -> Map:
        """Logarithm of the smoothed power at one of the frequencies."""
        if number not in self._logs:
            power = cv2.GaussianBlur(cv2.magnitude(*self._sums[number]) ** 2, (0, 0), SMOOTH_PX)
            power += 0.05 * float(np.median(power)) + 1e-6
            self._logs[number] = np.asarray(np.log(power), np.float32)
        return self._logs[number]


def _outlines(mask: NDArray[np.bool_]) -> list[Array]:
    """Bound the largest part of a mask, specks dropped and holes closed.

    Returns:
        the smallest quadrilateral and the smallest rectangle around it, (4, 2) pixels each; none
        where no part is large enough.
    """
    margin = CLOSED_PX
    around = cv2.copyMakeBorder(
        mask.astype(np.uint8), margin, margin, margin, margin, cv2.BORDER_CONSTANT
    )
    ellipse = cv2.MORPH_ELLIPSE
    closed = cv2.morphologyEx(
        around, cv2.MORPH_CLOSE, cv2.getStructuringElement(ellipse, (CLOSED_PX, CLOSED_PX))
    )
    closed = cv2.morphologyEx(
        closed, cv2.MORPH_OPEN, cv2.getStructuringElement(ellipse, (OPENED_PX, OPENED_PX))
    )
    contours, _ = cv2.findContours(closed, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    if not contours:
        return []
    largest = max(contours, key=cv2.contourArea)
    if cv2.contourArea(largest) < LEAST_SHARE * mask.size:
        return []
    quad = cv2.approxPolyN(cv2.convexHull(largest), 4, ensure_convex=True)
    box = cv2.boxPoints(cv2.minAreaRect(largest))
    return [np.asarray(points, np.float64).reshape(4, 2) - margin for points in (quad, box)]


def _fitted(quad: Array, gain: Map) -> tuple[Array, float]:
    """Move the corners of a quadrilateral, one by one, while that adds to the sum within it.

    Args:
        quad: (4, 2) pixels of the map.
        gain: what each pixel adds.

    Returns:
        the corners, and the sum.
    """
    small = cv2.resize(gain, None, fx=1 / FIT_PX, fy=1 / FIT_PX, interpolation=cv2.INTER_AREA)
    mask = np.zeros(small.shape, np.uint8)

    def worth(corners: Array) -> float:
        if not cv2.isContourConvex(np.asarray(corners, np.float32)):
            return -np.inf
        mask[:] = 0
        fine = np.rint((corners / FIT_PX) * 16).astype(np.int32)
        cv2.fillConvexPoly(mask, fine, 1, shift=4)
        return float(small[mask > 0].sum())

    best, corners = worth(quad), quad.copy()
    for step in FIT_STEPS:
        improved = True
        while improved:
            improved = False
            for corner in range(4):
                for move in MOVES:
                    tried = corners.copy()
                    tried[corner] += step * move
                    now = worth(tried)
                    if now > best + 1e-6:
                        best, corners, improved = now, tried, True
    return corners, best
