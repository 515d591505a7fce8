"""Line codes: what one block shows over the refreshes of the display for a row of bits.

A block toggles between two states, each shown for some refreshes. Two states are a *toggle*: the
smallest thing that carries a bit. A line code says how the bits become amplitudes, in units of
kappa; all codes here stay within half a kappa of their middle, so that kappa is the swing of each.

| code | toggles a bit | what is shown for a 1; for a 0 |
|---|---:|---|
| `on_off` | 1 | 0, 1; 0, 0 (the paper: kappa is added in the second state where the bit is 1) |
| `toggle` | 1 | -½, +½; +½, -½ (antipodal) |
| `hold2`, `hold4` | 2, 4 | the toggle of the bit, repeated |
| `soft2`, `soft4` | 2, 4 | as hold, with the amplitude on a raised cosine where the sign changes |
| `balanced` | 2 | -½, +½, +½, -½; the opposite: neither a mean nor a slope within a bit |

Holding moves the energy of a random message towards half the rate of states, which is the fastest
flicker that the states can make. `balanced` keeps energy away from the lowest frequencies instead.
Soft steps follow InFrame++ (Wang et al., MobiSys 2015, https://doi.org/10.1145/2742647.2742652),
where the sign of a block changes along a raised cosine.

How much a decoder gets of a bit is the *energy* of the code: the squared distance between what is
shown for a 1 and for a 0, each less its mean, over that of `toggle`. With a matched filter and
white noise the signal-to-noise ratio of a bit is proportional to kappa² times the energy.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import ArrayLike, NDArray

from link.errors import InputError, at_least
from link.types import Array

Levels = Callable[[NDArray[np.intp], int], Array]
"""Turns bits, and the number of refreshes of a state, into amplitudes in units of kappa."""


@dataclass(frozen=True)
class LineCode:
    """A way to show bits over time."""

    toggles: int
    """Number of toggles that one bit takes; a toggle is two states."""
    levels: Levels
    """Makes the amplitudes of all refreshes."""

    def amplitudes(self, bits: ArrayLike, refreshes: int = 1) -> Array:
        """Make what a block shows for a row of bits.

        Args:
            bits: (n,) 0 or 1.
            refreshes: number of refreshes of each state, at least 1.

        Returns:
            (n * 2 * toggles * refreshes,) amplitudes in units of kappa, one for each refresh.

        Raises:
            InputError: the bits are of another shape or other values.

        >>> LINE_CODES["toggle"].amplitudes([1, 0, 0])
        array([-0.5,  0.5,  0.5, -0.5,  0.5, -0.5])
        >>> LINE_CODES["on_off"].amplitudes([1, 0], refreshes=2)
        array([0., 0., 1., 1., 0., 0., 0., 0.])
        """
        at_least(1, refreshes=refreshes)
        values = np.asarray(bits)
        if values.ndim != 1 or not np.isin(values, (0, 1)).all():
            raise InputError("bits: need one row of 0 and 1")
        return self.levels(values.astype(np.intp), refreshes)

    def energy(self) -> float:
        """Work out the energy of a bit, over that of an antipodal toggle of the same kappa.

        Soft codes spend a part of the energy on steps, so that it depends on the neighbours: the
        mean over all of them is returned, of the message with the bit and without it.

        >>> [LINE_CODES[name].energy() for name in ("toggle", "on_off", "hold2", "balanced")]
        [1.0, 0.25, 2.0, 2.0]
        """
        distances = []
        for neighbours in np.ndindex(2, 2, 2, 2):
            before, after = list(neighbours[:2]), list(neighbours[2:])
            shown = [self.amplitudes([*before, bit, *after]) for bit in (0, 1)]
            change = (shown[1] - shown[0]).reshape(-1, 2)  # a row for each toggle
            distances.append(np.square((change[:, 1] - change[:, 0]) / 2).sum())
        return float(np.mean(distances))


def _on_off(bits: NDArray[np.intp], refreshes: int) -> Array:
    states = np.zeros((len(bits), 2))
    states[:, 1] = bits
    return np.repeat(states.ravel(), refreshes)


def _hold(toggles: int, bits: NDArray[np.intp], refreshes: int) -> Array:
    signs = np.repeat(bits - 0.5, toggles)
    return np.repeat(np.stack([-signs, signs], axis=1).ravel(), refreshes)


def _soft(toggles: int, bits: NDArray[np.intp], refreshes: int) -> Array:
    """Hold, times an envelope that follows a raised cosine between the middles of two bits."""
    length = 2 * toggles * refreshes
    signs = bits - 0.5
    padded = np.concatenate([signs[:1], signs, signs[-1:]])
    weight = (1 - np.cos(np.pi * (np.arange(length) + 0.5) / length)) / 2
    steps = padded[:-1, None] * (1 - weight) + padded[1:, None] * weight
    envelope = steps.ravel()[length // 2 : -(length // 2)] if len(bits) else np.zeros(0)
    carrier = np.tile(np.repeat([-1.0, 1.0], refreshes), toggles * len(bits))
    return np.asarray(envelope * carrier)


def _balanced(bits: NDArray[np.intp], refreshes: int) -> Array:
    signs = (bits - 0.5)[:, None] * np.array([-1.0, 1.0, 1.0, -1.0])
    return np.repeat(signs.ravel(), refreshes)


LINE_CODES = {
    "on_off": LineCode(1, _on_off),
    "toggle": LineCode(1, partial(_hold, 1)),
    "hold2": LineCode(2, partial(_hold, 2)),
    "hold4": LineCode(4, partial(_hold, 4)),
    "soft2": LineCode(2, partial(_soft, 2)),
    "soft4": LineCode(4, partial(_soft, 4)),
    "balanced": LineCode(2, _balanced),
}
"""Line codes by name."""
CODE_OF_MODULATION = {"on_off": "on_off", "antipodal": "toggle"}
"""By the name of a modulation, a key of `link.layout.MODULATIONS`, the line code with which the
sender shows each bit once."""
