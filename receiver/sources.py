"""Camera frames from a folder of images, a video file, a camera or a stream, one at a time.

Frames may be missing, so a frame's time is not its place in the order. A video says when each of
its frames is shown, a folder's names say the number of each image, and a camera stamps
its frames, or they are timed as they come (`receiver.cameras`).
"""

import os
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from link.errors import InputError
from link.images import IMAGE_SUFFIXES, image_files, pixel_limit
from link.images.files import read_image
from link.images.video import DEFAULT_FPS, VideoReader, check_fps
from link.outside import is_file
from receiver.cameras import SCHEMES, Camera, CameraFrame

MAX_NUMBER_DIGITS = 15
"""Largest number of digits of a file's name that count as the frame's number."""
FPS_HELP = (
    "camera frames a second: of a folder of images, whose names number the frames (else "
    f"{DEFAULT_FPS:g}), or in place of a video's own times where these are wrong, as in slow motion"
)
"""Help of the flag --fps."""
MAX_CAMERA_DIGITS = 4
"""Largest number of digits of a camera's number; a longer one is the name of a file."""
DEVICE = re.compile(r"/dev/video([0-9]{1,4})")
"""Path of a camera's device, with its number."""
ADDRESS = re.compile(r"([a-z][a-z0-9+.-]*)://.+", re.IGNORECASE)
"""Address of a stream, with its scheme."""


@dataclass(frozen=True)
class FrameSource:
    """A source of camera frames."""

    frames: Iterator[CameraFrame]
    """The frames, in order; they can be taken once."""
    fps: float
    """Nominal number of frames a second."""
    live: bool = False
    """Whether they come from a camera or a stream, so that none comes twice."""


def open_source(
    name: str,
    fps: float | None = None,
    camera_size: tuple[int, int] | None = None,
    camera_fps: float | None = None,
) -> FrameSource:
    """Open a folder of images, a video file, a camera by its number or device, or a stream.

    Args:
        name: path, a whole number for a camera, a device such as /dev/video0, or the address of a
            stream, such as rtsp://host/path.
        fps: frames a second of the camera. A folder's frames have their numbers' times at this rate
            in place of `link.images.video.DEFAULT_FPS`; a video's frames follow one another evenly
            at this rate, whatever times the file states; of a camera it is the nominal rate.
        camera_size: width and height for which a camera is asked, pixels.
        camera_fps: frames a second for which a camera is asked.

    Raises:
        InputError: nothing there, or nothing readable in it; also later, from ``frames``.
    """
    for flag, rate in (("fps", fps), ("camera_fps", camera_fps)):
        if rate is not None:
            check_fps(rate, flag)
    pixel_limit()  # a wrong limit is no error of each image
    device = DEVICE.fullmatch(os.path.realpath(name)) if name.startswith("/dev/") else None
    number = device[1] if device else name
    numbered = number.isascii() and number.isdigit() and len(number) <= MAX_CAMERA_DIGITS
    address = ADDRESS.fullmatch(name)
    if numbered or (address is not None and address[1].lower() in SCHEMES):
        camera = Camera(int(number) if numbered else name, camera_size, camera_fps)
        return FrameSource(camera.frames(), fps or camera.fps, live=True)
    path = Path(name)
    if path.is_dir():
        return _folder(path, fps)
    if name == "-" or (path.exists() and not is_file(path)):
        raise InputError(
            f"{name}: pipes and devices are not read; write the film to a file, and give its path"
        )
    if not is_file(path):
        streams = f", or stream ({', '.join(SCHEMES)})" if address else ""
        raise InputError(f"{name}: no such folder, video file, camera number or device{streams}")
    if path.suffix.lower() in IMAGE_SUFFIXES:
        raise InputError(
            f"{name}: one image is no film; give both images of a frame pair, or a film"
        )
    return _video(path, fps)


def number_frames(files: list[Path]) -> list[tuple[int, Path]]:
    """Find the number of each image of a folder in its name, so that gaps stay gaps in time.

    The number is the last run of digits of the name without its suffix. Where a name has none, or
    the numbers do not rise, the files are numbered in the order of their names instead.

    Args:
        files: sorted by name.

    Returns:
        the number, counted from the first file's, and the path of each file, in rising order.

    >>> named = number_frames([Path("x_10.png"), Path("x_12.png"), Path("x_9.png")])
    >>> [(number, path.name) for number, path in named]
    [(0, 'x_9.png'), (1, 'x_10.png'), (3, 'x_12.png')]
    >>> [number for number, _ in number_frames([Path("first.png"), Path("second.png")])]
    [0, 1]
    """
    found = [re.fullmatch(r"(.*?)([0-9]+)([^0-9]*)", file.stem, re.DOTALL) for file in files]
    parts = [match.groups() for match in found if match is not None]
    plain = list(enumerate(files))
    if len(parts) < len(files) or max(len(digits) for _, digits, _ in parts) > MAX_NUMBER_DIGITS:
        return plain
    numbered = [(int(digits), file) for (_, digits, _), file in zip(parts, files, strict=True)]
    if len({(before, after) for before, _, after in parts}) == 1:
        numbered.sort()  # 9 comes before 10, whatever the order of their names
    numbers = [number for number, _ in numbered]
    if any(number <= before for before, number in pairwise(numbers)):
        return plain
    return [(number - numbers[0], file) for number, file in numbered]


def _folder(path: Path, fps: float | None) -> FrameSource:
    files = number_frames(image_files(path))
    rate = fps or DEFAULT_FPS

    def frames() -> Iterator[CameraFrame]:
        for number, file in files:
            try:
                image = read_image(file)
            except InputError as error:
                print(f"skipped: {error}", file=sys.stderr)
                continue
            yield CameraFrame(image, number / rate, file.name)

    return FrameSource(frames(), rate)


def _video(path: Path, fps: float | None) -> FrameSource:
    reader = VideoReader(path)

    def frames() -> Iterator[CameraFrame]:
        start: float | None = None
        for number, (image, stated) in enumerate(reader.timed_frames()):
            start = stated if start is None else start
            time = stated - start if fps is None else number / fps
            yield CameraFrame(image, time, f"frame {number}")
        if reader.broken_off is not None:  # what there is may hold the message
            print(f"warning: {reader.broken_off}", file=sys.stderr)

    return FrameSource(frames(), fps or reader.rate)
