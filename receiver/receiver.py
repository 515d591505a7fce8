"""From camera frames to the message: find the display, follow it, and read it.

`Receiver.push` takes one camera frame through all stages. What the display shows need not be known
beforehand: the receiver looks for the layouts of all its decoders, and goes on with the one that it
finds (`receiver.reading.reader`).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from link.code.collect import Message
from link.errors import InputError
from link.layout import Layout
from link.presets import preset_name
from link.types import Image
from receiver.decoders import PairDecoder, WindowDecoder
from receiver.diagnosis import Observations
from receiver.reading.reader import DecodedPair, DisplayReader
from receiver.repeats import Repeats
from receiver.seen import SeenFrame, SeenFrames
from receiver.sight import Sight, StageTimes
from receiver.tracking.judge import Judge
from receiver.tracking.patches import Tracker
from receiver.tracking.pilots import PilotTracker

DisplayTracker = Tracker | PilotTracker
"""Finds a display, and follows it from frame to frame."""


@dataclass(frozen=True)
class ReceiverStep:
    """Results of one camera frame."""

    tracked: SeenFrame | None
    """The frame, if the display was seen in it, else None."""
    pairs: list[DecodedPair]
    """Frame pairs that could be decoded with this frame, in order."""
    message: Message | None
    """The message, where it became whole with this frame."""


class Receiver:
    """Reads a message from the frames of a camera that films the display.

    Args:
        decoders: one, or one for each layout that is looked for, with ratex patches or pilots.
        fps: nominal number of frames of the camera in a second.
        film: decodes windows of film where the layout allows it; None where films are read by
            frame pairs.

    Raises:
        InputError: there is no decoder, two have one layout, a layout has neither patches nor
            pilots, or too few message blocks for a message.

    >>> from export.runtime import Decoder
    >>> from models import PRETRAINED
    >>> receiver = Receiver(Decoder(PRETRAINED / "decoder.onnx"), fps=30)
    >>> step = receiver.push(np.full((240, 320, 3), 90, np.uint8), time=0.0)  # an empty wall
    >>> (step.tracked, step.pairs, step.message)
    (None, [], None)
    """

    def __init__(
        self,
        decoders: PairDecoder | Sequence[PairDecoder],
        fps: float = 30.0,
        film: WindowDecoder | None = None,
    ) -> None:
        chosen = list(decoders) if isinstance(decoders, Sequence) else [decoders]
        layouts = [decoder.layout for decoder in chosen]
        if not chosen:
            raise InputError("decoders: need at least one")
        if len(set(layouts)) < len(layouts):
            raise InputError("decoders: two of them read the same layout; give one of each")
        self.timing = StageTimes()
        """Time spent in each stage so far."""
        self.found = 0
        """Number of frames in which the display was found."""
        self.frames = 0
        """Number of frames taken."""
        self._fps = fps
        self._repeats = Repeats()
        self._sight = Sight()
        self._seen = SeenFrames()
        self._last: SeenFrame | None = None
        self._trackers = make_trackers(layouts, fps)
        self._readers = {
            decoder.layout: DisplayReader(decoder, fps, self._seen, self.timing, film)
            for decoder in chosen
        }
        self._reader = self._readers[layouts[0]]
        self._followed: DisplayTracker | None = None
        self._judge = Judge(layouts[0], fps, 0.0, 0, 0)

    @property
    def layout(self) -> Layout:
        """Layout of the display that was found last, or the first one that is looked for."""
        return self._reader.layout

    @property
    def decoded(self) -> int:
        """Number of frame pairs decoded."""
        return sum(reader.decoded for reader in self._readers.values())

    @property
    def progress(self) -> float:
        """Information received, as a share of what is needed: about 1 when the message is whole."""
        return self._reader.collector.progress

    @property
    def synchronised(self) -> bool:
        """Whether the display's clock is known."""
        return self._reader.sync.clock is not None

    @property
    def state_hz(self) -> float | None:
        """Number of states that the display shows in a second, or None while it is unknown."""
        clock = self._reader.sync.clock
        return None if clock is None else 1 / clock.period

    @property
    def observations(self) -> Observations:
        """Counts of what was seen so far, by which `explain_silence` says why no message came."""
        sight = self._sight
        measured = max(sight.measured, 1)
        layouts = [self.layout] if self.found else list(self._readers)
        return Observations(
            fps=self._fps,
            frames=self.frames,
            found=self.found,
            seconds=sight.last - sight.first if self.found else 0.0,
            level=sight.level / measured if sight.measured else None,
            clipped=sight.clipped / measured,
            cut=sight.cut,
            toggling=self._reader.sync.best,
            state_hz=sight.state_hz,
            exposed=sight.exposed,
            decoded=self.decoded,
            mixed=sum(reader.mixed for reader in self._readers.values()) / max(self.decoded, 1),
            progress=self.progress,
            presets=[name for name in map(preset_name, layouts) if name],
        )

    def push(self, image: NDArray[np.generic], time: float) -> ReceiverStep:
        """Take the next camera frame.

        Args:
            image: (H, W) or (H, W, 3) uint8 or uint16, encoded RGB.
            time: time of the frame, seconds; rising from frame to frame.

        Raises:
            InputError: not an image.
        """
        frame = as_uint8(image)
        self.frames += 1
        if self._repeats.is_repeat(frame):  # it was not exposed at this time
            self.found += self._last is not None
            return ReceiverStep(self._last, [], self._reader.go_on())
        with self.timing.stage("track"):
            seen = self._last = self._find(frame, time)
        if seen is None:
            step = ReceiverStep(None, [], self._reader.go_on())
        else:
            self.found += 1
            step = ReceiverStep(seen, *self._reader.take(seen))
        self._sight.take(frame, seen, self._reader.sync.clock)
        return step

    def _find(self, image: Image, time: float) -> SeenFrame | None:
        """Follow the display, or look for all layouts until one is found.

        What is followed comes first. If it is read in vain it comes last, so that it keeps no other
        display from being found.
        """
        followed, in_vain = self._followed, False
        order = [tracker for tracker in self._trackers if tracker is not followed]
        if followed is not None:
            reads = self.synchronised and self.progress > 0
            in_vain = self._judge.is_read_in_vain(time, self.frames, self.decoded, reads=reads)
            if in_vain:
                followed.set_aside(time, forget=False)
            order.insert(len(order) if in_vain else 0, followed)
        for tracker in order:
            seen = tracker.follow(image, time)
            if seen is None:
                continue
            if tracker is followed and self._judge.has_stopped(seen, self._seen):
                tracker.lose()
                continue
            elsewhere = in_vain and seen.anew
            if tracker is not followed or elsewhere:
                self._judge = Judge(seen.layout, self._fps, time, self.frames, self.decoded)
                if followed is not None and tracker is not followed:
                    followed.set_aside(time, forget=True)
            if seen.layout != self._reader.layout or elsewhere:
                self._reader = self._readers[seen.layout]
                self._reader.restart()
            self._followed = tracker
            self._reader.prepare()
            return seen
        self._followed = None
        return None

    def finish(self) -> ReceiverStep:
        """Decode what is left when the frames have ended; images without a clock by their order."""
        return ReceiverStep(None, *self._reader.finish())


