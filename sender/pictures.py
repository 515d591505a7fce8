"""The pictures that carry the message: one image, a folder of images, or a video."""

import sys
from collections.abc import Iterator
from functools import partial
from itertools import chain
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from link.errors import InputError
from link.images import IMAGE_SUFFIXES, image_files, read_picture
from link.images.video import VideoReader, read_video
from link.loop import Pictures
from link.outside import is_file

COARSE = 2.0
"""Factor of enlargement from which on a picture's own pixels are seen, so that it is worth a note.
"""


def open_pictures(source: Path, pair_hz: float, max_megapixels: float | None = None) -> Pictures:
    """Open an image, a folder of images, or a video, whichever ``source`` is.

    A folder gives its images by name, a video the frame that it would show at the time of each
    frame pair, so that it keeps its speed.

    Args:
        source: image file, folder of images (other files in it are passed over), or video file.
        pair_hz: frame pairs shown in a second.
        max_megapixels: largest number of pixels, in millions, of an image or a video's frame; see
            `link.images.pixel_limit`.

    Raises:
        InputError: nothing there, or nothing readable; also later, when the stream gets there.
    """
    noted: set[Path] = set()

    def read(path: Path) -> NDArray[np.uint8]:
        picture, see_through = read_picture(path, max_megapixels)
        if see_through and not noted:
            print(f"note: {path}: what is transparent is shown as white", file=sys.stderr)
            noted.add(path)
        return picture

    if not source.is_dir() and not is_file(source):
        raise InputError(f"{source}: no such image, folder or video; check the path")
    if source.is_dir() or source.suffix.lower() in IMAGE_SUFFIXES:
        first, *others = image_files(source) if source.is_dir() else [source]
        picture = read(first)  # once, however often it is shown
        return lambda: chain([picture], map(read, others))
    fps = VideoReader(source, max_megapixels).fps
    return partial(_in_time, source, max_megapixels, 1.0 if fps is None else fps / pair_hz)


def note_coarse(given_size: tuple[int, int], shown_size: tuple[int, int]) -> None:
    """Say on stderr where a picture is shown much larger than it is; sizes are (width, height)."""
    factor = max(shown / given for shown, given in zip(shown_size, given_size, strict=True))
    if factor >= COARSE:
        given, shown = (f"{width}x{height}" for width, height in (given_size, shown_size))
        print(
            f"note: a picture of {given} is shown as {shown} pixels, and looks coarse; give a "
            "larger one",
            file=sys.stderr,
        )


def _in_time(video: Path, max_megapixels: float | None, step: float) -> Iterator[NDArray[np.uint8]]:
    """Give, of the frames 0, 1, 2, ..., the first at or after 0, step, 2 step, ..."""
    given = 0
    for number, frame in enumerate(read_video(video, max_megapixels)):
        while number >= given * step:
            given += 1
            yield frame
