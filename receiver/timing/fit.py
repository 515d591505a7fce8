"""Fit the display's clock to some seconds of toggles, each place weighed by its own noise.

The toggle of a place is a constant, a slow drift, the clock's wave with one amplitude for all
places, and noise. The noise of a place has a variance of its own and a correlation from one frame
to the next (an autoregressive process of order one), because video codecs hold errors over several
frames. Toggles and waves are *whitened*: each sample less what the one before it predicts, as a
multiple of the standard deviation that is left. Drift is regressed with the wave.
"""

from dataclasses import astuple, dataclass
from functools import cached_property
from itertools import product

import numpy as np
from numpy.typing import NDArray

from link.clock import DisplayClock, embedded_share
from link.pilot_code import PLAIN, PilotCode
from link.types import Array
from receiver.pilots.code import MOST_STATE_HZ, PANEL_S, CodeSearch, longest_delay

ComplexArray = NDArray[np.complex128]

MIN_STATE_HZ = 1.0
"""Smallest number of states a second that is looked for: a frame pair then takes two seconds, and
slower displays carry hardly anything."""
MAX_STATES = 1.04
"""Largest number of states a camera frame that is looked for: above one state a frame, a frame pair
is seen in less than two frames (the sampling theorem), and 4 % are left for clocks that are off."""
STATES_STEP, LEAST_STATES = 0.25, 3
"""Step of the rates that are tried, and the smallest of them, in states over the window. States of
rates that are half a step apart move against each other by an eighth of a state at most; fewer than
three states could be a drift. Chosen by hand."""
DELAY_GRID = np.linspace(-0.9, 0.9, 7)
"""Delays that are tried along either side of the display, as shares of the longest one: steps of
0.3, of which a fit finds the rest by itself. Chosen by hand."""
LEAST_SHUTTER = 0.02
"""Shortest exposure that is fitted, as a share of a camera frame. A shorter one shows the same in
all frames, and a wave without slopes could not be fitted. Chosen by hand."""
DRIFT_HZ = 0.3
"""Highest frequency of a drift that is taken off; the slowest display toggles at 0.5 Hz."""
STARTS, ROUNDS = 4, 12
"""Number of clocks from which a fit starts under each of two models of the noise, and number of
steps that it takes; of a clock that is known, half so many. Chosen by hand: the strongest rate is
mostly the right one, and a fit has come to rest before."""
SPREAD_QUANTILES = (0.16, 0.84)
"""Quantiles of the toggles of a place between which one standard deviation to both sides lies, if
they are normal."""
OUTLIER = 4.0
"""Distance from a place's middle, in half distances between its 16 % and 84 % quantiles, at which a
toggle counts as unseen: chance goes so far once in 16,000 times, something in the way much more
often."""
NEIGHBOURS = np.array([0.0, -0.3, 0.3])
"""Starts of a fit beside a clock: relative changes of its period, in states over a window. Where no
exposure mixes two states, a fit does not move by itself. Chosen by hand."""
ROUGH_DELAYS = np.array(list(product((0.0, -0.008, 0.008), repeat=2)))
"""(9, 2) delays along both sides of the display, in seconds, that are added to a clock which is
known roughly, as starts of its fit: the search for a code takes exposure to go on along one side
alone, and tells its delay to about a state."""
MIN_SEEN = 8
"""Smallest number of toggles of a place that counts: from fewer, neither its drift nor the
correlation of its noise can be told. Chosen by hand."""
MAX_CORRELATION = 0.95
"""Largest correlation from one frame to the next that noise may have. At 1 it would be a walk, of
which whitening leaves nothing slow. Chosen by hand."""
STEP = 0.05
"""Step of numerical derivatives, in the natural units of a clock's five numbers: small against 1,
over which the wave changes wholly, and large against rounding. Chosen by hand."""
REACH = 0.4
"""Largest step of a fit, in the natural units of a clock's five numbers: farther than about half a
unit the derivatives say nothing. Chosen by hand."""
DAMPING, EASED, STIFFENED = 0.1, 3, 5
"""Damping of the first step of a fit, in shares of the wave's own power in each direction
(Levenberg and Marquardt), by how many times less it is after a step that led up, and by how many
times more after one that did not. Chosen by hand."""
ALONG_FLAT = 0.01
"""Share of the power of the wave that is added where damping is measured, so that a number that the
wave does not depend on stays. Chosen by hand."""
HELD = 1e9
"""Damping of a number that is held at its bound: so much that it does not move."""
PRIOR = np.array([1e-6, 0.01, 0.01, 1.0, 1.0, 1.0])
"""What is known of amplitude, period, start, both delays and shutter before a fit: inverse
variances in natural units, as multiples of what the toggles would tell at a noise of one. Delays
and shutter are known to about their unit, a camera frame, since neither may be longer; period and
start to ten units, which is as good as not at all, and keeps the covariance finite."""


