"""Framing for fine grids: a message becomes frames of thousands of bits, any of which help.

    information   message | CRC-32 of header and message | zeros, cut into equal blocks
    coded bits    as many as the loop has room for, by turns from each block (`link.code.rateless`)
    frame k       a word that says k | words that say the loop's terms | coded bits k P to k P + P

The *terms* are what a receiver must know before it can decode: the length of the message, the
number of frames in the loop and a mark of the message. They make six words, of which each frame
shows one or more by turns. So a receiver learns them within a few frames, and notices by them when
the message changes. The terms leave no bit free, so a header that is not sent but enters the CRC-32
says whether the message is signed (`link.code.authenticate`): the length in 31 bits, after a bit
that is 1 where it is. The receiver tries both; no message fits both.
"""

import hashlib
import math
import zlib
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from link.code.message import Content
from link.code.rateless import (
    MAX_INFORMATION,
    MIN_INFORMATION,
    RatelessCode,
    make_rateless,
)
from link.code.scrambled import scrambled, shuffled
from link.code.words import NUMBER_BITS, NUMBERS, WORD, all_words, weigh_words
from link.errors import ParameterError
from link.steps import Steps
from link.types import Floats

MAX_MESSAGE = 2**20
"""Largest number of bytes in a message."""
MIN_FRAMES, MAX_FRAMES = 8, NUMBERS
"""Smallest and largest number of frames in a loop that is read."""
USUAL_FRAMES = 32
"""Smallest number of frames in a loop whose redundancy is the usual one. A short message has more
coded bits instead of a shorter loop. Of a dark picture only few blocks can be read: its receiver
follows the frames' numbers for a second or two until it is sure of them, and the loop must not come
round before."""
MAX_CODED = 2**25
"""Largest number of coded bits in a loop, which bounds the receiver's memory."""
MIN_REDUNDANCY, USUAL_REDUNDANCY = 1.2, 8.0
"""Smallest and usual number of coded bits in a loop for each bit of information. With the
usual one a loop comes round only once a receiver has got more than most channels need: from then on
frames bring nothing new where bits were sure, and little where nothing can be read."""
PIECES = 6
"""Number of words that tell the terms."""
HEADER_SHARE = 1 / 12
"""Share of a frame's bits that words may take, if more than one word of the terms is shown."""
CRC_BYTES, MARK_BYTES = 4, 3
"""Number of bytes of the CRC-32 in the information, and of the message's mark in the terms."""


