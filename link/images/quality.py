"""How visible a hidden message is: PSNR and SSIM of the original and the embedded frame."""

import cv2
import numpy as np
from numpy.typing import NDArray

from link.types import Image


def psnr(original: NDArray[np.uint8], embedded: Image) -> float:
    """Peak signal-to-noise ratio over all pixels and channels.

    Args:
        original: uint8 of any shape, encoded.
        embedded: an `Image` of the same shape.

    Returns:
        decibels; infinite where the frames are equal.

    >>> round(psnr(np.full((4, 4), 100, np.uint8), np.full((4, 4), 103, np.uint8)), 2)
    38.59
    """
    error = np.mean((original.astype(np.float64) - embedded) ** 2)
    return float("inf") if error == 0 else float(10 * np.log10(255.0**2 / error))


def ssim(original: Image, embedded: Image) -> float:
    """Structural similarity, the mean over pixels and channels (Wang et al. 2004: sigma 1.5 px).

    Args:
        original: an `Image`, more than 10 px on each side.
        embedded: an `Image` of the same shape.

    Returns:
        at most 1, which equal frames have.
    """
    x, y = original.astype(np.float32), embedded.astype(np.float32)

    def blur(image: NDArray[np.float32]) -> NDArray[np.float32]:
        return np.asarray(cv2.GaussianBlur(image, (11, 11), 1.5, borderType=cv2.BORDER_REFLECT))

    mean_x, mean_y = blur(x), blur(y)
    var_x, var_y = blur(x * x) - mean_x**2, blur(y * y) - mean_y**2
    covariance = blur(x * y) - mean_x * mean_y
    c1, c2 = (0.01 * 255) ** 2, (0.03 * 255) ** 2
    numerator = (2 * mean_x * mean_y + c1) * (2 * covariance + c2)
    denominator = (mean_x**2 + mean_y**2 + c1) * (var_x + var_y + c2)
    return float(np.mean((numerator / denominator)[5:-5, 5:-5], dtype=np.float64))
