"""Framing turns a message into the protected bits of a loop of frames, and back.

Frames of `FINE_BITS` message blocks or more are those of a fine grid, which `link.code.fine`
describes. What follows is the framing of coarse grids:

    information   length (2 bytes) | message | zeros | CRC-32 of all before
    codeword      information + parity, rate 1/2 (`link.code.ldpc`): N P bits for N frames
    frame k       SIGNATURE bits that say (N, k) | P bits of the codeword

The highest bit of the length says that the message is signed (`link.code.authenticate`).

The codeword is whitened, and interleaved over all frames and blocks, so that a covered block or a
lost frame takes bits from everywhere; any half of the loop, or a little more, is enough.
"""

import zlib
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from link.code.fine import (
    CRC_BYTES,
    MIN_REDUNDANCY,
    encode_fine,
    fine_capacity,
    fine_frames,
)
from link.code.fine import MAX_FRAMES as FINE_MAX_FRAMES
from link.code.ldpc import Code, make_code
from link.code.message import Content
from link.code.scrambled import scrambled
from link.errors import InputError, ParameterError

FINE_BITS = 512
"""Smallest number of message blocks of a frame at which the framing is that of fine grids."""
SIGNATURE = 8
"""Number of bits that each frame spends on saying which frame of the loop it is."""
MAX_FRAMES = 1024
"""Largest number of frames in a loop."""
LENGTH_BYTES = 2
"""Number of bytes that hold the length of the message; its CRC-32 follows the message."""
SIGNED = 1 << 8 * LENGTH_BYTES - 1
"""Bit of the length that is set where a message is signed; no loop has room for such a length."""
MIN_BITS = 2 * SIGNATURE
"""Smallest number of message blocks that a frame may have."""


def is_fine(n_bits: int) -> bool:
    """Whether frames with a number of message blocks have the framing of fine grids."""
    return n_bits >= FINE_BITS


def check_bits(n_bits: int) -> None:
    """Raise an `InputError` where a frame has too few message blocks to carry a signature."""
    if n_bits < MIN_BITS:
        raise InputError(
            f"layout: {n_bits} message blocks a frame, a message needs at least {MIN_BITS}; "
            "use a finer grid or fewer ratex patches"
        )


def information_bytes(frames: int, n_bits: int) -> int:
    """Count the bytes of information that a loop carries, length and CRC included.

    Args:
        frames: number of frames in the loop.
        n_bits: message blocks of a frame.
    """
    return frames * (n_bits - SIGNATURE) // 16


def capacity(frames: int, n_bits: int) -> int:
    """Count the bytes of the longest message that fits into a loop.

    On a fine grid that is the longest one with the usual redundancy.

    Args:
        frames: number of frames in the loop.
        n_bits: message blocks of a frame.

    >>> capacity(frames=10, n_bits=59), capacity(frames=10, n_bits=2918)
    (25, 420)
    """
    if is_fine(n_bits):
        return fine_capacity(frames, n_bits)
    return max(0, information_bytes(frames, n_bits) - LENGTH_BYTES - CRC_BYTES)


def longest_message(n_bits: int) -> int:
    """Count the bytes of the longest message that frames of a layout carry.

    Args:
        n_bits: message blocks of a frame.

    >>> [longest_message(n_bits) for n_bits in (59, 730, 2918, 11674)]
    [3258, 270369, 1048576, 1048576]
    """
    if is_fine(n_bits):
        return fine_capacity(FINE_MAX_FRAMES, n_bits, MIN_REDUNDANCY)
    return min(SIGNED - 1, capacity(MAX_FRAMES, n_bits))


