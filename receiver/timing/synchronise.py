"""Find the display's clock, follow it, hold it through weak spells, and find it again."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from link.clock import DisplayClock
from link.pilot_code import PLAIN, PilotCode
from link.types import Real
from receiver.pilots.code import CLOCK_ERROR, RIVAL, clocks_tried
from receiver.timing.fit import ClockFit, ToggleWindow
from receiver.timing.toggles import Toggles

MIN_WINDOW_S, WINDOW_S = 0.3, 4.0
"""Seconds of toggles that the first fit needs, and that a later fit looks back."""
MIN_FRAMES = 20
"""Number of frames that the first fit needs: some clock fits one in a hundred orders of fewer."""
CODED_WINDOW = (12, 0.1)
"""Number of frames and seconds that the first fit needs where a code tells the clock."""
AWAY_S = 0.4
"""Seconds without a frame after which what comes may belong to another time: the display was lost,
and where a film had begun anew meanwhile, older frames no longer fit. They are left out once there
are enough new ones."""
REFIT_S, SEEK_S = 0.5, 0.25
"""Seconds from one fit to the next while the clock is known, and while it is not. A clock that is
known from a short window is fitted again after half as long, because its period is not exact yet.
"""
CONFIRMED = 30.0
"""Smallest evidence, in units of twice the log-likelihood, that confirms a clock known before."""
GOOD_R2 = 0.85
"""Share of the toggles' variance at which no other clock is looked for."""
SEARCH_S = 4.0
"""Seconds from one search to the next while the clock that is known is confirmed."""
CLEARLY, SHARE = 15.0, 0.05
"""Least evidence by which another clock must lead, and the least as a share of the held clock's."""
MIN_TOGGLE = 0.05
"""Smallest toggle between original and embedded frames, and smallest standard deviation of the
toggles of a place, in gray levels; what changes by less stands still. At kappa 1 the toggle is 1
to 2, and what is left of it in a film of few bits is about 0.1."""
HOLD_S = 6.0
"""Longest time, in seconds, for which a clock runs on without being confirmed."""
MAX_PHASE_ERROR = 0.25
"""Standard error of the state's number, in states, at which a clock that runs on is given up."""
WANDER = 5e-5
"""Share by which two clocks may drift apart while a clock runs on."""
SAME = 0.5
"""Largest distance, in states, between a clock that was found and the held one for the states to
keep their numbers."""
FALSE_ALARM = 1e-6
"""Chance, by the rule of `needed_evidence`, that a window without a clock shows one. Noise has
more large values than the rule says; docs/answered.md has how often it happens."""
CANDIDATES = 0.03
"""Factor of `needed_evidence`, fitted to the largest evidence in windows of simulated noise."""


def needed_evidence(span: float, fps: float, code: PilotCode = PLAIN) -> float:
    """Say how much evidence a search must find for its clock to be believed.

    Many clocks are tried, and the best of many looks better than it is. Their number grows with
    the window's length times the range of rates, and five numbers are fitted to each, so noise
    alone reaches evidence s with a chance of about `CANDIDATES` span fps s² exp(-s / 2), as for the
    largest value of a chi-squared field (Worsley 1994). Of a code, all rates and moments are tried.

    Args:
        span: length of the window, seconds.
        fps: frames of the camera in a second.
        code: of the display.

    Returns:
        twice a log-likelihood ratio, at which this chance is `FALSE_ALARM`.

    >>> round(needed_evidence(1.0, 30.0), 1), round(needed_evidence(4.0, 30.0), 1)
    (42.4, 45.5)
    """
    tried = CANDIDATES * max(span * fps, 1.0) if code == PLAIN else clocks_tried(code)
    evidence = 40.0
    for _ in range(20):
        evidence = 2 * np.log(tried * evidence**2 / FALSE_ALARM)
    return float(evidence)


@dataclass(frozen=True)
class Toggling:
    """The best clock that a search found, whether it is believed or not."""

    strength: float
    """Evidence of the best clock as a share of what is needed; 1 and more is a lock."""
    amplitude: float
    """Toggle between original and embedded frames by that clock, displayed gray levels."""
    state_hz: float
    """Number of states a second by that clock."""
    deviation: float
    """Standard deviation of the toggles of the place where it is largest, displayed gray levels."""


