"""Blind mode: no ratex patches; the message's own blocks calibrate the decoder.

The frames are registered, and each block is cut into tones, parts of similar captured intensity i.
A tone's mean change, in captured gray levels, is modelled as
    y = bit * s(i, x, y) + d(i, x, y) + noise
with s the signal, kappa seen through the CDTF, and d what changes whatever the bits: drift of
exposure and black level, banding, motion and blur left between the frames. Both are linear in
unknowns that have Gaussian priors. The bits are unknown too: expectation maximisation alternates
between their probabilities and the unknowns, from several starts, and the likeliest end wins.
"""

from dataclasses import dataclass
from typing import ClassVar

import cv2
import numpy as np
from numpy.typing import NDArray

from link.frames import Rectified, SoftBits
from link.layout import block_index
from link.register import align, gray

Array = NDArray[np.float64]

TONES = 12
"""Tones of a frame, equally many pixels in each; a CDTF's bend shows in less."""
RAMP = 0.25
"""Part of a block at each side over which pixels count less: corners are a few pixels off, a
message at a coarse pyramid level fades there, and s of the neighbours spills over."""
TEXTURE = 0.02
"""Gradient, in intensity per pixel, at which a pixel counts half: a tenth of a pixel of motion
then changes it by half a gray level."""
SHARE = 0.1
"""Of a block: below it a tone's error is its pixels' noise, above it an error common to them."""
NOISE_FLOOR = 0.3
"""Noise that does not pass the CDTF (sensor, 8 bits) relative to what does (picture, display)."""
SIGNAL_BEND = (0.5, 0.35, 0.25)
"""Prior deviation of s from `slope`, relative, by terms of degree 1, 2 and 3 of the intensity;
over the cameras and views of data_gen it is 0.2 to 0.5."""
SIGNAL_TILT = 0.15
"""The same, linear over the display: viewing angle and vignetting."""
SPREAD = 0.15
"""Relative deviation of the signal between blocks at one intensity: colours, viewing angle."""
OFFSET, GAIN, CURVE = 3.0, 8.0, 3.0
"""Prior deviations of d in gray levels: of black, of white (3 % of exposure), and of a bend."""
UNEVEN, BANDS = 0.5, 0.5
"""The same of d over the display: its smooth terms, and its terms of single block rows."""
MOTION_PX, BLUR_PX = 0.15, 0.1
"""Prior deviations of the motion and the blur that registration left, pixels."""
LEAST_SIGNAL = 0.1
"""Gray levels; the smallest kappa, 1, at 70 degrees is captured as more."""
LEAST_SLOPE = 0.15
"""Least s relative to what `slope` alone predicts: a bit 1 is brighter at every intensity."""
BALANCES = (0.15, 0.3, 0.5, 0.7, 0.85)
"""Shares of zeros among the bits from which the iteration starts."""
ITERATIONS = 12


@dataclass(frozen=True)
class Tones:
    """What is seen of each block's tones; arrays (blocks, TONES) but for ``row``."""

    change: Array
    """Mean change, embedded minus original, captured gray levels."""
    i: Array
    """Mean intensity of both frames, [0, 1]."""
    x: Array
    """Mean position in the frame, [-1, 1]; likewise ``y``."""
    y: Array
    gradient_x: Array
    """Mean d/dx of the intensity, gray levels per pixel; likewise ``gradient_y``."""
    gradient_y: Array
    curvature: Array
    """Mean Laplacian of the intensity, gray levels per square pixel."""
    share: Array
    """Of the block's weight; each block's sum is 1, or 0 where the embedded frame lacks it."""
    row: NDArray[np.intp]
    """(blocks,) row of the grid."""


