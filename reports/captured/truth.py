"""Find the part of the loop that a film shows, by matching the bits read with those sent.

A decoder that read the film says of each bit how sure it is, so it says how many of its bits should
be wrong. Where it is sure and no part of the loop fits, the film shows something else. Where it is
not sure and none fits, nothing can be said, and those frame pairs are left out.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from link.types import Array

MOST_UNLIKE = 0.375
"""Largest share of wrong bits that the best match with the loop may leave. Chance leaves a half,
less the little that the best of all places in the loop gains."""
SURE = 0.2
"""Largest share of wrong bits that a decoder may expect where a match that leaves more than
`MOST_UNLIKE` means that something else was shown. A frame pair among others that fit is something
else, too, where as many more bits are wrong as lie between the two: a decoder that has to be
careful all the time expects more wrong bits than it makes."""
BY_CHANCE = 5.0
"""Number of standard deviations of chance by which two places in the loop must fit better than
one before the film is taken to jump from the one to the other."""


@dataclass(frozen=True)
class Match:
    """Match of successive frame pairs with a part of the loop."""

    kind: Literal["fits", "jumps", "other", "unclear"]
    """Whether a part of the loop fits all frame pairs, or not some of them, though a part fits
    most; or none does though the bits were read surely, or none because they were not."""
    bits: NDArray[np.integer]
    """(P, n_bits) bits of the part that fits best."""
    place: int
    """Number of the loop's frame pair that the first frame pair shows."""


def match_loop(scores: Array, loop: NDArray[np.integer], place: int | None = None) -> Match:
    """Find the part of a loop that successive frame pairs show.

    Args:
        scores: (P, n_bits) log-likelihood ratios of the frame pairs; 0 where a bit was not read.
        loop: (loop pairs, n_bits) bits of the loop, 0 or 1.
        place: number of the loop's frame pair that the first one must show; None for any.

    >>> loop = np.random.default_rng(0).integers(0, 2, (9, 200))
    >>> scores = 5.0 * (2 * np.roll(loop, -3, axis=0)[:4] - 1)
    >>> found = match_loop(scores, loop)
    >>> found.kind, found.place, match_loop(-scores, loop).kind
    ('fits', 3, 'other')
    """
    decided = np.sign(scores)
    counted = np.abs(decided).sum(1)  # (P,)
    unlike = (counted[:, None] - decided @ (2 * loop.astype(np.float64) - 1).T) / 2  # (P, L)
    rows = np.arange(len(scores))
    numbers = (rows[:, None] + np.arange(len(loop))) % len(loop)  # (P, L)
    wrong = unlike[rows[:, None], numbers]  # by the place of the first pair
    total = wrong.sum(0)
    best = int(total.argmin()) if place is None else place % len(loop)
    bits = np.asarray(loop[(rows + best) % len(loop)])
    # (P,) wrong bits that the decoder expects of each frame pair
    expected = (np.abs(decided) / (1 + np.exp(np.minimum(np.abs(scores), 700)))).sum(1)
    if total[best] > MOST_UNLIKE * counted.sum() or not counted.any():
        sure = counted.sum() > 0 and expected.sum() <= SURE * counted.sum()
        return Match("other" if sure else "unclear", bits, best)
    surprise = wrong[:, best] - expected > (MOST_UNLIKE - SURE) * counted
    strange = surprise & (wrong[:, best] > MOST_UNLIKE * counted)
    jumps = bool(strange.any()) or _jumps(wrong, counted, best)
    return Match("jumps" if jumps else "fits", bits, best)


def _jumps(wrong: Array, counted: Array, best: int) -> bool:
    """Tell whether two places in the loop, one after the other, fit much better than one.

    At the other place the two states of a frame pair may be taken for each other, since the signs
    of a code (`link.pilot_code`) belong to the place. This does not hold for the first and the last
    frame pair, of which a window shows a part and tells little.

    Args:
        wrong: (P, loop pairs) wrong bits of each frame pair by the place of the first one.
        counted: (P,) bits of each frame pair that were read.
        best: the place that fits all frame pairs best.
    """
    either = np.minimum(wrong, counted[:, None] - wrong)
    either[[0, -1]] = wrong[[0, -1]]
    for along in (slice(None), slice(None, None, -1)):
        size = np.cumsum(counted[along])[:-1]
        here, there = (np.cumsum(part[along], 0)[:-1] for part in (wrong[:, best], either))
        gain, least = here - there.min(1), BY_CHANCE * np.sqrt(size) / 2
        if ((gain > least) & (there.min(1) <= MOST_UNLIKE * size)).any():
            return True
    return False
