"""Video files: reading as a stream, and writing without loss."""

import math
import os
import zlib
from collections.abc import Iterable, Iterator
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from link.errors import InputError

LOSSLESS = "FFV1"
"""Code of the writer; of those in OpenCV's wheels it is the smallest that keeps every level."""
MAX_FPS = 1000.0
SLACK_S = 0.5
"""Seconds that a stream may end before its file says: sound is often a little longer."""


def open_video(path: Path | str) -> cv2.VideoCapture:
    """Open a video file.

    Raises:
        InputError: the file is missing, or no video that OpenCV can read.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: no such video file; check the path")
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")  # our one line says what is wrong
    level = cv2.utils.logging.getLogLevel()
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        video = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
    finally:
        cv2.utils.logging.setLogLevel(level)
    if not video.isOpened():
        raise InputError(
            f"{path}: not a readable video; it may be cut off or of a kind that OpenCV cannot read"
        )
    return video


def frame_rate(path: Path | str) -> float | None:
    """Frames per second as the file states it, or None where it states none."""
    video = open_video(path)
    fps = float(video.get(cv2.CAP_PROP_FPS))
    video.release()
    return fps if 0 < fps <= MAX_FPS else None


def read_video(path: Path | str) -> Iterator[NDArray[np.uint8]]:
    """The frames of a video, one at a time, (H, W, 3) uint8, encoded RGB.

    Raises:
        InputError: no readable video, no frame in it, or it ends before the time it states.
    """
    video = open_video(path)
    try:
        fps, count = (video.get(p) for p in (cv2.CAP_PROP_FPS, cv2.CAP_PROP_FRAME_COUNT))
        frames, end_s = 0, 0.0
        while True:
            got, frame = video.read()
            if not got:
                break
            frames += 1
            end_s = video.get(cv2.CAP_PROP_POS_MSEC) / 1000
            yield np.asarray(cv2.cvtColor(frame, cv2.COLOR_BGR2RGB), np.uint8)
    finally:
        video.release()
    stated_s = count / fps if fps > 0 and count > 0 else 0.0
    if not frames or end_s + 2 / max(fps, 1.0) + SLACK_S < stated_s:
        raise InputError(
            f"{path}: the video breaks off after {frames} frames, at {end_s:.1f} of "
            f"{stated_s:.1f} s; copy it again, or cut it there"
        )


def write_video(path: Path, frames: Iterable[NDArray[np.uint8]], fps: float) -> None:
    """Write frames without loss, and read them back to be sure.

    Args:
        path: ends in .avi or .mkv.
        frames: (H, W, 3) uint8, encoded RGB, all of one size; width and height even.
        fps: frames per second.

    Raises:
        InputError: odd width or height, or this OpenCV cannot write or read the file bit for bit.
    """
    writer, sums = None, []
    for frame in frames:
        height, width = frame.shape[:2]
        if writer is None:
            writer = _open_writer(path, width, height, fps)
        writer.write(cv2.cvtColor(frame, cv2.COLOR_RGB2BGR))
        sums.append(zlib.crc32(frame.tobytes()))
    if writer is not None:
        writer.release()
    if [zlib.crc32(frame.tobytes()) for frame in read_video(path)] != sums:
        raise InputError(
            f"{path.suffix}: the installed OpenCV does not give {LOSSLESS} video back bit for bit; "
            "write a folder of images or .html"
        )


def _open_writer(path: Path, width: int, height: int, fps: float) -> cv2.VideoWriter:
    if width % 2 or height % 2:
        raise InputError(
            f"{path.suffix}: OpenCV writes even widths and heights only, got {width}x{height}; "
            "change --width, --height, or write a folder of images or .html"
        )
    if not (math.isfinite(fps) and 0 < fps <= MAX_FPS):
        raise InputError(f"{path.suffix}: need a rate from 0 to {MAX_FPS:g} frames/s, got {fps:g}")
    code = cv2.VideoWriter_fourcc(*LOSSLESS)  # type: ignore[attr-defined,unused-ignore]
    writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, code, fps, (width, height))
    if not writer.isOpened():
        raise InputError(
            f"{path.suffix}: the installed OpenCV cannot write {LOSSLESS} video; "
            "write a folder of images or .html"
        )
    return writer
