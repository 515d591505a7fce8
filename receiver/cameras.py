"""Frames of a camera, or of a stream at an address, as they come: the newest waits to be read.

A thread takes the frames, so that none grows old in the camera's queue. Their times are the
camera's own stamps where it has any.
"""

import sys
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from threading import Event, Thread
from time import perf_counter

import cv2
import numpy as np
from numpy.typing import NDArray

from link.errors import InputError
from link.images import check_pixels
from link.images.video import DEFAULT_FPS, MAX_FPS, next_frame, time_after
from receiver.newest import Newest

SIZE = (1280, 720)
"""Width and height, in pixels, for which a camera is asked; many give few frames of larger ones."""
HIGHEST_FPS = 120.0
"""Frames a second for which a camera is asked; it chooses the nearest rate that it has."""
FORMAT = "MJPG"
"""Format for which a camera is asked: without compression USB carries few frames of this size."""
MISSES = 30
"""Number of empty frames in a row after which a camera is taken to be unplugged."""
MOST_AHEAD_S = 2.0
"""Seconds by which stamps may be ahead of the clock, or behind it, and still be believed."""
WAIT_MS = 10_000
"""Milliseconds after which a stream that gives nothing is given up."""
SCHEMES = ("http", "https", "rtsp", "rtsps", "rtmp", "rtp", "srt", "tcp", "udp")
"""Beginnings of the addresses of streams."""


@dataclass(frozen=True)
class CameraFrame:
    """One image of a camera that films the display."""

    image: NDArray[np.uint8]
    """(H, W, 3) uint8, encoded RGB."""
    time: float
    """Seconds since the first frame."""
    name: str
    """Name of the image's file, or the frame's number in words; frames of a camera that were passed
    over count."""


class CameraTimes:
    """Tells when frames were taken: by the camera's stamps, or by when the frames came.

    Stamps count for as long as they rise and keep step with the clock.

    >>> times = CameraTimes()
    >>> [round(times.take(stamp, came), 2) for stamp, came in ((7.0, 0.5), (7.1, 0.5), (7.2, 0.7))]
    [0.0, 0.1, 0.2]
    >>> times = CameraTimes()
    >>> [round(times.take(0.0, came), 2) for came in (0.5, 0.6, 0.7)]
    [0.0, 0.1, 0.2]
    """

    def __init__(self) -> None:
        self._before: tuple[float, float] | None = None
        self._is_stamped = True
        self._ahead = self._time = 0.0

    def take(self, stamp: float, came: float) -> float:
        """Give the time of the next frame, seconds since the first.

        Args:
            stamp: the camera's stamp, seconds; any number where it has none.
            came: time at which the frame came, seconds.
        """
        if self._before is not None:
            by_stamp, by_clock = stamp - self._before[0], came - self._before[1]
            self._ahead += by_stamp - by_clock
            self._is_stamped &= by_stamp > 0 and abs(self._ahead) <= MOST_AHEAD_S
            self._time += by_stamp if self._is_stamped else max(by_clock, 1 / MAX_FPS)
        self._before = stamp, came
        return self._time


class Camera:
    """An open camera or stream.

    Args:
        where: number of a camera, or address of a stream.
        size: width and height, in pixels, for which a camera is asked; `SIZE` where None.
        asked_fps: frames a second for which a camera is asked; `HIGHEST_FPS` where None.

    Raises:
        InputError: it cannot be opened, or its frames are too large.
    """

    def __init__(
        self,
        where: int | str,
        size: tuple[int, int] | None = None,
        asked_fps: float | None = None,
    ) -> None:
        self._name = f"camera {where}" if isinstance(where, int) else where
        try:
            capture = self._capture = _open(where)
            opened = capture.isOpened()
        except cv2.error:
            opened = False
        if not opened:
            remedy = "is it plugged in and free?"
            if isinstance(where, str):
                remedy = "check the address, or record the stream: ffmpeg -i ADDRESS -t 20 film.mkv"
            raise InputError(f"{self._name}: cannot be opened; {remedy}")
        if isinstance(where, int):
            width, height = size or SIZE
            for what, value in (
                (cv2.CAP_PROP_FOURCC, cv2.VideoWriter.fourcc(*FORMAT)),
                (cv2.CAP_PROP_FRAME_WIDTH, width),
                (cv2.CAP_PROP_FRAME_HEIGHT, height),
                (cv2.CAP_PROP_FPS, asked_fps or HIGHEST_FPS),
            ):
                with suppress(cv2.error):  # it gives what it has
                    capture.set(what, value)
        width, height = (
            int(capture.get(side)) for side in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT)
        )
        check_pixels(width, height, self._name)
        stated = capture.get(cv2.CAP_PROP_FPS)
        self.fps = float(stated) if 1 <= stated <= MAX_FPS else DEFAULT_FPS
        """Frames a second that it states, else `DEFAULT_FPS`."""
        rate = f"{stated:g} frames a second" if self.fps == stated else "at a rate not stated"
        print(f"{self._name}: {width}x{height}, {rate}", file=sys.stderr)

    def frames(self) -> Iterator[CameraFrame]:
        """Give the frames: of a live source the newest each time, of a file at an address all.

        Raises:
            InputError: there is none.
        """
        if self._capture.get(cv2.CAP_PROP_FRAME_COUNT) > 0:  # a file, which comes faster
            yield from self._all()
            return
        waiting, stopped = Newest[CameraFrame](), Event()
        thread = Thread(target=self._take, args=(waiting, stopped), daemon=True)
        thread.start()
        came = False
        try:
            for frame in waiting:
                came = True
                yield frame
        finally:
            stopped.set()
            thread.join(1.0)  # a camera that gives nothing more does not end it
        if not came:
            raise InputError(f"{self._name}: returns no frames; is another program using it?")
        print(f"warning: {self._name} returns no more frames; is it unplugged?", file=sys.stderr)

    def _take(self, waiting: Newest[CameraFrame], stopped: Event) -> None:
        """Take the frames as they come, in a thread of its own."""
        times, missed, number = CameraTimes(), 0, 0
        try:
            while missed < MISSES and not stopped.is_set():
                image = next_frame(self._capture)
                missed = missed + 1 if image is None else 0
                if image is not None:
                    stamp = self._capture.get(cv2.CAP_PROP_POS_MSEC) / 1000
                    time = times.take(stamp, perf_counter())
                    waiting.put(CameraFrame(image, time, f"frame {number}"))
                    number += 1
        finally:
            self._capture.release()
            waiting.close()

    def _all(self) -> Iterator[CameraFrame]:
        time, number = None, 0
        while (image := next_frame(self._capture)) is not None:
            stated = self._capture.get(cv2.CAP_PROP_POS_MSEC) / 1000
            time = time_after(stated, time, self.fps)
            yield CameraFrame(image, time, f"frame {number}")
            number += 1
        self._capture.release()
        if not number:
            raise InputError(f"{self._name}: holds no readable frame; check the address")


def _open(where: int | str) -> cv2.VideoCapture:
    if isinstance(where, int):
        return cv2.VideoCapture(where)
    limits = cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, cv2.CAP_PROP_READ_TIMEOUT_MSEC
    return cv2.VideoCapture(where, cv2.CAP_FFMPEG, [x for each in limits for x in (each, WAIT_MS)])
