"""The collector of fine grids turns scores of frames, as they come, into their loop's message.

Each frame tells its number and a part of the loop's terms by words (`link.code.fine`). The numbers
of the frames are followed from frame to frame by Bayes' rule: a number usually moves on as the
display's count does, and sometimes jumps, because count was lost or the loop began again. A frame
whose number is not sure yet waits; so does one that comes before the terms are known. The terms
are summed up over frames. Frames that contradict them are not used, and several mean that the
message has changed.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from link.code.fine import (
    PIECES,
    USUAL_FRAMES,
    ReadFrame,
    Shape,
    Terms,
    coded_bits,
    coded_decoding_steps,
    number_likelihoods,
    read_terms,
)
from link.code.likely_terms import likely_terms
from link.code.message import Content, Message
from link.code.scores import agreement_of, cut_scores, information_of
from link.code.words import NUMBERS
from link.steps import Steps
from link.types import Floats

UNSURE = 1e-2
"""Largest posterior probability of all other numbers together at which a frame's number counts."""
JUMP = 1e-4
"""Probability that a frame's number is not the one that the display's count says. After each
frame the others keep about this probability over the likelihood of the right one. So it is small,
and frames of which few blocks can be read are numbered, too."""
LOOP_ENDS = 1 / 64
"""Probability that a loop of unknown length ends with a frame, and begins again."""
MAX_WAITING = 64
"""Number of frames that may wait until their number or the terms are known; the oldest are
dropped."""
TERMS_MEMORY = 0.95
"""Factor by which the evidence for a word of the terms fades when that word is seen again. A word
of which little can be read must be seen often, so it fades slowly."""
CONTRADICTS, DOUBTFUL = -4.0, -12.0
"""Log-likelihood, over chance, below which a frame clearly contradicts a number or the terms, and
sum over frames below 0 at which the terms are learnt afresh: three clear frames are enough."""
SCORES_MEMORY = 15 / 16
"""Factor by which the scores of a frame fade when that frame is seen again, so that what was
collected amiss loses its weight."""
FIRST_TRY, NEXT_TRY = 1.08, 1.03
"""Information received over information sent at which decoding is first tried, and the factor by
which it has to grow until decoding is tried again."""
LATE, LATE_TRY = 1.25, 1.12
"""Information over that of the message from which on decoding is tried less often, and the factor
by which it then has to grow. Scores that are surer than they should be bring receivers there."""


