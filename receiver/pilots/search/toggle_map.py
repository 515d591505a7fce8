"""Map where in the image something toggles, which separates a display from the room around it.

Frames are held still by the camera's motion first. A block that goes up and down, or down and up,
as each bit says, has power in a wide band around its toggling rate, and none at twice that rate.
Noise has as much in the one place as in the other. The amplitudes of the pixels are summed up when
an outline is asked for: only then is it known which time the frames cover, and only where no edges
gave the display away.
"""

import math
from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from link.geometry import homography_from_corners, resized_homography, whole_factor
from link.steps import Steps
from link.types import Array, Corners, Map
from receiver.locate.quads import upright
from receiver.pilots.waves import span_of, waves

SLOWEST = 3
"""Number of periods in a window below which no display is looked for: motion and exposure drift
slowly, displays do not."""
BAND, QUIET = (0.55, 1.3), (1.85, 2.15)
"""Ends of the band in which toggling has power, and of that in which it has none, as multiples of
the toggling rate. A block that goes up or down in each pair, as random bits say, has the spectrum
of a Manchester code, which is strongest a little below its rate and has a zero at twice it."""
BAND_WAVES, QUIET_WAVES = 4, 2
"""Largest number of frequencies at which power is measured in either band. They bound the work;
chosen by hand."""
MEASURED = 2
"""Number of frequencies at which power is measured in one step, which then takes about as long as
other steps of the search. Chosen by hand."""
STACKED = 16
"""Number of frames that are added up at once: more would be as quick, but for their memory."""
FINE_PX, COARSE_PX = 1.0, 4.0
"""Standard deviations, in pixels of the maps, of the band of sizes that is looked at: that of
blocks, between the noise of pixels and what exposure and shadows change. Chosen by hand."""
SMOOTH_PX, LEAST_POWER = 7.0, 0.05
"""Standard deviation, in pixels of the maps, over which power is averaged, and the share of its
median that is added everywhere: several blocks, so that power is even within a display, and a
little where nothing moves at all. Chosen by hand."""
CEILING = 1.5
"""Logarithm of power over the usual, above which more does not count: one bright flicker must not
lift its surroundings. Chosen by hand."""
EVEN_PX = 9.0
"""Standard deviation, in pixels of the maps, over which the logarithm of power over the usual is
averaged. Chosen by hand; `FAINT` allows for what it spreads."""
CLEAR_QUANTILE = 0.98
"""Quantile of the excess, over all parts of the image, of which half is clear toggling: a display
of 2 % of the image still holds the highest parts. Chosen by hand."""
LEAST_EXCESS = 0.25
"""Smallest averaged logarithm at which a place toggles; half of what the clearest places have is
needed as well. Chosen by hand."""
CLOSED_PX, OPENED_PX = 45, 31
"""Size, in pixels of the maps, of holes that are closed, and of specks that are dropped: dark parts
of a picture hardly toggle. Chosen by hand."""
FIT_PX = 4
"""Number of pixels of the map, along each axis, in one of the copy to which outlines are fitted:
the last of `FIT_STEPS` is finer than that, and sums cost a sixteenth. Chosen by hand."""
FIT_STEPS = (24.0, 12.0, 6.0, 3.0)
"""Distances, in pixels of the map, by which corners are tried to be moved: each half the last
one, from the rounding of a corner by `CLOSED_PX` down. Chosen by hand."""
MOVES = np.array([[x, y] for x in (-1, 0, 1) for y in (-1, 0, 1) if x or y], float)
"""Directions in which corners are tried to be moved."""
FAINT, EDGE_SHARE = 0.12, 0.25
"""A place speaks for lying within the outline if its averaged logarithm is above the usual one by
`FAINT`, or by `EDGE_SHARE` of what is usual where something toggles clearly, if that is more:
averaging spreads the toggling over the display's edges. Chosen by hand."""
LEAST_SHARE = 0.01
"""Smallest share of the image that a toggling display covers: twice that of
`receiver.pilots.search.film.LEAST_AREA`, since averaging spreads it. Chosen by hand."""


