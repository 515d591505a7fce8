"""Waves at the times of a camera's frames, with which amplitudes are measured.

Cameras drop frames, and a receiver that is too slow does, too. So the frames of a window need not
be evenly spaced: each has a position, its time in nominal frames of the camera. An amplitude is the
sum of the frames' values times a wave at these positions. Where the frames are evenly spaced, waves
of whole periods do not see anything slower than themselves; where they are not, they would. So
what is slow, as motion and exposure are, is taken out of the waves themselves.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from link.types import Array

FINE_STEP = 1 / 4
"""Step to which positions are rounded, in nominal frames, so that evenly spaced frames come out as
evenly spaced: files often hold times in whole milliseconds, an eighth of a frame at 240 a second.
At two frames a period, the fastest wave, the rounding costs at most a twelfth of the amplitude."""
FAINT_SINE = 0.1
"""Power of a wave's imaginary part, as a share of the real part's, below which it is left out: at
two frames a period it vanishes, and what rounding leaves of it shows only noise. Chosen by hand."""
MOST_SPAN = 1200
"""Largest number of nominal frames that are looked at together; frames that were taken before are
left out. It bounds the work: ten seconds at 120 frames a second, and windows are much shorter."""
SPARE = 0.25
"""Number of periods that may be missing in the span of a window for its fastest wave: half a frame,
at two frames a period. Chosen by hand."""


def position(seconds: float, fps: float) -> float:
    """Tell the position of a frame from its time.

    Args:
        seconds: since the window's first frame.
        fps: nominal number of frames of the camera in a second.

    Returns:
        nominal frames, rounded to `FINE_STEP`.

    >>> position(0.1, 30.0), position(0.033, 30.0), position(0.05, 30.0)
    (3.0, 1.0, 1.5)
    """
    return round(seconds * fps / FINE_STEP) * FINE_STEP


def span_of(at: Sequence[float] | Array) -> tuple[float, int]:
    """Tell how much time a window covers.

    Args:
        at: (T,) positions of its frames, rising.

    Returns:
        span: number of nominal frames that the window covers, T where no frame is missing.
        fastest: number of periods in it of the fastest wave that the camera can tell from a
            slower one when it misses no frame.

    >>> span_of([0, 1, 2, 3, 4, 5]), span_of([0, 3, 4, 9])
    ((6.0, 3), (10.0, 5))
    """
    places = np.asarray(at, np.float64)
    if len(places) < 2:
        return float(len(places)), 0
    step = min(1.0, max(FINE_STEP, float(np.median(np.diff(places)))))
    span = float(places[-1] - places[0]) + step
    return span, int(span / step / 2 + SPARE)


def waves(at: Sequence[float] | Array, frequencies: Array, slower: Array) -> NDArray[np.complex128]:
    """Make waves at the positions of frames that see nothing of slower waves.

    Args:
        at: (T,) positions.
        frequencies: (F,) of the waves, in periods for each nominal frame.
        slower: (S,) frequencies of slower waves, 0 among them, which are taken out.

    Returns:
        (F, T) complex: by these, the values of the frames are multiplied, and then added up.
    """
    places = np.asarray(at, np.float64) - at[0]
    made = np.exp(-2j * np.pi * np.outer(frequencies, places))
    turns = 2 * np.pi * np.outer(slower, places)
    slow = np.concatenate([np.cos(turns), np.sin(turns)]).T
    known, *_ = np.linalg.lstsq(slow, made.T, rcond=1e-6)
    made = made - (slow @ known).T
    sine, cosine = (made.imag**2).sum(axis=1), (made.real**2).sum(axis=1)
    made[sine < FAINT_SINE * cosine] = made.real[sine < FAINT_SINE * cosine]
    return np.asarray(made)
