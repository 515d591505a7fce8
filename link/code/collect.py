"""The collector turns scores of frames, in the order they were seen, into their loop's message.

The receiver may join the loop anywhere, does not know its length N, and may lose count when the
display leaves the view. Frames whose mutual distance is known form a *run*; every pair (N, first
frame) is a hypothesis, and the signatures of the run's frames weigh them. Once one stands out, the
run's scores are added to those of earlier runs and loops.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from link.code.framing import (
    MAX_FRAMES,
    SIGNATURE,
    check_bits,
    decode,
    encode,
    information_bytes,
    signatures,
)

MAX_SCORE = 8.0
"""Largest magnitude of a score, in log-likelihood units; larger ones are cut, because what covers a
block can look certain, and no single block should decide."""
SURE = 1e-4
"""Largest posterior probability of all other hypotheses together at which a run is placed."""
MAX_RUN = 128
"""Number of frames of a run that may wait for a place; then the run starts afresh."""
DOUBT = 6
"""Number of frames of a placed run over which its signatures are watched for contradiction."""
MEMORY_LOOPS = 16
"""Number of loops over which scores fade, so that a changed message wins in time."""


@dataclass(frozen=True)
class Message:
    """A message that arrived whole."""

    data: bytes
    """The bytes that were sent."""
    frames: int
    """Number of frames in the loop that carries the message."""
    seen: int
    """Number of received frames whose scores were used."""
    agreement: float
    """Share of the scores' weight that agrees with the message, in [0, 1]."""

    @property
    def text(self) -> str:
        """The message read as UTF-8, with bytes that are no UTF-8 escaped."""
        return self.data.decode("utf-8", "backslashreplace")


@lru_cache(maxsize=1)
def _hypotheses() -> tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.uint8]]:
    """List all (N, first frame): N and first (M,), and the signatures of all loops end to end."""
    lengths = np.arange(1, MAX_FRAMES + 1, dtype=np.int32)
    frames = np.repeat(lengths, lengths)
    ends = np.repeat(np.cumsum(lengths) - lengths, lengths)
    first = np.asarray(np.arange(frames.size) - ends, np.int32)
    words = np.concatenate([signatures(int(length)) for length in lengths])
    return frames, first, np.asarray(words, np.uint8)


def word_likelihoods(head: NDArray[np.float64]) -> NDArray[np.float32]:
    """Weigh all words that a signature may be.

    Args:
        head: (SIGNATURE,) scores of the signature's bits.

    Returns:
        (2 ** SIGNATURE,) log-likelihood of each word, but for a constant.
    """
    bits = np.unpackbits(np.arange(2**SIGNATURE, dtype=np.uint8)[:, None], axis=1)
    return np.asarray((bits - 0.5) @ head, np.float32)


class Collector:
    """Collects frames until the message is whole.

    Args:
        n_bits: message blocks of a frame.

    Raises:
        InputError: the frames have too few blocks for a signature.

    The receiver joins the loop at its third frame and does not know how long the loop is:

    >>> loop = encode(b"Hello", n_bits=59)
    >>> collector, message = Collector(n_bits=59), None
    >>> for count in range(len(loop)):
    ...     message = message or collector.add(9.0 * loop[(count + 2) % len(loop)] - 4.5, count)
    >>> message.text
    'Hello'
    """

    def __init__(self, n_bits: int) -> None:
        check_bits(n_bits)
        self.n_bits = n_bits
        self.frames: int | None = None
        """Number of frames in the loop, or None while it is unknown."""
        self.seen = 0
        """Number of received frames whose place in the loop is known."""
        self._loop = np.zeros((0, n_bits))
        self._tried = 0.0
        self.start_run()

    def start_run(self) -> None:
        """Say that the next frame's distance to the earlier ones is not known."""
        self._waiting: list[tuple[int, NDArray[np.float64]]] = []
        self._belief: NDArray[np.float32] | None = None
        self._place: tuple[int, int] | None = None
        self._trust: list[float] = []

    @property
    def progress(self) -> float:
        """Information received, as a share of what is needed: about 1 when the message is whole."""
        if self.frames is None:
            return 0.0
        llr = np.abs(self._loop[:, SIGNATURE:])
        entropy = np.log1p(np.exp(-llr)) + llr / (1 + np.exp(llr))
        received = float((1 - entropy / np.log(2)).sum())
        return received / (8 * information_bytes(self.frames, self.n_bits))

    def add(self, scores: NDArray[np.float64], count: int) -> Message | None:
        """Add one frame, and try to decode.

        Args:
            scores: (n_bits,) log-likelihood ratios, positive for 1; 0 for an erasure.
            count: number of the frame on the display, from any start; rising within a run.

        Returns:
            the message where it is whole now, else None.
        """
        scores = np.clip(np.nan_to_num(scores), -MAX_SCORE, MAX_SCORE)
        words = word_likelihoods(scores[:SIGNATURE])
        if self._place is not None and self._lost(words, count):
            self.start_run()
        if self._place is not None:
            return self._try() if self._put([(count, scores)]) else None
        frames, first, table = _hypotheses()
        if self._belief is None:
            self._belief = -np.log(frames.astype(np.float32))
        starts = frames * (frames - 1) // 2
        self._belief += words[table[starts + (first + np.int32(count)) % frames]]
        self._waiting.append((count, scores))
        best = int(np.argmax(self._belief))
        others = np.exp(self._belief - self._belief[best]).sum() - 1
        if others > SURE:
            if len(self._waiting) >= MAX_RUN:
                self.start_run()
            return None
        self._place = int(frames[best]), int(first[best])
        waiting, self._waiting, self._belief = self._waiting, [], None
        return self._try() if self._put(waiting) else None

    def _lost(self, words: NDArray[np.float32], count: int) -> bool:
        """Whether the last signatures speak against the place of this run."""
        assert self._place is not None
        frames, first = self._place
        word = signatures(frames)[(first + count) % frames]
        chance = np.logaddexp.reduce(words) - SIGNATURE * np.log(2)
        self._trust = [*self._trust, float(words[word] - chance)][-DOUBT:]
        return len(self._trust) > 2 and sum(self._trust) < 0

    def _put(self, waiting: list[tuple[int, NDArray[np.float64]]]) -> bool:
        """Add frames to the loop; false while there is nothing new to decode."""
        assert self._place is not None
        frames, first = self._place
        if self.frames != frames:
            self.frames, self.seen, self._tried = frames, 0, 0.0
            self._loop = np.zeros((frames, self.n_bits))
        for count, scores in waiting:
            self._loop *= 1 - 1 / (MEMORY_LOOPS * frames)
            self._loop[(first + count) % frames] += scores
        self.seen += len(waiting)
        enough = self.progress >= max(1.0, 1.02 * self._tried)
        overdue = 2 * self.seen >= frames and self.seen % max(1, frames // 4) == 0
        return enough or overdue

    def _try(self) -> Message | None:
        assert self.frames is not None
        self._tried = self.progress
        data = decode(self._loop)
        if data is None:
            return None
        sent = encode(data, self.n_bits)
        weight = np.abs(self._loop)
        agree = float(weight[(self._loop > 0) == (sent == 1)].sum() / weight.sum())
        return Message(data, self.frames, self.seen, agree)
