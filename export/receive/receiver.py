"""From camera frames to the message: track, rectify, synchronise, decode and collect.

`Receiver.push` takes one camera frame through all stages.
"""

from collections import deque
from dataclasses import dataclass, field
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from export.receive.diagnosis import CLIPPED, CUT, Observations
from export.receive.hidden import fill_hidden, hidden_blocks
from export.receive.occlusion import Occlusion
from export.receive.repeats import Repeats
from export.receive.states import (
    MESH,
    DisplayState,
    RectifiedFrame,
    block_purity,
    compose_state,
    points_in_view,
)
from export.receive.synchronise import Synchroniser
from export.receive.toggles import patch_toggles
from export.receive.track import Tracked, Tracker
from export.runtime import Decoder
from link.code.collect import Collector, Message
from link.errors import InputError
from link.frames import Captured, SoftBits

BUFFER = 256
"""Largest number of rectified frames that are kept while the clock is unknown."""
PURE_FROM, PURE_TO = 0.6, 0.95
"""Purities of a block's exposure at which its score begins to count, and counts in full."""
STILL = 2.0
"""Smallest change of the toggles between two images, in standard errors over the patches, at which
the images show different states."""
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
class ReceiverStep:
    """What one camera frame brought."""

    tracked: Tracked | None
    """The display in the frame, or None where it was not found."""
    pairs: list[DecodedPair]
    """Frame pairs that could be decoded with this frame, in order."""
    message: Message | None
    """The message, where it became whole with this frame."""


@dataclass
class StageTimes:
    """Time that the receiver has spent in each of its stages."""

    spent: dict[str, float] = field(default_factory=dict)
    """Seconds spent in each stage, by its name."""
    count: dict[str, int] = field(default_factory=dict)
    """Number of times that each stage ran, by its name."""

    def add(self, stage: str, since: float) -> None:
        """Add the time since ``since`` (of `perf_counter`) to a stage."""
        self.spent[stage] = self.spent.get(stage, 0.0) + perf_counter() - since
        self.count[stage] = self.count.get(stage, 0) + 1


@dataclass
class Sight:
    """Sums of what the frames show, for the reason why no message came."""

    found: bool = False
    """Whether the display was found; until then whole frames are measured, and then it alone."""
    measured: int = 0
    """Number of frames measured."""
    level: float = 0.0
    """Sum of the mean gray levels of what was measured."""
    clipped: float = 0.0
    """Sum of the shares of pixels at the camera's limit."""
    cut: int = 0
    """Number of frames with a part of the display outside the image."""
    first: float = 0.0
    """Time of the first frame with the display, seconds."""
    last: float = 0.0
    """Time of the last frame with the display, seconds."""
    mixed: float = 0.0
    """Sum over frame pairs of the share of the blocks' trust that mixed exposures cost."""
    state_hz: float | None = None
    """Number of states a second by the clock that was known last, or None where none was."""

    def miss(self, frame: NDArray[np.uint8]) -> None:
        """Take a frame in which the display was not found."""
        if not self.found:
            self._measure(frame)

    def see(
        self, rectified: NDArray[np.uint8], time: float, in_view: NDArray[np.bool_] | None
    ) -> None:
        """Take a frame in which the display was found."""
        if not self.found:
            self.found, self.first = True, time
            self.measured, self.level, self.clipped = 0, 0.0, 0.0
        self.last = time
        self.cut += in_view is not None and float(in_view.mean()) < CUT
        self._measure(rectified)

    def _measure(self, image: NDArray[np.uint8]) -> None:
        sample = image[::8, ::8]
        self.measured += 1
        self.level += float(sample.mean())
        self.clipped += float((sample >= CLIPPED).mean())


