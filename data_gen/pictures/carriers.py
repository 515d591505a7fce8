"""Films that carry messages in the simulation: scenes of the library, or a video file."""

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from data_gen.pictures.library import Picture
from data_gen.pictures.moving import SCENES, Film, moving_carrier
from link.errors import InputError
from link.images import fit_picture
from link.images.video import VideoReader
from link.outside import is_file

STILL, MOVING = "still", "moving"
"""Names of no film, and of a film of a scene that is drawn at random."""
MAX_FILM_BYTES = 2**30
"""Largest memory that the frames of a video file may take at the size at which they are shown."""


def check_carriers(name: str) -> None:
    """Raise an `InputError` unless `open_carrier` knows the name, or it is `STILL`."""
    if name not in (STILL, MOVING, *SCENES) and not is_file(Path(name)):
        known = ", ".join((STILL, MOVING, *SCENES))
        raise InputError(f"carriers: need a video file or one of {known}, got {name!r}")


class VideoCarrier:
    """A video file, cut and resized for a display, which is played over and over.

    Its frames are held in memory, as a simulated shutter looks back and forth in time.

    Raises:
        InputError: the file is no video that can be read, or its frames fill `MAX_FILM_BYTES`.
    """

    def __init__(self, path: Path, width: int, height: int) -> None:
        self.name = path.name
        reader = VideoReader(path)
        frames: list[NDArray[np.uint8]] = []
        times: list[float] = []
        for image, time in reader.whole_frames():
            if len(frames) * width * height * 3 > MAX_FILM_BYTES:
                raise InputError(f"{path}: the film is too long to simulate; cut it")
            frames.append(fit_picture(image, width, height))
            times.append(time)
        self._frames, self._begins = frames, np.array(times) - times[0]
        self._seconds = self._begins[-1] + 1 / reader.rate

    def __call__(self, time_s: float) -> NDArray[np.uint8]:
        """Give the frame that the file shows at a time in seconds."""
        at = np.searchsorted(self._begins, time_s % self._seconds + 1e-6, "right") - 1
        return self._frames[int(at)]


video_carrier = lru_cache(maxsize=2)(VideoCarrier)
"""Opens a video file once for each size: its path, and width and height in pixels."""


def open_carrier(
    name: str, pictures: Sequence[Picture], rng: np.random.Generator
) -> Film | VideoCarrier:
    """Open a video file, or draw a film of a scene.

    Either has a ``name``, and gives its picture, (H, W, 3) uint8, at a time in seconds, 0 or later.

    Args:
        name: `MOVING`, a scene of `SCENES`, or a video file.
        pictures: pictures of one split, over which scenes are drawn; films have their size.
        rng: source of every random draw.

    Raises:
        InputError: there is no such scene or file, or the file is no video that is read.
    """
    check_carriers(name)
    if name == MOVING:
        name = str(rng.choice(list(SCENES)))
    if name in SCENES:
        return moving_carrier(name, pictures, rng)
    height, width = pictures[0].rgb.shape[:2]
    return video_carrier(Path(name), width, height)
