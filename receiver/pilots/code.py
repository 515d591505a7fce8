"""Find a coded display's clock: which rate, which moment of the code, and how rows follow rows.

The order in which a display shows the two states of its frame pairs follows a pseudo-random code
(`link.pilot_code`). So what its pilots do in the frames of a camera is known for each rate and each
moment of the code, whatever the rate of the camera, and all of them are tried.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from link.clock import DisplayClock, embedded_share
from link.pilot_code import STATE_HZ, PilotCode
from link.types import Array
from receiver.pilots.signal import clipped_changes, less_near_frames, limited

MOST_STATE_HZ = 150.0
"""Largest number of states a second, a little more than the largest that is tried."""
CLOCK_ERROR = 0.01
"""Share by which the clocks of camera and display may differ from their nominal rates: crystals
keep within a ten-thousandth, but 59.94 passes for 60, and nominal rates of cameras are rounded."""
MOST_STEPS = 4
"""Largest number of rates above a nominal rate that are tried, and below it: the longer the time
that frames cover, the more could be told apart, and the work must be bounded. Chosen by hand."""
PHASES = 2
"""Number of moments that are tried within a state: no more than a quarter of a state is then
missed. Chosen by hand."""
PANEL_S = 1 / 60
"""Longest time, in seconds, in which a panel writes its rows; the camera reads its own within
a frame. The delays across the display are the difference of the two, or their sum where the camera
is held upside down."""
DELAYS_S = np.arange(-32, 33, 8) / 1000
"""Delays, in seconds, that are tried along either side of the display, as far as `longest_delay`
allows, which is 33 ms for a camera of 30 frames a second. A step is about a state of a display of
120 states a second."""
SLOPES = np.array(
    sorted([(0.0, d) for d in DELAYS_S] + [(d, 0.0) for d in DELAYS_S if d], key=np.ptp)
)
"""(slopes, 2) times, in seconds, by which the right side of the display may be exposed after the
left one, or the bottom after the top. The smallest come first, because slopes that lead to the same
phases explain the same, and the first of them is chosen; so number 0 has no delay."""
SIDES = 4
"""Number of parts along each side of the display that are each taken to be exposed at once: of the
longest of `DELAYS_S`, a part's own is 8 ms, one step of them."""
COMPARED = 16
"""Largest number of a part's series that are compared with all clocks. It bounds the work; chosen
by hand."""
RIVAL = 2
"""Distance of clocks in the newest frame, in states, from which they are rivals: nearer ones are
taken for the same clock, fitted badly."""
OPEN = 0.5
"""Exposure time that is taken for granted, as a share of a state or of a frame, if that is less.
Between all of it, as in the dark, and next to nothing, as in the sun."""
SURER = 1 + 1e-5
"""Factor by which a clock must explain more than those before it: clocks may show the same in all
frames, and rounding must not choose."""


@dataclass(frozen=True)
class CodeLock:
    """A clock by which a display with a code may run, and how surely it does."""

    clock: DisplayClock
    """Clock that says when the display shows which state, in the unit of the frames' times."""
    evidence: float
    """Minus the natural logarithm of the probability that chance does as well in one of all the
    clocks that were tried."""
    rival: float
    """Evidence of the best clock that shows another state in the newest frame, as a share of this
    clock's; 1 where there is none."""