@dataclass(frozen=True)
class PlaceNoise:
    """Noise of the toggles of P places, beside the wave and its drift."""

    deviation: Array
    """(P,) standard deviation, gray levels, of what the frame before does not predict."""
    correlation: Array
    """(P,) correlation from one frame to the next, in [0, `MAX_CORRELATION`]."""


@dataclass(frozen=True)
class ClockFit:
    """A clock that was fitted to a window of toggles."""

    clock: DisplayClock
    """The clock; its times count from the middle of the window."""
    evidence: float
    """Twice the logarithm of the likelihood ratio of this clock and of no clock."""
    amplitude: float
    """Toggle between original and embedded frames, displayed gray levels."""
    r2: float
    """Share of the toggles' variance, each place weighed by its noise, that the clock explains."""
    covariance: Array
    """(5, 5) covariance of the errors of period, start, both delays and shutter, in seconds
    squared."""
    noise: PlaceNoise
    """Noise of the places beside the clock's wave."""

    def phase_error(self, time: float) -> float:
        """Standard error, in states, of the state at a time from the middle of the window."""
        number = self.clock.number(time)
        slope = np.array([-number, -1.0, 0.5, 0.5, 0.5]) / self.clock.period
        return float(max(0.0, float(slope @ self.covariance @ slope)) ** 0.5)


