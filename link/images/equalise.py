"""Hidden ratex: intensity mapping to a near-uniform histogram (paper, § Hidden Ratex).

The display shows a picture whose intensities are near uniform. The receiver maps the captured
original to uniform again, and that mapping is an estimate of the inverse CDTF. One mapping, from
the histogram of all colour channels together, serves every channel.
"""

import numpy as np
from numpy.typing import NDArray

from link.types import Image


def uniform_mapping(frame: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Find the mapping that makes the histogram of a frame near uniform.

    Args:
        frame: uint8 of any shape, encoded.

    Returns:
        (256,) float64 in [0, 255]: 255 times the mid-rank of each intensity; non-decreasing.
    """
    histogram = np.bincount(frame.reshape(-1), minlength=256)
    return np.asarray(255.0 * (np.cumsum(histogram) - 0.5 * histogram) / histogram.sum())


def equalise(picture: Image) -> NDArray[np.uint8]:
    """Give a picture a near-uniform histogram before it is displayed.

    Args:
        picture: an `Image`.

    Returns:
        uint8 of the same shape, encoded.
    """
    return uniform_mapping(picture).round().astype(np.uint8)[picture]
