"""Read a display whose layout is known: clock, states, bits, message.

A `DisplayReader` takes the rectified display of one camera frame after another. The receiver finds
the display and hands its frames to the reader of its layout (`receiver.receiver`).
"""

from collections import deque
from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from link.clock import DisplayClock
from link.code.collect import Message, make_collector
from link.frames import SoftBits
from link.types import Homography
from models.film.window import reads_films
from receiver.decoders import PairDecoder, WindowDecoder
from receiver.reading.film import VAGUE, FilmDesk, information
from receiver.reading.pairs import ComposedPair, PairScorer
from receiver.reading.states import (
    MESH,
    DisplayState,
    RectifiedFrame,
    compose_state,
    points_in_view,
    unseen_state,
)
from receiver.sight import Sight, StageTimes
from receiver.timing.synchronise import Synchroniser
from receiver.timing.toggles import make_toggles
from receiver.tracking.corners import CornerShift
from receiver.tracking.patches import Tracked

BUFFER = 256
"""Largest number of rectified frames that are kept until their frame pairs can be decoded. Most are
kept while the clock is unknown."""
PAIRS_A_FRAME = 2
"""Largest number of frame pairs that are decoded with one camera frame. Many wait when the clock
has just been found; the next frames take the rest, so that no frame takes long."""
WORK_A_FRAME, PAIR_WORK = 18_000_000, 1000
"""Units of work (`link.code.rateless.GRAPH_WORK`) after which decoding of a long message is left to
the next camera frame, and by how many of them a frame pair that is decoded with the same camera
frame lowers this number, for each of its blocks. The first is about 30 ms of one core, so that no
frame takes long."""
MOST_WAITING = 36
"""Largest number of frame pairs that wait for the film decoder."""
APART = 4.0
"""Smallest distance of the toggles' two levels, in standard deviations, at which images without a
clock are told apart by their toggles."""


@dataclass(frozen=True)
class DecodedPair:
    """A frame pair that the receiver has decoded."""

    number: int
    """Number of the frame pair on the display, counted from an arbitrary start."""
    time: float
    """Seconds of the camera's clock at which the pair was decoded."""
    soft: SoftBits
    """Scores as they went to the collector: 0 for an erased block."""
    original: DisplayState
    """The pair's original frame, put together from camera frames."""
    embedded: DisplayState
    """The pair's embedded frame, put together from camera frames."""
    progress: float
    """Information received for the message so far, as a share of what is needed."""


@dataclass(frozen=True)
class BufferedFrame:
    """A camera frame that is kept until its frame pairs can be decoded."""

    shown: RectifiedFrame
    """The display in it."""
    measured: NDArray[np.float64]
    """(V,) what `Toggles.measure` says of it."""
    moved: NDArray[np.float64] | None
    """(8,) value of `CornerShift.total` when the frame was rectified; None where the display was
    found anew since."""


