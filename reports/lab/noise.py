"""Estimators for real and simulated captures alike: noise by level, cubic CDTF, moire."""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from link.frames import Captured
from link.images import intensity

Array = NDArray[np.floating]
"""Numbers of any shape."""
HIGH_PASS_PX = 2.0
"""Standard deviation, in pixels, of the blur that is subtracted before noise is estimated."""
FLAT = 2.0
"""Steepest gradient, in gray levels a pixel, of pixels whose noise counts: elsewhere
misregistration shows."""
LEVELS = tuple(range(16, 256, 32))
"""Centres of the bins of captured gray levels; a bin reaches 16 levels to either side."""
MIN_PIXELS = 300
"""Number of pixels that a bin needs for its noise to be stated."""
TILE = 64
"""Side of the tiles in which moire is looked for, pixels."""
FLATTEST = 0.1
"""Share of the lit tiles in which ripple is measured: those that vary least as displayed."""
LIT = (64, 224)
"""Least and largest mean displayed level of a lit tile: black shows no moire."""
BLUR_PX = 3.0
"""Standard deviation, in pixels, of the blur before a CDTF is fitted: what is left of
misalignment and moire averages out."""


def at_captured_scale(captured: Captured) -> tuple[Array, Array]:
    """Rectify both frames at about one pixel a captured pixel.

    Returns:
        (H, W) luma of the original and of the embedded frame, in [0, 255].
    """
    sides = np.linalg.norm(np.roll(captured.corners, -1, axis=0) - captured.corners, axis=1)
    layout = replace(
        captured.layout,
        width=round((sides[0] + sides[2]) / 2),
        height=round((sides[1] + sides[3]) / 2),
    )
    pair = replace(captured, layout=layout).rectified()
    return 255.0 * intensity(pair.original), 255.0 * intensity(pair.embedded)


def _blur(image: Array, sigma: float) -> Array:
    return np.asarray(cv2.GaussianBlur(image.astype(np.float32), (0, 0), sigma), np.float64)


def passed_share(sigma: float) -> float:
    """Standard deviation that is left of white noise of 1 when its Gaussian blur is subtracted.

    >>> round(passed_share(2.0), 3)
    0.97
    """
    impulse = np.zeros((65, 65))
    impulse[32, 32] = 1.0
    return float(np.sqrt(np.sum((impulse - _blur(impulse, sigma)) ** 2)))


def noise_by_level(original: Array, embedded: Array) -> dict[int, float]:
    """Estimate the noise of one frame by captured level.

    It is half the variance of the frames' difference, high-passed (which removes message, drift and
    shading), by the median absolute deviation over flat pixels.

    Args:
        original: (H, W) luma in [0, 255], encoded.
        embedded: the same shape, registered to it.

    Returns:
        standard deviation, in gray levels, at those of `LEVELS` that have enough pixels.
    """
    difference = embedded - original
    high = difference - _blur(difference, HIGH_PASS_PX)
    smooth = _blur(original, HIGH_PASS_PX)
    flat = np.hypot(*np.gradient(smooth)) < FLAT
    scale = 1.4826 / np.sqrt(2) / passed_share(HIGH_PASS_PX)
    noise = {}
    for level in LEVELS:
        chosen = high[flat & (np.abs(smooth - level) < 16)]
        if chosen.size >= MIN_PIXELS:
            noise[level] = float(scale * np.median(np.abs(chosen - np.median(chosen))))
    return noise


@dataclass(frozen=True)
class CubicFit:
    """Captured luma as a cubic of displayed luma, both in [0, 255]."""

    coefficients: Array
    """(4,) coefficients of powers of rho / 255, the highest power first."""
    low: float
    """Least displayed level that the fit saw."""
    high: float
    """Largest displayed level that the fit saw."""
    r2: float
    """Share of the captured variance that the cubic explains, at most 1."""
    residual: float
    """Standard deviation of what the cubic leaves, gray levels."""

    def __call__(self, rho: Array) -> Array:
        """Captured levels of displayed levels; not a number outside what the fit saw."""
        seen = (rho >= self.low) & (rho <= self.high)
        return np.asarray(np.where(seen, np.polyval(self.coefficients, rho / 255), np.nan))


def fit_cubic(displayed: Array, captured: Array) -> CubicFit:
    """Fit a cubic by least squares over all pixels, after both images were blurred.

    Args:
        displayed: (H, W) luma in [0, 255], encoded.
        captured: luma of the same shape, aligned.
    """
    x, y = _blur(displayed, BLUR_PX).ravel(), _blur(captured, BLUR_PX).ravel()
    coefficients = np.polyfit(x / 255, y, 3)
    left = y - np.polyval(coefficients, x / 255)
    r2 = float(1 - left.var() / y.var())
    return CubicFit(coefficients, float(x.min()), float(x.max()), r2, float(left.std()))


def ripple(displayed: Array, captured: Array) -> float:
    """Measure what a camera adds to flat parts of a picture: moire, banding and noise.

    It is the standard deviation of the captured luma in those lit tiles where the displayed one
    varies least, with each tile's plane taken off; the median over those tiles.

    Args:
        displayed: (H, W) luma in [0, 255].
        captured: image of the same shape, aligned.

    Returns:
        gray levels.
    """
    tops = range(0, displayed.shape[0] - TILE + 1, TILE)
    lefts = range(0, displayed.shape[1] - TILE + 1, TILE)
    tiles = [np.s_[top : top + TILE, left : left + TILE] for top in tops for left in lefts]
    tiles = [tile for tile in tiles if LIT[0] < displayed[tile].mean() < LIT[1]]
    order = sorted(tiles, key=lambda tile: float(displayed[tile].std()))
    y, x = np.mgrid[0:TILE, 0:TILE].reshape(2, -1) / TILE  # (2, TILE, TILE) -> (2, N)
    plane = np.stack([np.ones_like(x), x, y], axis=1)
    left_over = []
    for tile in order[: max(1, round(FLATTEST * len(order)))]:
        values = captured[tile].reshape(-1).astype(np.float64)
        solution = np.linalg.lstsq(plane, values, rcond=None)[0]
        left_over.append(float((values - plane @ solution).std()))
    return float(np.median(left_over))
