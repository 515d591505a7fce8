"""Films without compression (.y4m), which the page reads and Chromium's fake camera plays."""

import io
from collections.abc import Iterable

import cv2
import numpy as np

from lab.films.y4m import Y4mFile


def limited(luma):
    """Squeeze luma to limited range: black is 16 and white 235."""
    return np.rint(16 + luma.astype(np.float64) * 219 / 255).astype(np.uint8)


def gray(image):
    """Luma of an RGB image as OpenCV has it; a gray one as it is."""
    return image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)


def y4m_bytes(frames: Iterable[np.ndarray], fps, chroma="420jpeg", tag="", times=None):
    """A film of gray frames (H, W) uint8, of which ``times`` states the times where it is given."""
    stream = io.BytesIO()
    film = Y4mFile(stream, fps, chroma, tag)
    for number, luma in enumerate(frames):
        film.write(luma, None if times is None else times[number])
    return stream.getvalue()
