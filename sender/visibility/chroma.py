"""How small a flicker of colour alone the eye sees: two channels of the model castleCSF.

Source: Maliha Ashraf, Rafał K. Mantiuk, Alexandre Chapiro and Sophie Wuerger, "castleCSF - A
contrast sensitivity function of color, area, spatiotemporal frequency, luminance and eccentricity",
Journal of Vision 24(4):5, 2024, https://doi.org/10.1167/jov.24.4.5. The constants are those of
their code, https://github.com/gfxdisp/castleCSF (MIT licence), which is not used here.

The model has three channels. Its luminance channel is left to `sender.visibility.elatcsf`, which
was fitted to flicker; what is here are the red-green and the yellow-violet one, as the authors use
them for uniform discs: the largest response over spatial frequencies, times a power of the radius.
A block counts as a disc of its area, at the line of sight, where the eye sees colour best. This is
on the safe side: the edge of a block may not be as sharp as that of a disc in the laboratory, and
neighbours that toggle in opposite senses are not taken off.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from link.types import Array

XYZ_FROM_RGB = np.array(
    [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750],
     [0.0193339, 0.1191920, 0.9503041]]
)  # fmt: skip
"""Matrix from linear sRGB, in which white is (1, 1, 1), to CIE 1931 XYZ (IEC 61966-2-1)."""
XYZ_FROM_LMS = np.array(
    [[2.629129278399650, -3.780202391780134, 10.294956387893450],
     [0.865649062438827, 1.215555811642301, -0.984175688105352],
     [-0.008886561474676, 0.081612628990755, 51.371024830897888]]
)  # fmt: skip
"""Matrix from CIE 2006 cone responses to CIE 1931 XYZ for the spectra of an LCD with LED light."""
OPPONENT_FROM_LMS = np.array([[1.0, 1.0, 0.0], [1.0, -2.3112, 0.0], [-1.0, -1.0, 50.9875]])
"""Matrix from cone responses to luminance, red-green and yellow-violet."""
DISC_AREA = 2.42437
"""Area, in square degrees, for which a disc's response at its edge is worked out."""
DISC_EXPONENT = 3.01142
"""One over the power of a disc's radius, in degrees, by which the sensitivity to it grows."""
CYCLES_PER_DEGREE = np.geomspace(0.125, 16, 100)
"""Spatial frequencies, in cycles per degree, of which the most sensitive counts."""


@dataclass(frozen=True)
class Opponent:
    """Constants of a colour channel of castleCSF, named as in the authors' code."""

    S_max: tuple[float, float, float]
    """Peak sensitivity s0 (1 + s1 / L)^-s2 at luminance L in cd/m²."""
    f_max: float
    """Spatial frequency of the peak, in cycles per degree."""
    bw: float
    """Binary logarithm of the bandwidth over spatial frequencies."""
    A_0: float
    """Largest area over which the channel adds up, in square degrees."""
    f_0: float
    """Spatial frequency above which this area shrinks, in cycles per degree."""
    sigma: float
    """Constant of the decay exp(-f^beta / sigma) over temporal frequencies f in Hz."""
    beta: float
    """Exponent of the decay over temporal frequencies."""

    def sensitivity(self, frequency_hz: ArrayLike, luminance: float) -> Array:
        """Work out the sensitivity to a grating of `DISC_AREA` at the line of sight.

        Args:
            frequency_hz: (F,) temporal frequencies, Hz.
            luminance: mean luminance, cd/m².

        Returns:
            (F, 100) sensitivities to the channel's contrast, at each of `CYCLES_PER_DEGREE`.
        """
        hz = np.asarray(frequency_hz, np.float64)
        peak, half, power = self.S_max
        distance = np.log10(CYCLES_PER_DEGREE / self.f_max)
        in_space = peak * (1 + half / luminance) ** -power * 10 ** (-(distance**2) / 2**self.bw)
        reach = self.A_0 / (1 + (CYCLES_PER_DEGREE / self.f_0) ** 2)
        summed = np.sqrt(reach / (1 + reach / DISC_AREA)) * CYCLES_PER_DEGREE
        return np.asarray(np.exp(-(hz**self.beta) / self.sigma)[:, None] * in_space * summed)


RED_GREEN = Opponent(
    (681.434, 38.0038, 0.480386), 0.0178364, 2.42104, 2816.44, 0.0711058, 16.4325, 1.15591
)
"""Constants of the red-green channel."""
YELLOW_VIOLET = Opponent(
    (166.683, 62.8974, 0.41193), 0.00425753, 2.68197, 2.82789e7, 0.000635093, 7.15012, 0.969123
)
"""Constants of the yellow-violet channel."""


def opponent_change(light: Array) -> Array:
    """Take the changes of colour out of a changing light, in proportion to its mean luminance.

    What changes in proportion to the mean light, as gray does, is no change of colour.

    Args:
        light: (T, 3) linear sRGB over time, of any scale.

    Returns:
        (T, 2) contrast to the mean of red-green and of yellow-violet.

    >>> gray = np.array([[1.0, 1.0, 1.0], [1.5, 1.5, 1.5]])
    >>> np.abs(opponent_change(gray)).max() < 1e-12
    np.True_
    """
    opponent_from_rgb = OPPONENT_FROM_LMS @ np.linalg.inv(XYZ_FROM_LMS) @ XYZ_FROM_RGB
    mean = light.mean(axis=0)
    luminance = light @ XYZ_FROM_RGB[1]
    colour = light - mean * (luminance / luminance.mean())[:, None]
    changes = colour @ opponent_from_rgb.T / (opponent_from_rgb[0] @ mean)
    return np.asarray(changes[:, 1:])


@lru_cache(maxsize=1024)
def _disc_sensitivities(
    hz: tuple[float, ...], luminance: float, width: float, height: float
) -> Array:
    growth = (np.sqrt(width * height / np.pi)) ** (1 / DISC_EXPONENT)
    channels = [c.sensitivity(hz, luminance) * growth for c in (RED_GREEN, YELLOW_VIOLET)]
    both = np.stack(channels)
    both.flags.writeable = False
    return both


def colour_over_threshold(
    amplitudes: Array,
    frequency_hz: ArrayLike,
    luminance_cd_m2: float,
    width_deg: float,
    height_deg: float,
) -> Array:
    """Work out how far each frequency of a flicker of colour lies above what is just seen.

    Args:
        amplitudes: (..., F, 2) amplitudes of the two changes of `opponent_change`.
        frequency_hz: (F,) temporal frequencies, Hz.
        luminance_cd_m2: mean luminance, cd/m².
        width_deg: width of the flickering rectangle, degrees.
        height_deg: height of the flickering rectangle, degrees.

    Returns:
        (...) pooled over frequencies and channels in quadrature; 1 is just seen.
    """
    hz = tuple(np.atleast_1d(np.asarray(frequency_hz, np.float64)).tolist())
    red_green, yellow_violet = _disc_sensitivities(
        hz, float(luminance_cd_m2), float(width_deg), float(height_deg)
    )
    power = np.square(amplitudes[..., 0]) @ np.square(red_green)
    power = power + np.square(amplitudes[..., 1]) @ np.square(yellow_violet)
    return np.asarray(np.sqrt(power.max(axis=-1)))