class DisplayReader:
    """Reads the message of a display that shows one layout.

    Args:
        decoder: decoder of the layout.
        fps: nominal number of frames of the camera in a second.
        timing: takes the time spent in each stage.
        sight: takes what the frames show.
        film: decodes windows of film where the layout and the picture allow it; None where all is
            read by frame pairs.

    Raises:
        InputError: the layout has too few message blocks for a message.
    """

    def __init__(
        self,
        decoder: PairDecoder,
        fps: float,
        timing: StageTimes,
        sight: Sight,
        film: WindowDecoder | None = None,
    ) -> None:
        self.decoder = decoder
        self.layout = decoder.layout
        self.timing = timing
        self.decoded = 0
        """Number of frame pairs decoded."""
        self.collector = make_collector(self.layout.n_bits)
        """Turns the scores of frame pairs into messages."""
        self._fps = fps
        self._sight = sight
        self._scorer = PairScorer(decoder, timing)
        self._buffer: deque[BufferedFrame] = deque(maxlen=BUFFER)
        self._next: int | None = None
        self._waiting: list[ComposedPair] = []
        self._scored: deque[tuple[ComposedPair, SoftBits]] = deque()
        self._by_pairs = self._alone = 0
        self._desk = (
            FilmDesk(self.layout, film, BUFFER)
            if film is not None and reads_films(self.layout)
            else None
        )
        self._corners = CornerShift(self.layout)
        self._toggles = make_toggles(self.layout)
        self.restart()

    def prepare(self) -> None:
        """Get ready: frames of this layout will soon come."""
        self.decoder.prepare()
        if self._desk is not None:
            self._desk.prepare()

    def restart(self) -> None:
        """Forget the clock and the frames that wait for it; the collector keeps what it has."""
        self.sync = Synchroniser(self._fps, self._toggles, self.layout.code)
        """Finds and holds the display's clock."""
        self._slips = 0
        self._buffer.clear()
        if self._desk is not None:
            self._desk.clear()
        self._start_run()

    def _start_run(self) -> None:
        """Begin to count frame pairs anew."""
        self._next, self._by_pairs = None, 0
        self._waiting.clear()
        self._scored.clear()
        self.collector.start_run()

    def take(
        self, tracked: Tracked, time: float, shape: tuple[int, ...]
    ) -> tuple[list[DecodedPair], Message | None]:
        """Take the display in the next camera frame.

        Args:
            tracked: the display.
            time: time of the frame, seconds; rising from frame to frame.
            shape: shape of the camera frame.

        Returns:
            frame pairs that could be decoded with it, in order, and the message where it became
            whole.
        """
        start = perf_counter()
        if self._buffer and self._buffer[-1].shown.rectified.shape != tracked.rectified.shape:
            self._buffer.clear()  # frames were gray, and now have colours, or the other way round
        if tracked.anew:
            if self._desk is not None:
                self._desk.clear()
            self._corners = CornerShift(self.layout)
            for at, waiting in enumerate(self._buffer):
                self._buffer[at] = replace(waiting, moved=None)
        if tracked.clock is not None:
            self.sync.begin(tracked.clock, time)
        for earlier, seen in tracked.before:
            self._keep(seen, earlier, shape, fit=False)
        in_view = self._keep(tracked, time, shape, fit=True)
        self._sight.see(tracked.rectified, time, in_view)
        if self.sync.clock is not None:
            self._sight.state_hz = 1 / self.sync.clock.period
            self._sight.exposed = self.sync.clock.shutter / self.sync.clock.period
        if self.sync.slips != self._slips:
            self._slips = self.sync.slips
            self._start_run()
        self.timing.add("synchronise", start)
        pairs, message = self._decode_ready(time)
        return pairs, message if pairs else self.go_on()

    def _keep(
        self, tracked: Tracked, time: float, shape: tuple[int, ...], *, fit: bool
    ) -> NDArray[np.bool_] | None:
        """Measure the display in a frame, and keep it until its frame pairs can be decoded.

        Args:
            tracked: the display.
            time: time of the frame, seconds; rising from frame to frame.
            shape: shape of the camera frame.
            fit: whether the clock may be fitted now; of many frames at once, the newest fits it.

        Returns:
            what `points_in_view` says.
        """
        in_view = points_in_view(tracked.corners, shape)
        measured = self._toggles.measure(tracked.rectified)
        self.sync.add(time, measured, fit=fit)
        shown = RectifiedFrame(time, tracked.rectified, in_view)
        self._buffer.append(BufferedFrame(shown, measured, self._corners.total))
        if self._desk is not None:
            self._desk.add(shown)
        return in_view

    def go_on(self, work: float = WORK_A_FRAME) -> Message | None:
        """Go on with decoding the message, where that takes longer than one camera frame.

        Args:
            work: units of work (`link.code.rateless.GRAPH_WORK`) after which it stops for now.

        Returns:
            the message where it became whole.
        """
        if not self.collector.decoding:
            return None
        start = perf_counter()
        message = self.collector.go_on(work)
        self.timing.add("collect", start)
        return message

    def shift(self) -> Homography | None:
        """Say where the display lies in its rectified image, as its decoded blocks tell.

        Returns:
            ``H_old_from_new`` in layout pixels, once; None where nothing new is known.
        """
        return self._corners.shift()

    def finish(self) -> tuple[list[DecodedPair], Message | None]:
        """Decode what is left when the frames have ended; images without a clock by their order."""
        pairs, message = (
            self._decode_unclocked() if self.sync.clock is None else self._decode_ready(np.inf)
        )
        return pairs, self.go_on(np.inf) if message is None else message

    def _decode_ready(self, now: float) -> tuple[list[DecodedPair], Message | None]:
        """Decode frame pairs whose time on the display is over: all of them once frames have ended.

        Args:
            now: time of the newest frame, seconds; infinite where the frames have ended.
        """
        clock = self.sync.clock
        if clock is None or not self._buffer:
            return [], None
        if self._next is None:
            self._next = int(np.ceil(clock.number(self._buffer[0].shown.time) / 2))
        over, last = np.isinf(now), self._buffer[-1].shown.time
        end = clock.number(last + clock.latest if over else now + clock.earliest)
        most = PAIRS_A_FRAME if self._desk is None else MOST_WAITING
        while end >= 2 * self._next + 2 and (over or len(self._waiting) < most):
            self._compose(clock, self._next)
            self._next += 1
        pairs: list[DecodedPair] = []
        work = np.inf if over else max(0.0, WORK_A_FRAME - PAIR_WORK * self.layout.n_bits)
        self._alone = 0
        while (scored := self._next_scored(clock, over)) is not None:
            pair, message = self._finish_pair(*scored, last, work)
            pairs.append(pair)
            if message is not None:
                return pairs, message
        return pairs, None

    def _compose(self, clock: DisplayClock, number: int) -> None:
        """Put the two states of a frame pair together, and let go of frames that no other needs."""
        start = perf_counter()
        frames = [waiting.shown for waiting in self._buffer]
        original, embedded = (
            compose_state(frames, clock, state) for state in self.layout.code.states_of(number)
        )
        moved: list[NDArray[np.float64] | None] = []
        while self._buffer and clock.number(self._buffer[0].shown.time + clock.latest) < 2 * (
            number + 1
        ):
            moved.append(self._buffer.popleft().moved)
        if self._desk is not None:  # which reads what a slow camera sees of one state alone
            original, embedded = (
                original or unseen_state(embedded),
                embedded or unseen_state(original),
            )
        if original is not None and embedded is not None:
            self._waiting.append(ComposedPair(number, original, embedded, moved))
        self.timing.add("compose", start)

    def _next_scored(self, clock: DisplayClock, over: bool) -> tuple[ComposedPair, SoftBits] | None:
        """Score the next frame pair that waits, or return None where that is left for later.

        Scores come from a window of film. Where the picture moves, the film decoder says next to
        nothing, and less than a single frame pair does; the pairs of that window are then decoded
        one by one.
        """
        if self._scored:
            return self._scored.popleft()
        if not self._waiting:
            return None
        if self._desk is not None and not self._by_pairs:
            waiting_s = 2 * clock.period * len(self._waiting)
            if not (over or self._desk.due(self._fps, waiting_s)):
                return None
            start = perf_counter()
            scores = self._desk.score(clock, [composed.number for composed in self._waiting])
            self.timing.add("film", start)
            done, last = self._waiting[: len(scores)], self._waiting[len(scores) - 1]
            if not self._says_less(scores, last):
                del self._waiting[: len(scores)]
                for composed in done:
                    soft = SoftBits(scores[composed.number])
                    self._scored.append((composed, self._scorer.without_covered(composed, soft)))
                return self._scored.popleft()
            self._by_pairs = len(done)
        if self._alone >= PAIRS_A_FRAME and not over:
            return None
        self._alone, self._by_pairs = self._alone + 1, max(0, self._by_pairs - 1)
        composed = self._waiting.pop(0)
        return composed, self._scorer.score(composed)

    def _says_less(self, scores: dict[int, NDArray[np.float64]], last: ComposedPair) -> bool:
        """Tell whether the film says less of its frame pairs than the last one's two states do."""
        known = np.mean([information(found) for found in scores.values()])
        alone = information(self._scorer.score_states(last).scores) if known < VAGUE else 0.0
        return bool(known < alone)

    def _finish_pair(
        self, composed: ComposedPair, soft: SoftBits, time: float, work: float = np.inf
    ) -> tuple[DecodedPair, Message | None]:
        """Learn from a pair's scores where the corners lie, and hand them to the collector.

        Args:
            composed: the pair.
            soft: its scores, 0 for erased blocks.
            time: time of the newest frame, seconds.
            work: units of work after which decoding of the message stops for now.
        """
        start = perf_counter()
        self._sight.mixed += 1 - float(self._scorer.trust(composed).mean())
        original, embedded = composed.original, composed.embedded
        known = [total for total in composed.moved if total is not None]
        if known and len(known) == len(composed.moved):
            total = np.mean(known, axis=0)
            self._corners.take(original.image, embedded.image, soft.scores, total)
        self.decoded += 1
        self.timing.add("correct", start)
        start = perf_counter()
        message = self.collector.add(soft.scores, composed.number, work)
        self.timing.add("collect", start)
        progress = self.collector.progress
        return DecodedPair(composed.number, time, soft, original, embedded, progress), message

    def _decode_unclocked(self) -> tuple[list[DecodedPair], Message | None]:
        """Decode frames in order, each of one state, which ends where the toggles change level."""
        pairs: list[DecodedPair] = []
        seen = [waiting for waiting in self._buffer if np.isfinite(waiting.measured).any()]
        if len(seen) < 2:
            return pairs, None
        toggles = self._toggles.over_time(np.array([waiting.measured for waiting in seen]))
        levels = np.nanmean(toggles, axis=1)
        high = levels > (levels.max() + levels.min()) / 2
        if not high.any():  # all have one level
            return pairs, None
        spread = max(levels[high].std(), levels[~high].std(), 1e-6)
        if levels[high].mean() - levels[~high].mean() < APART * spread:
            return pairs, None
        states: list[tuple[bool, list[RectifiedFrame]]] = []
        for waiting, up in zip(seen, high, strict=True):
            if not states or states[-1][0] != up:
                states.append((bool(up), []))
            states[-1][1].append(waiting.shown)
        for at in range(len(states) - 1):
            if not states[at][0]:
                original, embedded = (_average(states[at + which][1]) for which in (0, 1))
                time = states[at][1][0].time
                composed = ComposedPair(at // 2, original, embedded)
                pair, message = self._finish_pair(composed, self._scorer.score(composed), time)
                pairs.append(pair)
                if message is not None:
                    return pairs, message
        return pairs, None


def _average(frames: list[RectifiedFrame]) -> DisplayState:
    """Average frames of one state, all of them pure."""
    images = np.stack([frame.rectified for frame in frames])
    mean = np.asarray(images.mean(axis=0) + 0.5, np.uint8)
    return DisplayState(mean, np.ones((MESH, MESH)), len(frames))
