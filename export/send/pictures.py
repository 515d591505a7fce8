"""The pictures that carry the message: one image, a folder of images, or a video."""

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from link.errors import InputError
from link.images import read_image
from link.video import frame_rate, read_video

SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp")

Pictures = Callable[[], Iterator[NDArray[np.uint8]]]
"""Each call starts again from the first picture; (H, W, 3) uint8, encoded RGB."""


def fit(picture: NDArray[np.uint8], width: int, height: int) -> NDArray[np.uint8]:
    """Cut the largest centred window of the wanted aspect and resize it.

    Args:
        picture: (H, W, 3) or (H, W) uint8, encoded.
        width: of the result, px.
        height: of the result, px.

    Returns:
        (height, width, 3) or (height, width) uint8; averaged down (INTER_AREA) or bilinear up.
    """
    rows, cols = picture.shape[:2]
    scale = min(cols / width, rows / height)
    window_cols, window_rows = max(1, round(scale * width)), max(1, round(scale * height))
    left, top = (cols - window_cols) // 2, (rows - window_rows) // 2
    window = picture[top : top + window_rows, left : left + window_cols]
    how = cv2.INTER_AREA if scale >= 1 else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(window, (width, height), interpolation=how), np.uint8)


def open_pictures(source: Path, pair_hz: float) -> Pictures:
    """Choose by what ``source`` is.

    A folder gives its images by name, a video the frame that it would show at the time of each
    frame pair, so that it keeps its speed.

    Args:
        source: image file, folder of images (other files in it are passed over), or video file.
        pair_hz: frame pairs shown in a second.

    Raises:
        InputError: nothing there, or nothing readable; also later, when the stream gets there.
    """
    if source.is_dir():
        files = sorted(
            file
            for file in source.iterdir()
            if file.suffix.lower() in SUFFIXES and not file.name.startswith(".")
        )
        if not files:
            raise InputError(f"{source}: no image in this folder; looked for {', '.join(SUFFIXES)}")
        return partial(map, read_image, files)
    if not source.exists():
        raise InputError(f"{source}: no such image, folder or video; check the path")
    if source.suffix.lower() in SUFFIXES:
        picture = read_image(source)
        return lambda: iter([picture])
    fps = frame_rate(source)
    return partial(_in_time, source, 1.0 if fps is None else fps / pair_hz)


def _in_time(video: Path, step: float) -> Iterator[NDArray[np.uint8]]:
    """Of the frames 0, 1, 2, ... the first at or after 0, step, 2 step, ..."""
    given = 0
    for number, frame in enumerate(read_video(video)):
        while number >= given * step:
            given += 1
            yield frame
