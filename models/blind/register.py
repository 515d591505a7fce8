"""Registration of a rectified frame pair: a whole-pixel start, then a homography to sub-pixels.

Corners that are off by a few pixels, or a camera that moved, leave the embedded frame shifted and
slightly distorted against the original. Both searches look at edges alone, so that neither the
message's blocks nor a change of exposure counts as motion.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from link.images import intensity
from link.robust import MAD_TO_SIGMA, reweighted, ridge_solution
from link.types import Homography, Image

REACH_PX = 8
"""Largest shift on each axis, in pixels, that `whole_pixel_shift` considers."""
EDGE_SIGMA_PX = 3.0
"""Standard deviation, in pixels, of the blur that the high-pass takes away. It is below any block's
side, so that blocks leave only thin seams."""
MIN_CORRELATION = 0.3
"""Smallest correlation of the frames' edges at which a shift is believed; unrelated frames of
100 x 100 pixels reach about 0.1."""
PYRAMID_LEVELS = 4
"""Number of levels of the image pyramid. The coarsest has an eighth of the size, where corners that
are wrong by 8 px are wrong by 1 px, which a linear step can undo."""
NEWTON_STEPS = 4
"""Number of Gauss-Newton steps on each level."""
MIN_PYRAMID_SIDE_PX = 48
"""Smallest side, in pixels, of an image of the pyramid: 16 times `EDGE_SIGMA_PX`."""
MOTION_RIDGE = 1e-7
"""Weight per pixel, in squared intensity, with which least squares holds the motion at 0, so that
flat pictures stay where they are."""
ROBUST = MAD_TO_SIGMA * 2
"""Residual at which a pixel counts half, in median absolute residuals: 2 standard deviations."""


def high_pass(image: NDArray[np.float32]) -> NDArray[np.float32]:
    """Take away what is smoother than `EDGE_SIGMA_PX`, so that edges remain.

    Args:
        image: (H, W) float32.

    Returns:
        (H, W) float32, about zero on average.
    """
    smooth = cv2.GaussianBlur(image, (0, 0), EDGE_SIGMA_PX, borderType=cv2.BORDER_REFLECT)
    return np.asarray(image - smooth, np.float32)


def whole_pixel_shift(original: Image, embedded: Image) -> tuple[int, int]:
    """Find how far the embedded frame lies from the original, in whole pixels.

    The shift of largest normalised correlation of the frames' edges.

    Args:
        original: an `Image`.
        embedded: an `Image` of the same height and width.

    Returns:
        (dy, dx), each within `REACH_PX`, such that embedded[y + dy, x + dx] shows what
        original[y, x] shows. (0, 0) where it is unsure: the frames are small or flat, or correlate
        weakly, or best at the end of the reach.
    """
    height, width = original.shape[:2]
    if min(height, width) < 6 * REACH_PX:
        return 0, 0
    fixed, moving = high_pass(intensity(original)), high_pass(intensity(embedded))
    inner = fixed[REACH_PX : height - REACH_PX, REACH_PX : width - REACH_PX]
    if min(float(inner.std()), float(moving.std())) < 1e-3:  # a quarter of a gray level
        return 0, 0
    scores = cv2.matchTemplate(moving, inner, cv2.TM_CCOEFF_NORMED)
    y, x = np.unravel_index(int(np.argmax(scores)), scores.shape)
    at_end = {int(y), int(x)} & {0, 2 * REACH_PX}
    if at_end or scores[y, x] < MIN_CORRELATION:
        return 0, 0
    return int(y) - REACH_PX, int(x) - REACH_PX


def _step(
    fixed: NDArray[np.float32], moved: NDArray[np.float32], inside: NDArray[np.bool_]
) -> Homography:
    """Take one robust Gauss-Newton step (Lucas & Kanade 1981).

    The change is taken as motion times gradient, plus a change of contrast that is no motion.

    Returns:
        homography on coordinates in [-1, 1], from the original to where ``moved`` shows it.
    """
    height, width = fixed.shape
    mean = (fixed + moved) / 2
    gx = cv2.Sobel(mean, cv2.CV_32F, 1, 0, scale=width / 16)  # per unit of u
    gy = cv2.Sobel(mean, cv2.CV_32F, 0, 1, scale=height / 16)
    v, u = np.meshgrid(centred(height), centred(width), indexing="ij")
    x, y, u, v, i, change = (
        map_[inside].astype(np.float64) for map_ in (gx, gy, u, v, mean, moved - fixed)
    )
    radial = -(x * u + y * v)
    A = np.stack([x, x * u, x * v, y, y * u, y * v, radial * u, radial * v, i])
    ridge = MOTION_RIDGE * change.size * np.eye(len(A))
    solution, _ = reweighted(
        solve=lambda weights: ridge_solution(A.T, change, weights, ridge),
        residuals_of=lambda solution: np.abs(change - solution @ A),
        scale_of=lambda residuals: ROBUST * float(np.median(residuals)) + 1e-6,
        rounds=2,
        weights=np.ones_like(change),
    )
    a = np.clip(solution, -0.25, 0.25)  # and so the matrix can be inverted
    return np.array([[1 + a[1], a[2], a[0]], [a[4], 1 + a[5], a[3]], [a[6], a[7], 1.0]])


def centred(length: int) -> NDArray[np.float64]:
    """Pixel centres along one axis on which the frame spans [-1, 1]."""
    return (2 * np.arange(length) + 1) / length - 1


def _warp(
    image: NDArray[np.float32], H: NDArray[np.float64]
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Sample the image at H x, and tell where that lies inside; ``H`` on coordinates in [-1, 1]."""
    height, width = image.shape[:2]
    x, y = 2 / width, 2 / height
    to_centred = np.array([[x, 0, x / 2 - 1], [0, y, y / 2 - 1], [0, 0, 1.0]])
    pixels = np.linalg.inv(to_centred) @ H @ to_centred
    flags, size = cv2.WARP_INVERSE_MAP, (width, height)
    warped = cv2.warpPerspective(
        image, pixels, size, flags=flags | cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE
    )
    inside = cv2.warpPerspective(np.ones((height, width), np.uint8), pixels, size, flags=flags)
    return np.asarray(warped, np.float32), np.asarray(inside > 0)


