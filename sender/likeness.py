"""How much the picture changes: PSNR and SSIM of the frame pairs, CIEDE2000 of the mean over time.

The eye blurs the two states of a frame pair, which change faster than it follows, into their mean.
What that mean differs from the picture is the price of hiding beside the flicker: tones that were
squeezed to make room for kappa, and ratex patches, which lie in the picture's place.
"""

import math

import numpy as np
from numpy.typing import NDArray
from skimage.color import deltaE_ciede2000, rgb2lab

from link.images.quality import psnr, ssim
from link.loop import Loop

MEASURED_PIXELS = 1_000_000
"""Number of pixels that are measured. So many frame pairs are taken from the loop's first on, an
equal number with each of the two turns of the dither. Of a picture with more pixels, every third of
each row and column is taken, or every fifth and so on; an odd step meets all of the dither's 4 x 4.
"""


def likeness_of(loop: Loop) -> dict[str, float | None]:
    """Compare a loop's first frame pairs, and their mean over time, with its first picture.

    Returns:
        PSNR in decibels, None where nothing changes, and SSIM, of embedded against original frames
        in the mean of the pairs, and `colour_difference`; rounded.

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
    decibels, similarity = np.transpose(pairs)
    noise = float(np.mean(10 ** (-decibels / 10)))
    mean, high = colour_difference(total / np.float32(states), picture)
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
    shown, given = (rgb2lab(levels[::step, ::step] / 255.0) for levels in (mean, picture))
    difference = deltaE_ciede2000(shown, given)
    return float(difference.mean()), float(np.percentile(difference, 95))
