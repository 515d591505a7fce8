"""A low-density parity-check code of any length, and belief propagation.

Irregular repeat-accumulate (Jin, Khandekar & McEliece 2000, as in DVB-S2): parity bit j is
    p_j = p_(j-1) + (sum of the information bits of check j)  mod 2,
so encoding is a running sum, and every column of the parity-check matrix is sparse. The graph
depends on the number of bits alone: both ends build the same one.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from link.code.scrambled import shuffled

DEGREES = ((0.4, 8), (0.6, 3))
"""Shares of the information bits, and in how many checks each stands (DVB-S2 at rate 1/2)."""
MAX_LLR = 30.0
"""Largest magnitude of a log-likelihood ratio in belief propagation; larger ones are cut."""
ITERATIONS = 60
"""Number of rounds after which belief propagation gives up."""


@dataclass(frozen=True)
class Code:
    """A code as a graph: edge e joins bit ``bit[e]`` and check ``check[e]``, sorted by check."""

    information: int
    """Number of information bits; they come first in a codeword."""
    parity: int
    """Number of parity bits, which is the number of checks."""
    bit: NDArray[np.intp]
    """(E,) bit of each edge, from 0 to information + parity - 1."""
    check: NDArray[np.intp]
    """(E,) check of each edge, from 0 to parity - 1, in rising order."""
    starts: NDArray[np.intp]
    """(parity,) first edge of each check."""

    @property
    def length(self) -> int:
        """Number of bits in a codeword."""
        return self.information + self.parity

    def encode(self, information: NDArray[np.integer]) -> NDArray[np.uint8]:
        """Append parity: (information,) bits of 0 or 1 become a (length,) uint8 codeword."""
        mine = self.bit < self.information
        sums = np.bincount(
            self.check[mine], information[self.bit[mine]], minlength=self.parity
        ).astype(np.int64)
        return np.concatenate([information, np.cumsum(sums) % 2]).astype(np.uint8)

    def unsatisfied(self, codeword: NDArray[np.integer]) -> int:
        """Count the checks that a (length,) word of 0 and 1 fails."""
        return int((np.add.reduceat(codeword[self.bit].astype(np.int64), self.starts) % 2).sum())

    def decode(self, llr: NDArray[np.float64]) -> NDArray[np.uint8] | None:
        """Find the codeword by belief propagation (sum-product; all checks, then all bits).

        Args:
            llr: (length,) log-likelihood ratios, positive for 1; 0 where nothing was received.

        Returns:
            (length,) uint8, a codeword, or None where none was found.
        """
        channel = np.clip(np.nan_to_num(llr), -MAX_LLR, MAX_LLR)
        messages = channel[self.bit]
        for _ in range(ITERATIONS):
            # positive for 1, so the sign of a check's product is (-1) ** (its edges + 1)
            tanh = np.tanh(np.clip(messages, -MAX_LLR, MAX_LLR) / 2)
            magnitude = np.log(np.maximum(np.abs(tanh), 1e-12))
            negative = (tanh >= 0).astype(np.int64)
            total = np.add.reduceat(magnitude, self.starts)[self.check] - magnitude
            odd = (np.add.reduceat(negative, self.starts)[self.check] - negative) % 2
            back = 2 * np.arctanh(np.minimum(np.exp(total), 1 - 1e-12)) * (2 * odd - 1)
            posterior = channel + np.bincount(self.bit, back, minlength=self.length)
            word = (posterior > 0).astype(np.uint8)
            if self.unsatisfied(word) == 0:
                return word
            messages = posterior[self.bit] - back
        return None


@lru_cache(maxsize=16)
def make_code(information: int, parity: int) -> Code:
    """Make the code with given numbers of information and parity bits, at least 8 each.

    Each information bit in turn takes the next free sockets of the checks, in a scrambled order,
    passing over those that would close a cycle of length four.
    """
    degree = np.concatenate(
        [np.full(round(share * information), times) for share, times in DEGREES]
    )
    degree = np.resize(degree, information)  # rounding may leave one bit too many or too few
    per_check = -(-int(degree.sum()) // parity)
    order = shuffled(parity * per_check, parity)
    free = [int(number) % parity for number in order[::-1]]  # the next one is the last
    members: list[list[int]] = [[] for _ in range(parity)]
    checks_of: list[list[int]] = []
    for number in range(information):
        chosen: list[int] = []
        barred: set[int] = set()
        for _ in range(int(degree[number])):
            ahead = range(-1, -min(len(free), 64) - 1, -1)
            best = next((at for at in ahead if free[at] not in barred), None)
            if best is None:
                best = next((at for at in ahead if free[at] not in chosen), None)
            if best is None:
                break
            socket = free.pop(best)
            chosen.append(socket)
            barred |= {socket - 1, socket, socket + 1}
            barred.update(other for member in members[socket] for other in checks_of[member])
        for socket in chosen:
            members[socket].append(number)
        checks_of.append(chosen)
    bit = np.array([number for number, checks in enumerate(checks_of) for _ in checks], np.intp)
    check = np.array([one for checks in checks_of for one in checks], np.intp)
    chain = np.arange(parity)
    bit = np.concatenate([bit, information + chain, information + chain[:-1]])
    check = np.concatenate([check, chain, chain[1:]])
    by_check = np.lexsort((bit, check))
    starts = np.searchsorted(check[by_check], chain)
    return Code(information, parity, bit[by_check], check[by_check], starts)