def align_frames(original: Image, embedded: Image) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Move the embedded frame onto the original, by a homography found on a pyramid of their luma.

    Args:
        original: an `Image`.
        embedded: an `Image` of the same height and width.

    Returns:
        (moved, inside): the embedded frame's intensity where the original shows the same, (H, W)
        float32 in [0, 1], encoded; and (H, W) bool, false where the embedded frame ends. It stays
        where it was if moving brings the edges no closer.
    """
    fixed, moving = intensity(original), intensity(embedded)
    height, width = fixed.shape
    dy, dx = whole_pixel_shift(original, embedded)
    H = np.array([[1, 0, 2 * dx / width], [0, 1, 2 * dy / height], [0, 0, 1.0]])
    for level in reversed(range(PYRAMID_LEVELS)):
        size = (width >> level, height >> level)
        if min(size) < MIN_PYRAMID_SIDE_PX:
            continue
        small = [cv2.resize(image, size, interpolation=cv2.INTER_AREA) for image in (fixed, moving)]
        for _ in range(NEWTON_STEPS):
            moved, inside = _warp(small[1], H)
            H = H @ np.linalg.inv(_step(high_pass(small[0]), high_pass(moved), inside))
    everywhere = np.ones(fixed.shape, bool)
    moved, inside = _warp(moving, H)
    target, before, after = (high_pass(image) for image in (fixed, moving, moved))
    if inside.mean() < 0.5 or _misfit(target, after, inside) >= _misfit(target, before, everywhere):
        return moving, everywhere
    return moved, inside


def _misfit(
    fixed: NDArray[np.float32], moved: NDArray[np.float32], inside: NDArray[np.bool_]
) -> float:
    """Mean absolute difference of what lies inside."""
    return float(np.abs(fixed - moved)[inside].mean())
