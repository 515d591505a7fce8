"""The collector of coarse grids turns scores of frames, as they come, into their loop's message.

The receiver may join the loop anywhere, does not know its length N, and may lose count when the
display leaves the view. Frames whose mutual distance is known form a *run*; every pair (N, first
frame) is a hypothesis, and the signatures of the run's frames weigh them. Once one stands out, the
run's scores are added to those of earlier runs and loops.

Once a message is delivered, each frame is held against it. Frames that agree bring nothing new.
From the first frame that contradicts it, scores are collected afresh, while the delivered message
stands until another one is whole.
"""

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
    parity_mask,
    signatures,
)
from link.code.message import Message
from link.code.scores import agreement_of, cut_scores, information_of

SURE = 1e-4
"""Largest posterior probability of all other hypotheses together at which a run is placed."""
MAX_RUN = 128
"""Number of frames of a run that may wait for a place; then the run starts afresh."""
DOUBT = 6
"""Number of frames of a placed run over which its signatures are watched for contradiction."""
MEMORY_LOOPS = 16
"""Number of loops over which scores fade, so that what was collected amiss loses its weight."""
TOLERATED = 0.2
"""Share of parity bits that may contradict the delivered message while the display still shows it;
another message contradicts about half of them."""
TRIED_AGAIN = 1.02
"""Factor by which the received information must have grown before decoding is tried again."""
DOUBTED_LOOPS = 0.5
"""Number of loops of another message after which doubt grows no further, so that the delivered
message, once it is back in view, is recognised within about as many."""


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


class LoopScores:
    """Scores of a loop's frames, summed over all times that each frame was seen.

    Args:
        frames: number of frames in the loop.
        n_bits: message blocks of a frame.
    """

    def __init__(self, frames: int, n_bits: int) -> None:
        self.frames = frames
        self.sums = np.zeros((frames, n_bits))
        """(frames, n_bits) log-likelihood ratios."""
        self.seen = 0
        """Number of received frames that were added."""
        self.tried = 0.0
        """Value of `progress` when decoding was last tried."""

    def add(self, at: int, scores: NDArray[np.float64]) -> None:
        """Add the (n_bits,) scores of frame number ``at`` of the loop; older ones fade a little."""
        self.sums *= 1 - 1 / (MEMORY_LOOPS * self.frames)
        self.sums[at] += scores
        self.seen += 1

    @property
    def progress(self) -> float:
        """Information received, as a share of what is needed: about 1 when the message is whole."""
        received = information_of(self.sums[:, SIGNATURE:])
        return received / (8 * information_bytes(self.frames, self.sums.shape[1]))

    def worth_decoding(self) -> bool:
        """Whether there is enough that is new since decoding was last tried."""
        enough = self.progress >= max(1.0, TRIED_AGAIN * self.tried)
        overdue = 2 * self.seen >= self.frames and self.seen % max(1, self.frames // 4) == 0
        return enough or overdue


class DeliveredMessage:
    """A message that was delivered, and the doubt whether the display still shows it.

    Doubt is a cumulative sum (Page 1954): it rises with the parity bits of a frame that contradict
    the message, beyond the share that noise explains, and falls with those that agree. It is never
    below 0, so frames from before a change do not delay its discovery.

    Args:
        message: what was delivered.
        n_bits: message blocks of a frame.

    >>> bits = encode(b"Hello", n_bits=59)
    >>> known = DeliveredMessage(Message(b"Hello", len(bits), seen=4, agreement=1.0), n_bits=59)
    >>> known.is_shown(0, 8.0 * bits[0] - 4), known.is_shown(1, 4 - 8.0 * bits[1])
    (True, False)
    """

    def __init__(self, message: Message, n_bits: int) -> None:
        self.message = message
        self.doubt = 0.0
        """Parity bits beyond those tolerated that contradict the message, in frames; at least 0."""
        bits = encode(message.data, n_bits, signed=message.signed)
        parity = parity_mask(message.frames, n_bits)
        self._signs = (2.0 * bits - 1) * parity
        self._parity_bits = np.maximum(parity.sum(axis=1), 1)
        self._limit = DOUBTED_LOOPS * message.frames * (0.5 - TOLERATED)

    def is_shown(self, at: int, scores: NDArray[np.float64]) -> bool:
        """Say whether the display still shows the message, after one more frame.

        Args:
            at: number of the frame in the loop, from 0.
            scores: (n_bits,) log-likelihood ratios, positive for 1; 0 for an erasure.
        """
        agreement = self._signs[at] * scores
        certainty = np.tanh(np.abs(agreement) / 2)  # 1 - 2 P(the decision is wrong)
        excess = certainty @ ((agreement < 0) - TOLERATED) / self._parity_bits[at]
        self.doubt = min(max(0.0, self.doubt + float(excess)), self._limit)
        return self.doubt == 0


class CoarseCollector:
    """Collects frames of coarse grids (`link.code.collect.Collector`).

    Its arguments, methods and attribute ``progress`` are those of
    `link.code.collect_fine.FineCollector`.
    """

    def __init__(self, n_bits: int) -> None:
        check_bits(n_bits)
        self.n_bits = n_bits
        self.progress = 0.0
        self.attempts = 0
        self._loop: LoopScores | None = None
        self._delivered: DeliveredMessage | None = None
        self.start_run()

    @property
    def decoding(self) -> bool:
        """Whether decoding is under way: never, for it ends before `add` returns."""
        return False

    def start_run(self) -> None:
        """Say that the next frame's distance to the earlier ones is not known."""
        self._waiting: list[tuple[int, NDArray[np.float64]]] = []
        self._belief: NDArray[np.float32] | None = None
        self._place: tuple[int, int] | None = None
        self._trust: list[float] = []

    def add(self, scores: NDArray[np.float64], count: int, work: float = np.inf) -> Message | None:
        """Add one frame, and decode at once whatever ``work``; `FineCollector.add` says more."""
        scores = cut_scores(scores)
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

    def go_on(self, work: float = np.inf) -> Message | None:
        """Return None: coarse grids decode when a frame is added, and nothing is left for later."""
        return None

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
        known = self._delivered
        for count, scores in waiting:
            at = (first + count) % frames
            if known is not None and known.message.frames == frames and known.is_shown(at, scores):
                self._loop = None
                continue
            if self._loop is None or self._loop.frames != frames:
                self._loop = LoopScores(frames, self.n_bits)
            self._loop.add(at, scores)
        self.progress = 1.0 if self._loop is None else self._loop.progress
        return self._loop is not None and self._loop.worth_decoding()

    def _try(self) -> Message | None:
        """Decode what was collected; a message ends the collection, whether it is new or not."""
        loop, known = self._loop, self._delivered
        assert loop is not None
        self.attempts += 1
        loop.tried = self.progress
        content = decode(loop.sums)
        if content is None:
            return None
        self._loop = None
        if known is not None and (known.message.data, known.message.signed) == content:
            known.doubt = 0.0
            return None
        sent = encode(content.data, self.n_bits, signed=content.signed)
        agree = agreement_of(loop.sums, sent)
        changed = known is not None
        message = Message(content.data, loop.frames, loop.seen, agree, changed, content.signed)
        self._delivered = DeliveredMessage(message, self.n_bits)
        return message