@dataclass(frozen=True)
class Terms:
    """What a receiver must know of a loop before it can decode it."""

    n_bytes: int
    """Length of the message in bytes."""
    frames: int
    """Number of frames in the loop."""
    mark: int
    """First three bytes of the message's SHA-256, as a whole number."""

    @property
    def blocks(self) -> int:
        """Number of blocks into which the information is cut."""
        return -(-8 * (self.n_bytes + CRC_BYTES) // MAX_INFORMATION)

    @property
    def block_bytes(self) -> int:
        """Number of bytes of information in a block."""
        return max(MIN_INFORMATION // 8, -(-(self.n_bytes + CRC_BYTES) // self.blocks))

    @property
    def information(self) -> int:
        """Number of bits of information in all blocks."""
        return 8 * self.blocks * self.block_bytes

    @property
    def code(self) -> RatelessCode:
        """The code of each block."""
        return make_rateless(8 * self.block_bytes)

    def pieces(self) -> NDArray[np.int64]:
        """Tell the terms in (PIECES,) numbers below 4096, as `pieces_of` does."""
        return np.array(pieces_of(self.mark, self.n_bytes, self.frames))


def pieces_of(marks: ArrayLike, n_bytes: ArrayLike, frames: ArrayLike) -> list[NDArray[np.int64]]:
    """Tell many terms in numbers, one for each of the `PIECES` words; the last 16 bits are a check.

    In a row, the numbers are 72 bits: mark (24), length less 1 (20), frames less 1 (12) and check
    (16). The mark scrambles all numbers after its own, so that they change with the message.

    Args:
        marks: whole numbers below 2**24.
        n_bytes: lengths of messages, of a shape that broadcasts with that of the marks.
        frames: numbers of frames in their loops, of such a shape too.

    Returns:
        `PIECES` arrays of numbers below 4096, which broadcast with one another.
    """
    mark, length, count = np.asarray(marks), np.asarray(n_bytes) - 1, np.asarray(frames) - 1
    # a CRC is linear, so marks and what follows them are checked each by itself
    check = checks_of(mark << 32) ^ checks_of(length << NUMBER_BITS | count) ^ checks_of(0)
    plain = (
        mark >> 12,
        mark & 0xFFF,
        length >> 8,
        (length & 0xFF) << 4 | count >> 8,
        (count & 0xFF) << 4 | check >> 12,
        check & 0xFFF,
    )
    masks = np.moveaxis(masks_of(mark), -1, 0)
    return [number ^ mask for number, mask in zip(plain, masks, strict=True)]


def checks_of(told: ArrayLike) -> NDArray[np.int64]:
    """Work out the 16 bits that check 56 bits: mark, length less 1 and number of frames less 1."""
    values = np.asarray(told, np.int64)
    sums = [zlib.crc32(value.to_bytes(7, "big")) & 0xFFFF for value in values.ravel().tolist()]
    return np.array(sums, np.int64).reshape(values.shape)


def masks_of(marks: ArrayLike) -> NDArray[np.int64]:
    """Make the numbers, (..., PIECES) below 4096, by which (...) marks scramble their pieces."""
    masks = scrambled(np.arange(PIECES), np.asarray(marks)[..., None]) % np.uint64(NUMBERS)
    masks[..., :2] = 0  # the mark itself
    return np.asarray(masks, np.int64)


def read_terms(pieces: NDArray[np.integer], n_bits: int) -> Terms | None:
    """Read the terms from numbers that may be wrong.

    Args:
        pieces: (PIECES,) numbers below 4096.
        n_bits: message blocks of a frame.

    Returns:
        the terms, or None where their check fails or where no sender would make such a loop.
    """
    mark = int(pieces[0]) << NUMBER_BITS | int(pieces[1])
    value = 0
    for piece in pieces ^ masks_of(mark):
        value = value << NUMBER_BITS | int(piece)
    told = value >> 16
    if checks_of(told) != value & 0xFFFF:
        return None
    n_bytes, frames = (told >> NUMBER_BITS & MAX_MESSAGE - 1) + 1, (told & MAX_FRAMES - 1) + 1
    terms = Terms(n_bytes, frames, mark)
    coded = frames * Shape.of(n_bits).body
    possible = frames >= MIN_FRAMES and terms.information <= coded <= MAX_CODED
    return terms if possible else None


@dataclass(frozen=True)
class Shape:
    """Where the bits of a frame's words and the coded bits lie among its message blocks."""

    n_bits: int
    """Number of message blocks of a frame."""
    shown: int
    """Number of the terms' words that each frame shows: 1, 2, 3 or 6."""
    head: NDArray[np.intp]
    """((1 + shown) * WORD,) places of the words' bits, all over the frame: first those of the word
    that tells the frame's number."""
    rest: NDArray[np.intp]
    """(body,) places of the coded bits, in rising order."""

    @property
    def body(self) -> int:
        """Number of coded bits in a frame."""
        return self.rest.size

    @staticmethod
    @lru_cache(maxsize=16)
    def of(n_bits: int) -> "Shape":
        """Share out the bits of frames with a number of message blocks."""
        fitting = [m for m in (2, 3, 6) if (1 + m) * WORD <= HEADER_SHARE * n_bits]
        shown = max([1, *fitting])
        order = shuffled(n_bits, n_bits)
        head = (1 + shown) * WORD
        return Shape(n_bits, shown, order[:head], np.sort(order[head:]))

    def pieces_shown(self, number: int) -> NDArray[np.int64]:
        """List which words of the terms a frame shows: (shown,) numbers below `PIECES`."""
        return (number * self.shown + np.arange(self.shown)) % PIECES

    def whitening(self, number: int) -> NDArray[np.uint8]:
        """Make the (n_bits,) pseudo-random bits that are added to all of a frame's bits.

        The bits of the word that tells the number are whitened alike in all frames.
        """
        white = scrambled(np.arange(self.n_bits) + number * self.n_bits, 2) & np.uint64(1)
        white[self.head[:WORD]] = scrambled(np.arange(WORD), 3) & np.uint64(1)
        return np.asarray(white, np.uint8)


def encode_fine(message: bytes, n_bits: int, signed: bool = False) -> NDArray[np.uint8]:
    """Turn a message into the bits of the loop that carries it.

    Args:
        message: 1 to `MAX_MESSAGE` bytes.
        n_bits: message blocks of a frame.
        signed: whether the message ends with stamp and tag, which the loop then says.

    Returns:
        (frames, n_bits) uint8, 0 or 1, row-major over the message cells.

    Raises:
        InputError: the message is empty or too long.
    """
    frames = fine_frames(len(message), n_bits)
    terms = Terms(len(message), frames, mark_of(message))
    shape, pieces = Shape.of(n_bits), all_words()[terms.pieces()]
    coded = coded_bits(Content(message, signed), terms, n_bits)
    bits = np.empty((frames, n_bits), np.uint8)
    for number, row in enumerate(bits):
        words = [all_words()[[number]], pieces[shape.pieces_shown(number)]]
        row[shape.head] = np.concatenate(words).reshape(-1)
        row[shape.rest] = coded[number]
        row ^= shape.whitening(number)
    return bits


class ReadFrame:
    """Log-likelihoods of a frame's words, and scores of its coded bits, by its known number.

    Args:
        scores: (n_bits,) log-likelihood ratios, positive for 1; 0 for an erasure.
        number: number of the frame in the loop, from 0.
    """

    def __init__(self, scores: Floats, number: int) -> None:
        shape = Shape.of(scores.size)
        clear = np.where(shape.whitening(number) == 1, -scores, scores)
        self.number = number
        """Number of the frame in the loop."""
        self.pieces = shape.pieces_shown(number)
        """(shown,) which words of the terms the frame shows."""
        self.likelihoods = weigh_words(clear[shape.head[WORD:]].reshape(-1, WORD))
        """(shown, 4096) log-likelihood of each number that such a word may tell, over chance."""
        self.coded = clear[shape.rest]
        """(body,) log-likelihood ratios of the coded bits."""

    def supports(self, terms: Terms) -> float:
        """Give the log-likelihood of terms over chance; it is below 0 where others are shown."""
        told = terms.pieces()[self.pieces]
        return float(self.likelihoods[np.arange(told.size), told].sum())


def number_likelihoods(scores: Floats) -> Floats:
    """Weigh all numbers that a frame may have: (4096,) log-likelihood over chance.

    Args:
        scores: (n_bits,) log-likelihood ratios, positive for 1; 0 for an erasure.
    """
    shape = Shape.of(scores.size)
    head = shape.head[:WORD]
    clear = np.where(shape.whitening(0)[head] == 1, -scores[head], scores[head])
    return np.asarray(weigh_words(clear[None])[0], np.float32)


def fine_frames(n_bytes: int, n_bits: int, name: str = "message") -> int:
    """Count the frames of the loop that carries a message.

    It has `USUAL_REDUNDANCY` coded bits for each bit of information, or less where that would make
    too long a loop, or more where it would be too short.

    Args:
        n_bytes: length of the message.
        n_bits: message blocks of a frame.
        name: the parameter that errors about the length name, or the flag of a command.

    Raises:
        InputError: the message is empty or too long.
    """
    if n_bytes < 1:
        raise ParameterError(name, "empty; give at least one byte")
    longest = fine_capacity(MAX_FRAMES, n_bits, MIN_REDUNDANCY)
    if n_bytes > longest:
        raise ParameterError(
            name,
            f"{n_bytes} bytes, a loop with {n_bits} bits a frame carries {longest}; shorten it, or "
            "use a finer grid",
        )
    body = Shape.of(n_bits).body
    coded = USUAL_REDUNDANCY * Terms(n_bytes, MIN_FRAMES, 0).information
    return min(max(USUAL_FRAMES, math.ceil(coded / body)), MAX_FRAMES, MAX_CODED // body)


def fine_capacity(frames: int, n_bits: int, redundancy: float = USUAL_REDUNDANCY) -> int:
    """Count the bytes of the longest message that fits into a loop with a redundancy."""
    coded = min(frames * Shape.of(n_bits).body, MAX_CODED)
    most = int(coded / redundancy) // 8 - CRC_BYTES
    if most < 1:
        return 0
    # blocks are equally long, so information may be a few bytes longer than the message
    blocks = Terms(min(most, MAX_MESSAGE), MIN_FRAMES, 0).blocks
    return max(0, min(most - blocks, MAX_MESSAGE))


def mark_of(message: bytes) -> int:
    """Give the mark by which the terms tell a message from others."""
    return int.from_bytes(hashlib.sha256(message).digest()[:MARK_BYTES], "big")


def coded_bits(content: Content, terms: Terms, n_bits: int) -> NDArray[np.uint8]:
    """Encode a message: (frames, body) coded bits of its loop, before whitening."""
    data = (content.data + _crc(content)).ljust(terms.information // 8, b"\0")
    information = np.unpackbits(np.frombuffer(data, np.uint8)).reshape(terms.blocks, -1).T
    size = terms.frames * Shape.of(n_bits).body
    coded = terms.code.encode(information, -(-size // terms.blocks))  # (count, blocks)
    return np.asarray(coded.reshape(-1)[:size].reshape(terms.frames, -1), np.uint8)


def coded_decoding_steps(scores: Floats, terms: Terms) -> Steps[Content | None]:
    """Read a message whose terms are known, step by step.

    Args:
        scores: (frames, body) log-likelihood ratios of the coded bits, positive for 1; 0 where
            nothing is known. They are copied, and may change between steps.
        terms: terms of the loop.

    Returns:
        a generator, which yields the work of each step (`link.code.rateless.GRAPH_WORK` says its
        unit), and returns the message and whether it is signed, or None where the scores do not
        suffice.
    """
    count = -(-scores.size // terms.blocks)
    llr = np.zeros(count * terms.blocks, np.float32)
    llr[: scores.size] = scores.reshape(-1)
    return _message_steps(llr.reshape(count, terms.blocks), terms)


def _message_steps(llr: Floats, terms: Terms) -> Steps[Content | None]:
    """Decode (count, blocks) log-likelihood ratios, and check the message."""
    information, done = yield from terms.code.decoding_steps(llr)
    if not done.all():
        return None
    content = np.packbits(information.T).tobytes()
    message, rest = content[: terms.n_bytes], content[terms.n_bytes :]
    if any(rest[CRC_BYTES:]) or mark_of(message) != terms.mark:
        return None
    possible = (Content(message, signed) for signed in (False, True))
    return next((content for content in possible if rest[:CRC_BYTES] == _crc(content)), None)


def _crc(content: Content) -> bytes:
    header = (content.signed << 31 | len(content.data)).to_bytes(4, "big")
    return zlib.crc32(content.data, zlib.crc32(header)).to_bytes(CRC_BYTES, "big")