class ToggleMap:
    """Tells how much each pixel toggles at each frequency, over the frames that were added."""

    def __init__(self) -> None:
        self._stills: list[NDArray[np.uint8]] = []
        self._at: list[float] = []
        self._shrunk: dict[int, list[NDArray[Any]]] = {}
        self._logs: dict[int, Map] = {}

    def add(self, still: NDArray[np.uint8], at: float) -> None:
        """Take the next frame.

        Args:
            still: (h, w) uint8, aligned with those before.
            at: position of the frame (`receiver.pilots.waves.position`).
        """
        self._stills.append(still)
        self._at.append(at)
        self._logs = {}

    def mean(self) -> NDArray[np.uint8]:
        """Average all frames so far, (h, w) uint8, rounded down."""
        return np.asarray(np.mean(self._stills, axis=0, dtype=np.float32), np.uint8)

    def outline(self, frequency: float) -> Steps[Corners | None]:
        """Outline what toggles at a frequency, in periods for each nominal frame, in steps.

        Returns:
            pixels of the map, turned the way that is nearest to upright; None where nothing toggles
            there, or the frames do not cover enough time.
        """
        span, fastest = span_of(self._at)
        band = _spread(frequency * span, BAND, fastest, BAND_WAVES)
        quiet = _spread(frequency * span, QUIET, fastest, QUIET_WAVES)
        if not band or not quiet:
            return None
        numbers = sorted({*band, *quiet} - set(self._logs))
        for first in range(0, len(numbers), MEASURED):
            self._measure(span, numbers[first : first + MEASURED])
            yield 1
        power, usual = (
            np.mean([self._logs[number] for number in numbers], axis=0) for numbers in (band, quiet)
        )
        over = np.asarray(np.clip(power - usual, -CEILING, CEILING), np.float32)
        excess = cv2.GaussianBlur(over, (0, 0), EVEN_PX)
        usual_excess = float(np.median(excess))
        clear = max(LEAST_EXCESS, 0.5 * float(np.quantile(excess, CLEAR_QUANTILE)))
        toggling = excess[excess > clear]
        level = float(np.median(toggling)) if toggling.size else 0.0
        edge = max(FAINT, EDGE_SHARE * (level - usual_excess))
        gain = np.clip((excess - usual_excess) / edge - 1, -1, 2)
        size = [max(1, round(side / FIT_PX)) for side in gain.shape[::-1]]
        gain = np.asarray(cv2.resize(gain, size, interpolation=cv2.INTER_AREA), np.float32)
        fits = [_fitted(start, gain) for start in _outlines(excess > clear)]
        if not fits:
            return None
        best, _ = max(fits, key=lambda fit: fit[1])
        return np.asarray(upright(best[None])[0])

    def views(
        self, quads: Sequence[Array], width: int, height: int, turn: int = 0, first: int = 0
    ) -> NDArray[Any]:
        """Show what a quadrilateral bounds in frames, (frames, height, width).

        Args:
            quads: (4, 2) pixels of the map: one for all frames, or one for each of the first ones.
            width: width of the views, pixels.
            height: height of the views, pixels.
            turn: number of quarter turns after which they are upright.
            first: number of the first frame that is shown.
        """
        factor = whole_factor(np.roll(quads[0], -turn, axis=0), width, height)
        copies = self._copies(factor)
        H_copy_from_still = np.linalg.inv(resized_homography(factor, factor))
        places = [*quads] * len(copies) if len(quads) == 1 else quads
        how, size = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP, (width, height)
        views = []
        for copy, quad in zip(copies[first:], places[first:], strict=False):
            corners = np.roll(quad, -turn, axis=0)
            H = H_copy_from_still @ homography_from_corners(corners, width, height)
            view = cv2.warpPerspective(copy, H, size, flags=how, borderMode=cv2.BORDER_REPLICATE)
            views.append(view)
        return np.array(views)

    def _copies(self, factor: int) -> Sequence[NDArray[Any]]:
        """Average all stills down by a whole factor, without rounding; 1 leaves them."""
        shrunk = self._stills if factor == 1 else self._shrunk.setdefault(factor, [])
        for still in self._stills[len(shrunk) :]:
            rows, cols = (side // factor for side in still.shape)
            whole = np.float32(still[: rows * factor, : cols * factor])
            shrunk.append(cv2.resize(whole, (cols, rows), interpolation=cv2.INTER_AREA))
        return shrunk

    def _measure(self, span: float, numbers: list[int]) -> None:
        """Find the logarithm of the smoothed power where a window holds some numbers of periods."""
        weights = waves(self._at, np.array(numbers) / span, np.arange(SLOWEST - 1) / span)
        parts = np.concatenate([weights.real, weights.imag]).astype(np.float32)
        sums = np.zeros((len(parts), *self._stills[0].shape), np.float32)
        for first in range(0, len(self._stills), STACKED):
            some = slice(first, first + STACKED)
            sums += np.tensordot(parts[:, some], np.array(self._stills[some], np.float32), axes=1)
        for number, real, imaginary in zip(numbers, *np.split(sums, 2), strict=True):
            power = cv2.GaussianBlur(_band(real) ** 2 + _band(imaginary) ** 2, (0, 0), SMOOTH_PX)
            power += LEAST_POWER * float(np.median(power)) + 1e-6
            self._logs[number] = np.asarray(np.log(power), np.float32)


def _spread(rate: float, ends: tuple[float, float], fastest: int, most: int) -> list[int]:
    """Choose numbers of periods that are spread evenly over a band.

    Args:
        rate: number of periods of the toggling.
        ends: ends of the band, as multiples of ``rate``.
        fastest: largest number that the frames can tell.
        most: number of them that is enough.

    Returns:
        at most ``most`` numbers, rising; none where the band holds no number from `SLOWEST` on.
    """
    low, high = max(SLOWEST, math.ceil(ends[0] * rate)), min(fastest, math.floor(ends[1] * rate))
    if high < low:
        return []
    return sorted({round(number) for number in np.linspace(low, high, most)})


def _band(image: NDArray[np.floating]) -> Map:
    """Keep details of the sizes between `FINE_PX` and `COARSE_PX`."""
    fine, coarse = (cv2.GaussianBlur(image, (0, 0), size) for size in (FINE_PX, COARSE_PX))
    return np.asarray(fine - coarse, np.float32)


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


def _sum_within(quad: Array, gain: Map) -> float:
    """Sum a map, `FIT_PX` times smaller, within (4, 2) pixels; minus infinity if not convex."""
    if not cv2.isContourConvex(np.asarray(quad, np.float32)):
        return -np.inf
    mask = np.zeros(gain.shape, np.uint8)
    fine = np.rint((quad / FIT_PX) * 16).astype(np.int32)
    cv2.fillConvexPoly(mask, fine, 1, shift=4)
    return float(gain[mask > 0].sum())


def _fitted(quad: Array, gain: Map) -> tuple[Array, float]:
    """Move the corners of a quadrilateral, one by one, while that adds to the sum within it.

    Args:
        quad: (4, 2) pixels of the map.
        gain: what each pixel adds, in a map `FIT_PX` times smaller.

    Returns:
        the corners, and the sum.
    """
    best, corners = _sum_within(quad, gain), quad.copy()
    for step in FIT_STEPS:
        improved = True
        while improved:
            improved = False
            for corner in range(4):
                for move in MOVES:
                    tried = corners.copy()
                    tried[corner] += step * move
                    now = _sum_within(tried, gain)
                    if now > best + 1e-6:
                        best, corners, improved = now, tried, True
    return corners, best
