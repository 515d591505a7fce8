"""Pseudo-random numbers on which sender and receiver agree."""

import numpy as np
from numpy.typing import NDArray


def scrambled(first: int, count: int) -> NDArray[np.uint64]:
    """Give the numbers from ``first`` on as SplitMix64 scrambles them (Steele et al. 2014).

    It is written out here because sender and receiver must agree whatever version of numpy, or
    which language, they run on.
    """
    z = np.arange(first + 1, first + count + 1, dtype=np.uint64) * np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return np.asarray(z ^ (z >> np.uint64(31)))
