"""How much the picture changes for somebody who looks at it: CIEDE2000 of its mean over time.

The eye blurs the two states of a frame pair, which change faster than it follows, into their mean.
What that mean differs from the picture is the price of hiding beside the flicker: tones that were
squeezed to make room for kappa, and ratex patches, which lie in the picture's place.
"""

import math

import numpy as np
from numpy.typing import NDArray
from skimage.color import deltaE_ciede2000, rgb2lab

MEASURED_PIXELS = 1_000_000
"""Largest number of pixels of which the difference is taken; of larger pictures every third pixel
of a row and column is taken, or every fifth, and so on, so that all of the dither's 4 x 4 are."""


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
    shown, given = (rgb2lab(levels[::step, ::step] / 255) for levels in (mean, picture))
    difference = deltaE_ciede2000(shown, given)
    return float(difference.mean()), float(np.percentile(difference, 95))
