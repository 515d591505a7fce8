"""Measure how strongly blocks at the pilots' places toggle with the pilots' signs.

A pilot is a block whose bit is known, so the sign with which it toggles is known too: from one
state of the display to the next, all pilots of bit 1 change one way and all of bit 0 the other way.
Whether a quadrilateral of the image is the display, which way up it is, and which grid it shows
follows from how well its blocks keep to these signs. Rate and phase need not be known.
"""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from link.layout import Layout
from link.pilots import pilot_centres, pilot_signs
from link.robust import MAD_TO_SIGMA
from link.types import Array
from receiver.pilots.waves import MOST_SPAN, span_of, waves

LEAST_DEVIATION = 0.3
"""Gray levels added to a block's standard deviation over time before values are divided by it: the
rounding to whole levels has a deviation of 0.29, so a block that shows nothing else does not count
as much as one that toggles."""
NEAR = 3
"""Number of frames before each frame, and after it, whose mean is taken off what it shows: the
picture, which may move, and exposure change little in that time. Chosen by hand."""
CLIPPED = 1.5
"""Largest difference from that mean that counts, in usual ones of its place: a cut or something
that passes is one bad difference, and no more. Chosen by hand among 1 to 3 on seven simulated films
of moving pictures."""
LIMIT = 0.5
"""Amplitude of a place, relative to the median of all places, from which larger ones count for
hardly more: where a picture moves, few places have most of the power. Chosen by hand among 0.5, 1
and 2 on seven simulated films of moving pictures."""
SLOWEST = 2
"""Number of periods in a window below which a frequency is not looked at: motion and exposure drift
slowly, the display does not."""
PHASE_STEPS = np.pi / 2 * np.arange(-3, 4)
"""Differences of phase across the display, in radians, that are tried: camera and panel go through
their rows one after the other, so that one side toggles later than the other."""
PHASE_SLOPES = np.array(
    [(0.0, step) for step in PHASE_STEPS] + [(step, 0.0) for step in PHASE_STEPS if step]
)
"""(slopes, 2) differences of phase from left to right and from top to bottom, radians."""


@lru_cache(maxsize=16)
def less_near_frames(count: int) -> Array:
    """Make the matrix that takes the mean of the frames within `NEAR` off each frame.

    Args:
        count: number of frames, T.

    Returns:
        (T, T), by which (T, P) values are multiplied from the left.
    """
    frames = np.arange(count)
    near = np.abs(frames - frames[:, None]) <= NEAR
    return np.asarray(np.eye(count) - near / near.sum(axis=1, keepdims=True))


def clipped_changes(values: NDArray[np.floating]) -> tuple[Array, Array]:
    """Take what changes slowly off values over time, and bound what is left by `CLIPPED`.

    Args:
        values: (T, P) gray levels of P places in T frames.

    Returns:
        changes: (T, P) gray levels.
        usual: (P,) the usual change of each place, by the median over time, gray levels.
    """
    changes = less_near_frames(len(values)) @ np.asarray(values, np.float64)
    usual = MAD_TO_SIGMA * np.median(np.abs(changes), axis=0) + LEAST_DEVIATION
    return np.clip(changes, -CLIPPED * usual, CLIPPED * usual), usual


def limited(amplitudes: NDArray[Any]) -> NDArray[Any]:
    """Bound amplitudes, so that strong ones do not outweigh all others; signs and phases stay.

    Args:
        amplitudes: (..., P) real or complex amplitudes of P places.

    Returns:
        amplitudes of at most 1, in the shape of ``amplitudes``.

    >>> limited(np.array([0.0, 1.0, -1.0, 100.0])).round(2).tolist()
    [0.0, 0.89, -0.89, 1.0]
    """
    usual = np.median(np.abs(amplitudes), axis=-1, keepdims=True)
    return np.asarray(amplitudes / np.sqrt(np.abs(amplitudes) ** 2 + (LIMIT * usual) ** 2 + 1e-12))


@lru_cache(maxsize=16)
def signed_phases(layout: Layout) -> NDArray[np.complex128]:
    """Factors that bring all pilots into one phase if their phases have a slope of `PHASE_SLOPES`.

    Args:
        layout: layout with pilots.

    Returns:
        (slopes, pilots) complex: the pilots' signs, turned back by the phase at their places.
    """
    places = pilot_centres(layout) - 0.5
    return np.asarray(pilot_signs(layout) * np.exp(-1j * PHASE_SLOPES @ places.T))


