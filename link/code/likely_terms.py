"""The terms of a short message are guessed before each of their words is sure by itself.

A loop's terms (`link.code.fine`) are 72 bits in six words. Most messages are short, and most loops
are as long as is usual. Of such a loop only the mark (24 bits) and the length (8 bits) are open, so
the six words together tell the terms much earlier than each of them tells its own 12 bits.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from link.code.fine import MARK_BYTES, Terms, fine_frames, masks_of, pieces_of
from link.code.words import NUMBER_BITS, NUMBERS, over_chance
from link.types import Floats

SHORT = 256
"""Largest number of bytes in a message whose terms are guessed. All such lengths share the word
that holds their higher bits."""
DOUBT = 1e-2
"""Largest probability of all other terms together at which the likeliest ones are believed."""
MOST_MARKS = 4096
"""Largest number of marks that are weighed with every length."""


def likely_terms(evidence: Floats, n_bits: int) -> Terms | None:
    """Guess the terms of a short message whose loop has the usual number of frames.

    Args:
        evidence: (PIECES, 4096) log-likelihood of each number that each word of the terms may tell,
            summed up over frames; 0 where a word was not seen.
        n_bits: message blocks of a frame.

    Returns:
        the likeliest terms, or None while others are not improbable.
    """
    words = over_chance(evidence)
    most = words.max(axis=1)
    open_terms = np.log(2.0 ** (8 * MARK_BYTES) * SHORT)
    needed = open_terms - np.log(DOUBT)
    if most.sum() < needed:
        return None
    order = np.argsort(-words[:2], axis=1, kind="stable")
    high, low = (ranked[ranks] for ranked, ranks in zip(order, _ranks(), strict=True))
    marks, score = high << NUMBER_BITS | low, words[0][high] + words[1][low]
    near = score + most[2:].sum() >= needed
    marks, score = marks[near], score[near]
    score = score + words[2][masks_of(marks)[:, 2]]  # where a short length has its higher bits: 0
    best = np.argsort(-score, kind="stable")[:MOST_MARKS]
    best = best[score[best] + most[3:].sum() >= needed]
    if best.size == 0:
        return None
    marks, total = marks[best, None], score[best, None]
    lengths, frames = _usual(n_bits)
    for word, numbers in list(zip(words, pieces_of(marks, lengths, frames), strict=True))[3:]:
        total = total + word[numbers]  # (M, 1) -> (M, SHORT)
    mark, length = np.unravel_index(total.argmax(), total.shape)
    sure = total[mark, length]
    if np.exp(total - sure).sum() - 1 + np.exp(open_terms - sure) > DOUBT:
        return None
    return Terms(int(lengths[length]), int(frames[length]), int(marks[mark, 0]))


@lru_cache(maxsize=1)
def _ranks() -> NDArray[np.intp]:
    """List (2, N) ranks of a mark's two words: each pair with fewer than 4096 surely better ones.

    A pair of the ranks a and b, counted from 0, has (a + 1) (b + 1) - 1 pairs that are no worse.
    """
    counts = NUMBERS // np.arange(1, NUMBERS + 1)
    first = np.repeat(np.arange(NUMBERS), counts)
    second = np.concatenate([np.arange(count) for count in counts])
    return np.stack([first, second])


@lru_cache(maxsize=16)
def _usual(n_bits: int) -> NDArray[np.int64]:
    """List the lengths of short messages and the frames of their loops: (2, SHORT)."""
    lengths = np.arange(1, SHORT + 1)
    frames = [fine_frames(length, n_bits) for length in lengths.tolist()]
    return np.stack([lengths, frames])
