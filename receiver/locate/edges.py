"""What an image shows along the sides of a quadrilateral: evidence for a display, and its edges."""

import cv2
import numpy as np
from numpy.typing import NDArray

from link.robust import MAD_TO_SIGMA, geman_mcclure_weights, reweighted, ridge_solution
from receiver.locate.quads import signed_areas

SAMPLES = 24
"""Number of places along a side where the image is looked at for `side_features`:
each stands for 4 % of the side. `receiver.locate.candidates.WEIGHTS`
were fitted with it."""
AHEAD = np.concatenate([np.linspace(-0.15, -0.03, 8), np.linspace(1.03, 1.15, 8)])
"""Places beyond a side's ends, in lengths of the side from its start: what bounds a display ends at
its corners."""
SIDE_START, SIDE_SHARE = 0.03, 0.94
"""Distance of the first place from the side's start, and length over which the places are spread,
both in lengths of the side. A corner may be off by 3 % of the side, and no place must lie beyond
the corner at its other end."""
REACH = 5
"""Number of pixels of the small image that are looked at on each side of an edge. Chosen by
hand."""
SNAP_SAMPLES = 40
"""Number of places along a side that vote where whole sets of quadrilaterals snap to edges. Chosen
by hand."""
FIT_SAMPLES = 96
"""Number of places along a side through which a line is fitted. The line's error falls with the
root of their number, and the work grows with it. Chosen by hand."""
STEP_LEVELS = 10.0
"""Smallest step, in gray levels, that counts as an edge in an image whose white is at 200 or more;
less in a darker one. Chosen by hand."""
NOISE_SLOPE, SATURATION_SLOPE = 0.7, 4.0
"""Gradient, in levels per pixel, up to which a place does not vote, and gradient above that at
which it has half a vote. So a strong edge in the picture does not outvote a weak one along the
whole side. Chosen by hand."""
OTHER_SIDE = 1.5
"""Factor by which an edge that is darker inside must have more votes than another to be preferred,
because lit displays are mostly brighter than what is around them. Chosen by hand."""
WHITE_QUANTILE = 0.95
"""Quantile of the image's levels that counts as white, but for some levels more: a
lamp or a reflection should cover less than the rest, 5 % of the image."""
RIM_PX = -2.5
"""Distance from the sides of a display, in pixels along the inward normal, at which its rim is
measured: the middle of the `REACH` pixels outside, clear of the blur of the edge."""
CONTENT_SCALES, BEYOND_SCALE = (0.85, 0.6, 0.3), 1.12
"""Factors by which a quadrilateral shrinks to where its content is looked at, and grows to where
its surroundings are. `receiver.locate.candidates.WEIGHTS` were fitted
with these."""
PEAK_STEPS = 2.01
"""Largest distance of a gradient's peak from where it may be, in distances of the samples: two, and
a little for rounding."""
MIN_EDGE_SHARE = 0.2
"""Smallest share of a side's places that must lie on the fitted line. A hand or
glare may hide most of a side. Chosen by hand."""


def inward(quads: NDArray[np.float64]) -> NDArray[np.float64]:
    """Give the unit normals, (N, 4, 2), that point from the sides into clockwise quadrilaterals."""
    along = np.roll(quads, -1, axis=1) - quads
    along = along / (np.linalg.norm(along, axis=2, keepdims=True) + 1e-9)
    return np.stack([-along[..., 1], along[..., 0]], axis=-1)


def side_places(samples: int) -> NDArray[np.float64]:
    """Spread ``samples`` places evenly along a side, from 0.03 to 0.97 of its length."""
    return np.asarray((np.arange(samples) + 0.5) / samples * SIDE_SHARE + SIDE_START)


PLACES, CONTENT_PLACES, SNAP_PLACES = map(side_places, (SAMPLES, 12, SNAP_SAMPLES))
"""Places along a side, in lengths of it, at which edges are looked at, and what lies well inside;
and at which edges are sought that sides snap to."""


