"""A rateless code: from a block of information, as many coded bits as anyone wants.

It is a Raptor code (Shokrollahi 2006; over noisy channels Etesami & Shokrollahi 2006). A block's
information bits and a few parity bits are its *intermediate* bits. Coded bit number t is the sum
modulo 2 of some intermediate bits, which its number chooses. So every coded bit brings as much as
any other, and a receiver needs any of them that are enough, whichever they are.

All blocks of a message are equally long and share one graph. The decoder works on many of them at
once: arrays have one column for each block, which makes numpy fast.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from link.code.scrambled import scrambled, shuffled
from link.steps import Steps
from link.types import Floats

MIN_INFORMATION, MAX_INFORMATION = 256, 16384
"""Smallest number of information bits in a block, and the largest that a message is cut into."""
DEGREES = {1: 20, 2: 450, 3: 180, 4: 75, 5: 95, 8: 95, 19: 60, 65: 25}
"""Numbers of coded bits, of 1000, by the number of intermediate bits whose sum each of them is.
They are close to Shokrollahi's distribution, with more coded bits of degree 1, with which decoding
starts on a clean channel."""
PRECODE_COPIES = 3
"""Number of parity checks of the precode in which each information bit stands."""
ITERATIONS = 120
"""Number of rounds of belief propagation after which the decoder gives up."""
PATIENCE, LEAST_GROWTH = 8, 1.05
"""Number of rounds after which the mean certainty of some block must have grown by a factor, as it
does nearly wherever decoding goes on to succeed; otherwise the decoder gives up early. It does not
once a block is decoded, because the other blocks of a message have as much information."""
MAX_COLUMNS = 4
"""Number of blocks that are decoded at once. A message of four blocks is 16 bytes, which numpy
copies from place to place several times as fast as one of ten, and more would not fit into the
processor's caches."""
GRAPH_WORK = 8
"""Work of building the graph, for each of its edges. A unit of work is the time in which one
message is passed along an edge for one block, some two nanoseconds of one core."""
MAX_HALF_LLR = np.float32(9)
"""Largest magnitude of half a log-likelihood ratio in belief propagation; larger ones are cut."""
MAX_PRODUCT = np.float32(1 - 2**-23)
"""Largest magnitude of a product of hyperbolic tangents; larger ones are cut."""

Bits = NDArray[np.uint8]
"""Bits 0 and 1."""
Group = tuple[NDArray[np.intp], NDArray[np.intp]]
"""Checks of one degree: the (n,) numbers of their coded bits, and their (degree, n) members."""


