"""The display's clock as the camera sees it, and which share of an exposure fell into which state.

The display shows states 0, 1, 2 ..., even ones original frames and odd ones embedded frames, each
for ``period`` seconds. A camera reads its rows one after the other, and a panel writes its rows one
after the other, so the place (x, y) of the display, each in [0, 1], is exposed during
[t + delay, t + delay + shutter] of a frame at time t, with delay = x delay_x + y delay_y whatever
way up the camera is. All five numbers are fitted to the *toggle* of the ratex patches: how much
brighter tiles of label 1 are than tiles of label 0 that show the same intensity, which no change of
exposure can mimic.

With about one state a frame, a rate above the camera's and one as far below it give the same
toggles: the states' numbers are then off by one from time to time, and `link.code.collect` notices.
"""

from collections import deque
from dataclasses import astuple, dataclass, replace

import numpy as np
from numpy.typing import NDArray

from link.layout import Layout
from link.ratex import match_patches

Array = NDArray[np.float64]

MIN_STATE_HZ = 1.0
"""Smallest number of states a second that is looked for."""
MIN_WINDOW_S, WINDOW_S = 1.0, 4.0
"""Seconds of toggles that the first fit needs, and that a later fit looks back."""
MAX_SAMPLES = 4096
"""Largest number of frames that a fit looks back, whatever their times say."""
MIN_FRAMES = 12
"""Number of frames that the first fit needs."""
REFIT_S = 0.5
"""Seconds from one fit to the next."""
LOCKED_R2 = 0.5
"""Share of the toggles' variance that a clock must explain; with noise alone a fit reaches 0.1."""
GOOD_R2 = 0.85
"""Share of the toggles' variance at which no other clock is looked for."""
CLIMB, STARTS = 24, 8
"""Number of steps of a fit, and of clocks from which a fit starts."""
MIN_TOGGLE = 0.1
"""Standard deviation of the toggles, displayed gray levels, below which the display stands still:
a square wave of kappa 1 has 0.5."""
OUTLIER = 5.0
"""Distance from a patch's median, in median distances, at which a toggle is no toggle."""
MIN_CORRELATION = 0.8
"""Smallest correlation of shown and captured tiles of a patch that nothing covers."""


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

    def shares(self, time: float, places: Array, state: int) -> Array:
        """Work out the share that a state has of the exposure at places of the display.

        Args:
            time: of the frame.
            places: (n, 2) x and y on the display, in [0, 1].
            state: number of the state.

        Returns:
            (n,) in [0, 1].
        """
        delays = places @ [self.delay_x, self.delay_y]
        begin = (time + delays - self.start) / self.period - state
        length = self.shutter / self.period
        inside = np.minimum(begin + length, 1) - np.maximum(begin, 0)
        return np.asarray(np.clip(inside / length, 0, 1))


def patch_toggles(frame: NDArray[np.uint8], layout: Layout) -> Array:
    """Measure how much brighter tiles of label 1 are than their twins of label 0, in each patch.

    Args:
        frame: (H, W) or (H, W, 3) uint8, encoded, rectified.
        layout: with at least one patch.

    Returns:
        (patches,) in displayed gray levels, as the patch's own contrast tells; NaN where something
        covers the patch.
    """
    match = match_patches(frame, layout)
    gain = (match.captured * match.shown).sum(axis=1) / (match.shown**2).sum(axis=1)
    contrast = np.where(match.correlation > MIN_CORRELATION, gain, np.nan)
    return np.asarray(2 * (match.captured * (2 * match.label - 1)).mean(axis=1) / contrast)


