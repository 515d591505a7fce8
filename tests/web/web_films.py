"""Films of gray frames that the page reads, and their luma."""

from collections.abc import Iterable, Sequence
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np


def limited(luma):
    """Squeeze luma to limited range: black is 16 and white 235."""
    return np.rint(16 + luma.astype(np.float64) * 219 / 255).astype(np.uint8)


def gray(image):
    """Luma of an RGB image as OpenCV has it; a gray one as it is."""
    return image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)


CODECS = {
    ".mp4": ("libx264", {"crf": "18"}),
    ".webm": ("libvpx", {"crf": "8"}),
    ".mkv": ("libx264", {"crf": "4", "preset": "ultrafast"}),
}
"""Codec and its options by the ending of a film's name; .mkv loses next to nothing."""


def write_film(film: Path, frames: Sequence[np.ndarray], fps=30) -> None:
    """Compress gray frames (H, W) uint8 in full range, as the ending of the film's name says."""
    codec, options = CODECS[film.suffix]
    with av.open(film, "w") as container:
        stream = container.add_stream(codec, rate=Fraction(fps), options=options)
        stream.pix_fmt, stream.bit_rate = "yuv420p", 8_000_000
        stream.codec_context.color_range = av.video.reformatter.ColorRange.JPEG
        stream.height, stream.width = frames[0].shape
        for luma in frames:
            frame = av.VideoFrame.from_ndarray(in_three_planes(luma), "yuv420p")
            frame.color_range = av.video.reformatter.ColorRange.JPEG
            container.mux(stream.encode(frame))
        container.mux(stream.encode())


def in_three_planes(luma):
    """Luma, and below it chroma of no colour, as PyAV takes them."""
    height, width = luma.shape
    return np.vstack([luma, np.full((height // 2, width), 128, np.uint8)])


def write_y4m(film: Path, frames: Iterable[np.ndarray], fps: int = 30) -> None:
    """Write gray frames (H, W) uint8 without compression, as Chromium's simulated camera plays."""
    with film.open("wb") as stream:
        for number, luma in enumerate(frames):
            height, width = luma.shape
            if number == 0:
                head = f"YUV4MPEG2 W{width} H{height} F{fps}:1 Ip A1:1 C420jpeg\n"
                stream.write(head.encode())
            chroma = 2 * -(-width // 2) * -(-height // 2)  # a sample is shared by 2 x 2 pixels
            stream.write(b"FRAME\n" + luma.tobytes() + bytes([128]) * chroma)