@dataclass(frozen=True)
class RatelessCode:
    """The code of blocks of a given number of information bits."""

    information: int
    """Number of information bits in a block; they are the first intermediate bits."""
    intermediate: int
    """Number of intermediate bits in a block, a prime."""
    precode: NDArray[np.intp]
    """(members, checks) intermediate bits in each check of the precode; the last two rows are the
    check's own parity bit and the one before it. The number `intermediate` stands for a bit that
    does not exist and counts as 0."""

    def encode(self, information: Bits, count: int) -> Bits:
        """Make coded bits.

        Args:
            information: (information, blocks) bits.
            count: number of coded bits for each block.

        Returns:
            (count, blocks) uint8; coded bits 0 to ``count`` - 1 of each block.
        """
        blocks = information.shape[1]
        bits = np.zeros((self.intermediate + 1, blocks), np.uint8)
        bits[: self.information] = information
        sums = np.bitwise_xor.reduce(bits[self.precode[:-2]], axis=0)
        bits[self.information : -1] = np.bitwise_xor.accumulate(sums, axis=0)
        coded = np.empty((count, blocks), np.uint8)
        for numbers, members in self.groups(np.arange(count)):
            coded[numbers] = bits[members[0]]
            for row in members[1:]:
                coded[numbers] ^= bits[row]
        return coded

    def groups(self, numbers: NDArray[np.integer]) -> Iterator[Group]:
        """List the members of coded bits, degree by degree.

        The members of a coded bit are an arithmetic progression modulo the number of intermediate
        bits. That is a prime, so they are all different.

        Args:
            numbers: (T,) numbers of coded bits.
        """
        words = scrambled(numbers, self.intermediate)
        draw = words % np.uint64(sum(DEGREES.values()))
        prime = np.uint64(self.intermediate)
        start = (words >> np.uint64(10)) % prime
        step = (words >> np.uint64(36)) % (prime - np.uint64(1)) + np.uint64(1)
        least = 0
        for degree, share in DEGREES.items():
            mine = np.flatnonzero((draw >= least) & (draw < least + share))
            least += share
            times = np.arange(degree, dtype=np.uint64)[:, None]
            members = (start[mine] + times * step[mine]) % prime
            yield numbers[mine].astype(np.intp), members.astype(np.intp)

    def decoding_steps(self, llr: NDArray[np.floating]) -> Steps[tuple[Bits, NDArray[np.bool_]]]:
        """Find the information by belief propagation (sum-product), step by step.

        `MAX_COLUMNS` blocks are decoded at a time. If one of them cannot be, the blocks after them
        are left alone, because a message needs all of its blocks.

        Args:
            llr: (count, blocks) log-likelihood ratios of coded bits 0 to ``count`` - 1, positive
                for 1; 0 where nothing was received. It must not change between steps.

        Returns:
            a generator, which yields the work of each step in the unit of `GRAPH_WORK`, and returns
            (information, blocks) bits, and (blocks,) whether a block's are thought to be right.
        """
        graph = _Graph(self, np.flatnonzero(llr.any(axis=1)))
        yield GRAPH_WORK * graph.edges
        bits = np.zeros((self.information, llr.shape[1]), np.uint8)
        done = np.zeros(llr.shape[1], bool)
        for first in range(0, llr.shape[1], MAX_COLUMNS):
            columns = slice(first, first + MAX_COLUMNS)
            found = yield from graph.decoding_steps(llr[:, columns], bool(done.any()))
            bits[:, columns], done[columns] = found
            if not done[columns].all():
                break
        return bits, done