def frames_needed(n_bytes: int, n_bits: int, name: str = "message") -> int:
    """Count the frames of the loop that carries a message, which is the shortest on coarse grids.

    Args:
        n_bytes: length of the message.
        n_bits: message blocks of a frame.
        name: the parameter that the error names, or the flag of a command.

    Raises:
        InputError: the message is empty or too long, or the layout has too few message blocks.
    """
    if is_fine(n_bits):
        return fine_frames(n_bytes, n_bits, name)
    check_bits(n_bits)
    if n_bytes < 1:
        raise ParameterError(name, "empty; give at least one byte")
    longest = longest_message(n_bits)
    if n_bytes > longest:
        raise ParameterError(
            name,
            f"{n_bytes} bytes, a loop of {MAX_FRAMES} frames with {n_bits} bits each "
            f"carries {longest}; shorten it or use a finer grid, such as that of the preset robust",
        )
    needed = n_bytes + LENGTH_BYTES + CRC_BYTES
    return -(-16 * needed // (n_bits - SIGNATURE))


@lru_cache(maxsize=16)
def code_of(frames: int, n_bits: int) -> Code:
    """Make the error-correcting code of a loop.

    Args:
        frames: number of frames in the loop.
        n_bits: message blocks of a frame.
    """
    information = 8 * information_bytes(frames, n_bits)
    return make_code(information, frames * (n_bits - SIGNATURE) - information)


@lru_cache(maxsize=16)
def _order(length: int) -> tuple[NDArray[np.intp], NDArray[np.uint8]]:
    """Interleaving (length,) and whitening (length,): displayed = codeword[order] ^ white."""
    words = scrambled(np.arange(length), length)
    return np.argsort(words, kind="stable"), (words & np.uint64(1)).astype(np.uint8)


def signatures(frames: int) -> NDArray[np.uint8]:
    """List the signatures that tell the frames of a loop from one another.

    Args:
        frames: number of frames in the loop; loops of other lengths have other signatures.

    Returns:
        (frames,) uint8, words of `SIGNATURE` bits.
    """
    words = scrambled(np.arange(frames), 1000 + frames)
    return (words >> np.uint64(64 - SIGNATURE)).astype(np.uint8)


def parity_mask(frames: int, n_bits: int) -> NDArray[np.bool_]:
    """Tell which displayed bits are parity bits of the codeword.

    A change of a single byte of the message changes its CRC-32 and by it about half of the parity
    bits, all over the loop. Most information bits stay as they are.

    Args:
        frames: number of frames in the loop.
        n_bits: message blocks of a frame.

    Returns:
        (frames, n_bits) bool; False for signatures and information.
    """
    order, _ = _order(frames * (n_bits - SIGNATURE))
    parity = (order >= code_of(frames, n_bits).information).reshape(frames, -1)
    return np.concatenate([np.zeros((frames, SIGNATURE), bool), parity], axis=1)


def encode(message: bytes, n_bits: int, signed: bool = False) -> NDArray[np.uint8]:
    """Turn a message into the bits of the loop that carries it.

    Args:
        message: at least 1 byte, and at most as many as `longest_message` says.
        n_bits: message blocks of a frame.
        signed: whether the message ends with stamp and tag, which the loop then says.

    Returns:
        (frames, n_bits) uint8, 0 or 1, row-major over the message cells.

    Raises:
        InputError: the message is empty or too long, or the layout has too few message blocks.

    >>> bits = encode(b"Hello", n_bits=59)
    >>> bits.shape
    (4, 59)
    """
    if is_fine(n_bits):
        return encode_fine(message, n_bits, signed)
    frames = frames_needed(len(message), n_bits)
    room = information_bytes(frames, n_bits) - CRC_BYTES
    length = len(message) | SIGNED * signed
    data = (length.to_bytes(LENGTH_BYTES, "big") + message).ljust(room, b"\0")
    data += zlib.crc32(data).to_bytes(CRC_BYTES, "big")
    codeword = code_of(frames, n_bits).encode(np.unpackbits(np.frombuffer(data, np.uint8)))
    order, white = _order(codeword.size)
    body = (codeword[order] ^ white).reshape(frames, -1)  # (N P,) -> (N, P)
    heads = np.unpackbits(signatures(frames)[:, None], axis=1)
    return np.concatenate([heads, body], axis=1)


def decode(scores: NDArray[np.floating]) -> Content | None:
    """Read the message of a coarse grid's loop from its scores.

    Args:
        scores: (frames, n_bits) log-likelihood ratios, positive for 1; 0 where nothing is known.

    Returns:
        the message and whether it is signed, or None where the scores do not suffice, or where the
        loop is not the one that `encode` makes. It is never a wrong message, short of a CRC-32 that
        fits by chance.

    A covered block and a lost frame do no harm:

    >>> scores = 4.0 * encode(b"Hello", n_bits=59) - 2.0
    >>> scores[:, 20] = 0
    >>> scores[1] = 0
    >>> decode(scores)
    Content(data=b'Hello', signed=False)
    """
    frames, n_bits = scores.shape
    if capacity(frames, n_bits) < 1 or not scores.any():
        return None
    body = scores[:, SIGNATURE:].reshape(-1)
    order, white = _order(body.size)
    llr = np.empty_like(body)
    llr[order] = np.where(white == 1, -body, body)
    codeword = code_of(frames, n_bits).decode(llr)
    if codeword is None:
        return None
    data = np.packbits(codeword[: 8 * information_bytes(frames, n_bits)]).tobytes()
    signed, length = divmod(int.from_bytes(data[:LENGTH_BYTES], "big"), SIGNED)
    content, crc = data[:-CRC_BYTES], data[-CRC_BYTES:]
    message = content[LENGTH_BYTES : LENGTH_BYTES + length]
    padding = content[LENGTH_BYTES + length :]
    whole = 1 <= length == len(message) and not any(padding)
    if not whole or zlib.crc32(content).to_bytes(CRC_BYTES, "big") != crc:
        return None
    fits = frames == frames_needed(length, n_bits)
    return Content(message, signed == 1) if fits else None
