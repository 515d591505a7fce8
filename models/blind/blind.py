"""Blind mode: without ratex patches, the message's own blocks calibrate the decoder.

The frames are registered, and each block is cut into tones, parts of similar captured intensity i.
A tone's mean change, in captured gray levels, is modelled as
    y = bit * s(i, x, y) + d(i, x, y) + noise
with s the signal, kappa seen through the CDTF, and d what changes whatever the bits: drift of
exposure and black level, banding, motion and blur left between the frames. Both are linear in
unknowns that have Gaussian priors. The bits are unknown too: expectation maximisation alternates
between their probabilities and the unknowns, from several starts, and the likeliest end wins.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from link.frames import SoftBits
from link.observation import Observation
from link.types import Array
from models.blind.tones import Tones, cut_into_tones

SHARE = 0.1
"""Share of a block at which two errors of a tone are equal. In smaller tones the noise of their
pixels prevails, in larger tones an error that their pixels have in common."""
NOISE_FLOOR = 0.3
"""Standard deviation of the noise that does not pass the CDTF, from the sensor and from rounding,
relative to the noise that does, from the picture and the display."""
SIGNAL_BEND = (0.5, 0.35, 0.25)
"""Prior standard deviations of s from `slope`, relative, for terms of degree 1, 2 and 3 of the
intensity. Over the cameras and views of data_gen they are 0.2 to 0.5."""
SIGNAL_TILT = 0.15
"""Prior standard deviation of s from `slope`, relative, for terms that are linear over the display,
such as the viewing angle and vignetting make."""
SIGNAL_SPREAD = 0.15
"""Relative standard deviation of the signal between blocks of one intensity, which differ in colour
and viewing angle."""
OFFSET, GAIN, CURVE = 3.0, 8.0, 3.0
"""Prior standard deviations of d, in gray levels: for a shift of black, for a shift of white (3 %
of the exposure), and for a bend between them."""
UNEVEN, BANDS = 0.5, 0.5
"""Prior standard deviations of how d varies over the display, in gray levels: smoothly, and from
one row of blocks to the next."""
MOTION_PX, BLUR_PX = 0.15, 0.1
"""Prior standard deviations of the motion and of the blur that registration left, in pixels."""
LEAST_SIGNAL = 0.1
"""Smallest amplitude of the signal, in gray levels. Even a kappa of 1 at 70 degrees is captured as
more."""
LEAST_SLOPE = 0.15
"""Smallest s, relative to what `slope` alone predicts; a bit 1 is brighter at every intensity."""
BALANCES = (0.15, 0.3, 0.5, 0.7, 0.85)
"""Shares of zeros among the bits from which the iteration starts."""
EM_ROUNDS = 12
"""Number of rounds of expectation maximisation from each start."""
COVERED_DEVIATIONS = 8.0
"""Number of standard deviations at which a block counts half, because a pointer or a reflection
seems to cover it. At 6, the few ones among many zeros (1 in 20) would be taken for that."""


def slope(i: Array) -> Array:
    """Give the usual slope of a CDTF where it yields an intensity, relative to its steepest.

    A display's glare and a camera's toe flatten the dark end, a camera's shoulder the bright end.

    Args:
        i: captured intensities in [0, 1], any shape.

    Returns:
        slopes in (0, 1], with the shape of ``i``.

    >>> slope(np.array([0.0, 0.5, 1.0])).round(2)
    array([0.27, 1.  , 0.27])
    """
    return np.asarray(2 * np.sqrt((np.clip(i, 0, 1) + 0.02) * (1.02 - np.clip(i, 0, 1))) / 1.04)


def signal_terms(tones: Tones) -> Array:
    """Build the terms of s for a signal of one gray level: (blocks, TONES, 6).

    The coefficients of all terms but the first have a prior standard deviation of 1.
    """
    h, t = slope(tones.i), 2 * tones.i - 1
    legendre = (t, 1.5 * t**2 - 0.5, 2.5 * t**3 - 1.5 * t)
    bends = [deviation * h * p for deviation, p in zip(SIGNAL_BEND, legendre, strict=True)]
    return np.stack([h, *bends, SIGNAL_TILT * h * tones.x, SIGNAL_TILT * h * tones.y], axis=-1)


def change_terms(tones: Tones) -> Array:
    """Build the terms of d: (blocks, TONES, N), with a prior standard deviation of 1 each."""
    i, x, y, h = tones.i, tones.x, tones.y, slope(tones.i)
    terms = [OFFSET * np.ones_like(i), GAIN * i, CURVE * i * i, CURVE * h, CURVE * h * (2 * i - 1)]
    light = 0.3 + 0.7 * i  # of uneven light, part adds (glare) and part multiplies
    terms += [UNEVEN * light * p for p in (x, y, x * y, x * x - 1 / 3, y * y - 1 / 3)]
    terms += [BANDS * light * (tones.row == row)[:, None] for row in np.unique(tones.row)]
    for gradient in (tones.gradient_x, tones.gradient_y):
        terms += [MOTION_PX * gradient * p for p in (np.ones_like(x), x, y)]
    return np.stack([*terms, BLUR_PX * tones.curvature], axis=-1)


@dataclass(frozen=True)
class BlindFit:
    """Result of expectation maximisation from one start."""

    scores: Array
    """(blocks,) natural log odds that the bit is 1."""
    likelihood: float
    """Penalised log likelihood, which can be compared between starts."""


def log_odds(amplitude: Array, variance: Array) -> Array:
    """Compute log p(amplitude | 1) - log p(amplitude | 0).

    The amplitude of a bit 1 is Normal(1, v + SIGNAL_SPREAD^2), that of a bit 0 is Normal(0, v). The
    wider class would win far below 0 too; there the odds stay at their least.

    Args:
        amplitude: change of each block, relative to the change that a bit 1 makes.
        variance: v, the variance of a bit 0's amplitude, with the shape of ``amplitude``.
    """
    wide = variance + SIGNAL_SPREAD**2
    a = np.maximum(amplitude, -variance / SIGNAL_SPREAD**2)
    return np.asarray((a**2 / variance - (a - 1) ** 2 / wide - np.log(wide / variance)) / 2)


def fit(tones: Tones, p: Array, keep: Array) -> BlindFit:
    """Run expectation maximisation from one start.

    Args:
        tones: averages over the tones of a frame pair.
        p: (blocks,) probability that each bit is 1, with which the iteration starts.
        keep: (blocks,) weights in (0, 1], small where a block seems to be covered.
    """
    h, change = slope(tones.i), tones.change
    S, n_s = signal_terms(tones), 6
    # a swapped pair darkens its ones: d may be as large as s, which has bits for its sign
    D = np.concatenate([S, change_terms(tones)], axis=-1)
    X = np.concatenate([S, D], axis=-1)
    trust = tone_reliability(tones)
    block, tone = np.nonzero(tones.share > 0)  # small blocks have few of the tones
    S_there, D_there = S[block, tone], D[block, tone]
    change_there, trust_there = change[block, tone], trust[block, tone]
    level = block_level(tones)
    high, low = (w @ level / (w.sum() + 1e-9) for w in (keep * p, keep * (1 - p)))
    size = max(float(high - low), LEAST_SIGNAL)  # of the signal, gray levels
    s = size * h
    noise = 0.1 * np.mean((trust * s * s).sum(axis=1))  # variance of a block, relative to 1 / trust
    for _ in range(EM_ROUNDS):
        # maximise: Gaussian unknowns given the bits' probabilities
        one = keep * p
        prior = np.ones(X.shape[-1])  # inverse variances
        prior[: 2 * n_s] = size**-2
        prior[0] = 1e-6
        J = (trust * s * s).sum(axis=1)
        scatter = SIGNAL_SPREAD**2 / (1 + SIGNAL_SPREAD**2 * J / noise) / noise**2
        sX = np.einsum("bk,bkp->bp", trust * s, X)
        sy = (trust * s * change).sum(axis=1)
        weighted_S = S_there * (trust_there * (one / noise)[block])[:, None]
        weighted_D = D_there * (trust_there * (keep / noise)[block])[:, None]
        SD = weighted_S.T @ D_there
        A = np.block([[weighted_S.T @ S_there, SD], [SD.T, weighted_D.T @ D_there]])
        b = np.concatenate([weighted_S.T @ change_there, weighted_D.T @ change_there])
        A -= (sX * (one * scatter)[:, None]).T @ sX
        b -= (one * scatter * sy) @ sX
        unknowns = np.linalg.solve(A + np.diag(prior), b)
        s = S @ unknowns[:n_s]
        size = max(float((trust * h * s).sum() / (trust * h * h).sum()), LEAST_SIGNAL)
        s = np.maximum(s, LEAST_SLOPE * size * h)
        # expect: the bits, from each block's amplitude in units of its signal
        J = (trust * s * s).sum(axis=1)
        amplitude = (trust * s * (change - D @ unknowns[n_s:])).sum(axis=1) / J
        spread = 1 + J * SIGNAL_SPREAD**2 / noise
        squares = J * np.stack([amplitude**2, (amplitude - 1) ** 2 / spread])
        keep = 1 / (1 + squares.min(axis=0) / (COVERED_DEVIATIONS**2 * noise))
        one, zero = keep * p, keep * (1 - p)
        total = 0.2 * J.mean() + zero @ squares[0] + one @ squares[1]
        noise = max(float(total / (2 + (zero + one / spread).sum())), 1e-3)
        share = (p.sum() + 2) / (p.size + 4)
        odds = log_odds(amplitude, noise / J)
        scores = odds + np.log(share / (1 - share))
        p = 1 / (1 + np.exp(-np.clip(scores, -40, 40)))
    mixture = np.logaddexp(np.log(1 - share), np.log(share) + odds) - squares[0] / noise / 2
    mixture = np.logaddexp(mixture, -(COVERED_DEVIATIONS**2) / 2)
    mixture -= np.log(noise) / 2  # a density in units that no start changes
    penalty = (prior[1:] * unknowns[1:] ** 2).sum() / 2
    return BlindFit(scores, float(mixture.sum() - penalty))


def tone_reliability(tones: Tones) -> Array:
    """Compute (blocks, TONES) inverse variances of each tone's change, up to a common factor."""
    return tones.share / (tones.share + SHARE) / (slope(tones.i) + NOISE_FLOOR) ** 2 + 1e-9