class CodedScores:
    """Scores of a loop's coded bits, summed over all times that each frame was seen.

    Args:
        terms: terms of the loop.
        n_bits: message blocks of a frame.
    """

    def __init__(self, terms: Terms, n_bits: int) -> None:
        self.terms = terms
        self.sums = np.zeros((terms.frames, Shape.of(n_bits).body), np.float32)
        """(frames, body) log-likelihood ratios."""
        self.seen = 0
        """Number of received frames that were added."""
        self.tried = 0.0
        """Value of `progress` when decoding was last tried."""
        self._information = np.zeros(terms.frames)

    def add(self, number: int, coded: Floats) -> None:
        """Add the (body,) scores of a frame's coded bits; what it brought before fades a little."""
        self.sums[number] *= SCORES_MEMORY
        self.sums[number] += coded
        self._information[number] = information_of(self.sums[number])
        self.seen += 1

    @property
    def progress(self) -> float:
        """Information received, as a share of what was sent: about 1.1 when it can be decoded."""
        return float(self._information.sum()) / self.terms.information

    def worth_decoding(self) -> bool:
        """Whether there is enough that is new since decoding was last tried."""
        factor = NEXT_TRY if self.tried < LATE else LATE_TRY
        enough = self.progress >= max(FIRST_TRY, factor * self.tried)
        turn = max(2, self.terms.frames // 4)
        return enough or (2 * self.seen >= self.terms.frames and self.seen % turn == 0)


@dataclass
class WaitingFrame:
    """A frame that cannot be used yet."""

    scores: Floats
    """(n_bits,) log-likelihood ratios."""
    count: int
    """Number of the frame on the display, from any start."""
    read: ReadFrame | None
    """The frame's scores read under its number in the loop, or None while the number is not
    sure."""


class FineCollector:
    """Collects frames of fine grids (`link.code.collect.Collector`).

    Its attribute ``progress`` is the information received, as a share of what is needed: about 1
    when the message is whole. It is 1 while the display goes on showing a message that was
    returned.

    Args:
        n_bits: message blocks of a frame.
    """

    def __init__(self, n_bits: int) -> None:
        self.n_bits = n_bits
        self.progress = 0.0
        self.attempts = 0
        self._terms: Terms | None = None
        self._loop: CodedScores | None = None
        # a loop that is being decoded, to which more may have been added since, and the steps
        self._attempt: tuple[CodedScores, Steps[Content | None]] | None = None
        self._due = False
        self._delivered: Terms | None = None
        self._forget_terms()
        self.start_run()

    @property
    def decoding(self) -> bool:
        """Whether decoding is under way, which `go_on` goes on with."""
        return self._attempt is not None

    def start_run(self) -> None:
        """Say that the next frame's distance to the earlier ones is not known."""
        self._belief: NDArray[np.float64] | None = None
        self._count = 0
        self._waiting: list[WaitingFrame] = []

    def add(self, scores: NDArray[np.floating], count: int, work: float = np.inf) -> Message | None:
        """Add one frame, and try to decode.

        Args:
            scores: (n_bits,) log-likelihood ratios, positive for 1; 0 for an erasure.
            count: number of the frame on the display, from any start; rising within a run.
            work: units of work after which decoding is left to `go_on`.

        Returns:
            the message where it is whole now and not the one that was returned last, else None.
        """
        self._take(scores, count)
        return self.go_on(work)

    def _take(self, scores: NDArray[np.floating], count: int) -> None:
        """Add one frame, or let it wait; one of which nothing was read says nothing."""
        if not np.any(scores):
            return
        frame = WaitingFrame(cut_scores(scores).astype(np.float32), count, None)
        self._waiting = [*self._waiting, frame][-MAX_WAITING:]
        number = self._follow(number_likelihoods(frame.scores), count)
        if number is None:
            return
        for read in self._number_waiting(number, count):
            self._learn_terms(read)
        if self._terms is None:
            return
        self._number_waiting(number, count)
        for waiting in self._waiting:
            if waiting.read is not None:
                self._put(waiting.read, self._terms)
        self._waiting = []

    def _follow(self, likelihoods: Floats, count: int) -> int | None:
        """Weigh the numbers that the next frame may have; returns it once it is sure."""
        belief = likelihoods.astype(np.float64)
        if self._belief is None:  # half of all loops have the usual length
            belief[:USUAL_FRAMES] += np.log(1 + NUMBERS / USUAL_FRAMES)
        else:
            moved = self._moved_on(self._belief, count - self._count)
            belief += np.logaddexp(moved + np.log(1 - JUMP), np.log(JUMP / NUMBERS))
        self._count = count
        belief -= belief.max()
        self._belief = belief - np.log(np.exp(belief).sum())
        best = int(self._belief.argmax())
        return best if np.exp(self._belief).sum() - np.exp(self._belief[best]) < UNSURE else None

    def _moved_on(self, belief: NDArray[np.float64], steps: int) -> NDArray[np.float64]:
        """Give the logarithm of each number's probability, (4096,), once the display moved on.

        A loop of unknown length may have ended meanwhile, most likely one of the usual length.
        """
        moved = np.full(NUMBERS, -np.inf)
        if self._terms is not None:
            frames = self._terms.frames
            moved[:frames] = np.roll(belief[:frames], steps % frames)
            return moved
        step = min(max(steps, 0), NUMBERS)
        moved[step:] = belief[: NUMBERS - step]
        moved[:step] = np.log(-np.expm1(step * np.log1p(-LOOP_ENDS)) / max(step, 1))
        over = np.s_[: min(step, USUAL_FRAMES)]
        usual = np.roll(belief[:USUAL_FRAMES], step % USUAL_FRAMES)
        moved[over] = np.logaddexp(moved[over], usual[over])
        return moved

    def _number_waiting(self, number: int, count: int) -> list[ReadFrame]:
        """Number the frames that wait by one whose number is sure; drop what misfits.

        Those from before the loop began again go on waiting until its length is known.

        Returns:
            what the frames that are numbered now say.
        """
        kept, numbered = [], []
        for frame in self._waiting:
            if frame.read is None:
                own = number - (count - frame.count)
                if self._terms is not None:
                    own %= self._terms.frames
                if own >= 0:
                    if own >= NUMBERS or number_likelihoods(frame.scores)[own] < CONTRADICTS:
                        continue
                    frame.read = ReadFrame(frame.scores, own)
                    numbered.append(frame.read)
            kept.append(frame)
        self._waiting = kept
        return numbered

    def _forget_terms(self) -> None:
        """Learn the terms from the next frames."""
        self._terms = None
        self._evidence = np.zeros((PIECES, NUMBERS), np.float32)
        self._support = 0.0

    def _learn_terms(self, frame: ReadFrame) -> None:
        """Add what a frame says about the terms, or hold it against them once they are known."""
        if self._terms is not None:
            self._support = min(0.0, self._support + max(frame.supports(self._terms), CONTRADICTS))
            if self._support > DOUBTFUL:
                return
            self._forget_terms()
        self._evidence[frame.pieces] *= TERMS_MEMORY
        self._evidence[frame.pieces] += frame.likelihoods
        told = read_terms(self._evidence.argmax(axis=1), self.n_bits)
        self._terms = told or likely_terms(self._evidence, self.n_bits)

    def _put(self, frame: ReadFrame, terms: Terms) -> None:
        """Add a frame to the loop, and note whether decoding is due."""
        if frame.number >= terms.frames or frame.supports(terms) < CONTRADICTS:
            return
        if terms == self._delivered:
            self._loop, self._due, self.progress = None, False, 1.0
            return
        if self._loop is None or self._loop.terms != terms:
            self._loop, self._due = CodedScores(terms, self.n_bits), False
        self._loop.add(frame.number, frame.coded)
        self.progress = self._loop.progress
        self._due = self._due or self._loop.worth_decoding()

    def go_on(self, work: float = np.inf) -> Message | None:
        """Go on with decoding that is under way.

        Decoding a long message takes as long as several camera frames, so it may be done in steps.
        It goes on with what was collected when it began.

        Args:
            work: units of work (`link.code.rateless.GRAPH_WORK`) after which no further step is
                taken; without it, decoding goes on until it ends.

        Returns:
            the message where it is whole now and not the one that was returned last, else None.
        """
        spent = 0
        while True:
            if self._attempt is None:
                if self._loop is None or not self._due:
                    return None
                self.attempts += 1
                self._due, self._loop.tried = False, self._loop.progress
                steps = coded_decoding_steps(self._loop.sums, self._loop.terms)
                self._attempt = self._loop, steps
            loop, steps = self._attempt
            try:
                while spent < work:
                    spent += next(steps)
                return None
            except StopIteration as end:
                self._attempt = None
                if end.value is not None:
                    return self._deliver(loop, end.value)

    def _deliver(self, loop: CodedScores, content: Content) -> Message:
        """Make the message that was decoded of a loop; it ends the collection."""
        sent = coded_bits(content, loop.terms, self.n_bits)
        agree = agreement_of(loop.sums, sent)
        changed = self._delivered is not None
        if self._loop is not None and self._loop.terms == loop.terms:
            self._loop, self._due, self.progress = None, False, 1.0
        self._delivered = loop.terms
        return Message(content.data, loop.terms.frames, loop.seen, agree, changed, content.signed)