class ToggleWindow:
    """Some seconds of toggles, made ready for fits of clocks.

    Args:
        times: (n,) seconds, rising.
        toggles: (n, P) displayed gray levels; NaN where a place is unseen.
        places: (P, 2) x and y on the display, in [0, 1].
        fps: frames of the camera in a second; they bound delays and shutter.
        code: says in which order the states of each frame pair are shown.
    """

    def __init__(
        self, times: Array, toggles: Array, places: Array, fps: float, code: PilotCode = PLAIN
    ) -> None:
        self.middle = float(times.mean())
        """Time, in seconds, from which the times of fitted clocks count."""
        self._times = times - self.middle
        self._span = float(times[-1] - times[0])
        self._places, self._code = places, code
        self._frame = 1 / fps
        values = toggles.T
        seen = _without_outliers(values)
        seen &= seen.sum(axis=1, keepdims=True) >= MIN_SEEN
        self._seen = seen
        self._count = seen.sum(axis=1)
        terms = np.arange(1 + int(2 * self._span * DRIFT_HZ))
        x = (self._times - self._times[0]) / max(self._span, 1e-9)
        self._drift = np.cos(np.pi * terms[:, None] * x)  # (q, n)
        mean = np.where(seen, values, 0).sum(axis=1) / np.maximum(self._count, 1)
        self._values = np.where(seen, values - mean[:, None], 0.0)
        self._plain = self._drift_space(seen.astype(float), np.zeros(seen.shape))
        self._free = np.maximum(self._count - len(terms) - 1, 1)
        self.deviation = np.sqrt((self._values**2).sum(axis=1) / np.maximum(self._count, 1))
        """(P,) standard deviation of the toggles of each place, gray levels."""
        self._without = self._set_noise(self._noise_of(self._values))
        self._left_without = (self._x**2).sum(axis=1) * self._scale2

    @property
    def places_seen(self) -> int:
        """Number of places that are not unseen for most of the window."""
        return int((self._count > 0).sum())

    @cached_property
    def state_hz(self) -> Array:
        """(F,) numbers of states a second that are looked for.

        There are none where the window is too short for the camera's nominal rate, which then is
        far below the real one.
        """
        slowest, fastest = max(MIN_STATE_HZ, LEAST_STATES / self._span), MAX_STATES / self._frame
        return np.arange(slowest, fastest, STATES_STEP / self._span)

    def search(self) -> ClockFit:
        """Find the clock that explains the toggles best, among all of `state_hz`, at least one."""
        # correlated noise hides fast clocks, and what makes it white hides slow ones
        plain = PlaceNoise(self.deviation + 1e-6, np.zeros_like(self.deviation))
        fits = []
        for noise in (plain, self._without):
            self._set_noise(noise)
            fits.append(self._settle(self._climb(self._start_clocks(), ROUNDS)))
        return max(fits, key=lambda fit: fit.evidence)

    def follow(self, clock: DisplayClock, *, rough: bool = False) -> ClockFit:
        """Fit a clock, known from before, anew.

        Args:
            clock: the clock; its times count from the middle of the window.
            rough: whether its delays are no better than those of `receiver.pilots.code`.
        """
        start = np.array([astuple(clock)])
        wave = self._shares(start)[0]
        self._set_noise(self._without)
        self._set_noise(self._noise_of(self._values - self._amplitude(start) * self._centre(wave)))
        if rough:
            return self._settle(self._climb(_other_delays(start), ROUNDS))
        return self._settle(self._climb(self._neighbours(start), ROUNDS // 2))

    def _neighbours(self, clock: Array) -> Array:
        """A clock (1, 5), and clocks a little faster and slower."""
        clocks = np.repeat(clock, len(NEIGHBOURS), axis=0)
        clocks[:, 0] += NEIGHBOURS * self._units(clock)[0, 0]
        return clocks

    def _settle(self, clocks: Array) -> ClockFit:
        """Estimate the noise beside the best clock, fit it once more, and weigh the evidence."""
        wave = self._shares(clocks[:1])[0]
        left = self._values - self._amplitude(clocks[:1]) * self._centre(wave)
        noise = self._set_noise(self._noise_of(left))
        starts = np.concatenate([self._neighbours(clocks[:1]), clocks[1:3]])
        best = self._climb(starts, ROUNDS // 2)[:1]
        gram, product = self._products(self._moved(best))
        amplitude = max(0.0, float(product[0, 0] / gram[0, 0, 0]))
        v = self._whiten(self._shares(best)[0])
        v = v - self._project(v)
        rss = ((self._x - amplitude * v) ** 2).sum(axis=1)
        evidence = min(self._evidence_of_places(rss), self._evidence_of_all(v, amplitude))
        r2 = 1 - float(rss.sum() / max((self._x**2).sum(), 1e-12))
        covariance = self._covariance(best, gram[0], amplitude)
        clock = DisplayClock(*best[0].tolist())
        return ClockFit(clock, evidence, amplitude, r2, covariance, noise)

    def _evidence_of_places(self, left: Array) -> float:
        """Evidence of a clock if the noise of each place is its own; (P,) squares that it leaves.

        It speaks against a clock that explains some places and not the others.
        """
        seen = self._count > 0
        ratio = self._left_without[seen] / np.maximum(left * self._scale2, 1e-12)[seen]
        return float(self._free[seen] @ np.log(ratio))

    def _evidence_of_all(self, wave: Array, amplitude: float) -> float:
        """Evidence of a clock if all places may share their noise, as the mean of all places tells.

        The mean weighs each place by its noise; (P, n) is the whitened wave.
        """
        weight = np.sqrt((wave**2).sum(axis=1) / max(float((wave**2).sum()), 1e-12))
        frames = weight**2 @ self._seen
        free = frames.sum() ** 2 / max(float((frames**2).sum()), 1e-12) - len(self._drift) - 1
        mean, mean_wave = weight @ self._x, weight @ wave
        left = ((mean - amplitude * mean_wave) ** 2).sum()
        return float(max(free, 1) * np.log((mean**2).sum() / max(float(left), 1e-12)))

    # Noise

    def _noise_of(self, left: Array) -> PlaceNoise:
        """Estimate the noise of each place from what is left of its toggles, (P, n)."""
        left = left * self._seen
        left = left - np.einsum(
            "pnq,pq->pn", self._plain, np.einsum("pnq,pn->pq", self._plain, left)
        )
        left = left * self._seen
        both = self._seen[:, 1:] & self._seen[:, :-1]
        power = np.maximum((left**2).sum(axis=1), 1e-12)
        lag = (left[:, 1:] * left[:, :-1] * both).sum(axis=1) / power
        lag = lag + (1 + 3 * lag) / np.maximum(self._count, 1)  # its bias in short windows
        correlation = np.clip(lag, 0, MAX_CORRELATION)
        ones = np.ones_like(correlation)
        fresh = _whiten(left, *self._factors(ones, correlation))
        variance = (fresh**2).sum(axis=1) / self._free
        return PlaceNoise(np.sqrt(np.maximum(variance, 1e-8)), correlation)

    def _factors(self, deviation: Array, correlation: Array) -> tuple[Array, Array]:
        """Weights (P, n) of a sample and of the one before it in what is whitened."""
        before = np.zeros_like(self._seen)
        before[:, 1:] = self._seen[:, :-1]
        alone = np.sqrt(1 - correlation**2)[:, None]
        now = np.where(before, 1.0, alone) * self._seen / deviation[:, None]
        back = correlation[:, None] * (self._seen & before) / deviation[:, None]
        return now, back

    def _set_noise(self, noise: PlaceNoise) -> PlaceNoise:
        """Whiten by this noise from now on."""
        self._now, self._back = self._factors(noise.deviation, noise.correlation)
        self._scale2 = noise.deviation**2
        self._basis = self._drift_space(self._now, self._back)
        x = self._whiten(self._values)
        self._x = x - self._project(x)
        return noise

    def _whiten(self, series: Array) -> Array:
        return _whiten(series, self._now, self._back)

    def _drift_space(self, now: Array, back: Array) -> Array:
        """Orthonormal basis (P, n, q) of the whitened drifts of each place."""
        drifts = _whiten(
            np.broadcast_to(self._drift[:, None], (len(self._drift), *now.shape)), now, back
        )
        return np.asarray(np.linalg.qr(drifts.transpose(1, 2, 0))[0])

    def _project(self, series: Array) -> Array:
        """Take the part of whitened series (P, n) that drifts explain."""
        inner = np.matmul(series[:, None], self._basis)  # (P, 1, q)
        return np.asarray(np.matmul(self._basis, inner.transpose(0, 2, 1))[:, :, 0])

    def _centre(self, wave: Array) -> Array:
        mean = (wave * self._seen).sum(axis=1) / np.maximum(self._count, 1)
        return np.asarray((wave - mean[:, None]) * self._seen)

    # Fits

    def _shares(self, clocks: Array) -> Array:
        """Give the shares of embedded frames, (C, P, n), by (C, 5) clocks."""
        return embedded_share(clocks, self._times, self._places, self._code)

    def _products(self, clocks: Array) -> tuple[Array, Array]:
        """Inner products (C, K, K) of whitened waves of (C, K, 5) clocks, and with the toggles."""
        count, each = clocks.shape[:2]
        waves = self._shares(clocks.reshape(-1, 5))
        v = self._whiten(waves)  # (C K, P, n)
        inner = np.matmul(v.transpose(1, 0, 2), self._basis)  # (P, C K, q)
        inner = inner.transpose(1, 0, 2).reshape(count, each, -1)
        flat = v.reshape(count, each, -1)
        gram = flat @ flat.transpose(0, 2, 1) - inner @ inner.transpose(0, 2, 1)
        return np.asarray(gram), np.asarray(flat @ self._x.ravel())

    def _amplitude(self, clocks: Array) -> float:
        gram, product = self._products(clocks[:, None])
        return max(0.0, float(product[0, 0] / max(gram[0, 0, 0], 1e-9)))

    def _units(self, clocks: Array) -> Array:
        """Natural units (C, 5) of a clock's numbers: each changes the wave about wholly."""
        period = clocks[:, :1]
        frame = np.minimum(self._frame, 2 * period)
        return np.concatenate([period**2 / self._span, period, frame, frame, frame], axis=1)

    def _moved(self, clocks: Array) -> Array:
        """Each clock and five that differ from it in one number: (C, 6, 5)."""
        steps = self._units(clocks) * STEP
        moved = np.repeat(clocks[:, None], 6, axis=1)
        moved[:, np.arange(1, 6), np.arange(5)] += steps
        return moved

    def _linear(self, gram: Array, product: Array) -> tuple[Array, Array]:
        """Turn products of moved waves into those of the wave and of its five derivatives."""
        turn = np.eye(6) / STEP
        turn[:, 0] = -1 / STEP
        turn[0] = [1, 0, 0, 0, 0, 0]
        return turn @ gram @ turn.T, product @ turn.T

    def _climb(self, clocks: Array, rounds: int) -> Array:
        """Climb from each clock (Levenberg and Marquardt); clocks in order, the best first."""
        limit, delay = self._frame, self._frame + PANEL_S  # a camera may be held upside down
        fastest = limit / MAX_STATES if self._code == PLAIN else 1 / MOST_STATE_HZ
        low = np.array([fastest, -np.inf, -delay, -delay, LEAST_SHUTTER * limit])
        high = np.array([1 / MIN_STATE_HZ, np.inf, delay, delay, limit])
        best, score = clocks, np.full(len(clocks), -np.inf)
        damping = np.full(len(clocks), DAMPING)
        normal, right = np.zeros((len(clocks), 6, 6)), np.zeros((len(clocks), 6))
        for _ in range(rounds):
            gram, product = self._products(self._moved(clocks))
            reached = np.maximum(product[:, 0], 0) ** 2 / np.maximum(gram[:, 0, 0], 1e-9)
            better = reached > score
            best = np.where(better[:, None], clocks, best)
            score = np.where(better, reached, score)
            damping = np.where(better, damping / EASED, damping * STIFFENED)
            fresh, fresh_right = self._linear(gram, product)
            normal = np.where(better[:, None, None], fresh, normal)
            right = np.where(better[:, None], fresh_right, right)
            units = self._units(best)
            each = np.repeat(damping[:, None], best.shape[1], axis=1)
            clocks = best + self._step(normal, right, each) * units
            # what is at its bound and would leave it stays, and the others step without it
            held = ((best <= low) & (clocks < low)) | ((best >= high) & (clocks > high))
            clocks = best + self._step(normal, right, each + HELD * held) * units
            clocks = np.clip(clocks, low, high)
        return np.asarray(best[np.argsort(-score)])

    @staticmethod
    def _step(normal: Array, right: Array, damping: NDArray[np.floating]) -> Array:
        """The step of each fit, (C, 5), in natural units, by the damping (C, 5) of its numbers."""
        diagonal = np.einsum("ckk->ck", normal)
        heavier = np.full(diagonal.shape, 1e-9)
        heavier[:, 1:] += damping * (diagonal[:, 1:] + ALONG_FLAT * diagonal[:, :1])
        solution = np.linalg.solve(normal + heavier[:, :, None] * np.eye(6), right[:, :, None])[
            ..., 0
        ]
        amplitude = solution[:, :1]
        step = np.where(amplitude > 1e-6, solution[:, 1:] / np.maximum(amplitude, 1e-6), 0)
        return np.asarray(np.clip(step, -REACH, REACH))

    def _covariance(self, best: Array, gram: Array, amplitude: float) -> Array:
        normal, _ = self._linear(gram[None], np.zeros((1, 6)))
        prior = PRIOR * max(amplitude, 1e-3) ** 2
        scaled = np.linalg.inv(normal[0] + np.diag(prior))[1:, 1:] / max(amplitude, 1e-3) ** 2
        units = self._units(best)[0]
        return np.asarray(scaled * units[:, None] * units)

    @cached_property
    def _candidates(self) -> tuple[ComplexArray, Array, ComplexArray]:
        """Waves (F, n) of all `state_hz`, and delays (D, 2) with turns.

        A wave is the fundamental of a display at that rate. The turns (F, P, D) are the phases by
        which a delay turns it at each place.
        """
        state_hz = self.state_hz
        waves = np.exp(-1j * np.pi * state_hz[:, None] * self._times)
        grid = DELAY_GRID * longest_delay(self._frame)
        along = -1j * np.pi * state_hz[:, None, None] * grid
        across, down = (np.exp(along * self._places[:, axis, None]) for axis in (0, 1))
        turns = (across[:, :, None, :] * down[:, :, :, None]).reshape(*across.shape[:2], -1)
        delays = np.stack(np.meshgrid(grid, grid), axis=-1).reshape(-1, 2)  # (7, 7, 2) -> (49, 2)
        return waves, delays, turns

    def _start_clocks(self) -> Array:
        """Find (C, 5) clocks to start from: strongest frequencies, each with its best delays."""
        if self._code != PLAIN:
            return self._starts_by_code
        state_hz = self.state_hz
        waves, delays, turns = self._candidates
        adjoint = self._x * self._now
        adjoint[:, :-1] -= self._x[:, 1:] * self._back[:, 1:]
        lines = waves @ adjoint.T  # (F, P)
        correlation = self._back.max(axis=1) * np.sqrt(self._scale2)
        turn = np.cos(np.pi * state_hz[:, None] * self._frame)
        passed = 1 + correlation**2 - 2 * correlation * turn
        norm = passed @ (self._count / self._scale2)
        line = np.matmul(lines[:, None], turns)[:, 0]
        power = np.abs(line)
        best = power.argmax(axis=1)
        strongest = power.max(axis=1) / np.sqrt(np.maximum(norm, 1e-12))
        before, after = np.roll(strongest, 1), np.roll(strongest, -1)
        peaks = np.flatnonzero(strongest >= np.maximum(before, after))
        starts = []
        for peak in peaks[np.argsort(strongest[peaks])[-STARTS:]]:
            # the embedded state's middle is where the fundamental is highest
            period, shutter = 1 / state_hz[peak], 0.5 * self._frame
            middle = -np.angle(line[peak, best[peak]]) * period / np.pi
            start = middle - 1.5 * period + shutter / 2
            starts.append([period, start, *delays[best[peak]], shutter])
        return np.array(starts)

    @cached_property
    def _starts_by_code(self) -> Array:
        """Find (C, 5) clocks to start from, by the code alone."""
        signs = np.ones(len(self._places))
        search = CodeSearch(self._code, signs, self._places, self._times, 1 / self._frame)
        locks = search.strongest((self._values / (self.deviation[:, None] + 1e-6)).T, STARTS)
        clocks = np.array([astuple(lock.clock) for lock in locks])
        return np.concatenate([_other_delays(clocks[:1]), clocks[1:]])


def _other_delays(clock: Array) -> Array:
    """A clock (1, 5) by `ROUGH_DELAYS`, each with the same state at the display's centre."""
    clocks = np.repeat(clock, len(ROUGH_DELAYS), axis=0)
    clocks[:, 2:4] += ROUGH_DELAYS
    clocks[:, 1] += ROUGH_DELAYS.sum(axis=1) / 2
    return clocks


def _whiten(series: Array, now: Array, back: Array) -> Array:
    """Weigh each sample of (..., P, n) and take off what the one before it predicts."""
    whitened = series * now
    whitened[..., 1:] -= series[..., :-1] * back[:, 1:]
    return np.asarray(whitened)


def _without_outliers(values: Array) -> NDArray[np.bool_]:
    """Tell which toggles (P, n) are seen, and no farther from the rest than toggles are."""
    seen = np.isfinite(values)
    enough = seen.any(axis=1)
    low, high = np.full((2, len(values)), np.nan)
    low[enough], high[enough] = np.nanquantile(values[enough], SPREAD_QUANTILES, axis=1)
    middle, half = (low + high) / 2, (high - low) / 2
    with np.errstate(invalid="ignore"):
        near = np.abs(values - middle[:, None]) <= OUTLIER * half[:, None] + 1e-9
    return np.asarray(seen & near)
