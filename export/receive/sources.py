"""Camera frames from a folder of images, a video file or a camera, one at a time."""

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from link.errors import InputError
from link.images import read_image

IMAGES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp")
DEFAULT_FPS = 30.0
MISSES = 30
"""A camera that returns so many empty frames in a row is taken to be unplugged."""


@dataclass(frozen=True)
class Frame:
    """A camera frame."""

    image: NDArray[np.uint8]
    """(H, W, 3) uint8, encoded, RGB."""
    time: float
    """Seconds since the first frame."""
    name: str


@dataclass(frozen=True)
class Source:
    """Where frames come from; iterate over `frames` once."""

    frames: Iterator[Frame]
    fps: float
    """Nominal, frames a second."""
    total: int | None
    """Frames, where known."""


def open_source(name: str, fps: float | None = None) -> Source:
    """Open a folder of images, a video file, or a camera by its number.

    Args:
        name: path, or a whole number for a camera.
        fps: frames a second, where the source does not know it or is wrong.

    Raises:
        InputError: nothing there, or nothing readable in it.
    """
    if fps is not None and not 0 < fps <= 1000:
        raise InputError(f"--fps: need more than 0 and at most 1000 frames a second, got {fps:g}")
    if name.isdigit():
        return _camera(int(name), fps)
    path = Path(name)
    if path.is_dir():
        return _folder(path, fps)
    if not path.is_file():
        raise InputError(f"{path}: no such folder, video file or camera number")
    return _video(path, fps)


def _folder(path: Path, fps: float | None) -> Source:
    files = sorted(
        file
        for file in path.iterdir()
        if file.suffix.lower() in IMAGES and not file.name.startswith(".")
    )
    if not files:
        raise InputError(f"{path}: no image in this folder; looked for {', '.join(IMAGES)}")
    rate = fps or DEFAULT_FPS

    def frames() -> Iterator[Frame]:
        for number, file in enumerate(files):
            try:
                image = read_image(file)
            except InputError as error:
                print(f"skipped: {error}", file=sys.stderr)
                continue
            yield Frame(image, number / rate, file.name)

    return Source(frames(), rate, len(files))


def _open(source: str | int) -> cv2.VideoCapture | None:
    try:
        capture = cv2.VideoCapture(source)
    except cv2.error:
        return None
    return capture if capture.isOpened() else None


def _read(capture: cv2.VideoCapture) -> NDArray[np.uint8] | None:
    try:
        ok, image = capture.read()
    except cv2.error:
        return None
    if not ok or image is None or image.ndim not in (2, 3):
        return None
    code = cv2.COLOR_GRAY2RGB if image.ndim == 2 else cv2.COLOR_BGR2RGB
    return np.asarray(cv2.cvtColor(image, code), np.uint8)


def _video(path: Path, fps: float | None) -> Source:
    capture = _open(str(path))
    if capture is None:
        raise InputError(f"{path}: not a readable video; give a folder of images or a video file")
    stated = capture.get(cv2.CAP_PROP_FPS)
    rate = fps or (stated if 1 <= stated <= 1000 else DEFAULT_FPS)
    total = int(capture.get(cv2.CAP_PROP_FRAME_COUNT))

    def frames() -> Iterator[Frame]:
        number = 0
        while (image := _read(capture)) is not None:
            yield Frame(image, number / rate, f"frame {number}")
            number += 1
        capture.release()
        if number == 0:
            raise InputError(f"{path}: holds no readable frame; copy or record it again")
        if number < 0.98 * total - 1:
            text = f"{path}: ends after {number} of {total} frames; it is truncated or damaged"
            print(f"warning: {text}", file=sys.stderr)

    return Source(frames(), rate, total if total > 0 else None)


def _camera(index: int, fps: float | None) -> Source:
    capture = _open(index)
    if capture is None:
        raise InputError(f"camera {index}: cannot be opened; is it plugged in and free?")
    stated = capture.get(cv2.CAP_PROP_FPS)
    rate = fps or (stated if 1 <= stated <= 1000 else DEFAULT_FPS)

    def frames() -> Iterator[Frame]:
        start, number, missed = cv2.getTickCount(), 0, 0
        while missed < MISSES:
            image = _read(capture)
            if image is None:
                missed += 1
                continue
            missed = 0
            seconds = (cv2.getTickCount() - start) / cv2.getTickFrequency()
            yield Frame(image, seconds, f"frame {number}")
            number += 1
        capture.release()
        raise InputError(f"camera {index}: returns no more frames; is it unplugged?")

    return Source(frames(), rate, None)