def cut_into_tones(pair: Rectified) -> Tones:
    """Register the frames and average over the tones of each message block."""
    layout = pair.layout
    i_o = gray(pair.original)
    i_e, inside = align(pair.original, pair.embedded)
    i = (i_o + i_e) / 2
    smooth = cv2.GaussianBlur(i, (0, 0), 1.0)
    dx = cv2.Sobel(smooth, cv2.CV_32F, 1, 0, scale=1 / 8)
    dy = cv2.Sobel(smooth, cv2.CV_32F, 0, 1, scale=1 / 8)
    weights = _ramp(layout.height, layout.rows)[:, None] * _ramp(layout.width, layout.cols)
    weights = weights * inside / (1 + (dx * dx + dy * dy) / TEXTURE**2)

    edges = np.quantile(i, np.arange(1, TONES) / TONES)
    block = block_index(layout.height, layout.rows)[:, None] * layout.cols
    block = block + block_index(layout.width, layout.cols)
    cell = (block * TONES + np.searchsorted(edges, i, side="right")).ravel()
    message = layout.message_mask.ravel()

    def total(values: NDArray[np.float64]) -> Array:
        sums = np.bincount(cell, values.ravel(), minlength=message.size * TONES)
        return np.asarray(sums.reshape(-1, TONES)[message], np.float64)

    count = total(weights)

    def mean(values: NDArray[np.float32] | Array) -> Array:
        return total(weights * values) / (count + 1e-9)

    y, x = np.meshgrid(
        (2 * np.arange(layout.height) + 1) / layout.height - 1,
        (2 * np.arange(layout.width) + 1) / layout.width - 1,
        indexing="ij",
    )
    return Tones(
        change=255 * mean(i_e - i_o),
        i=mean(i),
        x=mean(x),
        y=mean(y),
        gradient_x=255 * mean(dx),
        gradient_y=255 * mean(dy),
        curvature=255 * mean(cv2.Laplacian(smooth, cv2.CV_32F)),
        share=count / (count.sum(axis=1, keepdims=True) + 1e-9),
        row=np.nonzero(layout.message_mask)[0],
    )


def _ramp(length: int, blocks: int) -> Array:
    """(length,) weights in (0, 1] that fall towards the edges of each block."""
    within = (np.arange(length) + 0.5) * blocks / length % 1
    return np.clip(np.minimum(within, 1 - within) / RAMP, 0.02, 1)


def slope(i: Array) -> Array:
    """Usual slope of a CDTF where it yields intensity ``i`` in [0, 1], relative to its steepest.

    A display's glare and a camera's toe flatten the dark end, a camera's shoulder the bright end.
    """
    return np.asarray(2 * np.sqrt((np.clip(i, 0, 1) + 0.02) * (1.02 - np.clip(i, 0, 1))) / 1.04)


def signal_terms(tones: Tones) -> Array:
    """Terms of s for a signal of one gray level, (blocks, TONES, 6); unit prior but the first."""
    h, t = slope(tones.i), 2 * tones.i - 1
    legendre = (t, 1.5 * t**2 - 0.5, 2.5 * t**3 - 1.5 * t)
    bends = [deviation * h * p for deviation, p in zip(SIGNAL_BEND, legendre, strict=True)]
    return np.stack([h, *bends, SIGNAL_TILT * h * tones.x, SIGNAL_TILT * h * tones.y], axis=-1)


def change_terms(tones: Tones) -> Array:
    """Terms of d, (blocks, TONES, N), each scaled to a unit prior."""
    i, x, y, h = tones.i, tones.x, tones.y, slope(tones.i)
    terms = [OFFSET * np.ones_like(i), GAIN * i, CURVE * i * i, CURVE * h, CURVE * h * (2 * i - 1)]
    light = 0.3 + 0.7 * i  # of uneven light, part adds (glare) and part multiplies
    terms += [UNEVEN * light * p for p in (x, y, x * y, x * x - 1 / 3, y * y - 1 / 3)]
    terms += [BANDS * light * (tones.row == row)[:, None] for row in range(tones.row.max() + 1)]
    for gradient in (tones.gradient_x, tones.gradient_y):
        terms += [MOTION_PX * gradient * p for p in (np.ones_like(x), x, y)]
    return np.stack([*terms, BLUR_PX * tones.curvature], axis=-1)


@dataclass(frozen=True)
class Fit:
    """Where one start of the iteration ended."""

    scores: Array
    """(blocks,) log odds that the bit is 1."""
    likelihood: float
    """Penalised log likelihood, comparable between starts."""


def log_odds(amplitude: Array, variance: Array) -> Array:
    """log p(amplitude | 1) - log p(amplitude | 0), for Normal(1, v + SPREAD^2) and Normal(0, v).

    The wider class would win far below 0 too; there the odds stay at their least.
    """
    wide = variance + SPREAD**2
    a = np.maximum(amplitude, -variance / SPREAD**2)
    return np.asarray((a**2 / variance - (a - 1) ** 2 / wide - np.log(wide / variance)) / 2)


