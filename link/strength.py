"""By how much each block changes, so that the eye sees all blocks alike.

The eye's threshold depends on the gray level over which a block flickers, and on the picture's
texture. Where one kappa served all blocks, those over dark gray would be seen most, and those over
bright or busy parts would be weaker than they may be. So kappa is that of the most visible gray
over plain parts, and each block's change is kappa times a factor that follows from the picture
alone. A receiver is told nothing of it; it sees the picture.

Two parts make the factor:

- **Gray level**, by elaTCSF: `EVEN` at the block's mean light. It holds for 60 states a second on
  a display of 200 cd/m² (`sender.visibility`, by which tests hold it).
- **Texture**, by the masking of ColorVideoVDP (Mantiuk et al., SIGGRAPH 2024, equation of mutual
  masking with cross-channel weights; its parameters of version 0.5.4): of the channels of still
  brightness and of flicker, the still one raises the threshold of flicker by
  (1 + w (k s c)^q)^(1/p), where c is the picture's contrast at the size of blocks and s the eye's
  sensitivity to it.
"""

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from link.layout import Layout, block_mean
from link.types import Array, Image

STEPS_PER_OCTAVE = 16
"""Number of steps of strength from a change to one twice as large."""
FACTORS = 2.0 ** (np.arange(2 * STEPS_PER_OCTAVE + 1) / STEPS_PER_OCTAVE)
"""Factors from 1 to 4 by which a block's change exceeds kappa, by the number of the block's step of
strength."""
EVEN = {
    0: 1.00, 2: 1.05, 4: 1.13, 8: 1.26, 12: 1.25, 16: 1.15, 24: 1.03, 32: 1.00, 40: 1.00, 48: 1.02,
    64: 1.10, 96: 1.29, 128: 1.50, 160: 1.74, 192: 1.97, 224: 2.21, 255: 2.43,
}  # fmt: skip
"""Factors over kappa by gray level: with its factor, flicker over each level is as visible as
flicker of kappa over the most visible gray."""
MASKING_WEIGHT, MASKING_EXPONENT = 2**-1.9321587, 1.3026227
"""Weight w and exponent q of still brightness in the masking of flicker (ColorVideoVDP 0.5.4,
`xcm_weights` of the first channel on the fourth, and `mask_q` of the first)."""
MASKING_SCALE, SIGNAL_EXPONENT = 10**-0.7954971, 2.2643552
"""Scale k of contrasts over threshold and exponent p of what is masked (`mask_c` and `mask_p`)."""
STILL_SENSITIVITY = 100.0
"""Contrast sensitivity s of the eye to still patterns of about a block's size, taken low: castleCSF
has 100 to 200 at 1 cycle a degree and 10 to 100 cd/m²."""
BLACK_LIGHT = 1e-3
"""Light of black, of the display and the room, in units of white's."""
UNCERTAINTY_BLOCKS = 1.5
"""Standard deviation, in blocks, over which texture masks: ColorVideoVDP blurs by 3 samples, two of
which make half a period of a block's pattern."""
AROUND_BLOCKS = 2.0
"""Standard deviation, in blocks, of the surroundings against which a block's contrast is taken."""

LUMINANCE_FROM_RGB = np.array([0.2126, 0.7152, 0.0722])
"""Share of white's luminance that each of sRGB's primaries gives (IEC 61966-2-1)."""


def light_of_level(levels: ArrayLike) -> Array:
    """Turn gray levels of [0, 255] into linear light of [0, 1] by sRGB's curve (IEC 61966-2-1)."""
    shares = np.asarray(levels, np.float64) / 255
    linear = np.where(shares <= 0.04045, shares / 12.92, ((shares + 0.055) / 1.055) ** 2.4)
    return np.asarray(linear)


LIGHT = light_of_level(np.arange(256)).astype(np.float32).astype(np.float64)
"""Linear light of each gray level, of 24 bits, so that sums are exact, and equal in every order."""
EVEN_LIGHT = light_of_level(list(EVEN))
"""Linear light of the gray levels of `EVEN`."""


def even_factor(light: ArrayLike) -> Array:
    """Work out by which factor flicker over a plain gray may be larger than over the most visible.

    Args:
        light: linear light of [0, 1], of any shape, in units of white's.

    Returns:
        factors of at least 1, of the same shape.

    >>> float(even_factor(light_of_level(128)))
    1.5
    """
    return np.asarray(np.interp(np.asarray(light), EVEN_LIGHT, list(EVEN.values())))


def masking(light: Array) -> Array:
    """Work out by which factor the picture's texture raises the threshold of each block's flicker.

    Args:
        light: (rows, cols) mean linear light of the blocks, in units of white's.

    Returns:
        (rows, cols) of at least 1.

    >>> float(masking(np.full((4, 4), 0.5)).max())
    1.0
    """
    around = cv2.GaussianBlur(light, (0, 0), AROUND_BLOCKS, borderType=cv2.BORDER_REPLICATE)
    contrast = np.abs(light - around) / (around + BLACK_LIGHT)
    contrast = cv2.GaussianBlur(contrast, (0, 0), UNCERTAINTY_BLOCKS)
    seen = MASKING_SCALE * STILL_SENSITIVITY * contrast
    return np.asarray((1 + MASKING_WEIGHT * seen**MASKING_EXPONENT) ** (1 / SIGNAL_EXPONENT))


def block_steps(picture: Image, layout: Layout) -> NDArray[np.uint8]:
    """Choose how strongly each block of a picture may change.

    Args:
        picture: an `Image` of the layout's size, encoded sRGB.
        layout: grid of the blocks.

    Returns:
        (rows, cols) numbers of steps: indices of `FACTORS`, the largest that keeps a block no more
        visible than kappa over the most visible gray.

    >>> from link.layout import make_layout
    >>> bright = np.full((48, 64), 255, np.uint8)
    >>> float(FACTORS[block_steps(bright, make_layout(4, 4, 64, 48))].round(2).max())
    2.38
    """
    weights = (1.0,) if picture.ndim == 2 else LUMINANCE_FROM_RGB
    planes = picture.reshape(*picture.shape[:2], -1)  # (H, W, 1 or 3)
    light = np.zeros((layout.rows, layout.cols))
    for channel, weight in enumerate(weights):
        light += weight * block_mean(LIGHT[planes[..., channel]], layout.rows, layout.cols)
    factors = even_factor(light) * masking(light)
    steps = np.floor(STEPS_PER_OCTAVE * np.log2(factors) + 1e-9)
    return np.asarray(np.clip(steps, 0, len(FACTORS) - 1), np.uint8)
