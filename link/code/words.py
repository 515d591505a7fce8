"""Words: numbers below 4096, each told by 48 bits that differ in 14 places from any other word.

A frame of a fine grid says by words which one it is. Words are read from scores: the likelihood of
all 4096 is one product of a matrix and a vector.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from link.code.scrambled import scrambled

NUMBER_BITS = 12
"""Number of bits of the number that a word tells."""
NUMBERS = 1 << NUMBER_BITS
"""Number of different words."""
WORD = 48
"""Number of bits of a word."""
SEED = 13
"""The first seed with which any two words differ in 14 bits or more."""
_ROWS = scrambled(np.arange(NUMBER_BITS), SEED)[:, None] >> np.arange(WORD, dtype=np.uint64)
COLUMNS = (1 << np.arange(NUMBER_BITS)[::-1]) @ (_ROWS & np.uint64(1)).astype(np.int64)
"""(48,) masks, one for each bit of a word: that bit is the sum modulo 2 of those bits of the number
that the mask has. So words are all sums modulo 2 of twelve pseudo-random ones."""


@lru_cache(maxsize=1)
def all_words() -> NDArray[np.uint8]:
    """List the words of all numbers in order: (4096, 48) uint8, 0 or 1."""
    return np.asarray(np.bitwise_count(np.arange(NUMBERS)[:, None] & COLUMNS) & 1, np.uint8)


@lru_cache(maxsize=1)
def _signs() -> NDArray[np.float32]:
    return all_words().astype(np.float32) - np.float32(0.5)


def weigh_words(scores: NDArray[np.floating]) -> NDArray[np.float32]:
    """Weigh all words against what was received, relative to chance.

    Args:
        scores: (words, 48) log-likelihood ratios of bits, positive for 1.

    Returns:
        (words, 4096) logarithm of each number's likelihood over the mean likelihood of all numbers.

    >>> word = 4.0 * all_words()[[77]] - 2.0
    >>> likelihoods = weigh_words(word)
    >>> int(likelihoods.argmax()), bool(likelihoods[0, 77] > 8), bool(likelihoods[0, 78] < 0)
    (77, True, True)
    """
    return over_chance(np.asarray(scores, np.float32) @ _signs().T)


def over_chance(likelihoods: NDArray[np.floating]) -> NDArray[np.float32]:
    """Take the logarithm of the mean likelihood of all numbers off (words, 4096) logarithms."""
    most = likelihoods.max(axis=1, keepdims=True)
    chance = most + np.log(np.exp(likelihoods - most).mean(axis=1, keepdims=True))
    return np.asarray(likelihoods - chance, np.float32)