class _Graph:
    """Received coded bits and the precode as a graph, for belief propagation on many blocks.

    Intermediate bits are renumbered by falling degree. So the sum of all messages to each of them
    is a few additions of whole arrays, each to as many bits as have that many messages.
    """

    def __init__(self, code: RatelessCode, received: NDArray[np.intp]) -> None:
        self.code = code
        single, *groups = code.groups(received)
        groups.append((np.arange(0), code.precode))
        edges = np.concatenate([members.reshape(-1) for _, members in groups])
        degree = np.bincount(edges, minlength=code.intermediate + 1)
        degree[-1] = 0  # the bit that does not exist is told nothing
        order = np.argsort(-degree, kind="stable")
        self.rank = np.empty_like(order)
        self.rank[order] = np.arange(order.size)
        self.single = single[0], self.rank[single[1][0]]
        self.groups = [(numbers, self.rank[members]) for numbers, members in groups]
        small = np.min_scalar_type(order.size)  # of 16 bits, which are sorted by their digits
        by_bit = np.argsort(self.rank.astype(small)[edges], kind="stable")
        starts = np.cumsum(degree[order]) - degree[order]
        reach = np.searchsorted(-degree[order], -np.arange(degree.max()), side="left")
        self.messages_to = [by_bit[starts[:many] + turn] for turn, many in enumerate(reach)]
        """For each turn, the messages to the first bits that receive at least so many; the n-th
        turn adds the n-th message of each bit."""
        self.edges = edges.size

    def decoding_steps(
        self, llr: NDArray[np.floating], hopeful: bool
    ) -> Steps[tuple[Bits, NDArray[np.bool_]]]:
        """Decode some blocks at once; `RatelessCode.decoding_steps` says the rest.

        Args:
            llr: (count, columns) log-likelihood ratios.
            hopeful: whether other blocks of the message were decoded, so that it does not give up
                early.
        """
        count, columns = self.code.intermediate + 1, llr.shape[1]
        bits, done = np.zeros((count, columns), np.uint8), np.zeros(columns, bool)
        half = np.clip(llr, -2 * MAX_HALF_LLR, 2 * MAX_HALF_LLR).astype(np.float32) / -2
        channel = [np.tanh(half[numbers]) for numbers, _ in self.groups]  # positive for 0 from here
        known = np.zeros((count, columns), np.float32)
        np.add.at(known, self.single[1], 2 * half[self.single[0]])
        known[self.rank[-1]] = 2 * MAX_HALF_LLR
        messages = np.zeros((self.edges, columns), np.float32)
        active, total = np.arange(columns), known
        certainty = np.zeros(columns)
        for turn in range(ITERATIONS):
            self._pass(messages, channel, total)
            total = self._sum(messages, known)
            yield self.edges * (active.size + 1)  # one for what is done once for all blocks
            word = (total < 0).astype(np.uint8)
            failed = np.bitwise_xor.reduce(word.take(self.groups[-1][1], axis=0), axis=0)
            whole = ~failed.any(axis=0) & total.all(axis=0)
            bits[:, active[whole]] = word[:, whole]
            done[active[whole]] = True
            if done.all():
                break
            hopeful = hopeful or bool(done.any())
            if turn % PATIENCE == PATIENCE - 1 and not hopeful:
                before, certainty[active] = certainty[active], np.abs(total[:-1]).mean(axis=0)
                if not (certainty[active] > LEAST_GROWTH * before).any():
                    break
            if whole.sum() > active.size // 4:
                left = np.flatnonzero(~whole)
                active, known = active[left], known.take(left, axis=1)
                messages, total = messages.take(left, axis=1), total.take(left, axis=1)
                channel = [tanh.take(left, axis=1) for tanh in channel]
        return bits[self.rank[: self.code.information]], done

    def _sum(self, messages: Floats, known: Floats) -> Floats:
        """Add up all that each bit is told: (intermediate + 1, columns)."""
        total = known.copy()
        for edges in self.messages_to:
            total[: edges.size] += messages.take(edges, axis=0)
        return total

    def _pass(self, messages: Floats, channel: list[Floats], total: Floats) -> None:
        """Turn the messages that bits were sent into the next ones, in place."""
        at = 0
        for (_, members), tanh in zip(self.groups, channel, strict=True):
            degree, checks = members.shape
            mine = messages[at : at + members.size].reshape(degree, checks, -1)
            at += members.size
            told = total.take(members, axis=0)
            told -= mine
            told *= np.float32(0.5)
            np.tanh(np.clip(told, -MAX_HALF_LLR, MAX_HALF_LLR, out=told), out=told)
            # each message is the product of all others: of those before it and those after it
            mine[0] = tanh if tanh.size else 1
            for turn in range(1, degree):
                np.multiply(mine[turn - 1], told[turn - 1], out=mine[turn])
            product = told[-1]
            for turn in range(degree - 2, -1, -1):
                mine[turn] *= product
                np.multiply(product, told[turn], out=product)
            np.clip(mine, -MAX_PRODUCT, MAX_PRODUCT, out=mine)
            np.add(mine, 1, out=told)
            np.subtract(1, mine, out=mine)
            np.log(np.divide(told, mine, out=mine), out=mine)


@lru_cache(maxsize=8)
def make_rateless(information: int) -> RatelessCode:
    """Make the code of blocks of a number of information bits, at least `MIN_INFORMATION`.

    The precode has about one parity bit for 50 information bits, and 16 more. Each is the parity
    bit before it plus the information bits that three pseudo-random orders assign to it.
    """
    intermediate = information + information // 50 + 16
    while any(intermediate % factor == 0 for factor in range(2, int(intermediate**0.5) + 1)):
        intermediate += 1
    checks = intermediate - information
    orders = [shuffled(information, information + copy) for copy in range(PRECODE_COPIES)]
    length = -(-PRECODE_COPIES * information // checks)
    members = np.full(length * checks, intermediate, np.intp)
    members[: PRECODE_COPIES * information] = np.concatenate(orders)
    members = np.sort(members.reshape(length, checks), axis=0)
    twice = np.zeros(members.shape, bool)
    twice[1:] = members[1:] == members[:-1]
    twice[:-1] |= twice[1:]  # a bit that stands twice in a check stands for nothing
    members[twice] = intermediate
    chain = information + np.arange(checks)
    before = np.concatenate([[intermediate], chain[:-1]])
    return RatelessCode(information, intermediate, np.vstack([members, chain, before]))
