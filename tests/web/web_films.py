"""Films without compression (.y4m), which the page reads and Chromium's fake camera plays."""

from collections.abc import Iterable

import cv2
import numpy as np

CHROMA = {"mono": 0, "420jpeg": 0.5, "422": 1, "444": 2}
"""Number of chroma samples a pixel, by the name of the format."""


def limited(luma):
    """Squeeze luma to limited range: black is 16 and white 235."""
    return np.rint(16 + luma.astype(np.float64) * 219 / 255).astype(np.uint8)


def gray(image):
    """Luma of an RGB image as OpenCV has it; a gray one as it is."""
    return image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)


def y4m_bytes(frames: Iterable[np.ndarray], fps, chroma="420jpeg", tag="", times=None):
    """A film of gray frames (H, W) uint8; ``tag`` ends its first line, chroma is gray."""
    parts = []
    for number, luma in enumerate(frames):
        height, width = luma.shape
        if not parts:
            rate = f"{round(1000 * fps)}:1000"
            line = f"YUV4MPEG2 W{width} H{height} F{rate} Ip A1:1 C{chroma} {tag}".strip()
            parts.append(f"{line}\n".encode())
        half = 2 * -(-width // 2) * -(-height // 2)
        samples = half if chroma.startswith("420") else int(CHROMA[chroma] * width * height)
        time = "" if times is None else f" XTIME={times[number]:.6f}"
        parts += [f"FRAME{time}\n".encode(), luma.tobytes(), bytes([128]) * samples]
    return b"".join(parts)
