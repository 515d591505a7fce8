"""Message <-> protected bits of a loop of frames.

    information   length (2 bytes) | message | zeros | CRC-32 of all before
    codeword      information + parity, rate 1/2 (`link.code.ldpc`): N P bits for N frames
    frame k       SIGNATURE bits that say (N, k) | P bits of the codeword

The codeword is whitened, and interleaved over all frames and blocks, so that a covered block or a
lost frame takes bits from everywhere; any half of the loop, or a little more, is enough.
"""

import zlib
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from link.code.ldpc import Code, make_code, scrambled
from link.errors import InputError

SIGNATURE = 8
"""Bits of each frame that say which one it is."""
MAX_FRAMES = 1024
LENGTH_BYTES, CRC_BYTES = 2, 4
MIN_BITS = 2 * SIGNATURE
"""Fewest message blocks of a frame."""


def check_bits(n_bits: int) -> None:
    """Raise an `InputError` where a frame has too few message blocks to carry a signature."""
    if n_bits < MIN_BITS:
        raise InputError(
            f"layout: {n_bits} message blocks a frame, a message needs at least {MIN_BITS}; "
            "use a finer grid or fewer ratex patches"
        )


def information_bytes(frames: int, n_bits: int) -> int:
    """Bytes of information that a loop of ``frames`` carries, length and CRC included."""
    return frames * (n_bits - SIGNATURE) // 16


def capacity(frames: int, n_bits: int) -> int:
    """Longest message, bytes, of a loop of ``frames`` frames with ``n_bits`` blocks each."""
    return max(0, information_bytes(frames, n_bits) - LENGTH_BYTES - CRC_BYTES)


def frames_needed(n_bytes: int, n_bits: int) -> int:
    """Frames of the loop that carries a message of ``n_bytes`` bytes.

    Raises:
        InputError: the message is empty or too long, or the layout has too few message blocks.
    """
    check_bits(n_bits)
    if n_bytes < 1:
        raise InputError("--message: empty; give at least one byte")
    longest = min(capacity(MAX_FRAMES, n_bits), 256**LENGTH_BYTES - 1)
    if n_bytes > longest:
        raise InputError(
            f"--message: {n_bytes} bytes, a loop of {MAX_FRAMES} frames with {n_bits} bits each "
            f"carries {longest}; shorten it or use a finer grid"
        )
    needed = n_bytes + LENGTH_BYTES + CRC_BYTES
    return -(-16 * needed // (n_bits - SIGNATURE))


@lru_cache(maxsize=16)
def code_of(frames: int, n_bits: int) -> Code:
    """The code of a loop."""
    information = 8 * information_bytes(frames, n_bits)
    return make_code(information, frames * (n_bits - SIGNATURE) - information)


@lru_cache(maxsize=16)
def _order(length: int) -> tuple[NDArray[np.intp], NDArray[np.uint8]]:
    """Interleaving (length,) and whitening (length,): displayed = codeword[order] ^ white."""
    words = scrambled(np.arange(length), length)
    return np.argsort(words, kind="stable"), (words & np.uint64(1)).astype(np.uint8)


def signatures(frames: int) -> NDArray[np.uint8]:
    """(frames,) words of SIGNATURE bits that the frames of a loop of this length carry."""
    words = scrambled(np.arange(frames), 1000 + frames)
    return (words >> np.uint64(64 - SIGNATURE)).astype(np.uint8)


def encode(message: bytes, n_bits: int) -> NDArray[np.uint8]:
    """The loop that carries a message.

    Args:
        message: 1 byte to `capacity` of `MAX_FRAMES`.
        n_bits: message blocks of a frame.

    Returns:
        (frames, n_bits) uint8, 0 or 1, row-major over the message cells.

    Raises:
        InputError: see `frames_needed`.
    """
    frames = frames_needed(len(message), n_bits)
    room = information_bytes(frames, n_bits) - CRC_BYTES
    data = (len(message).to_bytes(LENGTH_BYTES, "big") + message).ljust(room, b"\0")
    data += zlib.crc32(data).to_bytes(CRC_BYTES, "big")
    codeword = code_of(frames, n_bits).encode(np.unpackbits(np.frombuffer(data, np.uint8)))
    order, white = _order(codeword.size)
    body = (codeword[order] ^ white).reshape(frames, -1)  # (N P,) -> (N, P)
    heads = np.unpackbits(signatures(frames)[:, None], axis=1)
    return np.concatenate([heads, body], axis=1)


def decode(scores: NDArray[np.float64]) -> bytes | None:
    """The message of a loop, or None: never a wrong one, short of a CRC-32 that fits by chance.

    Args:
        scores: (frames, n_bits) log-likelihood ratios, positive for 1; 0 where nothing is known.
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
    length = int.from_bytes(data[:LENGTH_BYTES], "big")
    content, crc = data[:-CRC_BYTES], data[-CRC_BYTES:]
    message = content[LENGTH_BYTES : LENGTH_BYTES + length]
    padding = content[LENGTH_BYTES + length :]
    whole = 1 <= length == len(message) and not any(padding)
    return message if whole and zlib.crc32(content).to_bytes(CRC_BYTES, "big") == crc else None