class Synchroniser:
    """Fits the clock to the toggles of the last seconds.

    Args:
        fps: frames of the camera in a second; they bound delays and shutter.
        toggles: says at which places of the display toggles are known, and works them out.
        code: says in which order the display shows the states of each frame pair.
    """

    def __init__(self, fps: float, toggles: Toggles, code: PilotCode = PLAIN) -> None:
        self.fps = fps
        self.toggles = toggles
        self._code, self._again = code, 2 * code.period
        self.clock: DisplayClock | None = None
        """The clock, or None while it is unknown."""
        self.slips = 0
        """Number of times that the numbers of the states began anew."""
        self.best: Toggling | None = None
        """The strongest toggling of all windows so far, or None before the first fit."""
        self._fitted_at = self._searched_at = self._confirmed_at = -np.inf
        self._fit: tuple[ClockFit, float] | None = None

    def phase_error(self, time: float) -> float:
        """Standard error, in states, of the state's number at a time; infinite without a clock."""
        if self.clock is None or self._fit is None:
            return np.inf
        fit, middle = self._fit
        wander = WANDER * (time - middle) / self.clock.period
        return float(np.hypot(fit.phase_error(time - middle), wander))

    def update(self, toggles: Iterable[tuple[float, Real]], time: float) -> None:
        """Fit the clock to the newest toggles where it is time, and give up what nothing confirms.

        Args:
            toggles: times of the newest frames, rising, and what they show of the toggling, (V,)
                each, as `receiver.seen.SeenFrames.toggles` has them.
            time: time of the newest frame, seconds.
        """
        recent = without_stale([each for each in toggles if each[0] >= time - WINDOW_S])
        unconfirmed = time - self._confirmed_at
        overdue = self._fit is not None and unconfirmed > 2 * REFIT_S
        unsure = overdue and self.phase_error(time) > MAX_PHASE_ERROR
        if unsure or unconfirmed > HOLD_S:
            self.clock = None
        frames, seconds = (MIN_FRAMES, MIN_WINDOW_S) if self._code == PLAIN else CODED_WINDOW
        begun = recent[0][0] if recent else time
        enough = len(recent) >= frames and time - begun >= seconds
        pause = SEEK_S if self.clock is None else min(REFIT_S, (self._fitted_at - begun) / 2)
        if enough and time >= self._fitted_at + pause:
            self._fitted_at = time
            self._fit_to(recent, time)

    def begin(self, clock: DisplayClock, time: float) -> None:
        """Take the clock with which the display was found.

        Args:
            clock: by the camera's time, seconds.
            time: time of the newest frame, seconds.
        """
        self.clock, self._confirmed_at, self._fit = clock, time, None
        self.slips += 1

    def _fit_to(self, recent: Sequence[tuple[float, Real]], time: float) -> None:
        """Fit the clock to the last seconds, and look for another one where that is in doubt."""
        times, values = (np.array(column) for column in zip(*recent, strict=True))
        toggles = self.toggles.over_time(values)
        window = ToggleWindow(times, toggles, self.toggles.places, self.fps, self._code)
        if window.places_seen == 0 or window.state_hz.size == 0:
            return
        if window.deviation.max() < MIN_TOGGLE:
            self.clock = None
            self._note(Toggling(0.0, 0.0, 0.0, float(window.deviation.max())))
            return
        needed = needed_evidence(times[-1] - times[0], self.fps, self._code)
        followed = None
        if self.clock is not None:
            followed = self._follow(window)
            sure = followed.evidence >= needed and followed.r2 >= GOOD_R2
            lately = time < self._searched_at + SEARCH_S
            if sure or (lately and followed.evidence >= CONFIRMED):
                self._adopt(followed, window, times[0], time)
                return
        found = window.search()
        self._searched_at = time
        strength = max(found.evidence, 0.0) / needed
        deviation = float(window.deviation.max())
        self._note(Toggling(strength, found.amplitude, 1 / found.clock.period, deviation))
        if followed is not None and followed.evidence >= CONFIRMED:
            lead = found.evidence - followed.evidence
            if lead < max(CLEARLY, SHARE * followed.evidence) or found.evidence < needed:
                self._adopt(followed, window, times[0], time)
                return
        wanted = CONFIRMED if self._agrees(found, window) else needed
        if found.evidence >= wanted and found.amplitude >= MIN_TOGGLE:
            self._adopt(found, window, times[0], time)

    def _agrees(self, found: ClockFit, window: ToggleWindow) -> bool:
        """Tell whether a clock that was found is about the one with which the display was found.

        That one is right to about two states and one per cent, which may be too far off to be
        followed where frames are missing.
        """
        held = self.clock
        if held is None or self._fit is not None:
            return False
        apart = _number_seen(found.clock, 0.0) - _number_seen(held, window.middle)
        near = abs(apart - self._again * round(apart / self._again)) <= RIVAL
        return near and abs(found.clock.period / held.period - 1) <= CLOCK_ERROR

    def _note(self, toggling: Toggling) -> None:
        if self.best is None or toggling.strength > self.best.strength:
            self.best = toggling

    def _follow(self, window: ToggleWindow) -> ClockFit:
        """Fit the held clock to the window, from where it has run to."""
        assert self.clock is not None
        number = self._again * round(self.clock.number(window.middle) / self._again)
        start = self.clock.start + number * self.clock.period - window.middle
        return window.follow(replace(self.clock, start=start), rough=self._fit is None)

    def _adopt(self, fit: ClockFit, window: ToggleWindow, begun: float, time: float) -> None:
        """Take a fitted clock; states keep their numbers where it goes on from the held one."""
        clock = replace(fit.clock, start=fit.clock.start + window.middle)
        if self.clock is None:
            self.slips += 1
        else:
            ends = [_number_seen(clock, at) - _number_seen(self.clock, at) for at in (begun, time)]
            shift = self._again * round(ends[1] / self._again)
            clock = replace(clock, start=clock.start + shift * clock.period)
            self.slips += int(max(abs(end - shift) for end in ends) > SAME)
        self.clock = clock
        self._fit, self._confirmed_at = (fit, window.middle), time


def without_stale(toggles: Sequence[tuple[float, Real]]) -> Sequence[tuple[float, Real]]:
    """Leave out what was seen before a pause of `AWAY_S`, if enough was seen after it.

    Args:
        toggles: times of frames, seconds, rising, and what they show.

    >>> seen = [(number / 30, np.zeros(5)) for number in (*range(30), *range(60, 90))]
    >>> [len(without_stale(seen[:count])) for count in (30, 49, 50, 60)]
    [30, 49, 20, 30]
    """
    times = np.array([time for time, _ in toggles])
    begun = [0, *(np.flatnonzero(np.diff(times) > AWAY_S) + 1), len(times)]
    for first, end in reversed([*pairwise(begun)]):
        if end - first >= MIN_FRAMES and times[end - 1] - times[first] >= MIN_WINDOW_S:
            return toggles[first:]
    return toggles


def _number_seen(clock: DisplayClock, time: float) -> float:
    """State in the middle of the exposure of the display's centre, of a frame at a time."""
    return clock.number(time + clock.centre)
