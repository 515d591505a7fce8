"""How small a flicker the eye sees: the model elaTCSF, for rectangles of light.

Source: Yancheng Cai, Ali Bozorgian, Maliha Ashraf, Robert Wanat and Rafał K. Mantiuk, "elaTCSF: A
Temporal Contrast Sensitivity Function for Flicker Detection and Modeling Variable Refresh Rate
Flicker", SIGGRAPH Asia 2024 Conference Papers, https://doi.org/10.1145/3680528.3687586 (also
arXiv:2503.16759). Their code, https://github.com/gfxdisp/elaTCSF, is under the MIT licence; it is
not used here, but the numbers of this module agree with it.

The model is of luminance only, and of large uniform areas: it knows no spatial frequency, no edges
and no masking by a picture. The sensitivity of a small spot at eccentricity e (degrees), luminance
L (cd/m²) and temporal frequency f (Hz) is

    S(e, L, f) = 10^(-0.0330933 e) 1.76801 (1 + 1.62402 / L)^-0.533781 H(f'),
    H(f') = 154.133 |(1 + 2πi f' τ)^-15 - 0.721095 (1 + 2πi f' 2.12547 τ)^-16|,
    f' = ((f + 2) / (1 + 0.0341811 e) - 2) / (0.6678 + 0.222269 log10 L),   τ = 0.00292069 s.

A flicker of contrast c (amplitude over mean) is at threshold where the integral of (c S)^3.80022
over the visual field, in square degrees, is 6.52801. All constants are those of the paper.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from link.types import Array

POOLING_EXPONENT = 3.80022
"""Exponent by which the response is summed over the visual field (the paper's beta)."""
THRESHOLD_ENERGY = 6.52801
"""Value of the integral over the visual field, in square degrees, at which flicker is detected."""
NODES = 20
"""Number of nodes of the Gauss-Legendre rule along each of its two axes."""
_NODE, _WEIGHT = (part / 2 for part in np.polynomial.legendre.leggauss(NODES))


def spot_sensitivity(
    eccentricity_deg: ArrayLike, luminance_cd_m2: float, frequency_hz: ArrayLike
) -> Array:
    """Work out the sensitivity to flicker of a small spot, which only `flicker_sensitivity` uses.

    Args:
        eccentricity_deg: angles from the line of sight, degrees, at least 0.
        luminance_cd_m2: mean luminance, cd/m², at least 0.1: the model has no data below, and a
            pole at 0.001 cd/m².
        frequency_hz: temporal frequencies, Hz, of a shape that broadcasts with the angles.

    Returns:
        the factor S of the module's formula, in the broadcast shape.
    """
    eccentricity = np.asarray(eccentricity_deg, np.float64)
    shifted = (np.asarray(frequency_hz, np.float64) + 2) / (1 + 0.0341811 * eccentricity) - 2
    phase = 2j * np.pi * 0.00292069 * shifted / (0.6678 + 0.222269 * np.log10(luminance_cd_m2))
    fast = (1 + phase) ** -15
    slow = (1 + 2.12547 * phase) ** -16
    in_time = 154.133 * np.abs(fast - 0.721095 * slow)
    in_light = 1.76801 * (1 + 1.62402 / luminance_cd_m2) ** -0.533781
    return np.asarray(10 ** (-0.0330933 * eccentricity) * in_light * in_time)


def _corner_integral(width: float, height: float, luminance: float, hz: Array) -> Array:
    """Integrate S^3.80022 over a rectangle with one corner at the line of sight, by frequency.

    The rectangle is cut along its diagonal. In each triangle x = u and y = u v: the integrand,
    which has a kink at the corner because it depends on the distance, is smooth in u and v.
    """
    total = np.zeros(len(hz))
    if width == 0 or height == 0:
        return total
    fraction = _NODE + 0.5
    for near, far in ((width, height), (height, width)):
        u = near * fraction[:, None]
        v = far / near * fraction
        eccentricity = u * np.sqrt(1 + v**2)
        area = (near * _WEIGHT[:, None] * u * (far / near) * _WEIGHT).ravel()
        spots = spot_sensitivity(eccentricity.reshape(-1, 1), luminance, hz)
        total += area @ spots**POOLING_EXPONENT
    return total


@lru_cache(maxsize=4096)
def _pooled(
    width: float, height: float, luminance: float, hz: tuple[float, ...], eccentricity: float
) -> Array:
    right, left = eccentricity + width / 2, eccentricity - width / 2
    frequencies = np.array(hz, np.float64)
    sides = [
        np.sign(side) * _corner_integral(abs(side), height / 2, luminance, frequencies)
        for side in (right, left)
    ]
    pooled = (2 * (sides[0] - sides[1]) / THRESHOLD_ENERGY) ** (1 / POOLING_EXPONENT)
    pooled.flags.writeable = False
    return np.asarray(pooled)


def flicker_sensitivity(
    frequency_hz: ArrayLike,
    luminance_cd_m2: float,
    width_deg: float,
    height_deg: float,
    eccentricity_deg: float = 0.0,
) -> Array:
    """Work out the sensitivity to flicker of a rectangle: one over the contrast that is just seen.

    Args:
        frequency_hz: (F,) temporal frequencies or one of them, Hz, above 0.
        luminance_cd_m2: mean luminance, cd/m², at least 0.1.
        width_deg: width of the rectangle as seen, degrees, above 0.
        height_deg: height of the rectangle as seen, degrees, above 0.
        eccentricity_deg: angle between the line of sight and the rectangle's centre, which lies to
            the side of it, degrees, at least 0.

    Returns:
        (F,) sensitivities; a sine of contrast c is at threshold where c times this is 1. The
        result is kept for the next call, and cannot be written to.

    >>> flicker_sensitivity([15, 60], 100, 6, 3.5).round(3)  # the authors' code: 247.655, 3.06588
    array([247.655,   3.066])
    """
    frequencies = tuple(np.atleast_1d(np.asarray(frequency_hz, np.float64)).tolist())
    return _pooled(
        float(width_deg),
        float(height_deg),
        float(luminance_cd_m2),
        frequencies,
        float(eccentricity_deg),
    )