def make_trackers(layouts: Sequence[Layout], fps: float) -> list[DisplayTracker]:
    """Make what finds and follows the displays of some layouts.

    Args:
        layouts: layouts that are looked for.
        fps: nominal number of frames of the camera in a second.

    Raises:
        InputError: a layout has neither ratex patches nor pilots.
    """
    with_pilots = [layout for layout in layouts if layout.pilots]
    trackers: list[DisplayTracker] = [Tracker(layout) for layout in layouts if not layout.pilots]
    return [*trackers, PilotTracker(with_pilots, fps)] if with_pilots else trackers


def as_uint8(image: NDArray[np.generic]) -> Image:
    """Turn a camera's image into what the receiver takes.

    Args:
        image: (H, W), (H, W, 1) or (H, W, 3) uint8 or uint16, encoded.

    Returns:
        an `Image`.

    Raises:
        InputError: any other shape or type.
    """
    try:
        array = np.asarray(image)
    except ValueError:  # lists of unlike lengths
        array = np.empty(0)
    if array.ndim == 3 and array.shape[2] == 1:
        array = array[:, :, 0]
    if array.ndim not in (2, 3) or array.shape[2:] not in ((), (3,)) or min(array.shape[:2]) < 16:
        given = array.shape if isinstance(image, np.ndarray) else type(image).__name__
        raise InputError(f"frames must be (H, W) or (H, W, 3) of 16 px or more, got {given}")
    if array.dtype == np.uint16:
        return np.asarray((array.astype(np.uint32) + 128) // 257, np.uint8)
    if array.dtype != np.uint8:
        raise InputError(f"frames must be uint8 or uint16, got {array.dtype}")
    return np.asarray(array, np.uint8)