def embedded_share(clocks: Array, times: Array, places: Array) -> Array:
    """Work out the share that embedded frames have of exposures.

    Args:
        clocks: (C, 5) period, start, both delays and shutter, as in `DisplayClock`.
        times: (n,) seconds.
        places: (patches, 2) of the display, in [0, 1].

    Returns:
        (C, n, patches) in [0, 1].
    """
    period, start, _, _, shutter = clocks.T[:, :, None, None]
    delays = clocks[:, 2:4] @ places.T
    begin = (times[:, None] + delays[:, None] - start) / period
    length = shutter / period
    return np.asarray((_on_time(begin + length) - _on_time(begin)) / length)


def _on_time(x: Array) -> Array:
    """Integrate, from 0 to x, a wave of period 2 that is 0 and then 1."""
    whole = np.floor(x / 2)
    return np.asarray(whole + np.maximum(x - 2 * whole - 1, 0))


class Synchroniser:
    """Fits the clock to the toggles of the last seconds.

    Args:
        fps: frames of the camera in a second; they bound delays and shutter.
        places: (patches, 2) centres of the ratex patches on the display, in [0, 1].
    """

    def __init__(self, fps: float, places: Array) -> None:
        self.fps = fps
        self.places = places
        self.clock: DisplayClock | None = None
        """The clock, or None while it is unknown."""
        self.r2 = 0.0
        """Share of the toggles' variance that the clock explains, in [0, 1]."""
        self.slips = 0
        """Number of times that the numbers of the states began anew."""
        self._samples: deque[tuple[float, Array]] = deque(maxlen=MAX_SAMPLES)
        self._fitted_at = -np.inf

    def add(self, time: float, toggles: Array) -> None:
        """Take the toggles of one frame, and fit the clock where it is time.

        Args:
            time: of the frame, seconds; later than before.
            toggles: (patches,) as `patch_toggles` returns them.
        """
        self._samples.append((time, toggles))
        while self._samples[0][0] < time - WINDOW_S:
            self._samples.popleft()
        enough = time - self._samples[0][0] >= MIN_WINDOW_S and len(self._samples) >= MIN_FRAMES
        if enough and time >= self._fitted_at + REFIT_S:
            self._fitted_at = time
            self._fit()

    def _fit(self) -> None:
        times, toggles = (np.array(column) for column in zip(*self._samples, strict=True))
        toggles = toggles if np.isnan(toggles).all() else _centred(toggles)
        if np.isnan(toggles).all() or np.nanstd(toggles) < MIN_TOGGLE:
            self.clock, self.r2 = None, 0.0
            return
        middle = float(times.mean())
        times = times - middle
        held = self.clock
        if held is not None:
            # pivots at the window, so that states keep their numbers
            number = 2 * round(held.number(middle) / 2)
            held = replace(held, start=held.start + number * held.period - middle)
            found, r2 = self._climb(np.array([astuple(held)]), times, toggles)
            found = replace(found, start=found.start - number * found.period)
            if r2 >= GOOD_R2:
                self.clock, self.r2 = replace(found, start=found.start + middle), r2
                return
        searched, best = self._climb(self._search(times, toggles), times, toggles)
        if held is not None and r2 >= max(LOCKED_R2, best - 0.05):
            searched, best = found, r2
        elif best >= LOCKED_R2:
            self.slips += 1
        self.clock = replace(searched, start=searched.start + middle) if best >= LOCKED_R2 else None
        self.r2 = best

    def _search(self, times: Array, toggles: Array) -> Array:
        """Find (C, 5) clocks to start from: strongest frequencies, each with its best delays."""
        span = times[-1] - times[0]
        state_hz = np.arange(max(MIN_STATE_HZ, 3 / span), 1.04 * self.fps, 0.25 / span)
        lines = np.exp(-1j * np.pi * state_hz[:, None] * times) @ np.nan_to_num(toggles)
        grid = np.linspace(-0.9, 0.9, 7) / self.fps
        delays = np.stack(np.meshgrid(grid, grid), axis=-1).reshape(-1, 2)  # (7, 7, 2) -> (49, 2)
        turns = np.exp(-1j * np.pi * state_hz[:, None, None] * (delays @ self.places.T))
        line = (turns * lines[:, None]).sum(axis=2)
        power = np.abs(line)
        strongest, best = power.max(axis=1), power.argmax(axis=1)
        before, after = np.roll(strongest, 1), np.roll(strongest, -1)
        peaks = np.flatnonzero(strongest >= np.maximum(before, after))
        starts = []
        for peak in peaks[np.argsort(strongest[peaks])[-STARTS:]]:
            # the embedded state's middle is where the fundamental is highest
            period, shutter = 1 / state_hz[peak], 0.5 / self.fps
            middle = -np.angle(line[peak, best[peak]]) * period / np.pi
            start = middle - 1.5 * period + shutter / 2
            starts.append([period, start, *delays[best[peak]], shutter])
        return np.array(starts)

    def _climb(self, clocks: Array, times: Array, toggles: Array) -> tuple[DisplayClock, float]:
        """Climb from each clock by compass search; the clock that explains most, and how much."""
        period = clocks[:, :1]
        unit = np.full_like(period, 1 / self.fps)
        span = times[-1] - times[0]
        steps = np.concatenate([0.2 * period**2 / span, 0.1 * period, *3 * [0.1 * unit]], axis=1)
        limit = 1 / self.fps
        low = np.array([0.9 * limit, -np.inf, -limit, -limit, 0.02 * limit])
        high = np.array([1 / MIN_STATE_HZ, np.inf, limit, limit, limit])
        compass = np.concatenate([np.zeros((1, 5)), np.eye(5), -np.eye(5)])
        for _ in range(CLIMB):
            moves = clocks[:, None] + compass * steps[:, None]  # (C, 11, 5)
            moves = np.clip(moves, low, high)
            flat = moves.reshape(-1, 5)  # (C, 11, 5) -> (11 C, 5)
            scores = explained_variance(flat, times, self.places, toggles).reshape(moves.shape[:2])
            best = np.argmax(scores, axis=1)
            clocks = moves[np.arange(len(moves)), best]
            steps = np.where(best[:, None] == 0, steps / 2, steps)
        winner = int(np.argmax(scores.max(axis=1)))
        return DisplayClock(*clocks[winner].tolist()), float(scores[winner].max())


