"""Pseudo-random words of 64 bits that are equal on every machine (SplitMix64, Steele et al. 2014).

The generator is written out here because sender and receiver must agree whatever version of numpy,
or which language, they run on.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

SHIFTS = (30, 27, 31)
"""Numbers of bits by which a state is shifted in turn while it is mixed."""
_GOLDEN = 0x9E3779B97F4A7C15
_FACTORS = (0xBF58476D1CE4E5B9, 0x94D049BB133111EB)


def scrambled(numbers: NDArray[np.integer], seed: ArrayLike) -> NDArray[np.uint64]:
    """Turn whole numbers into pseudo-random words.

    Args:
        numbers: (N,) whole numbers.
        seed: chooses one of many sequences; or (..., 1) of them.

    Returns:
        (N,) uint64, or (..., N).
    """
    start = (np.atleast_1d(seed).astype(np.uint64) + np.uint64(1)) * np.uint64(_GOLDEN)
    return _mixed(numbers.astype(np.uint64) + start)


def shuffled(count: int, seed: int) -> NDArray[np.intp]:
    """Order the numbers from 0 to ``count - 1`` by their pseudo-random words."""
    return np.argsort(scrambled(np.arange(count), seed), kind="stable")


def splitmix64(first: int, count: int) -> NDArray[np.uint64]:
    """Give ``count`` successive words of the generator, from number ``first`` on."""
    return _mixed(np.arange(first + 1, first + count + 1, dtype=np.uint64) * np.uint64(_GOLDEN))


def _mixed(states: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Turn states of the generator into its words."""
    for shift, factor in zip(SHIFTS, (*_FACTORS, 1), strict=True):
        states = (states ^ (states >> np.uint64(shift))) * np.uint64(factor)
    return states
