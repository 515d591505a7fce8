"""Camera frames from a folder of images, a video file or a camera, one at a time."""

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from link.errors import InputError, ParameterError
from link.images import image_files, pixel_limit, read_image
from link.outside import is_file
from link.video import MAX_FPS, VideoReader, next_frame

DEFAULT_FPS = 30.0
"""Frames a second of a source that states none."""
MAX_CAMERA_DIGITS = 4
"""Largest number of digits of a camera's number; a longer one is the name of a file."""
MISSES = 30
"""Number of empty frames in a row after which a camera is taken to be unplugged."""


@dataclass(frozen=True)
class CameraFrame:
    """One image of a camera that films the display."""

    image: NDArray[np.uint8]
    """(H, W, 3) uint8, encoded RGB."""
    time: float
    """Seconds since the first frame."""
    name: str
    """Name of the image's file, or the frame's number in words."""


@dataclass(frozen=True)
class FrameSource:
    """Where camera frames come from."""

    frames: Iterator[CameraFrame]
    """The frames, in order; they can be taken once."""
    fps: float
    """Nominal number of frames a second."""


def open_source(
    name: str, fps: float | None = None, max_megapixels: float | None = None
) -> FrameSource:
    """Open a folder of images, a video file, or a camera by its number.

    Args:
        name: path, or a whole number for a camera.
        fps: frames a second, where the source does not know it or is wrong.
        max_megapixels: largest number of pixels, in millions, of an image or a video's frame; see
            `link.images.pixel_limit`.

    Raises:
        InputError: nothing there, or nothing readable in it; also later, from ``frames``.
    """
    if fps is not None and not 0 < fps <= MAX_FPS:
        raise ParameterError(
            "fps", f"need more than 0 and at most {MAX_FPS:g} frames a second, got {fps:g}"
        )
    pixel_limit(max_megapixels)  # a wrong limit is no error of each image
    if name.isascii() and name.isdigit() and len(name) <= MAX_CAMERA_DIGITS:
        return _camera(int(name), fps)
    path = Path(name)
    if path.is_dir():
        return _folder(path, fps, max_megapixels)
    if not is_file(path):
        raise InputError(f"{path}: no such folder, video file or camera number")
    return _video(path, fps, max_megapixels)


def _folder(path: Path, fps: float | None, max_megapixels: float | None) -> FrameSource:
    files = image_files(path)
    rate = fps or DEFAULT_FPS

    def frames() -> Iterator[CameraFrame]:
        for number, file in enumerate(files):
            try:
                image = read_image(file, max_megapixels)
            except InputError as error:
                print(f"skipped: {error}", file=sys.stderr)
                continue
            yield CameraFrame(image, number / rate, file.name)

    return FrameSource(frames(), rate)


def _video(path: Path, fps: float | None, max_megapixels: float | None) -> FrameSource:
    reader = VideoReader(path, max_megapixels)
    rate = fps or reader.fps or DEFAULT_FPS

    def frames() -> Iterator[CameraFrame]:
        for number, image in enumerate(reader.frames()):
            yield CameraFrame(image, number / rate, f"frame {number}")
        if reader.broken_off is not None:  # what there is may hold the message
            print(f"warning: {reader.broken_off}", file=sys.stderr)

    return FrameSource(frames(), rate)


def _camera(index: int, fps: float | None) -> FrameSource:
    try:
        capture = cv2.VideoCapture(index)
    except cv2.error:
        capture = None
    if capture is None or not capture.isOpened():
        raise InputError(f"camera {index}: cannot be opened; is it plugged in and free?")
    stated = capture.get(cv2.CAP_PROP_FPS)
    rate = fps or (stated if 1 <= stated <= MAX_FPS else DEFAULT_FPS)

    def frames() -> Iterator[CameraFrame]:
        start, number, missed = cv2.getTickCount(), 0, 0
        while missed < MISSES:
            image = next_frame(capture)
            if image is None:
                missed += 1
                continue
            missed = 0
            seconds = (cv2.getTickCount() - start) / cv2.getTickFrequency()
            yield CameraFrame(image, seconds, f"frame {number}")
            number += 1
        capture.release()
        raise InputError(f"camera {index}: returns no more frames; is it unplugged?")

    return FrameSource(frames(), rate)