def _centred(toggles: Array) -> Array:
    """Take off each patch's mean; half-covered patches, far from the rest, count as covered."""
    covered = np.isnan(toggles)
    ever = ~covered.all(axis=0)
    middle = np.zeros(toggles.shape[1])
    middle[ever] = np.nanmedian(toggles[:, ever], axis=0)
    distance = np.abs(toggles - middle)
    limit = OUTLIER * np.nanmedian(distance)
    kept = np.where(distance <= limit, toggles, np.nan)
    count = np.maximum((~np.isnan(kept)).sum(axis=0), 1)
    return np.asarray(kept - np.nansum(kept, axis=0) / count)


def explained_variance(clocks: Array, times: Array, places: Array, toggles: Array) -> Array:
    """Work out how well each clock explains the toggles, with one amplitude for all patches.

    Args:
        clocks: (C, 5) period, start, both delays and shutter, as in `DisplayClock`.
        times: (n,) seconds.
        places: (patches, 2) of the display, in [0, 1].
        toggles: (n, patches), centred; NaN where a patch is covered.

    Returns:
        (C,) share of the toggles' variance, in [0, 1].
    """
    hidden = np.isnan(toggles)
    toggles = np.where(hidden, 0, toggles)
    count = np.maximum((~hidden).sum(axis=0), 1)
    wave = embedded_share(clocks, times, places) * ~hidden
    wave = (wave - wave.sum(axis=1, keepdims=True) / count) * ~hidden
    product = (wave * toggles).sum(axis=(1, 2))
    power = (wave**2).sum(axis=(1, 2)) * (toggles**2).sum() + 1e-12
    return np.asarray(np.maximum(product, 0) ** 2 / power)
