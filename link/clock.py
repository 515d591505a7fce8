"""The display's clock as the camera sees it, and which share of an exposure fell into which state.

The display shows states 0, 1, 2 ..., each for ``period`` seconds: even ones original frames and odd
ones embedded frames, or as the layout's code orders those of a frame pair (`link.pilot_code`). A
camera reads its rows one after the other, and a panel writes its rows one after the other. So the
place (x, y) of the display, each in [0, 1], is exposed during
[t + delay, t + delay + shutter] of a frame at time t, with delay = x delay_x + y delay_y whatever
way up the camera is.

With about one state a frame, a rate above the camera's and one as far below it give the same
toggles: the states' numbers are then off by one from time to time, and `link.code.collect` notices.
"""

from dataclasses import dataclass

import numpy as np

from link.pilot_code import PLAIN, PilotCode
from link.types import Array


@dataclass(frozen=True)
class DisplayClock:
    """When the display shows which state: state n begins at ``start`` + n ``period``.

    All values are seconds of the camera's clock.

    >>> clock = DisplayClock(period=0.1, start=0.0, delay_x=0.0, delay_y=0.02, shutter=0.04)
    >>> clock.number(0.25)
    2.5
    >>> top_and_bottom = np.array([[0.5, 0.0], [0.5, 1.0]])
    >>> clock.shares(0.08, top_and_bottom, state=0).round(3).tolist()  # exposed until 0.12 and 0.14
    [0.5, 0.0]
    """

    period: float
    """Time for which the display shows each state."""
    start: float
    """Time at which state 0 begins."""
    delay_x: float
    """Time by which the display's right side is exposed after its left side."""
    delay_y: float
    """Time by which the display's bottom is exposed after its top."""
    shutter: float
    """Time for which each place is exposed."""

    def number(self, time: float) -> float:
        """Say which state the display shows at a time; the fraction says how far it has come."""
        return (time - self.start) / self.period

    @property
    def latest(self) -> float:
        """Time from a frame's own to the end of the last place's exposure."""
        return max(self.delay_x, 0) + max(self.delay_y, 0) + self.shutter

    @property
    def earliest(self) -> float:
        """Time from a frame's own to the beginning of the first place's exposure; 0 or negative."""
        return min(self.delay_x, 0) + min(self.delay_y, 0)

    @property
    def centre(self) -> float:
        """Time from a frame's own to the middle of the exposure of the display's centre."""
        return (self.delay_x + self.delay_y + self.shutter) / 2

    def shares(self, time: float, places: Array, state: int) -> Array:
        """Work out the share that a state has of the exposure at places of the display.

        Args:
            time: time of the frame, seconds.
            places: (n, 2) x and y on the display, in [0, 1].
            state: number of the state.

        Returns:
            (n,) in [0, 1].
        """
        delays = places @ [self.delay_x, self.delay_y]
        begin = (time + delays - self.start) / self.period - state
        return exposure_share(begin, self.shutter / self.period)


def exposure_share(begin: Array, length: float) -> Array:
    """Work out the share that a state has of exposures.

    Args:
        begin: by how many states' time each exposure begins after the state does, any shape.
        length: duration of the exposures, in states.

    Returns:
        shares in [0, 1], of the shape of ``begin``.
    """
    inside = np.minimum(begin + length, 1) - np.maximum(begin, 0)
    return np.asarray(np.clip(inside / length, 0, 1))


def embedded_share(clocks: Array, times: Array, places: Array, code: PilotCode = PLAIN) -> Array:
    """Work out the share that embedded frames have of exposures.

    Args:
        clocks: (C, 5) period, start, both delays and shutter, as in `DisplayClock`.
        times: (n,) seconds.
        places: (P, 2) x and y on the display, in [0, 1].
        code: says in which order the states of each frame pair are shown.

    Returns:
        (C, P, n) in [0, 1].
    """
    period, start, _, _, shutter = clocks.T[:, :, None, None]
    delays = clocks[:, 2:4] @ places.T
    begin = (times + (delays[:, :, None] - start)) / period
    length = shutter / period
    return np.asarray((_on_time(begin + length, code) - _on_time(begin, code)) / length)


def _on_time(x: Array, code: PilotCode) -> Array:
    """Integrate, from 0 to x states, a wave that is 1 while an embedded frame is shown, else 0."""
    whole = np.floor(x / 2)
    rest = x - 2 * whole
    on = np.maximum(rest - 1, 0)
    if code != PLAIN:
        signs = code.signs[whole.astype(np.intp) % code.period]
        on = np.where(signs > 0, on, np.minimum(rest, 1))
    return np.asarray(whole + on)
