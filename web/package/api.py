"""Read hidden messages from camera frames: frames and times in, events out.

`Receiver` reads a film, and `read_pair` two captured frames. What ``__all__`` names is promised to
stay; all else in this package may change. Events are plain dicts, the same as those that the
command `receiver` prints, and ``events.schema.json`` describes them.
"""

from collections.abc import Sequence
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from link import __version__
from link.code.authenticate import Verifier
from link.errors import InputError, ParameterError
from link.frames import check_same_size
from link.geometry import as_corners
from link.images.video import check_fps
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
from receiver.receiver import Receiver as FrameReceiver
from receiver.receiver import as_uint8
from receiver.stream import EventStream, pair_event
from receiver.tracking.two_images import find_in_both

__all__ = [
    "ClockEvent",
    "DisplayEvent",
    "EndEvent",
    "FilmEvent",
    "InputError",
    "MessageEvent",
    "PairEvent",
    "Receiver",
    "RefusedEvent",
    "__version__",
    "read_pair",
]


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
        InputError: an argument is out of range, or a model unreadable.
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
        check_fps(fps)
        if max_age_s is not None and key is None:
            raise ParameterError("max_age_s", "only a message with a key has an age; give a key")
        verifier = None if key is None else Verifier(key, max_age_s)
        decoders, film = _decoders(tuple(map(str, models)), threads)
        self._stream = EventStream(decoders, fps, verifier, scores, film)
        self._frames = 0
        self._time = -np.inf

    def push(self, frame: NDArray[np.generic], time: float) -> list[FilmEvent]:
        """Take the next camera frame.

        Args:
            frame: (H, W) or (H, W, 3) uint8 or uint16, encoded RGB.
            time: time of the frame, seconds; rising from frame to frame.

        Returns:
            what the frame brought, often nothing.

        Raises:
            InputError: not an image, or the time does not rise.
        """
        if not time > self._time:
            raise ParameterError("time", f"must rise, got {time} s after {self._time} s")
        events = self._stream.push(frame, time, f"frame {self._frames}")
        self._time, self._frames = time, self._frames + 1
        return events

    def finish(self) -> list[FilmEvent]:
        """Decode what is left when the frames have ended; the last event is an `EndEvent`."""
        return [*self._stream.finish(), self._stream.end()]

    @property
    def explanation(self) -> str:
        """What was seen so far, and why no message came, in one line."""
        return self._stream.explanation


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
        InputError: frames or corners are no good, no display is in both, or both show one state.
    """
    if corners is None and corners_second is not None:
        raise ParameterError("corners_second", "is given without corners")
    decoders, _ = _decoders(() if model is None else (str(model),), threads)
    frames = as_uint8(first), as_uint8(second)
    check_same_size(*frames)
    by_layout = {decoder.layout: decoder for decoder in decoders}
    if corners is None:
        found = find_in_both(*frames, list(by_layout))
        if found is None:
            raise InputError(
                "no display is in both frames whose blocks change from one to the other; take one "
                "frame of each state, from one place, or give corners and model"
            )
        decoder, places = by_layout[found.layout], found.corners
    else:
        if model is None:
            raise ParameterError("model", "name the preset whose display has these corners")
        place = as_corners(corners)
        decoder = decoders[0]
        places = place, place if corners_second is None else as_corners(corners_second)
    pair = FrameReceiver(decoder).decode_images(*frames, *places)
    return pair_event(pair, scores=True)


@cache
def _decoders(
    models: tuple[str, ...], threads: int
) -> tuple[list[PairDecoder], WindowDecoder | None]:
    """Open decoders once: receivers that are made later share them."""
    return open_decoders([find_graph(name) for name in models], threads)