class CodeSearch:
    """Compares what changes over the frames of a film with what a coded display shows in them.

    Args:
        code: of the display.
        signs: (P,) 1 or -1, the signs of P places that show the code.
        places: (P, 2) x and y on the display, in [0, 1].
        times: (T,) times of the frames, rising.
        fps: number of frames of the camera in the unit of time.
        second: a second, in the unit of time.

    >>> times, places = np.arange(24) / 30, np.full((40, 2), 0.5)
    >>> signs = np.tile([1.0, -1.0], 20)
    >>> clock = np.array([[1 / 60, 0.2, 0.0, 0.0, 0.008]])  # two states in each frame
    >>> wave = embedded_share(clock, times, places[:1], PilotCode())[0, 0]
    >>> noise = np.random.default_rng(0).standard_normal((24, 40))
    >>> search = CodeSearch(PilotCode(), signs, places, times, 30.0)
    >>> (lock,) = search.strongest(noise + wave[:, None] * signs)
    >>> lock.evidence > 20, round(1 / lock.clock.period), int(lock.clock.number(0.2) // 2) % 63
    (True, 60, 0)
    """

    def __init__(
        self,
        code: PilotCode,
        signs: Array,
        places: Array,
        times: Array,
        fps: float,
        second: float = 1.0,
    ) -> None:
        self._signs, self._second = signs, second
        longest = longest_delay(1 / (fps * second))
        self._slopes = SLOPES[np.abs(SLOPES).max(axis=1) <= longest]
        self._middle = float(times.mean())
        since = np.asarray(times, np.float64) - self._middle
        self._hz = np.array(_rates(float(since[-1] - since[0]) / second))
        self._steps = 2 * PHASES * code.period
        period = second / self._hz
        self._newest = PHASES * since[-1] / period[:, None] + np.arange(self._steps)
        self._shutter = OPEN * np.minimum(period, 1 / fps)
        clocks = np.zeros((len(self._hz), self._steps, 5))
        clocks[:, :, 0], clocks[:, :, 4] = period[:, None], self._shutter[:, None]
        clocks[:, :, 1] = -np.arange(self._steps) / PHASES * period[:, None]
        shares = embedded_share(clocks.reshape(-1, 5), since, np.zeros((1, 2)), code)[:, 0]
        self._apart = less_near_frames(len(since))
        waves = (2 * shares - 1) @ self._apart.T
        self.waves: NDArray[np.float32] = waves.astype(np.float32)
        """(H, T) what a block of sign 1 shows at the display's centre, by H clocks, less the mean
        of near frames."""
        self._waves_by_frame = np.ascontiguousarray(self.waves.T)
        self._part = np.minimum((places * SIDES).astype(np.intp), SIDES - 1)  # along x, along y
        within = self._part.T[:, None] == np.arange(SIDES)[:, None]  # (2, SIDES, P)
        self._signs_within = np.asarray(within * signs, np.float32)
        energy = (waves**2).sum(axis=1).reshape(-1, self._steps)
        # part of the display, rate and phase that goes with each slope, part, rate and phase
        axes = np.array([_axis(slope) for slope in self._slopes])[:, None, None]
        self._parts = axes, np.arange(SIDES)[:, None], np.arange(len(self._hz)), self._later()
        places = within.sum(axis=2)[axes[:, 0], self._parts[1][:, 0]]  # (slopes, SIDES)
        later = _turning(np.tile(energy, (2, SIDES, 1, 1)))[self._parts]
        powers = (places[:, :, None, None] * later).sum(axis=1)
        self._weights = np.asarray(1 / (powers + 1e-9), np.float32)

    def strongest(self, values: NDArray[np.floating], count: int = 1) -> list[CodeLock]:
        """Find the clocks by which values follow their signs most surely, the likeliest first.

        Clocks are compared by how much of all values they explain over time, less the mean of near
        frames, by least squares. To tell whether that is chance, the signs are regressed on X_p,
        the sum of a place's values times the clock's wave, bounded, as
        `receiver.pilots.signal.pilot_evidence` does with amplitudes: by chance these explain the
        share R2 of the signs' power with probability (1 - R2)^((P - 1) / 2), for P places.

        Args:
            values: (T, P) values of the places.
            count: number of clocks, none of them within a state of another.
        """
        shape = len(self._hz), self._steps
        values, usual = clipped_changes(values)
        values /= usual
        series = self._signs_within @ np.asarray(values, np.float32).T
        sums = series.reshape(2 * SIDES, -1) @ self._waves_by_frame  # (2, SIDES, T) -> (parts, T)
        sums = sums.reshape(2, SIDES, *shape)  # (parts, H) -> (2, SIDES, rates, phases)
        explained = np.maximum(_turning(sums)[self._parts].sum(axis=1), 0)
        explained *= explained * self._weights
        gain = explained.max(axis=0)
        kept, left = list[tuple[int, int]](), gain.copy()
        for _ in range(count):
            rate, phase = divmod(int((SURER * left >= left.max()).argmax()), self._steps)
            left[rate, np.arange(phase + 1 - PHASES, phase + PHASES) % self._steps] = -1
            kept.append((rate, phase))
        slopes = [int((SURER * explained[:, *at] >= gain[at]).argmax()) for at in kept]
        return [self._lock(at, s, gain, values) for at, s in zip(kept, slopes, strict=True)]

    def highest(self, matches: Sequence[NDArray[np.floating]]) -> DisplayClock:
        """Find the clock that the parts of a display follow most clearly, each by its best series.

        No series follows a clock more clearly than its own length, less the mean of near frames,
        allows. So the longest alone are compared.

        Args:
            matches: an array (T, S) for each part, of S series of alike noise.

        Returns:
            the clock, without delays across the display.
        """
        powers = (self.waves**2).sum(axis=1) + 1e-6
        total = np.zeros(len(self.waves))
        for series in matches:
            seen = np.asarray(self._apart, np.float32) @ np.asarray(series, np.float32)
            squares = (seen**2).sum(axis=0)
            longest = seen[:, np.argsort(-squares)[:COMPARED]] / (seen.std() + 1e-9)
            heights = np.maximum((self.waves @ longest).max(axis=1), 0)
            total += heights**2 / powers
        return self._clock(divmod(int(total.argmax()), self._steps), 0)

    def _later(self) -> NDArray[np.intp]:
        """Give the phases by which parts of the display are later: (slopes, SIDES, rates)."""
        centres = (np.arange(SIDES) + 0.5) / SIDES - 0.5
        phases = PHASES * np.outer(centres, self._hz) * self._slopes.sum(axis=1)[:, None, None]
        return np.asarray(np.rint(phases) % self._steps, np.intp)

    def _lock(
        self, at: tuple[int, int], slope: int, gain: Array, values: NDArray[np.floating]
    ) -> CodeLock:
        """Describe the clock of a rate and a phase, given by their numbers, and weigh it."""
        part = self._part[:, _axis(self._slopes[slope])]
        later = (at[1] + self._parts[3][slope, part, at[0]]) % self._steps
        wave = self.waves[at[0] * self._steps + later]  # (P, T)
        X = limited((wave * np.asarray(values).T).sum(axis=1, dtype=np.float64))
        count = len(X)
        share = float((self._signs @ X) ** 2 / (count * (X @ X) + 1e-9))
        evidence = -(count - 1) / 2 * np.log(max(1 - share, 1e-12))
        evidence -= np.log(len(self.waves) * len(self._slopes))
        if evidence <= 0:
            return CodeLock(self._clock(at, slope), 0.0, 1.0)
        apart = (self._newest - self._newest[at] + self._steps / 2) % self._steps - self._steps / 2
        rivals = gain[np.abs(apart) >= RIVAL * PHASES]
        rival = float(rivals.max() / (gain[at] + 1e-9))
        return CodeLock(self._clock(at, slope), float(evidence), rival)

    def _clock(self, at: tuple[int, int], slope: int) -> DisplayClock:
        """Make the clock of a rate and a phase, given by their numbers."""
        period = self._second / self._hz[at[0]]
        across, down = self._slopes[slope] * self._second
        start = self._middle - at[1] / PHASES * period + (across + down) / 2
        return DisplayClock(*map(float, (period, start, across, down, self._shutter[at[0]])))