def block_level(tones: Tones) -> Array:
    """Compute the (blocks,) change of each block, in captured gray levels at the steepest slope."""
    h, trust = slope(tones.i), tone_reliability(tones)
    return np.asarray((trust * h * tones.change).sum(axis=1) / (trust * h * h).sum(axis=1))


def starts(tones: Tones) -> Iterator[tuple[Array, Array]]:
    """Yield the starts of `fit`, each a pair (p, keep): one for every balance of the bits.

    Blocks beyond Tukey's outer fences may be covered, or be the few ones among many zeros. Where
    there are any, a second set of starts treats them as covered.
    """
    level = block_level(tones)
    low, high = np.quantile(level, (0.25, 0.75))
    reach = 3 * (high - low)
    fenced = np.clip(level, low - reach, high + reach)
    for part in [level] if (fenced == level).all() else [level, fenced]:
        for balance in BALANCES:
            z = (part - np.quantile(part, balance)) / (part.std() / 4 + 1e-6)
            yield 1 / (1 + np.exp(-np.clip(z, -40, 40))), (part == level) + 1e-3


@dataclass(frozen=True)
class Blind:
    """Decode without ratex patches, kappa, the picture, or the balance of the bits."""

    def decode(self, pair: Observation) -> SoftBits:
        """Score every message block of a frame pair, in natural log odds."""
        tones = cut_into_tones(pair)
        ends = [fit(tones, p, keep) for p, keep in starts(tones)]
        return SoftBits(max(ends, key=lambda end: end.likelihood).scores)
