"""How strongly blocks at the pilots' places toggle with the pilots' signs.

A pilot is a block whose bit is known, so the sign with which it toggles is known too: from one
state of the display to the next, all pilots of bit 1 change one way and all of bit 0 the other way.
Whether a quadrilateral of the image is the display, which way up it is, and which grid it shows
follows from how well its blocks keep to these signs. Rate and phase need not be known.
"""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from link.images import as_gray
from link.layout import Layout

Array = NDArray[np.float64]

LEAST_DEVIATION = 0.3
"""Gray levels added to a block's standard deviation over time before values are divided by it."""
SLOWEST = 2
"""Number of periods in a window below which a frequency is not looked at: motion and exposure drift
slowly, the display does not."""


def pilot_signs(layout: Layout) -> Array:
    """Signs with which the pilots toggle, (pilots,) of 1 and -1.

    >>> from link.layout import make_layout
    >>> pilot_signs(make_layout(4, 4, modulation="antipodal", pilots=4)).sum()
    np.float64(0.0)
    """
    return np.asarray(2.0 * layout.pilot_bits - 1)


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


def pilot_values(view: NDArray[np.uint8], layout: Layout) -> NDArray[np.float32]:
    """Measure by how much each pilot is brighter than its neighbourhood of 3 x 3 blocks.

    Args:
        view: (H, W) or (H, W, 3) uint8, encoded, the rectified display.
        layout: with pilots.

    Returns:
        (pilots,) gray levels.
    """
    blocks = standing_out(as_gray(view), layout)
    return blocks.reshape(-1)[layout.pilot_blocks]  # (rows, cols) -> (blocks,)


def pilot_evidence(values: Sequence[NDArray[np.floating]], signs: Array) -> tuple[float, float]:
    """Tell how surely values over time toggle with the signs, at any one frequency.

    At each frequency the values have complex amplitudes X_p. Without the display, signs and
    amplitudes have nothing to do with each other, whatever moves or flickers in the image, in one
    phase or in many. So the signs s_p are regressed on the real and the imaginary parts of X_p: by
    chance these explain the share R2 of the signs' power, or more, with probability
    (1 - R2)^((P - 2) / 2), for P pilots. The largest share over all frequencies is taken, and the
    number of them is paid for.

    Args:
        values: T arrays (P,), one for each of T evenly spaced frames.
        signs: (P,) of 1 and -1.

    Returns:
        evidence: natural logarithm of the probability that chance does as well, with the sign
            turned, so that more is surer; 0 at least.
        frequency: at which it was found, in periods for each frame.

    >>> rng, signs = np.random.default_rng(0), np.resize([1.0, -1.0], 40)
    >>> noise = rng.standard_normal((24, 40))
    >>> wave = np.sign(np.cos(np.pi * (np.arange(24) + 0.5) / 2))
    >>> evidence, frequency = pilot_evidence(list(noise + wave[:, None] * signs), signs)
    >>> evidence > 25, frequency
    (True, 0.25)
    >>> pilot_evidence(list(noise), signs)[0] < 6
    True
    """
    series = np.asarray(values, np.float64)
    series = series - series.mean(axis=0)
    series /= series.std(axis=0) + LEAST_DEVIATION
    lines = np.fft.rfft(series, axis=0)[SLOWEST:]
    if not len(lines):
        return 0.0, 0.0
    real, imaginary = lines.real, lines.imag
    little = 1e-9 * (np.abs(lines) ** 2).sum(axis=1) + 1e-12
    rr, ii = (real**2).sum(axis=1) + little, (imaginary**2).sum(axis=1) + little
    ri = (real * imaginary).sum(axis=1)
    a, b = real @ signs, imaginary @ signs
    share = (a**2 * ii - 2 * a * b * ri + b**2 * rr) / (rr * ii - ri**2) / len(signs)
    best = int(share.argmax())
    unexplained = max(1 - float(share[best]), 1e-12)
    chance = (len(signs) - 2) / 2 * float(np.log(unexplained)) + float(np.log(len(lines)))
    return max(0.0, -chance), (best + SLOWEST) / len(series)