def longest_delay(frame: float) -> float:
    """Give the longest delay across the display, in seconds, with which a search begins.

    The fit of a clock (`receiver.timing.fit`) goes farther, up to the sum of both times.

    Args:
        frame: time from one frame of the camera to the next, seconds.
    """
    return max(frame, PANEL_S)


def _axis(slope: Array) -> int:
    """Tell along which axis a slope goes, 0 for x and 1 for y."""
    return int(slope[0] == 0)


def _turning(sums: NDArray[np.floating]) -> NDArray[np.floating]:
    """View (..., phases), which come again, as they follow each: (..., phases + 1, phases)."""
    twice = np.concatenate([sums, sums], axis=-1)
    return sliding_window_view(twice, sums.shape[-1], axis=-1)


def clocks_tried(code: PilotCode) -> int:
    """Count the clocks that are tried in a short window of frames, at most."""
    return 2 * PHASES * code.period * len(STATE_HZ) * len(SLOPES)


def _rates(span: float) -> list[float]:
    """List the rates that are told apart in some seconds, with clocks that run fast or slow."""
    rates: list[float] = []
    for hz in STATE_HZ:
        off = CLOCK_ERROR * span / 2 * hz  # states, at both ends
        steps = min(round(off), MOST_STEPS)
        rates += [
            hz * (1 + CLOCK_ERROR * step / max(steps, 1)) for step in range(-steps, steps + 1)
        ]
    return rates