def pilot_evidence(
    values: Sequence[NDArray[np.floating]], layout: Layout, at: Sequence[float] | None = None
) -> tuple[float, float]:
    """Tell how surely values over time toggle with the pilots' signs, at any one frequency.

    What changes slowly is taken off, and large changes are bounded (`clipped_changes`), as a
    picture that moves brings them. At each frequency the values have complex amplitudes X_p,
    bounded (`limited`), whose phases may slope across the display (`PHASE_SLOPES`); they are turned
    back first. Without the display, signs and amplitudes have nothing to do with each other,
    whatever moves or flickers in the image, in one phase or in many. So the signs s_p are regressed
    on the real and the imaginary parts of X_p: by chance these explain the share R2 of the signs'
    power, or more, with probability (1 - R2)^((P - 2) / 2), for P pilots. The largest share over
    all frequencies and slopes is taken, and their number is paid for. That holds whenever the
    frames were taken: chance is in the pilots' signs, not in time. The frequencies are those of
    whole periods in the time that the frames cover, up to the fastest that the camera can see, so
    that more are paid for where frames are missing in between.

    Args:
        values: T arrays (P,), one for each of T frames.
        layout: with P pilots.
        at: (T,) positions of the frames (`receiver.pilots.waves.position`), rising; without
            them, the frames are evenly spaced.

    Returns:
        evidence: natural logarithm of the probability that chance does as well, with the sign
            turned, so that more is surer; 0 at least.
        frequency: frequency at which it was found, in periods for each nominal frame.

    >>> from link.layout import make_layout
    >>> layout = make_layout(16, 16, modulation="antipodal", pilots=40)
    >>> noise = np.random.default_rng(0).standard_normal((24, 40))
    >>> wave = np.sign(np.cos(np.pi * (np.arange(24) + 0.5) / 2))
    >>> evidence, frequency = pilot_evidence(noise + wave[:, None] * pilot_signs(layout), layout)
    >>> evidence > 20, frequency
    (True, 0.25)
    >>> pilot_evidence(noise, layout)[0] < 6
    True
    """
    places = tuple(range(len(values)) if at is None else at)
    taken = tuple(place for place in places if place > places[-1] - MOST_SPAN)
    made, span = _whole_waves(taken)
    if not len(made):
        return 0.0, 0.0
    series, _ = clipped_changes(np.asarray(values[-len(taken) :]))
    series -= series.mean(axis=0)
    series /= series.std(axis=0) + LEAST_DEVIATION
    lines = limited(made @ series)
    turned = signed_phases(layout)
    # of the turned amplitudes Z: sums of s Z, of Z Z and of |Z|^2, each (slopes, frequencies)
    along, squares = turned @ lines.T, turned**2 @ (lines**2).T
    power = (np.abs(lines) ** 2).sum(axis=1) * (1 + 1e-9) + 1e-12
    rr, ii, ri = (power + squares.real) / 2, (power - squares.real) / 2, squares.imag / 2
    a, b = along.real, along.imag
    apart = np.maximum(rr * ii - ri**2, 1e-10 * power**2)
    share = (a**2 * ii - 2 * a * b * ri + b**2 * rr) / apart / layout.pilots
    best = int(share.max(axis=0).argmax())
    unexplained = max(1 - float(share.max()), 1e-12)
    chance = (layout.pilots - 2) / 2 * float(np.log(unexplained)) + float(np.log(share.size))
    return max(0.0, -chance), (best + SLOWEST) / span


@lru_cache(maxsize=4)
def _whole_waves(at: tuple[float, ...]) -> tuple[NDArray[np.complex128], float]:
    """Make the waves of whole periods in the time of some positions, from `SLOWEST` periods on.

    Returns:
        (F, T) the waves, and the number of nominal frames that the positions cover.
    """
    span, fastest = span_of(at)
    numbers = np.arange(SLOWEST, fastest + 1)
    if not len(numbers):
        return np.zeros((0, len(at)), np.complex128), span
    return waves(at, numbers / span, np.arange(SLOWEST) / span), span


def common_phase(amplitudes: NDArray[np.complexfloating], layout: Layout) -> tuple[Array, float]:
    """Find the phase in which the pilots toggle, and by how much it slopes across the display.

    Args:
        amplitudes: (pilots,) of the pilots at one frequency.
        layout: layout with pilots.

    Returns:
        slope: (2,) differences of phase from left to right and from top to bottom, radians; one of
            `PHASE_SLOPES`.
        phase: phase of a pilot of bit 1 at the centre of the display, radians.
    """
    along = signed_phases(layout) @ amplitudes
    best = int(np.abs(along).argmax())
    return PHASE_SLOPES[best], float(np.angle(along[best]))
