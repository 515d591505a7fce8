"""Read hidden messages from camera frames: frames and times in, events out.

`Receiver` reads a film, `LiveReceiver` does so in a thread of its own beside a camera, `read_pair`
reads two captured frames, and `hidden_states` makes what a display shows. What ``__all__`` names
is promised to stay; all else in this package may change. Events are plain dicts, the same as those
that the command `receiver` prints, and ``events.schema.json`` describes them. All that is wrong
with what is given raises `InputError`, whose ``code`` says in a word what is wrong.
"""

try:
    # pip cannot say that opencv-python serves as well as the headless one; where one of both was
    # taken away again, cv2 is there, and empty
    from cv2 import imdecode  # noqa: F401
except ImportError:
    raise ImportError(
        "oorc_receiver needs OpenCV: pip install opencv-python-headless, or opencv-python where "
        "cv2 is to open windows, too"
    ) from None

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from threading import Thread
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from export.runtime import check_threads
from link import __version__
from link.code.authenticate import Verifier
from link.code.framing import encode
from link.errors import InputError, NoDisplayError, ParameterError, choose
from link.frames import check_same_size
from link.geometry import as_corners, check_corners
from link.images import as_rgb
from link.images.video import check_fps
from link.loop import Loop
from link.outside import is_file
from link.presets import DEFAULT_PRESET, PRESETS
from link.types import Image
from models import find_graph
from receiver.decoders import PairDecoder, WindowDecoder, open_decoders
from receiver.events import (
    ClockEvent,
    DisplayEvent,
    EndEvent,
    FilmEvent,
    MessageEvent,
    PairEvent,
    RefusedEvent,
)
from receiver.newest import Newest
from receiver.receiver import as_uint8
from receiver.stream import EventStream, pair_event
from receiver.tracking.two_images import decode_in_both, find_in_both

__all__ = [
    "ClockEvent",
    "DisplayEvent",
    "EndEvent",
    "FilmEvent",
    "InputError",
    "LiveReceiver",
    "MessageEvent",
    "PairEvent",
    "Receiver",
    "RefusedEvent",
    "__version__",
    "hidden_states",
    "luma",
    "read_pair",
]

OTHER_UNIT, OFTEN = 300.0, 3
"""Periods of the nominal rate between two frames, and how often in a row, from which times are
taken to be in another unit than seconds; a camera may well stop now and then."""
LARGEST = 1e15
"""Size from which on a number of seconds or frames is taken for infinite."""


class Receiver:
    """Reads messages from the frames of a camera that films a display.

    Args:
        fps: nominal number of frames of the camera in a second; messages need frames at their
            true times, not at this rate.
        models: what is looked for: names of presets (paper, hidden, fast, robust) or paths of
            .onnx files; all presets where it is empty. Fewer are found sooner.
        key: 16 to 4096 bytes that sender and receiver share; only what was sent with it is
            delivered. None delivers all messages.
        max_age_s: largest age, in seconds, of a message with a key; None for any age.
        scores: whether frame pairs come with their scores, too.
        threads: number of threads of onnxruntime.

    Raises:
        InputError: ``argument``: one is of a wrong type or out of range; ``model``: a model is
            unknown or unreadable.
    """

    def __init__(
        self,
        fps: float,
        *,
        models: Sequence[str | Path] = (),
        key: bytes | None = None,
        max_age_s: float | None = None,
        scores: bool = False,
        threads: int = 2,
    ) -> None:
        with _coded("argument"):
            _number("fps", fps)
            check_fps(fps)
            if key is not None and not isinstance(key, bytes):
                raise ParameterError("key", f"give bytes, got {type(key).__name__}")
            if max_age_s is not None:
                _number("max_age_s", max_age_s)
                if key is None:
                    raise ParameterError(
                        "max_age_s", "only a message with a key has an age; give a key"
                    )
            if not isinstance(scores, (bool, np.bool_)):
                raise ParameterError("scores", f"need True or False, got {scores!r:.60}")
            verifier = None if key is None else Verifier(key, max_age_s)
        decoders, film = _open(models, threads)
        with _coded("argument"):
            self._stream = EventStream(decoders, fps, verifier, bool(scores), film)
        self._period = 1 / fps
        self._frames = self._far = 0
        self._time = -math.inf
        self._finished = False

    def push(self, frame: NDArray[np.generic], time: float) -> list[FilmEvent]:
        """Take the next camera frame.

        Args:
            frame: (H, W) or (H, W, 3) uint8 or uint16, encoded RGB.
            time: time of the frame, seconds; rising from frame to frame.

        Returns:
            what the frame brought, often nothing.

        Raises:
            InputError: ``frame``: not an image; ``time``: not finite, does not rise, or is in
                another unit; ``finished``: after `finish`; ``failed``: a model failed to run.
        """
        self.check_open()
        with _coded("time"):
            _number("time", time)
            if not time > self._time:
                raise ParameterError("time", f"must rise, got {time} s after {self._time} s")
            step = time - self._time
            is_far = self._frames > 0 and step > OTHER_UNIT * self._period
            self._far = self._far + 1 if is_far else 0
            if self._far == OFTEN:
                raise ParameterError(
                    "time",
                    f"frames come {step:.3g} s apart, at {1 / self._period:.3g} frames a second; "
                    "give seconds, not milliseconds",
                )
        with _coded("frame"):
            image = as_uint8(frame)
        with _coded("failed"):
            events = self._stream.push(image, time, f"frame {self._frames}")
        self._time, self._frames = float(time), self._frames + 1
        return events

    def finish(self) -> list[FilmEvent]:
        """Decode what is left when the frames have ended; the last event is an `EndEvent`.

        Raises:
            InputError: ``finished``: it was called before; ``failed``: a model failed to run.
        """
        self.check_open()
        self._finished = True
        with _coded("failed"):
            return [*self._stream.finish(), self._stream.end()]

    def check_open(self) -> None:
        """Raise an `InputError`, ``finished``, after `finish`."""
        with _coded("finished"):
            if self._finished:
                raise InputError("this receiver has finished; make a new one for other frames")

    @property
    def explanation(self) -> str:
        """The message's length, or what was seen so far and why none came, in one line."""
        return self._stream.explanation


