"""The display's clock as the camera sees it: which share of an exposure fell into which state.

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

from dataclasses import astuple, dataclass, replace

import numpy as np
from numpy.typing import NDArray

from link import ratex
from link.layout import Layout

Array = NDArray[np.float64]

MIN_STATE_HZ = 1.0
MIN_WINDOW_S, WINDOW_S = 1.0, 4.0
"""The first fit, and how far a fit looks back."""
MIN_FRAMES = 12
REFIT_S = 0.5
LOCKED_R2 = 0.5
"""Share of the toggles' variance that a clock must explain; with noise alone a fit reaches 0.1."""
GOOD_R2 = 0.85
"""From here on no other clock is looked for."""
CLIMB, STARTS = 24, 8
"""Steps of a fit, and where it starts from."""
MIN_TOGGLE = 0.1
"""Standard deviation of the toggles, displayed gray levels, below which the display stands still:
a square wave of kappa 1 has 0.5."""
OUTLIER = 5.0
"""Distance from a patch's median, in median distances, at which a toggle is no toggle."""
MIN_CORRELATION = 0.8
"""Of shown and captured tiles of a patch that nothing covers."""


@dataclass(frozen=True)
class Clock:
    """State n starts at ``start`` + n ``period``; times in seconds of the camera's clock."""

    period: float
    start: float
    delay_x: float
    """From the display's left to its right side."""
    delay_y: float
    """From its top to its bottom."""
    shutter: float

    def number(self, time: float) -> float:
        """Which state the display shows at a time; the fraction says how far it has come."""
        return (time - self.start) / self.period

    @property
    def latest(self) -> float:
        """When the last place's exposure ends, after a frame's time."""
        return max(self.delay_x, 0) + max(self.delay_y, 0) + self.shutter

    @property
    def earliest(self) -> float:
        """When the first place's exposure begins."""
        return min(self.delay_x, 0) + min(self.delay_y, 0)

    def shares(self, time: float, places: Array, state: int) -> Array:
        """Share in [0, 1] of the exposure at places (n, 2) of the display that a state has."""
        delays = places @ [self.delay_x, self.delay_y]
        begin = (time + delays - self.start) / self.period - state
        length = self.shutter / self.period
        inside = np.minimum(begin + length, 1) - np.maximum(begin, 0)
        return np.asarray(np.clip(inside / length, 0, 1))


def toggle(frame: NDArray[np.uint8], layout: Layout) -> Array:
    """How much brighter tiles of label 1 are than their twins of label 0, patch by patch.

    Args:
        frame: (H, W) or (H, W, 3) uint8, encoded, rectified, of the layout's size.
        layout: with at least one patch.

    Returns:
        (patches,) in displayed gray levels, as the patch's own contrast tells; NaN where something
        covers the patch.
    """
    pixels = ratex.training_pixels(layout)
    samples = frame[pixels.y, pixels.x].astype(np.float64)
    gray = samples if samples.ndim == 1 else samples.mean(axis=1)
    shape = (len(layout.ratex), ratex.TILES**2, ratex.SAMPLES**2)
    seen = gray.reshape(shape).mean(axis=2)  # (N,) -> (patches, tiles)
    shown = pixels.rho.reshape(shape)[:, :, 0]
    sign = 2 * (pixels.label.reshape(shape)[:, :, 0]) - 1
    seen = seen - seen.mean(axis=1, keepdims=True)
    shown = shown - shown.mean(axis=1, keepdims=True)
    product, power = (seen * shown).sum(axis=1), (shown**2).sum(axis=1)
    correlation = product / np.sqrt((seen**2).sum(axis=1) * power + 1e-9)
    contrast = np.where(correlation > MIN_CORRELATION, product / power, np.nan)
    return np.asarray(2 * (seen * sign).mean(axis=1) / contrast)


def embedded_share(clocks: Array, times: Array, places: Array) -> Array:
    """Share of embedded frames in exposures.

    Args:
        clocks: (C, 5) period, start, delays and shutter.
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
    """Integral from 0 to x of a wave of period 2 that is 0, then 1."""
    whole = np.floor(x / 2)
    return np.asarray(whole + np.maximum(x - 2 * whole - 1, 0))


class Synchroniser:
    """Fits the clock to the toggles of the last seconds.

    Args:
        fps: of the camera, frames a second; bounds delays and shutter.
        places: (patches, 2) of the ratex patches on the display, in [0, 1].
    """

    def __init__(self, fps: float, places: Array) -> None:
        self.fps = fps
        self.places = places
        self.clock: Clock | None = None
        self.r2 = 0.0
        """Share of the toggles' variance that the clock explains."""
        self.slips = 0
        """How often the states' numbers began anew."""
        self._samples: list[tuple[float, Array]] = []
        self._fitted_at = -np.inf

    def add(self, time: float, toggles: Array) -> None:
        """Take one frame's `toggle` (patches,)."""
        self._samples.append((time, toggles))
        while self._samples[0][0] < time - WINDOW_S:
            self._samples.pop(0)
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
        """(C, 5) clocks to start from: the strongest frequencies, each with its best delays."""
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

    def _climb(self, clocks: Array, times: Array, toggles: Array) -> tuple[Clock, float]:
        """The clock that explains most of those found uphill from each, by compass search."""
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
            scores = explained(flat, times, self.places, toggles).reshape(moves.shape[:2])
            best = np.argmax(scores, axis=1)
            clocks = moves[np.arange(len(moves)), best]
            steps = np.where(best[:, None] == 0, steps / 2, steps)
        winner = int(np.argmax(scores.max(axis=1)))
        return Clock(*clocks[winner].tolist()), float(scores[winner].max())


def _centred(toggles: Array) -> Array:
    """Less each patch's mean; half-covered patches, far from the rest, count as covered."""
    covered = np.isnan(toggles)
    ever = ~covered.all(axis=0)
    middle = np.zeros(toggles.shape[1])
    middle[ever] = np.nanmedian(toggles[:, ever], axis=0)
    distance = np.abs(toggles - middle)
    limit = OUTLIER * np.nanmedian(distance)
    kept = np.where(distance <= limit, toggles, np.nan)
    count = np.maximum((~np.isnan(kept)).sum(axis=0), 1)
    return np.asarray(kept - np.nansum(kept, axis=0) / count)


def explained(clocks: Array, times: Array, places: Array, toggles: Array) -> Array:
    """(C,) share of the toggles' variance that a common amplitude times each wave explains.

    Args:
        clocks: as in `embedded_share`, as are ``times`` and ``places``.
        times: see there.
        places: see there.
        toggles: (n, patches), centred; NaN where a patch is covered.
    """
    hidden = np.isnan(toggles)
    toggles = np.where(hidden, 0, toggles)
    count = np.maximum((~hidden).sum(axis=0), 1)
    wave = embedded_share(clocks, times, places) * ~hidden
    wave = (wave - wave.sum(axis=1, keepdims=True) / count) * ~hidden
    product = (wave * toggles).sum(axis=(1, 2))
    power = (wave**2).sum(axis=(1, 2)) * (toggles**2).sum() + 1e-12
    return np.asarray(np.maximum(product, 0) ** 2 / power)
