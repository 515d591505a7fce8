"""Video files: the one reader and the one writer of the project.

They are part of the contract because the sender reads and writes video, the film simulator writes
it, and the receiver reads it. `VideoReader` serves all who read. It gives the frames with the times
at which the file shows them, and tells afterwards whether the file broke off; its caller decides
whether that is an error (`read_video`, for the sender) or a warning (`receiver.sources`, for
the receiver).
"""

import contextlib
import math
import os
import zlib
from collections.abc import Iterable, Iterator
from functools import cached_property
from pathlib import Path
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from link.errors import InputError, ParameterError
from link.images import (
    check_kind,
    check_size,
    replaced,
)
from link.outside import is_file

LOSSLESS = "FFV1"
"""Code of the writer; of those in OpenCV's wheels it is the smallest that keeps every level."""
MIN_FPS, MAX_FPS = 0.1, 1000.0
"""Least and largest number of frames a second that a file is believed to have."""
SPACE_BYTES = 2**20
"""Space, in bytes, that a disk must have left beside a video that is not whole: with less, the disk
is to blame."""
SLACK_S = 0.5
"""Seconds that a stream may end before its file says: sound is often a little longer."""
DEFAULT_FPS = 30.0
"""Frames a second of a source that states none."""
PROBED_FRAMES = 31
"""Number of frames from whose times a file's rate is measured."""
SOUGHT_FRAMES = 1000
"""Largest number of frames that are passed over in search of a file's end."""
MAX_GAP_S = 60.0
"""Largest time from one frame of a file to the next that is believed, seconds."""
CONTAINERS = (
    "asf,av1,avi,flv,gif,h264,hevc,ivf,m4v,matroska,mov,mpeg,mpegts,mpegvideo,mxf,nut,obu,ogg,"
    "yuv4mpegpipe"
)
"""Kinds of files, by FFmpeg's names, that are read as videos: those that hold their frames. FFmpeg
also follows playlists, which name other files and addresses, waits for more of them, and takes
any text for a screen."""
START_OF_JPEG = b"\xff\xd8"
"""First bytes of a JPEG picture."""
PICTURES = "jpeg_pipe,mjpeg"
"""Kinds of files that are one JPEG picture after the other. They must begin with one: FFmpeg finds
pictures in the midst of documents, archives and photographs of other kinds, too."""
TO_RGB = {(): cv2.COLOR_GRAY2RGB, (3,): cv2.COLOR_BGR2RGB, (4,): cv2.COLOR_BGRA2RGB}
"""OpenCV's codes of how a frame becomes RGB, by its channels; frames that a camera gives as they
are, such as YUYV, are not read."""
OPEN_OPTIONS = "OPENCV_FFMPEG_CAPTURE_OPTIONS"
"""Name of the environment variable from which OpenCV takes options whenever it opens a video."""
# our one line says what is wrong; OpenCV asks for this when it first reads or writes a video
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")


def check_fps(fps: float, parameter: str = "fps") -> None:
    """Raise a `ParameterError` where a camera's number of frames a second is out of its range."""
    if not MIN_FPS <= fps <= MAX_FPS:
        raise ParameterError(
            parameter, f"need {MIN_FPS:g} to {MAX_FPS:g} frames a second, got {fps:g}"
        )


def time_after(stated: float, before: float | None, rate: float) -> float:
    """Say when a frame is shown, from the time that its file states.

    A file that states no times, or that states constant, falling or wild ones, so gets the times
    that it would have at its rate; where its times are lost for a while, they are taken up again
    as soon as they have caught up.

    Args:
        stated: time of the frame as the file states it, seconds; may be anything.
        before: time of the frame before, seconds, or None for the first frame.
        rate: frames a second of the file.

    Returns:
        ``stated`` where it is later than ``before``, by `MAX_GAP_S` at most; else one period of
        the rate after ``before``. A first frame without a time is shown at 0.

    >>> [round(time_after(stated, 1.0, rate=10.0), 3) for stated in (1.3, 1.0, 0.2, np.nan, 1e9)]
    [1.3, 1.1, 1.1, 1.1, 1.1]
    """
    if before is None:
        return stated if math.isfinite(stated) and abs(stated) <= MAX_GAP_S else 0.0
    later = math.isfinite(stated) and 0.5 / MAX_FPS <= stated - before <= MAX_GAP_S
    return stated if later else before + 1 / rate


