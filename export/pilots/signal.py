"""How strongly blocks at the pilots' places toggle with the pilots' signs.

A pilot is a block whose bit is known, so the sign with which it toggles is known too: from one
state of the display to the next, all pilots of bit 1 change one way and all of bit 0 the other way.
Whether a quadrilateral of the image is the display, which way up it is, and which grid it shows
follows from how well its blocks keep to these signs. Rate and phase need not be known.
"""

from collections.abc import Sequence
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from export.pilots.waves import MOST_SPAN, span_of, waves
from link.images import as_gray, intensity
from link.layout import Layout
from link.types import Array, Image

LEAST_DEVIATION = 0.3
"""Gray levels added to a block's standard deviation over time before values are divided by it."""
OUTLIER = 2.5
"""Largest change of a pilot from one photograph to another that counts, in medians over the pilots,
so that a few edges of a picture that moved do not hide the others."""
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


def pilot_signs(layout: Layout) -> Array:
    """Signs with which the pilots toggle, (pilots,) of 1 and -1.

    >>> from link.layout import make_layout
    >>> pilot_signs(make_layout(4, 4, modulation="antipodal", pilots=4)).sum()
    np.float64(0.0)
    """
    return np.asarray(2.0 * layout.pilot_bits - 1)


@lru_cache(maxsize=16)
def expected_changes(layout: Layout) -> Array:
    """Expected changes of the blocks, (rows, cols): the pilots' signs, 0 elsewhere."""
    blocks = np.zeros(layout.rows * layout.cols)
    blocks[layout.pilot_blocks] = pilot_signs(layout)
    return blocks.reshape(layout.rows, layout.cols)  # (blocks,) -> (rows, cols)


def pilot_centres(layout: Layout) -> Array:
    """Give the centres (x, y) of the pilots on the display, (pilots, 2) in [0, 1]."""
    rows, cols = np.divmod(layout.pilot_blocks, layout.cols)
    return np.stack([(cols + 0.5) / layout.cols, (rows + 0.5) / layout.rows], axis=1)


def standing_out(gray: NDArray[np.generic], layout: Layout) -> NDArray[np.float32]:
    """Measure by how much each block is brighter than its neighbourhood of 3 x 3 blocks.

    Args:
        gray: (H, W) of any type and size, the rectified display.
        layout: says how many blocks there are.

    Returns:
        (rows, cols) in the levels of ``gray``.
    """
    blocks = cv2.resize(
        np.asarray(gray, np.float32), (layout.cols, layout.rows), interpolation=cv2.INTER_AREA
    )
    return np.asarray(blocks - cv2.blur(blocks, (3, 3)), np.float32)


def pilot_values(view: Image, layout: Layout) -> NDArray[np.float32]:
    """Measure by how much each pilot is brighter than its neighbourhood of 3 x 3 blocks.

    Args:
        view: an `Image`, the rectified display.
        layout: layout with pilots.

    Returns:
        (pilots,) gray levels.
    """
    blocks = standing_out(as_gray(view), layout)
    return blocks.reshape(-1)[layout.pilot_blocks]  # (rows, cols) -> (blocks,)


def pilots_toggled(original: Image, embedded: Image, layout: Layout) -> float:
    """Tell how surely the pilots of one frame pair changed as their bits say.

    Args:
        original: an `Image`, the rectified display.
        embedded: an `Image` of the shape of ``original``.
        layout: layout with pilots.

    Returns:
        mean change along the pilots' signs, in its standard errors: by chance within 3 of 0 but for
        one pair in a few hundred; below 0 where the frames are in the other order.

    >>> from link.embed import embed
    >>> from link.layout import make_layout
    >>> layout = make_layout(16, 16, modulation="antipodal", pilots=40)
    >>> gray = np.full((layout.height, layout.width, 3), 128, np.uint8)
    >>> shown = embed(gray, np.arange(layout.n_bits) % 2, layout, kappa=3)
    >>> pilots_toggled(shown.original, shown.embedded, layout) > 10
    True
    """
    change = 255 * (intensity(embedded, layout.colour) - intensity(original, layout.colour))
    changes = standing_out(change, layout).reshape(-1)[layout.pilot_blocks]
    most = OUTLIER * float(np.median(np.abs(changes)))
    along = np.clip(changes, -most, most) * pilot_signs(layout)
    return float(along.mean() / (along.std() / np.sqrt(along.size) + 1e-9))


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

    At each frequency the values have complex amplitudes X_p, whose phases may slope across the
    display (`PHASE_SLOPES`); they are turned back first. Without the display, signs and amplitudes
    have nothing to do with each other, whatever moves or flickers in the image, in one phase or in
    many. So the signs s_p are regressed on the real and the imaginary parts of X_p: by chance these
    explain the share R2 of the signs' power, or more, with probability (1 - R2)^((P - 2) / 2), for
    P pilots. The largest share over all frequencies and slopes is taken, and their number is paid
    for. That holds whenever the frames were taken: chance is in the pilots' signs, not in time. The
    frequencies are those of whole periods in the time that the frames cover, up to the fastest that
    the camera can see, so that more are paid for where frames are missing in between.

    Args:
        values: T arrays (P,), one for each of T frames.
        layout: with P pilots.
        at: (T,) positions of the frames (`export.pilots.waves.position`), rising; without
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
    series = np.asarray(values[-len(taken) :], np.float64)
    series = series - series.mean(axis=0)
    series /= series.std(axis=0) + LEAST_DEVIATION
    lines = made @ series
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
