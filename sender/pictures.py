"""The pictures that carry the message: one image, a folder of images, or a video."""

import mimetypes
import sys
from collections.abc import Iterator
from functools import partial
from io import BytesIO
from itertools import chain, repeat
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageCms

from link.errors import InputError, ParameterError
from link.images import IMAGE_SUFFIXES, image_files
from link.images.files import Picture, is_picture, read_picture
from link.images.video import VideoReader
from link.loop import Pictures
from link.outside import is_file

MAX_SECONDS = 3600.0
"""Longest time for which an image of a folder may stay."""
SAME_TIME = 1e-3
"""Share of a state's time by which a frame may be late and still be shown by it."""
COARSE = 2.0
"""Factor of enlargement from which on a picture's own pixels are seen, so that it is worth a note.
"""


def is_film(source: Path) -> bool:
    """Tell whether what `open_pictures` opens is a video, which has a picture for each state.

    A file whose name does not say so is a picture where its first bytes are those of one.
    """
    if source.is_dir() or source.suffix.lower() in IMAGE_SUFFIXES:
        return False
    kind, _ = mimetypes.guess_type(source.name)
    if source.suffix and not (kind or "").startswith("image/"):
        return True
    return not is_picture(source)


def open_pictures(
    source: Path,
    state_hz: float,
    seconds: float | None = None,
) -> Pictures:
    """Open an image, a folder of images, or a video, whichever ``source`` is.

    An image is one picture, and a folder gives its images by name, one for each frame pair, or for
    all frame pairs of some seconds. A video gives a picture for each state: the frame that it shows
    at the state's time, so that it keeps its speed.

    Args:
        source: image file, folder of images (other files in it are passed over), or video file.
        state_hz: states shown in a second.
        seconds: time for which each image of a folder stays; None for one frame pair.

    Raises:
        InputError: nothing there, or nothing readable; also later, when the stream gets there.
    """
    noted: set[Path] = set()

    def read(path: Path) -> NDArray[np.uint8]:
        picture = read_picture(path)
        if picture.see_through and not noted:
            print(f"note: {path}: what is transparent is shown as white", file=sys.stderr)
            noted.add(path)
        return as_srgb(path, picture)

    if not source.is_dir() and not is_file(source):
        raise InputError(f"{source}: no such image, folder or video; check the path")
    if seconds is not None and not (source.is_dir() and 2 / state_hz <= seconds <= MAX_SECONDS):
        raise ParameterError(
            "seconds",
            f"need a folder of images, and a frame pair to {MAX_SECONDS:g} s, got {seconds:g}",
        )
    if not is_film(source):
        first, *others = image_files(source) if source.is_dir() else [source]
        picture = read(first)  # once, however often it is shown
        pairs = 1 if seconds is None else round(seconds * state_hz / 2)
        return lambda: chain.from_iterable(
            repeat(each, pairs) for each in chain([picture], map(read, others))
        )
    VideoReader(source)  # refuses what is no video
    return partial(_in_time, source, state_hz)


def as_srgb(path: Path, picture: Picture) -> NDArray[np.uint8]:
    """Convert a picture from the colours of the profile in its file, such as Display P3, to sRGB.

    Args:
        path: the picture's file.
        picture: what it holds.

    Returns:
        (H, W, 3) uint8, encoded sRGB: the picture as it is where its file has no profile, or that
        of sRGB. A profile that is damaged, or is not for RGB, counts as none, and is told on
        stderr.
    """
    if not picture.profile:
        return picture.rgb
    try:
        profile = ImageCms.ImageCmsProfile(BytesIO(picture.profile))
        if profile.profile.xcolor_space.strip() == "GRAY":
            return picture.rgb
        if "sRGB" in (profile.profile.profile_description or ""):
            return picture.rgb
        shown = ImageCms.profileToProfile(
            Image.fromarray(picture.rgb), profile, ImageCms.createProfile("sRGB")
        )
    except (OSError, ValueError, ImageCms.PyCMSError):
        print(f"note: {path}: its colour profile cannot be used; taken as sRGB", file=sys.stderr)
        return picture.rgb
    return np.asarray(shown, np.uint8)


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


def _in_time(video: Path, state_hz: float) -> Iterator[NDArray[np.uint8]]:
    """Give the frame that is shown at the time of each state, for whole frame pairs."""
    reader = VideoReader(video)
    given, shown, begins = 0, None, 0.0
    for image, time in reader.whole_frames():
        if shown is None:
            shown, begins = image, time
        while given < (time - begins) * state_hz - SAME_TIME:
            yield shown
            given += 1
        shown, ends = image, time - begins + 1 / reader.rate
    while shown is not None and (given % 2 or given < ends * state_hz - SAME_TIME):
        yield shown
        given += 1