class LiveReceiver:
    """Reads frames in a thread of its own, so that `push` returns at once and a camera never waits.

    Where frames come faster than they are read, the newest waits and older ones are passed over,
    which costs no more than a slower camera.

    Args:
        receiver: reads the frames; only this object may use it from now on.
        on_event: is called with each event, in the receiver's thread.

    Raises:
        InputError: ``argument``: one is of a wrong type.
    """

    def __init__(self, receiver: Receiver, on_event: Callable[[FilmEvent], object]) -> None:
        if not isinstance(receiver, Receiver) or not callable(on_event):
            with _coded("argument"):
                raise InputError("give a Receiver, and a function that takes its events")
        self._receiver, self._on_event = receiver, on_event
        self._waiting: Newest[tuple[NDArray[np.generic], float]] = Newest()
        self._failed: Exception | None = None
        self._thread = Thread(target=self._read, daemon=True)
        self._thread.start()

    @property
    def passed_over(self) -> int:
        """Number of frames that were not read because newer ones had come."""
        return self._waiting.passed_over

    @property
    def waits(self) -> bool:
        """Whether a frame waits to be read."""
        return self._waiting.waits

    @property
    def explanation(self) -> str:
        """Sentence that says what was seen and what helps, as `Receiver.explanation`."""
        return self._receiver.explanation

    def push(self, frame: NDArray[np.generic], time: float) -> None:
        """Hand over the next camera frame, as `Receiver.push` takes it, and return at once.

        The frame must not be changed afterwards.

        Raises:
            InputError: that of an earlier frame; ``finished``: after `finish`.
        """
        self._raise()
        self._receiver.check_open()
        self._waiting.put((frame, time))

    def finish(self) -> None:
        """Read the frame that waits, and all else as `Receiver.finish`, before it returns.

        Raises:
            InputError: that of an earlier frame, or that of `Receiver.finish`.
        """
        self._waiting.close()
        self._thread.join()
        self._raise()
        for event in self._receiver.finish():
            self._on_event(event)

    def _read(self) -> None:
        try:
            for frame, time in self._waiting:
                for event in self._receiver.push(frame, time):
                    self._on_event(event)
        except Exception as error:  # told to who pushes the next frame
            self._failed = error

    def _raise(self) -> None:
        if self._failed is not None:
            raise self._failed