class VideoReader:
    """Reads the frames of a video file, one at a time. They can be taken once.

    Args:
        path: path of the file.

    Raises:
        InputError: the file is missing, no video that OpenCV can read, a list of other files, or
            its frames have more pixels than `link.images.pixel_limit` allows, or are smaller than
            16 x 16.
    """

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        if not is_file(self.path):
            raise InputError(f"{path}: no such video file; check the path")
        with contextlib.suppress(OSError), self.path.open("rb") as file:
            check_kind(path, file.read(1000))
        self._video = _open_capture(self.path)
        if not self._video.isOpened():
            raise InputError(
                f"{path}: not a readable video, and no PNG, JPEG, TIFF, BMP or WebP file; it may "
                "be cut off, or of a kind that OpenCV cannot read"
            )
        width, height = (
            int(self._video.get(side))
            for side in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT)
        )
        check_size(width, height, path)
        fps = float(self._video.get(cv2.CAP_PROP_FPS))
        count = float(self._video.get(cv2.CAP_PROP_FRAME_COUNT))
        self._stated_s = count / fps if fps > 0 and count > 0 else 0.0
        self._slack_s = 2 / max(fps, 1.0) + SLACK_S
        self.fps = fps if MIN_FPS <= fps <= MAX_FPS else None
        """Frames a second as the file states them, or None where it states none."""
        self.broken_off: str | None = None
        """Time at which the video ended, in words, if that is earlier than the file states; None if
        it is not, or while the end has not been reached."""

    @cached_property
    def rate(self) -> float:
        """Frames a second that the times of the first frames tell, where missing frames count, too.

        Files state their average rate, which missing frames lower, or a rate of which all times are
        multiples. Where the times tell nothing, the stated rate counts, else `DEFAULT_FPS`.
        """
        gaps = np.diff(np.array(_times_of(self.path, PROBED_FRAMES)))
        if len(gaps) and np.isfinite(gaps).all() and (gaps >= 1 / MAX_FPS).all():
            frames = np.maximum(1, np.rint(gaps / np.median(gaps)))
            return float(frames.sum() / gaps.sum())
        return self.fps or DEFAULT_FPS

    def timed_frames(self) -> Iterator[tuple[NDArray[np.uint8], float]]:
        """Give the frames one at a time, each with its presentation time as `time_after` finds it.

        Frames are (H, W, 3) uint8, encoded RGB. Times are seconds from the file's beginning, and
        rise from frame to frame. After the last one, ``broken_off`` says whether some are missing.

        Raises:
            InputError: the file holds no frame that can be read.
        """
        count, time, end_s = 0, None, 0.0
        try:
            while (image := next_frame(self._video)) is not None:
                end_s = self._video.get(cv2.CAP_PROP_POS_MSEC) / 1000
                time = time_after(end_s, time, self.rate)
                count += 1
                yield image, time
        finally:
            self._video.release()
        if not count:
            raise InputError(f"{self.path}: holds no readable frame; copy or record it again")
        if end_s + self._slack_s < self._stated_s:
            self.broken_off = (
                f"{self.path}: the video breaks off after {count} frames, at {end_s:.1f} of "
                f"{self._stated_s:.1f} s; copy it again, or cut it there"
            )

    def whole_frames(self) -> Iterator[tuple[NDArray[np.uint8], float]]:
        """Give the frames as `timed_frames` does, of a video that must be whole.

        Raises:
            InputError: the file holds no frame that can be read, or ends before the time it states.
        """
        yield from self.timed_frames()
        if self.broken_off is not None:
            raise InputError(self.broken_off)

    def check_end(self) -> None:
        """Look at the end of the file alone, which costs little however long it is.

        Raises:
            InputError: the video ends before the time that the file states.
        """
        near_end_s = max(0.0, self._stated_s - self._slack_s)
        times = _times_of(self.path, SOUGHT_FRAMES, near_end_s)
        end_s = times[-1] if times else 0.0
        if len(times) < SOUGHT_FRAMES and end_s + self._slack_s < self._stated_s:
            raise InputError(
                f"{self.path}: the video breaks off before the {self._stated_s:.1f} s that it "
                "states; copy it again, or cut it there"
            )


def _times_of(path: Path, most: int, sought_s: float | None = None) -> list[float]:
    """Return the times, in seconds, of some frames of a video; none where OpenCV fails on one.

    The file is opened once more for this, as frames that are grabbed are gone.

    Args:
        path: the file.
        most: number of frames after which it ends.
        sought_s: time, in seconds, from the key frame before which on it begins; None for the
            first frame.
    """
    video = _open_capture(path)
    try:
        if sought_s is not None:
            video.set(cv2.CAP_PROP_POS_MSEC, 1000 * sought_s)
        times: list[float] = []
        while len(times) < most and video.grab():
            times.append(video.get(cv2.CAP_PROP_POS_MSEC) / 1000)
        return times
    except cv2.error:
        return []
    finally:
        video.release()


