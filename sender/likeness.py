"""How much the picture changes: PSNR and SSIM of the frame pairs, CIEDE2000 of the mean over time.

The eye blurs the two states of a frame pair, which change faster than it follows, into their mean.
What that mean differs from the picture is the price of hiding beside the flicker: tones that were
squeezed to make room for kappa, and ratex patches, which lie in the picture's place.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from link.images.quality import psnr, ssim
from link.loop import Loop
from link.strength import light_of_level
from link.types import Array

XYZ_FROM_RGB = np.array(
    [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750],
     [0.0193339, 0.1191920, 0.9503041]]
)  # fmt: skip
"""Matrix from linear sRGB, in which white is (1, 1, 1), to CIE 1931 XYZ (IEC 61966-2-1)."""
MEASURED_PIXELS = 1_000_000
"""Number of pixels that are measured. So many frame pairs are taken from the loop's first on, an
equal number with each of the two turns of the dither. Of a picture with more pixels, every third of
each row and column is taken, or every fifth and so on; an odd step meets all of the dither's 4 x 4.
"""


@dataclass(frozen=True)
class Likeness:
    """A loop's first frame pairs and their mean over time, to be compared with the picture."""

    picture: NDArray[np.uint8]
    """(height, width, 3) the loop's first picture as it lies on the grid, encoded RGB."""
    time_mean: NDArray[np.float32]
    """(height, width, 3) mean, in gray levels of [0, 255], of the states that show this picture."""
    pairs: list[tuple[float, float]]
    """PSNR in decibels and SSIM of each frame pair, embedded against original."""

    @classmethod
    def of(cls, loop: Loop) -> "Likeness":
        """Look at a loop's first frame pairs.

        Raises:
            InputError: as `link.loop.Loop.carriers` does.
        """
        pairs: list[tuple[float, float]] = []
        states = 0
        for carrier in loop.carriers():
            pair = carrier.displayed()
            if not pairs:
                picture, total = carrier.picture, np.zeros(carrier.picture.shape, np.float32)
            pairs.append((psnr(pair.original, pair.embedded), ssim(pair.original, pair.embedded)))
            if np.array_equal(carrier.picture, picture):
                total += pair.original
                total += pair.embedded
                states += 2
            if len(pairs) % 2 == 0 and len(pairs) * picture[..., 0].size >= MEASURED_PIXELS:
                break
        return cls(picture, total / np.float32(states), pairs)

    def report(self) -> dict[str, float | None]:
        """Say PSNR in decibels, None where nothing changes, SSIM, and `colour_difference`."""
        decibels, similarity = np.transpose(self.pairs)
        noise = float(np.mean(10 ** (-decibels / 10)))
        mean, high = colour_difference(self.time_mean, self.picture)
        return {
            "psnr_db": round(-10 * math.log10(noise), 2) if noise > 0 else None,
            "ssim": round(float(similarity.mean()), 4),
            "delta_e_mean": round(mean, 2),
            "delta_e_95": round(high, 2),
        }


def colour_difference(
    mean: NDArray[np.floating], picture: NDArray[np.uint8]
) -> tuple[float, float]:
    """Compare the mean over time of what is shown with the picture.

    Args:
        mean: (H, W, 3) gray levels of [0, 255], encoded sRGB.
        picture: (H, W, 3) uint8, encoded sRGB, at the same size.

    Returns:
        the mean and the 95th percentile over the pixels of CIEDE2000 (ISO/CIE 11664-6), of which 1
        is just noticeable.

    >>> gray = np.full((8, 8, 3), 128, np.uint8)
    >>> colour_difference(gray.astype(float), gray)
    (0.0, 0.0)
    """
    step = math.ceil(math.sqrt(max(1.0, picture[..., 0].size / MEASURED_PIXELS)))
    step += 1 - step % 2  # odd, so that it meets all places of the dither
    shown, given = (_lab(levels[::step, ::step]) for levels in (mean, picture))
    difference = _ciede2000(shown, given)
    return float(difference.mean()), float(np.percentile(difference, 95))


def _lab(levels: NDArray[np.generic]) -> tuple[Array, NDArray[np.complex128]]:
    """Turn (H, W, 3) gray levels, encoded sRGB, into CIE L* and a* + i b*, (H, W) each."""
    xyz = light_of_level(levels) @ (XYZ_FROM_RGB / XYZ_FROM_RGB.sum(axis=1, keepdims=True)).T
    low = xyz * (29 / 6) ** 2 / 3 + 4 / 29
    x, y, z = np.moveaxis(np.where(xyz > (6 / 29) ** 3, np.cbrt(xyz), low), 2, 0)
    return 116 * y - 16, 500 * (x - y) + 200j * (y - z)


def _ciede2000(
    one: tuple[Array, NDArray[np.complex128]], other: tuple[Array, NDArray[np.complex128]]
) -> Array:
    """Work out CIEDE2000 as Sharma, Wu and Dalal give it (Color Res. Appl. 30(1), 2005).

    Args:
        one: L* and a* + i b* of one colour, (...) each, as `_lab` returns them.
        other: those of the other colour.

    Returns:
        (...) differences.
    """
    (light, ab), (other_light, other_ab) = one, other
    gray = 0.5 - _saturated((np.abs(ab) + np.abs(other_ab)) / 2) / 2
    ab, other_ab = ab + gray * ab.real, other_ab + gray * other_ab.real
    size, other_size = np.abs(ab), np.abs(other_ab)
    middle = (size + other_size) / 2
    hue = np.angle(ab / np.maximum(size, 1e-12) + other_ab / np.maximum(other_size, 1e-12))
    angles = ((1, 30, -0.17), (2, 0, 0.24), (3, -6, 0.32), (4, 63, -0.2))
    shape = 1 + sum(share * np.cos(k * hue - np.deg2rad(turn)) for k, turn, share in angles)
    off = ((light + other_light) / 2 - 50) ** 2
    by_light = (other_light - light) / (1 + 0.015 * off / np.sqrt(20 + off))
    by_size = (other_size - size) / (1 + 0.045 * middle)
    apart = 2 * np.sqrt(size * other_size) * np.sin(np.angle(other_ab * ab.conj()) / 2)
    by_hue = apart / (1 + 0.015 * middle * shape)
    blue = np.exp(-(((np.rad2deg(hue) % 360 - 275) / 25) ** 2))
    crossed = 2 * _saturated(middle) * np.sin(np.pi / 3 * blue) * by_size * by_hue
    return np.asarray(np.sqrt(np.maximum(by_light**2 + by_size**2 + by_hue**2 - crossed, 0)))


def _saturated(chroma: Array) -> Array:
    """Work out how close chromas are to full ones, 0 to 1, by the formula's seventh powers."""
    return np.sqrt(chroma**7 / (chroma**7 + 25.0**7))