def luma(planes: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Take the gray frame out of a camera's NV12, NV21, I420 or YV12 frame, which stays as it is.

    Args:
        planes: (3 H / 2, W) uint8, H rows of luma above the two planes of colour.

    Returns:
        (H, W) uint8, what `Receiver.push` and `read_pair` take.

    Raises:
        InputError: ``frame``: of another shape or type.
    """
    with _coded("frame"):
        array = np.asarray(planes)
        if array.ndim != 2 or array.shape[0] % 3 or array.dtype != np.uint8:
            raise InputError(f"planes must be (3 H / 2, W) uint8, got {array.dtype} {array.shape}")
        return as_uint8(array[: 2 * array.shape[0] // 3])


def hidden_states(
    picture: Image, message: bytes, *, preset: str = DEFAULT_PRESET
) -> Iterator[NDArray[np.uint8]]:
    """Hide a message in a picture: the states of one loop, which a display shows over and over.

    Args:
        picture: (H, W) or (H, W, 3) uint8 or uint16, encoded RGB.
        message: 1 byte or more.
        preset: hidden, which is shown at 60 states a second, fast (30), robust or paper (15).

    Returns:
        the states in turn, (height, width, 3) uint8, encoded RGB, of at most 1920 x 1080 pixels;
        they must be shown pixel by pixel.

    Raises:
        InputError: ``frame``: not an image, or longer than 3:1; ``argument``: the preset is
            unknown, or the message is empty or too long.
    """
    with _coded("frame"):
        shown = as_rgb(as_uint8(picture))
    with _coded("argument"):
        if not isinstance(message, bytes):
            raise ParameterError("message", f"give bytes, got {type(message).__name__}")
        chosen = choose(PRESETS, preset, "preset")
        bits = encode(message, chosen.layout.n_bits)
        loop = Loop(chosen.layout, chosen.kappa, bits, lambda: iter([shown]), even=chosen.even)
    with _coded("frame"):
        _ = loop.shown_layout  # is worked out now, so that nothing is refused later
    return loop.states()


def read_pair(
    first: NDArray[np.generic],
    second: NDArray[np.generic],
    *,
    corners: ArrayLike | None = None,
    corners_second: ArrayLike | None = None,
    model: str | Path | None = None,
    threads: int = 2,
) -> PairEvent:
    """Read the bits of one frame pair.

    Args:
        first: (H, W) or (H, W, 3) uint8 or uint16, encoded RGB; the original or the embedded frame.
        second: the other one, of the same shape.
        corners: (4, 2) pixels, x and y, of top left, top right, bottom right and bottom left of the
            displayed picture in the first frame; the display is looked for where they are absent.
        corners_second: the same in the second frame; ``corners`` where absent.
        model: name of a preset, or path of an .onnx file. It is needed beside corners; without
            them, all presets are looked for where it is absent.
        threads: number of threads of onnxruntime.

    Returns:
        the event, with bits and scores.

    Raises:
        InputError: ``frame``: not images of one size; ``argument``: corners are no good, or given
            without a model; ``model``: it is unknown or unreadable; ``no-display``: none is in
            both frames, or both show one state; ``failed``: a model failed to run.
    """
    with _coded("argument"):
        if corners is None and corners_second is not None:
            raise ParameterError(
                "corners_second", "is given without corners; give those of both frames"
            )
        if corners is not None and model is None:
            raise ParameterError("model", "name the preset whose display has these corners")
        place = None if corners is None else as_corners(corners)
        place_second = place if corners_second is None else as_corners(corners_second)
    decoders, _ = _open([] if model is None else [model], threads)
    with _coded("frame"):
        frames = as_uint8(first), as_uint8(second)
        check_same_size(*frames)
    with _coded("argument"):
        for points in (place, place_second):
            if points is not None:
                check_corners(points, frames[0].shape)
    with _coded("failed"):
        if place is not None and place_second is not None:
            pair = decode_in_both(decoders[0], *frames, (place, place_second))
            return pair_event(pair, scores=True)
        by_layout = {decoder.layout: decoder for decoder in decoders}
        found = find_in_both(*frames, list(by_layout))
        if found is None:
            raise NoDisplayError(
                "no display is in both frames whose blocks change from one to the other; take one "
                "frame of each state, from one place, or give corners and model"
            )
        pair = decode_in_both(by_layout[found.layout], *frames, found.corners)
        return pair_event(pair, scores=True)


@contextmanager
def _coded(code: str) -> Iterator[None]:
    """Give the errors of a block a code, where they have none of their own."""
    try:
        yield
    except InputError as error:
        if error.code == InputError.code:
            error.code = code
        raise


def _number(parameter: str, value: Any) -> None:
    """Raise a `ParameterError` where a value is no finite number."""
    is_number = isinstance(value, (int, float, np.integer, np.floating))
    if not is_number or isinstance(value, (bool, np.timedelta64)) or not abs(value) < LARGEST:
        raise ParameterError(parameter, f"need a finite number, got {value!r:.60}")


def _open(models: Sequence[str | Path], threads: int) -> tuple[list[PairDecoder], WindowDecoder]:
    """Open the decoders of presets or files, once; receivers that are made later share them."""
    with _coded("argument"):
        if isinstance(models, (str, bytes)) or not isinstance(models, Sequence):
            raise ParameterError("models", "give a list of presets or files, such as ['hidden']")
        if isinstance(threads, bool) or not isinstance(threads, int):
            raise ParameterError("threads", f"need a whole number, got {threads!r:.60}")
        check_threads(threads)
    with _coded("model"):
        for model in models:
            known = isinstance(model, str) and model in PRESETS
            if not known and not (isinstance(model, (str, Path)) and is_file(Path(model))):
                raise InputError(
                    f"{model!s:.60}: no such model; "
                    f"name one of {', '.join(PRESETS)}, or an .onnx file"
                )
        return _decoders(tuple(map(str, models)), threads)


@cache
def _decoders(models: tuple[str, ...], threads: int) -> tuple[list[PairDecoder], WindowDecoder]:
    return open_decoders([find_graph(name) for name in models], threads)