def _open_capture(path: Path) -> cv2.VideoCapture:
    """Open a video file that holds its own frames; the result may not be open."""
    usual = os.environ.get(OPEN_OPTIONS)
    kinds = CONTAINERS
    with contextlib.suppress(OSError), path.open("rb") as file:
        kinds += f",{PICTURES}" if file.read(2) == START_OF_JPEG else ""
    os.environ[OPEN_OPTIONS] = f"protocol_whitelist;file|format_whitelist;{kinds}"
    try:
        return cv2.VideoCapture(_as_file(path), cv2.CAP_FFMPEG)
    finally:
        if usual is None:
            del os.environ[OPEN_OPTIONS]
        else:
            os.environ[OPEN_OPTIONS] = usual


def _as_file(path: Path) -> str:
    """Name a file for FFmpeg, which takes what stands before a colon for a protocol.

    OpenCV crashes on text that is not UTF-8, but takes bytes in its place since 4.12.
    """
    name = os.path.abspath(path)
    try:
        name.encode()
    except UnicodeEncodeError:
        return cast(str, os.fsencode(name))
    return name


def next_frame(capture: cv2.VideoCapture) -> NDArray[np.uint8] | None:
    """Take the next frame of an open video or camera.

    Returns:
        (H, W, 3) uint8, encoded RGB, or None where there is none that can be read.
    """
    try:
        got, image = capture.read()
    except cv2.error:
        return None
    if not got or image is None or image.dtype != np.uint8 or image.shape[2:] not in TO_RGB:
        return None
    return np.asarray(cv2.cvtColor(image, TO_RGB[image.shape[2:]]), np.uint8)


def read_video(path: Path | str) -> Iterator[NDArray[np.uint8]]:
    """Give the frames of a whole video, one at a time, (H, W, 3) uint8, encoded RGB.

    Raises:
        InputError: no readable video, no frame in it, or it ends before the time it states.
    """
    for image, _ in VideoReader(path).whole_frames():
        yield image


def write_video(path: Path, frames: Iterable[NDArray[np.uint8]], fps: float) -> None:
    """Write frames without loss, and read them back to be sure.

    The video has its name only once it is whole; nothing else is left where that fails.

    Args:
        path: ends in .avi or .mkv.
        frames: (H, W, 3) uint8, encoded RGB, all of one size; width and height even.
        fps: frames per second.

    Raises:
        InputError: odd width or height, a full disk, or this OpenCV cannot write or read the file
            bit for bit.
    """
    writer, sums = None, []
    with replaced(path, path.suffix) as temporary:
        try:
            for frame in frames:
                height, width = frame.shape[:2]
                if writer is None:
                    writer = _open_writer(temporary, width, height, fps)
                writer.write(cv2.cvtColor(frame, cv2.COLOR_RGB2BGR))
                sums.append(zlib.crc32(frame.tobytes()))
        finally:
            if writer is not None:
                writer.release()
        if _sums_of(temporary) != sums:
            _try_space(temporary)
            raise InputError(
                f"{path.suffix}: the installed OpenCV does not give {LOSSLESS} video back bit for "
                "bit; write a folder of images or .html"
            )


def _try_space(path: Path) -> None:
    """Raise the system's error if a file cannot grow: OpenCV tells nobody that a disk is full."""
    with path.open("ab") as file:
        file.write(bytes(SPACE_BYTES))


def _sums_of(path: Path) -> list[int]:
    """Check sums of a video's frames, as far as it can be read."""
    try:
        return [zlib.crc32(frame.tobytes()) for frame in read_video(path)]
    except InputError:
        return []


def _open_writer(path: Path, width: int, height: int, fps: float) -> cv2.VideoWriter:
    if width % 2 or height % 2:
        raise InputError(
            f"{path.suffix}: OpenCV writes even widths and heights only, got {width}x{height}; "
            "change the width or height, or write a folder of images or .html"
        )
    if not (math.isfinite(fps) and 0 < fps <= MAX_FPS):
        raise InputError(f"{path.suffix}: need a rate from 0 to {MAX_FPS:g} frames/s, got {fps:g}")
    code = cv2.VideoWriter_fourcc(*LOSSLESS)  # type: ignore[attr-defined,unused-ignore]
    writer = cv2.VideoWriter(_as_file(path), cv2.CAP_FFMPEG, code, fps, (width, height))
    if not writer.isOpened():
        raise InputError(
            f"{path.suffix}: the installed OpenCV cannot write {LOSSLESS} video; "
            "write a folder of images or .html"
        )
    return writer
