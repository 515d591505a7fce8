"""Read a display whose layout is known: clock, states, bits, message.

A `DisplayReader` takes the rectified display of one camera frame after another. The receiver finds
the display and hands its frames to the reader of its layout (`receiver.receiver`).
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from link.code.collect import Message, make_collector
from link.frames import SoftBits
from models.film.window import reads_films
from receiver.decoders import PairDecoder, WindowDecoder
from receiver.reading.film import FilmReader
from receiver.reading.pairs import PairReader
from receiver.reading.shown import ReadPair, Shown, States
from receiver.reading.states import mean_state, split_by_level
from receiver.seen import SeenFrame, SeenFrames
from receiver.sight import StageTimes
from receiver.timing.synchronise import Synchroniser
from receiver.timing.toggles import make_toggles

WORK_A_FRAME, PAIR_WORK = 18_000_000, 1000
"""Units of work (`link.code.rateless.GRAPH_WORK`) after which decoding of a long message is left to
the next camera frame, and by how many of them a frame pair that is decoded with the same camera
frame lowers this number, for each of its blocks. The first is about 30 ms of one core, so that no
frame takes long."""


@dataclass(frozen=True)
class DecodedPair:
    """A frame pair that the receiver has decoded."""

    number: int
    """Number of the frame pair on the display, counted from an arbitrary start."""
    time: float
    """Seconds of the camera's clock at which the pair was decoded."""
    soft: SoftBits
    """Scores as they went to the collector: 0 for an erased block."""
    shown: Shown
    """States of the pair, composed of camera frames."""
    progress: float
    """Information received for the message so far, as a share of what is needed."""


class DisplayReader:
    """Reads the message of a display that shows one layout.

    Args:
        decoder: decoder of the layout's frame pairs.
        fps: nominal number of frames of the camera in a second.
        seen: takes the frames in which the display is seen.
        timing: takes the time spent in each stage.
        film: decodes windows of film where the layout allows it; None where films are read by
            frame pairs.

    Raises:
        InputError: the layout has too few message blocks for a message.
    """

    def __init__(
        self,
        decoder: PairDecoder,
        fps: float,
        seen: SeenFrames,
        timing: StageTimes,
        film: WindowDecoder | None = None,
    ) -> None:
        self.decoder = decoder
        self.layout = decoder.layout
        self.decoded = 0
        """Number of frame pairs decoded."""
        self.mixed = 0.0
        """Sum over frame pairs of the share of the blocks' trust that mixed exposures cost."""
        self.collector = make_collector(self.layout.n_bits)
        """Turns the scores of frame pairs into messages."""
        self._fps, self._seen, self._timing = fps, seen, timing
        self._pairs = PairReader(decoder, seen, timing)
        films = film if reads_films(decoder.layout) else None
        self._source = (
            FilmReader(decoder.layout, films, seen, fps, timing) if films else self._pairs
        )
        self.prepare = (films or decoder).prepare
        """Says to what will decode that frames of this layout come soon."""
        self._toggles = make_toggles(self.layout)
        self.restart()

    def restart(self) -> None:
        """Forget the clock and the frames that wait for it; the collector keeps what it has."""
        self._seen.whole.clear()
        self._seen.toggles.clear()
        self.sync = Synchroniser(self._fps, self._toggles, self.layout.code)
        """Finds and holds the display's clock."""
        self._slips = 0
        self._start_run()

    def _start_run(self) -> None:
        """Begin to count frame pairs anew."""
        self._source.start_run()
        self.collector.start_run()

    def take(self, frame: SeenFrame) -> tuple[list[DecodedPair], Message | None]:
        """Take the display in the next camera frame.

        Returns:
            frame pairs that could be decoded with it, in order, and the message where it became
            whole.
        """
        with self._timing.stage("synchronise"):
            if frame.anew:
                self._source.begin_anew()
            for each in (*frame.before, frame):
                self._seen.add(each)
            if frame.clock is not None:
                self.sync.begin(frame.clock, frame.time)
            self.sync.update(self._seen.toggles, frame.time)
            if self.sync.slips != self._slips:
                self._slips = self.sync.slips
                self._start_run()
        pairs, message = self._decode_ready(frame.time)
        self._seen.let_go(self._source.read_until)
        return pairs, message if pairs else self.go_on()

    def go_on(self, work: float = WORK_A_FRAME) -> Message | None:
        """Go on with decoding the message, where that takes longer than one camera frame.

        Args:
            work: units of work (`link.code.rateless.GRAPH_WORK`) after which it stops for now.

        Returns:
            the message where it became whole.
        """
        if not self.collector.decoding:
            return None
        with self._timing.stage("collect"):
            return self.collector.go_on(work)

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
        if clock is None:
            return [], None
        less = PAIR_WORK * self.layout.n_bits
        work = np.inf if np.isinf(now) else max(0.0, WORK_A_FRAME - less)
        reads = ((read, self._seen.newest) for read in self._source.read(clock, now))
        return self._finish_pairs(reads, work)

    def _decode_unclocked(self) -> tuple[list[DecodedPair], Message | None]:
        """Decode frames in order, each of one state, which ends where the toggles change level."""
        frames = [
            frame
            for frame in self._seen.after(self._source.read_until)
            if np.isfinite(frame.toggles).any()
        ]
        if not frames:
            return [], None
        toggles = self._toggles.over_time(np.array([frame.toggles for frame in frames]))
        states = split_by_level(frames, np.nanmean(toggles, axis=1))

        def reads() -> Iterator[tuple[ReadPair, float]]:
            for number, (first, second) in enumerate(states):
                shown = States(mean_state(first), mean_state(second), self.layout.message_mask)
                yield self._pairs.decode(number, shown), first[0].time

        return self._finish_pairs(reads(), np.inf)

    def _finish_pairs(
        self, reads: Iterable[tuple[ReadPair, float]], work: float
    ) -> tuple[list[DecodedPair], Message | None]:
        """Hand the scores of frame pairs to the collector, one by one, until a message is whole.

        Args:
            reads: pairs, and the time that counts as that of their decoding, seconds.
            work: units of work after which decoding of the message stops for now.
        """
        pairs: list[DecodedPair] = []
        for read, time in reads:
            self.mixed += read.mixed
            self.decoded += 1
            with self._timing.stage("collect"):
                message = self.collector.add(read.soft.scores, read.number, work)
            progress = self.collector.progress
            pairs.append(DecodedPair(read.number, time, read.soft, read.shown, progress))
            if message is not None:
                return pairs, message
        return pairs, None