def profiles(
    image: NDArray[np.uint8] | NDArray[np.float32],
    quads: NDArray[np.float64],
    offsets: NDArray[np.float64],
    share: NDArray[np.float64],
) -> NDArray[np.float32]:
    """Sample the image across the sides of quadrilaterals.

    Args:
        image: (H, W) or (H, W, channels) uint8 or float32; levels of uint8 are rounded.
        quads: (N, 4, 2) pixels, clockwise.
        offsets: (K,) pixels along the inward normal.
        share: (S,) places along a side, where 0 is its start and 1 its end.

    Returns:
        (N, 4, S, K) float32, with a last axis of channels where the image has one.
    """
    start, end = quads[:, :, None], np.roll(quads, -1, axis=1)[:, :, None]
    at = start + (end - start) * share[None, None, :, None]  # (N, 4, S, 2)
    at = at[:, :, :, None] + inward(quads)[:, :, None, None] * offsets[:, None]
    flat = at.reshape(len(quads), -1, 2).astype(np.float32)  # cv2.remap takes < 32768 rows
    taken = cv2.remap(
        image, flat[..., 0], flat[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    return np.asarray(taken.reshape(*at.shape[:-1], *image.shape[2:]), np.float32)


def side_features(small: NDArray[np.uint8], quads: NDArray[np.float64]) -> NDArray[np.float64]:
    """Measure what speaks for each quadrilateral being a lit display.

    Args:
        small: (h, w, 3) uint8, encoded RGB.
        quads: (N, 4, 2) in its pixels.

    Returns:
        (N, 9) float64: the share of places along the sides that are brighter inside, and that of
        the second weakest side; the share that is darker; picture against the darkest of the rim
        outside; evenness of the rim's colour; picture against what lies beyond; root of the share
        of the image; steps beside the sides, and on their continuation beyond the corners, where a
        display ends.
    """
    image = small.astype(np.float32)
    red, green, blue = cv2.split(image)
    value = cv2.max(cv2.max(red, green), blue) / 2 + (red + green + blue) / 6
    height, width = value.shape
    white = float(np.quantile(value[::3, ::3], WHITE_QUANTILE)) + 10
    unit = STEP_LEVELS * (0.3 + 0.7 * min(1.0, white / 200))
    v = profiles(value, quads, np.arange(-REACH, REACH + 1.0), PLACES)  # (N, 4, S, 2R+1)
    inside = v[..., REACH + 1 : REACH + 4].mean(axis=(1, 2, 3))
    rim_level = v[..., REACH - 4 : REACH].min(axis=-1).mean(axis=(1, 2))
    near = v[..., REACH + 1] - v[..., REACH - 1]
    wide = v[..., REACH + 2] - v[..., REACH - 2]
    step = np.where(np.abs(wide) > np.abs(near), wide, near)
    falls = np.sort((step > unit).mean(axis=2), axis=1)  # (N, 4): inside is brighter
    beside = np.abs(v[..., 2:] - v[..., :-2])[..., [0, 1, 2 * REACH - 3, 2 * REACH - 2]]
    ahead = profiles(value, quads, np.array([-1.5, 1.5]), AHEAD)
    goes_on = np.abs(ahead[..., 1] - ahead[..., 0]) > unit
    rim = profiles(image, quads, np.array([RIM_PX]), PLACES)[..., 0, :]  # (N, 4, S, 3)
    uneven = np.abs(rim - np.median(rim, axis=(1, 2), keepdims=True)).mean(axis=(1, 2, 3))
    beyond = profiles(value, _grown(quads, BEYOND_SCALE), np.zeros(1), PLACES).mean(axis=(1, 2, 3))
    content = sum(
        profiles(value, _grown(quads, scale), np.zeros(1), CONTENT_PLACES).mean(axis=(1, 2, 3)) / 3
        for scale in CONTENT_SCALES
    )
    return np.column_stack([
        falls.mean(axis=1),
        falls[:, 1],
        (step < -unit).mean(axis=(1, 2)),
        (inside - rim_level) / (inside + rim_level + 10),
        -np.log(uneven / white + 0.02),
        (content - beyond) / (content + beyond + 10),
        np.sqrt(np.abs(signed_areas(quads)) / (width * height)),
        (beside > unit).mean(axis=(1, 2, 3)),
        goes_on.mean(axis=(1, 2)),
    ])  # fmt: skip


def _grown(quads: NDArray[np.float64], factor: float) -> NDArray[np.float64]:
    """Scale quadrilaterals (N, 4, 2) about the mean of their corners."""
    centre = quads.mean(axis=1, keepdims=True)
    return np.asarray(centre + factor * (quads - centre))


def snap_to_edges(
    image: NDArray[np.float32], quads: NDArray[np.float64], reach: float
) -> NDArray[np.float64]:
    """Move each side to the straight edge that most of it shows, in steps of a pixel.

    Every pair of offsets at a side's two ends is tried; the votes of places along the side are
    saturated, so that glare, or a hand before part of it, moves nothing. Only edges that are
    bright inside count.

    Args:
        image: (H, W) float32 gray levels.
        quads: (N, 4, 2), clockwise.
        reach: pixels that a side may move at either end.

    Returns:
        (N, 4, 2); a side without any edge stays.
    """
    at, _, total = _votes(image, quads, reach, 1.0, SNAP_PLACES)
    best = total.reshape(len(quads), 4, -1).argmax(axis=2)
    none = total.reshape(len(quads), 4, -1).max(axis=2) < 0.1 * SNAP_SAMPLES
    first = np.where(none, 0.0, at[best // len(at)])
    last = np.where(none, 0.0, at[best % len(at)])
    return _moved(quads, first, last, reach)


def _votes(
    image: NDArray[np.float32],
    quads: NDArray[np.float64],
    reach: float,
    spacing: float,
    share: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float32], NDArray[np.float32]]:
    """Collect votes of (S,) places for lines from an offset at a side's start to one at its end.

    Returns:
        offsets (K,), slopes (N, 4, S, K) and votes (N, 4, K, K).
    """
    count = max(1, round(reach / spacing))
    offsets = np.arange(-count - 1.0, count + 2.0) * spacing
    taken = profiles(image, quads, offsets, share)
    slope = (taken[..., 2:] - taken[..., :-2]) / np.float32(2 * spacing)
    steps = np.arange(2 * count + 1)
    hit = steps[:, None, None] * (1 - share) + steps[None, :, None] * share  # (K, K, S)
    at_hit = np.rint(hit).astype(np.intp)
    vote = np.clip(slope - np.float32(NOISE_SLOPE), 0, None)
    vote = vote / (vote + np.float32(SATURATION_SLOPE))
    total = vote[:, :, np.arange(len(share)), at_hit].sum(axis=-1)
    # ties go to the line that moves least
    total -= np.float32(1e-3) * (np.abs(offsets[1:-1])[:, None] + np.abs(offsets[1:-1])).astype(
        np.float32
    )
    return offsets[1:-1], slope, total


def _moved(
    quads: NDArray[np.float64],
    first: NDArray[np.float64],
    last: NDArray[np.float64],
    reach: float,
) -> NDArray[np.float64]:
    """Move sides of (N, 4, 2) quadrilaterals inwards by (N, 4) px at their starts and ends."""
    normals = inward(quads)
    p = quads + normals * first[..., None]
    q = np.roll(quads, -1, axis=1) + normals * last[..., None]
    one = np.ones((*first.shape, 1))
    lines = np.cross(np.concatenate([p, one], axis=-1), np.concatenate([q, one], axis=-1))
    meet = np.cross(np.roll(lines, 1, axis=1), lines)  # corner s: side s - 1 with side s
    safe = np.abs(meet[..., 2:]) > 1e-9
    moved = np.where(safe, meet[..., :2] / np.where(safe, meet[..., 2:], 1), quads)
    wild = np.abs(moved - quads).max(axis=(1, 2)) > 4 * reach + 1
    return np.asarray(np.where(wild[:, None, None], quads, moved))


def fit_edges(
    image: NDArray[np.float32], corners: NDArray[np.float64], reach: float
) -> NDArray[np.float64]:
    """Move each side of one quadrilateral to a straight edge, to sub-pixels.

    The edge that most of the side shows gets a line through the peaks of the image's gradient.
    Edges that are dark inside count where they are much clearer: a light bezel, or a white page.

    Args:
        image: (H, W) float32 gray levels.
        corners: (4, 2), clockwise.
        reach: pixels that a side may move at either end.

    Returns:
        corners (4, 2); a side without an edge stays where it was.
    """
    spacing = max(0.5, reach / 10)
    share = side_places(FIT_SAMPLES)
    at, slopes, total = _votes(image, corners[None], reach, spacing, share)
    _, darker, rises = _votes(-image, corners[None], reach, spacing, share)
    # a light bezel, or a white page around the picture
    other = rises.max(axis=(2, 3)) > OTHER_SIDE * total.max(axis=(2, 3))
    slopes = np.where(other[..., None, None], darker, slopes)
    total = np.where(other[..., None, None], rises, total)
    first, last = np.zeros(4), np.zeros(4)
    for side in range(4):
        start, end = np.unravel_index(int(total[0, side].argmax()), total.shape[2:])
        guess = at[start] * (1 - share) + at[end] * share
        peak, height = _peaks(slopes[0, side], at, guess, spacing)
        a, b, part = _fit_line(share, peak, height)
        if part >= MIN_EDGE_SHARE:
            first[side], last[side] = a, b
    return np.asarray(_moved(corners[None], first[None], last[None], reach)[0])


def _peaks(
    slope: NDArray[np.float32],
    at: NDArray[np.float64],
    guess: NDArray[np.float64],
    spacing: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Find (S,) offsets of the gradient's peaks nearest the guess, to sub-pixels, and heights."""
    rows = np.arange(len(slope))
    window = np.abs(at[None] - guess[:, None]) <= PEAK_STEPS * spacing
    k = np.clip(np.where(window, slope, -np.inf).argmax(axis=1), 1, len(at) - 2)
    low, mid, high = slope[rows, k - 1], slope[rows, k], slope[rows, k + 1]
    bend = low - 2 * mid + high
    is_peak = (mid >= low) & (mid >= high) & (mid > 1.0) & (bend < 0)
    shift = np.where(is_peak, (low - high) / (2 * np.where(bend < 0, bend, -1)), 0.0)
    return at[k] + shift * spacing, np.where(is_peak, mid, 0.0)


def _fit_line(
    share: NDArray[np.float64], peak: NDArray[np.float64], height: NDArray[np.float64]
) -> tuple[float, float, float]:
    """Fit a line through the peaks, robustly.

    Returns:
        its offsets at both ends of the side, and the share of peaks that lie on it; zeros where
        there is no peak.
    """
    live = height > 0
    weight = height / (height + SATURATION_SLOPE)
    if weight.sum() < 1e-6:
        return 0.0, 0.0, 0.0
    A = np.stack([1 - share, share])

    def spread(residuals: NDArray[np.float64]) -> float:
        return max(0.1, MAD_TO_SIGMA * float(np.median(residuals[live])))

    def residuals_of(solution: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.abs(peak - solution @ A)

    solution, _ = reweighted(
        solve=lambda robust: ridge_solution(A.T, peak, weight * robust, 1e-6 * np.eye(2)),
        residuals_of=residuals_of,
        scale_of=lambda residuals: 1.5 * spread(residuals),
        rounds=6,
        weights=np.ones(len(peak)),
        weigh=geman_mcclure_weights,
    )
    residuals = residuals_of(solution)
    used = float(((residuals < 3 * spread(residuals)) & live).mean())
    return float(solution[0]), float(solution[1]), used
