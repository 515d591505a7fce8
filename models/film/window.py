"""What a window of film is to the film decoder: gray frames, half as large, and its arguments.

Needs no torch: a receiver prepares its frames by it.
"""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from link.errors import UnsuitedError
from link.images import as_rgb
from link.layout import Layout
from link.observation import Observation
from link.types import Image, Map
from models.phi.config import CHANNELS

SHRINK = 2
"""Number of pixels, along each axis, that are averaged before the decoder sees a frame."""
LEAST_SIDE = 16
"""Smallest number of rows, and of columns, of blocks that the decoder reads; it was trained on no
fewer."""
QUIET = np.array(CHANNELS["quiet"], np.float32)
"""(1, 3) weights of R, G and B that make gray with little noise of the camera."""


def reads_films(layout: Layout) -> bool:
    """Return whether the film decoder reads a layout; others are read by their frame pairs.

    >>> from link.presets import PRESETS
    >>> [name for name, preset in PRESETS.items() if reads_films(preset.layout)]
    ['hidden', 'fast', 'robust']
    """
    antipodal = layout.modulation == "antipodal"
    return bool(layout.pilots) and antipodal and min(layout.rows, layout.cols) >= LEAST_SIDE


def shrunk_gray(image: Image) -> Map:
    """Make gray of a rectified image, and average it over squares of `SHRINK` pixels.

    Args:
        image: an `Image`.

    Returns:
        (h, w) float32 gray levels.
    """
    height, width = image.shape[:2]
    small = cv2.resize(
        as_rgb(image).astype(np.float32),
        (width // SHRINK, height // SHRINK),
        interpolation=cv2.INTER_AREA,
    )
    return np.asarray(cv2.transform(small, QUIET), np.float32)


def gray_frames(observation: Observation) -> NDArray[np.float32]:
    """Give (T, h, w) gray levels of the frames; uint8 images are shrunk, others are so already."""
    return np.stack([_as_gray_frame(frame) for frame in observation.frames])


def _as_gray_frame(frame: Image | Map) -> Map:
    if frame.dtype == np.uint8:
        return shrunk_gray(np.asarray(frame, np.uint8))
    return np.asarray(frame, np.float32)


def film_inputs(observation: Observation) -> dict[str, NDArray[Any]]:
    """Give what the film decoder takes, by the names and in the order of its arguments.

    Raises:
        UnsuitedError: the layout is none that it reads.
    """
    if not reads_films(observation.layout):
        raise UnsuitedError(
            "it reads films of antipodal layouts with pilots and at least "
            f"{LEAST_SIDE} x {LEAST_SIDE} blocks"
        )
    mixture = observation.mixture
    return {
        "frames": gray_frames(observation)[:, None],
        "seen": observation.blocks_seen,
        "known": observation.known,
        "shares": mixture.shares,
        "pair": mixture.pair,
        "pairs": np.arange(mixture.count),
    }