def fit(tones: Tones, p: Array) -> Fit:
    """Iterate from (blocks,) probabilities ``p`` that each bit is 1."""
    h, change = slope(tones.i), tones.change
    S, n_s = signal_terms(tones), 6
    # a swapped pair darkens its ones: d may be as large as s, which has bits for its sign
    D = np.concatenate([S, change_terms(tones)], axis=-1)
    X = np.concatenate([S, D], axis=-1)
    trust = tones.share / (tones.share + SHARE) / (h + NOISE_FLOOR) ** 2  # (blocks, TONES)
    trust = trust + 1e-9
    XX = np.einsum("bkp,bkq->bpq", X * trust[..., None], X, optimize=True)
    Xy = np.einsum("bkp,bk->bp", X * trust[..., None], change, optimize=True)
    level = block_level(tones)
    high, low = (w @ level / (w.sum() + 1e-9) for w in (p, 1 - p))
    size = max(float(high - low), LEAST_SIGNAL)  # of the signal, gray levels
    s = size * h
    noise = 0.1 * np.mean((trust * s * s).sum(axis=1))  # variance of a block, relative to 1 / trust
    for _ in range(ITERATIONS):
        # maximise: Gaussian unknowns given the bits' probabilities
        prior = np.ones(X.shape[-1])  # inverse variances
        prior[: 2 * n_s] = size**-2
        prior[0] = 1e-6
        J = (trust * s * s).sum(axis=1)
        scatter = SPREAD**2 / (1 + SPREAD**2 * J / noise) / noise**2
        sX = np.einsum("bk,bkp->bp", trust * s, X)
        sy = (trust * s * change).sum(axis=1)
        A = np.tensordot(p / noise, XX, 1) - (sX * (p * scatter)[:, None]).T @ sX
        b = (p / noise) @ Xy - (p * scatter * sy) @ sX
        A[n_s:, n_s:] += np.tensordot((1 - p) / noise, XX[:, n_s:, n_s:], 1)
        b[n_s:] += ((1 - p) / noise) @ Xy[:, n_s:]
        unknowns = np.linalg.solve(A + np.diag(prior), b)
        s = S @ unknowns[:n_s]
        size = max(float((trust * h * s).sum() / (trust * h * h).sum()), LEAST_SIGNAL)
        s = np.maximum(s, LEAST_SLOPE * size * h)
        # expect: the bits, from each block's amplitude in units of its signal
        J = (trust * s * s).sum(axis=1)
        amplitude = (trust * s * (change - D @ unknowns[n_s:])).sum(axis=1) / J
        ones = p / (1 + J * SPREAD**2 / noise)
        squares = J * ((1 - p) * amplitude**2 + ones * (amplitude - 1) ** 2)
        noise = float((0.2 * J.mean() + squares.sum()) / (2 + (1 - p + ones).sum()))
        noise = max(noise, 1e-3)
        share = (p.sum() + 2) / (p.size + 4)
        odds = log_odds(amplitude, noise / J)
        scores = odds + np.log(share / (1 - share))
        p = 1 / (1 + np.exp(-np.clip(scores, -40, 40)))
    zero = -(np.log(noise) + amplitude**2 * J / noise) / 2  # density in units that no start changes
    mixture = zero + np.logaddexp(np.log(1 - share), np.log(share) + odds)
    penalty = (prior[1:] * unknowns[1:] ** 2).sum() / 2
    return Fit(scores, float(mixture.sum() - penalty))


def block_level(tones: Tones) -> Array:
    """(blocks,) change of each block in captured gray levels at the steepest of the CDTF."""
    h = slope(tones.i)
    trust = tones.share / (tones.share + SHARE) / (h + NOISE_FLOOR) ** 2 + 1e-9
    return np.asarray((trust * h * tones.change).sum(axis=1) / (trust * h * h).sum(axis=1))


@dataclass(frozen=True)
class Blind:
    """Decode without ratex patches, kappa, the picture or the balance of bits; see the module."""

    needs_ratex: ClassVar[bool] = False

    def decode(self, pair: Rectified) -> SoftBits:
        """Score every message block, in log odds."""
        tones = cut_into_tones(pair)
        level = block_level(tones)
        width = level.std() / 4 + 1e-6
        starts = (np.clip((level - np.quantile(level, q)) / width, -40, 40) for q in BALANCES)
        ends = [fit(tones, 1 / (1 + np.exp(-start))) for start in starts]
        return SoftBits(max(ends, key=lambda end: end.likelihood).scores)
