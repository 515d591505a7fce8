"""Which states of a display that runs free a camera's rows collect, and in what shares.

State k is sent to the display from k / state_hz on. The panel writes its rows from the top one to
the bottom one during ``scan_s``, and each pixel's light follows with a first-order lag,
    s(t) = 1 - exp(-t / response_s)  for t > 0, else 0,
so the light at time t is sum_k L_k (s(t - t_k) - s(t - t_(k+1))): linear in the states' light, and
the share of state k in an exposure is the integral of its factor over the time the row is open.
"""

import numpy as np
from numpy.typing import NDArray

Times = NDArray[np.float64]
"""Array of times in seconds, or of shares of an exposure time."""
FORGOTTEN_LAGS = 12.0
"""Number of time constants after which a past state is forgotten; exp(-12) is 6e-6."""


def state_shares(
    opens: Times, shutter_s: float, state_hz: float, response_s: float = 0.0
) -> tuple[int, Times]:
    """Return the shares of the display's states in exposures.

    >>> first, weights = state_shares(np.array([0.09]), shutter_s=0.02, state_hz=10.0)
    >>> first, weights.round(3).tolist()  # half of state 0, half of state 1
    (0, [[0.5], [0.5]])

    Args:
        opens: (...) seconds, by the display's clock, from the writing of the first state in the
            display's row in question to the opening of the shutter.
        shutter_s: exposure time, seconds.
        state_hz: number of states a second.
        response_s: time constant of the pixels, seconds; 0 for pixels that follow at once.

    Returns:
        Number of the first state, which may be negative, and the shares of this state and of its
        successors, (S, ...) float64, which sum to 1.
    """
    first = int(np.floor((opens.min() - FORGOTTEN_LAGS * response_s) * state_hz))
    last = int(np.floor((opens.max() + shutter_s) * state_hz))
    # since[j]: how much longer than none the light of state first + j or a later one was on
    since = [np.ones_like(opens)]
    for state in range(first + 1, last + 1):
        start = opens - state / state_hz
        lit = _lit(start + shutter_s, response_s) - _lit(start, response_s)
        since.append(lit / shutter_s)
    since.append(np.zeros_like(opens))
    weights = np.maximum(-np.diff(np.array(since), axis=0), 0.0)  # rounding can end below 0
    used = np.flatnonzero(weights.reshape(len(weights), -1).max(axis=1) > 1e-5)
    kept = weights[used[0] : used[-1] + 1]
    return first + int(used[0]), kept / kept.sum(axis=0)


def _lit(t: Times, response_s: float) -> Times:
    """Integrate s, the lag of a pixel's light, from 0 to t."""
    on = np.maximum(t, 0.0)
    if response_s <= 0:
        return on
    return np.asarray(on + response_s * np.expm1(-on / response_s))
