"""A hand that holds a camera, and an exposure that wanders: slow random processes.

Amplitudes are assumptions. A hand drifts by some pixels in a second and trembles at 5 to 10 Hz, the
band of physiological tremor; at 60 degrees over 1280 pixels a degree is 21 pixels, so that the
drift's 4 px are 0.2 degrees and the tremor's 0.25 px are 0.012 degrees.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

SWAY = (4.0, 4.0, 0.3, 0.4, 0.15, 0.15)
"""Standard deviations of the drift: shift in x and y, px of an image 1280 px wide; roll, degrees;
scale, per cent; and keystone in x and y, per cent over half the image's longer side."""
SLOW_S, SMOOTH_S = 2.0, 0.3
"""Time constants of the drift, seconds: a random walk that returns, and the lag that smooths it.
The speed of a shift has the standard deviation 4 / sqrt(2.0 * 0.3) = 5 px/s."""
LIMIT = 2.5
"""Number of standard deviations beyond which no drift goes."""
TREMOR_PX = 0.25
"""Standard deviation of the tremor along each axis, px of an image 1280 px wide."""
TREMOR_HZ = (5.0, 10.0)
"""Lowest and highest frequency of the tremor, Hz."""
TREMOR_SINES = 4
"""Number of sines that make up the tremor along each axis."""
EXPOSURE_JUMP = 0.2
"""Standard deviation of the log exposure to which automatic exposure jumps."""


@dataclass
class Wander:
    """N independent smooth processes of standard deviation 1, bounded by `LIMIT`."""

    count: int
    """Number of processes."""
    rng: np.random.Generator
    """Source of every random draw."""
    slow_s: float = SLOW_S
    """Time, in seconds, in which a process forgets where it was."""
    smooth_s: float = SMOOTH_S
    """Time constant, in seconds, of the lag that smooths a process."""

    def __post_init__(self) -> None:
        # both start in balance: the walk has deviation 1, and the lagged value that of `step`'s
        # ``spread``, correlated with the walk
        self._walk = self.rng.standard_normal(self.count)
        share = self.slow_s / (self.slow_s + self.smooth_s)
        rest = np.sqrt(max(0.0, share - share**2))
        self._value = share * self._walk + rest * self.rng.standard_normal(self.count)

    def step(self, seconds: float) -> NDArray[np.float64]:
        """Return the (count,) values after another ``seconds``."""
        keep, lag = np.exp(-seconds / self.slow_s), np.exp(-seconds / self.smooth_s)
        noise = self.rng.standard_normal(self.count)
        before = self._walk
        self._walk = keep * before + np.sqrt(1 - keep**2) * noise
        self._value = lag * self._value + (1 - lag) * (before + self._walk) / 2
        spread = np.sqrt(self.slow_s / (self.slow_s + self.smooth_s))
        return np.asarray(LIMIT * np.tanh(self._value / spread / LIMIT))


class Hand:
    """A hand that holds a camera; its motion is a (3, 3) homography of the image."""

    def __init__(self, size: tuple[int, int], amount: float, rng: np.random.Generator) -> None:
        """Draw a hand.

        Args:
            size: (width, height) of the image, pixels.
            amount: motion relative to the usual hand's; 0 for a tripod.
            rng: source of every random draw.
        """
        self._size, self._amount = size, amount
        self._drift = Wander(len(SWAY), rng)
        self._hz = rng.uniform(*TREMOR_HZ, (TREMOR_SINES, 2))
        self._phase = rng.uniform(0, 2 * np.pi, (TREMOR_SINES, 2))
        self._time = 0.0

    def step(self, seconds: float) -> NDArray[np.float64]:
        """Return the (3, 3) map from pixels at rest to this camera's pixels, ``seconds`` later."""
        self._time += seconds
        x, y, roll, zoom, *keystone = self._amount * np.array(SWAY) * self._drift.step(seconds)
        tones = np.sin(2 * np.pi * self._hz * self._time + self._phase)
        tremor = self._amount * TREMOR_PX * np.sqrt(2 / TREMOR_SINES) * tones.sum(axis=0)
        width, height = self._size
        shift = (np.array([x, y]) + tremor) * width / 1280
        a = 1 + zoom / 100
        cos, sin = a * np.cos(np.radians(roll)), a * np.sin(np.radians(roll))
        px, py = np.array(keystone) / 100 / (max(width, height) / 2)
        middle = np.array([[1, 0, (width - 1) / 2], [0, 1, (height - 1) / 2], [0, 0, 1.0]])
        moved = np.array([[cos, -sin, shift[0]], [sin, cos, shift[1]], [px, py, 1.0]])
        return np.asarray(middle @ moved @ np.linalg.inv(middle))


class ExposureDrift:
    """An automatic exposure whose gain breathes, and sometimes makes for another level."""

    def __init__(self, drift: float, jumps_hz: float, rng: np.random.Generator) -> None:
        """Start at the usual exposure.

        Args:
            drift: standard deviation of the log gain within seconds.
            jumps_hz: number of jumps a second.
            rng: source of every random draw.
        """
        self._drift, self._jumps_hz, self._rng = drift, jumps_hz, rng
        self._breath = Wander(1, rng, slow_s=1.0, smooth_s=0.2)
        self._level = self._target = 0.0

    def step(self, seconds: float) -> float:
        """Return the gain after another ``seconds``."""
        breath = self._drift * self._breath.step(seconds)[0]
        jumps, to = self._rng.random() < self._jumps_hz * seconds, self._rng.standard_normal()
        if jumps:
            self._target = EXPOSURE_JUMP * to
        self._level += (1 - np.exp(-seconds / 0.15)) * (self._target - self._level)
        return float(np.exp(breath + self._level))