class Receiver:
    """Reads a message from the frames of a camera that films the display.

    Args:
        decoder: its layout says what to look for.
        fps: nominal number of frames of the camera in a second.

    Raises:
        InputError: the layout has no ratex patches, or too few message blocks for a message.

    >>> from models import PRETRAINED
    >>> receiver = Receiver(Decoder(PRETRAINED / "decoder.onnx"), fps=30)
    >>> step = receiver.push(np.full((240, 320, 3), 90, np.uint8), time=0.0)  # an empty wall
    >>> (step.tracked, step.pairs, step.message)
    (None, [], None)
    """

    def __init__(self, decoder: Decoder, fps: float = 30.0) -> None:
        self.decoder = decoder
        self.layout = decoder.layout
        self.timing = StageTimes()
        """Time spent in each stage so far."""
        self.found = 0
        """Number of frames in which the display was found."""
        self.frames = 0
        """Number of frames taken."""
        self.decoded = 0
        """Number of frame pairs decoded."""
        self._fps = fps
        self._repeats = Repeats()
        self._tracked: Tracked | None = None
        self._tracker = Tracker(self.layout)
        self._collector = Collector(self.layout.n_bits)
        self._sync = self._fresh_clock()
        self._slips = 0
        self._occlusion = Occlusion(self.layout)
        self._buffer: deque[tuple[RectifiedFrame, float]] = deque(maxlen=BUFFER)
        self._next: int | None = None
        self._sight = Sight()

    def _fresh_clock(self) -> Synchroniser:
        cells = np.array(self.layout.ratex)[:, ::-1] + 0.5  # (row, col) -> (x, y)
        return Synchroniser(self._fps, cells / [self.layout.cols, self.layout.rows])

    @property
    def progress(self) -> float:
        """Information received, as a share of what is needed: about 1 when the message is whole."""
        return self._collector.progress

    @property
    def repeated(self) -> int:
        """Number of frames that showed again what the frame before showed, and were skipped."""
        return self._repeats.count

    @property
    def decode_attempts(self) -> int:
        """Number of times that what was collected was decoded, with or without success."""
        return self._collector.attempts

    @property
    def synchronised(self) -> bool:
        """Whether the display's clock is known."""
        return self._sync.clock is not None

    @property
    def state_hz(self) -> float | None:
        """Number of states that the display shows in a second, or None while it is unknown."""
        return None if self._sync.clock is None else 1 / self._sync.clock.period

    @property
    def observations(self) -> Observations:
        """What was seen so far, from which `explain_silence` tells why no message came."""
        sight = self._sight
        measured = max(sight.measured, 1)
        return Observations(
            fps=self._fps,
            frames=self.frames,
            found=self.found,
            seconds=sight.last - sight.first if self.found else 0.0,
            level=sight.level / measured if sight.measured else None,
            clipped=sight.clipped / measured,
            cut=sight.cut,
            toggling=self._sync.best,
            state_hz=sight.state_hz,
            decoded=self.decoded,
            mixed=sight.mixed / max(self.decoded, 1),
            progress=self.progress,
        )

    def push(self, image: NDArray[np.generic], time: float) -> ReceiverStep:
        """Take the next camera frame.

        Args:
            image: (H, W) or (H, W, 3) uint8 or uint16, encoded RGB.
            time: of the frame, seconds; rising from frame to frame.

        Raises:
            InputError: not an image.
        """
        frame = as_uint8(image)
        self.frames += 1
        start = perf_counter()
        if self._repeats.is_repeat(frame):  # it was not exposed at this time
            self.found += self._tracked is not None
            return ReceiverStep(self._tracked, [], None)
        tracked = self._tracked = self._tracker.follow(frame)
        self.timing.add("track", start)
        if tracked is None:
            self._sight.miss(frame)
            return ReceiverStep(None, [], None)
        self.found += 1
        in_view = points_in_view(tracked.corners, frame.shape)
        self._sight.see(tracked.rectified, time, in_view)
        start = perf_counter()
        toggles = patch_toggles(tracked.rectified, self.layout)
        self._sync.add(time, toggles)
        level = np.nanmean(toggles) if np.isfinite(toggles).any() else np.nan
        self._buffer.append((RectifiedFrame(time, tracked.rectified, in_view), float(level)))
        self._sight.state_hz = self.state_hz or self._sight.state_hz
        if self._sync.slips != self._slips:
            self._slips, self._next = self._sync.slips, None
            self._collector.start_run()
        self.timing.add("synchronise", start)
        return ReceiverStep(tracked, *self._decode_ready(time))

    def decode_images(
        self,
        first: NDArray[np.generic],
        second: NDArray[np.generic],
        corners_first: NDArray[np.float64],
        corners_second: NDArray[np.float64],
    ) -> DecodedPair:
        """Decode two images of one frame pair, in either order.

        Args:
            first: (H, W) or (H, W, 3) uint8 or uint16, encoded RGB, of either state.
            second: of the other state; the same shape and type.
            corners_first: (4, 2) pixels of the display in the first image, in corner order.
            corners_second: (4, 2) pixels of the display in the second image, in corner order.

        Raises:
            InputError: images of unlike size, corners that do not fit, or patches that do not
                differ between the images.
        """
        frames = [as_uint8(image) for image in (first, second)]
        captured = Captured(frames[0], frames[1], self.layout, corners_first, corners_second)
        rectified = captured.rectified()
        images = [rectified.original, rectified.embedded]
        before, after = (patch_toggles(image, self.layout) for image in images)
        gain = after - before
        gain = gain[np.isfinite(gain)]
        if gain.size == 0 or abs(gain.mean()) <= STILL * gain.std() / np.sqrt(gain.size):
            raise InputError("the two images show the same state; take one of each")
        original, embedded = images if gain.mean() > 0 else images[::-1]
        whole = np.ones((MESH, MESH))
        states = DisplayState(original, whole, 1), DisplayState(embedded, whole, 1)
        return DecodedPair(0, 0.0, self.decoder.decode(original, embedded), *states, 0.0)

    def finish(self) -> ReceiverStep:
        """Decode what is left when the frames have ended; images without a clock by their order."""
        if self._sync.clock is not None:
            return ReceiverStep(None, *self._decode_ready(np.inf))
        return ReceiverStep(None, *self._decode_unclocked())

    def _decode_ready(self, now: float) -> tuple[list[DecodedPair], Message | None]:
        """Decode all frame pairs whose time on the display is over."""
        clock = self._sync.clock
        pairs: list[DecodedPair] = []
        if clock is None or not self._buffer:
            return pairs, None
        if self._next is None:
            self._next = int(np.ceil(clock.number(self._buffer[0][0].time) / 2))
        last = self._buffer[-1][0].time
        over = last + clock.latest if np.isinf(now) else now + clock.earliest
        end = clock.number(over)
        while end >= 2 * self._next + 2:
            number, self._next = self._next, self._next + 1
            start = perf_counter()
            frames = [shown for shown, _ in self._buffer]
            states = [compose_state(frames, clock, 2 * number + which) for which in (0, 1)]
            while self._buffer and clock.number(self._buffer[0][0].time + clock.latest) < 2 * (
                number + 1
            ):
                self._buffer.popleft()
            self.timing.add("compose", start)
            if states[0] is None or states[1] is None:
                continue
            pair, message = self._decode(number, last, states[0], states[1])
            pairs.append(pair)
            if message is not None:
                return pairs, message
        return pairs, None

    def _decode(
        self, number: int, time: float, original: DisplayState, embedded: DisplayState
    ) -> tuple[DecodedPair, Message | None]:
        """Decode a pair, erase what is covered or impure, and hand the scores to the collector."""
        start = perf_counter()
        purity = np.minimum(original.purity, embedded.purity)
        images = [original.image, embedded.image]
        hidden = hidden_blocks(images[0], images[1], purity, self.layout)
        soft = self.decoder.decode(*fill_hidden(images, hidden, self.layout))
        pure = block_purity(purity, self.layout)
        trust = np.clip((pure - PURE_FROM) / (PURE_TO - PURE_FROM), 0, 1)
        self._sight.mixed += 1 - float(trust.mean())
        trust = trust * ~self._occlusion.covered(original.image)
        soft = SoftBits(soft.scores * trust, soft.head)
        self.decoded += 1
        self.timing.add("decode", start)
        start = perf_counter()
        message = self._collector.add(soft.scores, number)
        self.timing.add("collect", start)
        return DecodedPair(number, time, soft, original, embedded, self.progress), message

    def _decode_unclocked(self) -> tuple[list[DecodedPair], Message | None]:
        """Decode frames in order, each of one state, which ends where the toggles change level."""
        pairs: list[DecodedPair] = []
        seen = [(shown, level) for shown, level in self._buffer if np.isfinite(level)]
        levels = np.array([level for _, level in seen])
        if levels.size < 2:
            return pairs, None
        high = levels > (levels.max() + levels.min()) / 2
        spread = max(levels[high].std(), levels[~high].std(), 1e-6) if (~high).any() else np.inf
        if levels[high].mean() - levels[~high].mean() < APART * spread:
            return pairs, None
        states: list[tuple[bool, list[RectifiedFrame]]] = []
        for (shown, _), up in zip(seen, high, strict=True):
            if not states or states[-1][0] != up:
                states.append((bool(up), []))
            states[-1][1].append(shown)
        for at in range(len(states) - 1):
            if not states[at][0]:
                original, embedded = (_average(states[at + which][1]) for which in (0, 1))
                time = states[at][1][0].time
                pair, message = self._decode(at // 2, time, original, embedded)
                pairs.append(pair)
                if message is not None:
                    return pairs, message
        return pairs, None


def _average(frames: list[RectifiedFrame]) -> DisplayState:
    """Average frames of one state, all of them pure."""
    images = np.stack([frame.rectified for frame in frames])
    mean = np.asarray(images.mean(axis=0) + 0.5, np.uint8)
    return DisplayState(mean, np.ones((MESH, MESH)), len(frames))


def as_uint8(image: NDArray[np.generic]) -> NDArray[np.uint8]:
    """Turn a camera's image into what the receiver takes.

    Args:
        image: (H, W), (H, W, 1) or (H, W, 3) uint8 or uint16, encoded.

    Returns:
        (H, W) or (H, W, 3) uint8, encoded.

    Raises:
        InputError: any other shape or type.
    """
    array = np.asarray(image)
    if array.ndim == 3 and array.shape[2] == 1:
        array = array[:, :, 0]
    if array.ndim not in (2, 3) or array.shape[2:] not in ((), (3,)) or min(array.shape[:2]) < 16:
        raise InputError(f"frames must be (H, W) or (H, W, 3) of 16 px or more, got {array.shape}")
    if array.dtype == np.uint16:
        return np.asarray((array.astype(np.uint32) + 128) // 257, np.uint8)
    if array.dtype != np.uint8:
        raise InputError(f"frames must be uint8 or uint16, got {array.dtype}")
    return np.asarray(array, np.uint8)
