"""A small camera stream with exact timing: rows, shutter and clock; no noise model but Gaussian.

And films of any images in files.
"""

import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from link.code.framing import encode
from link.embed import embed
from link.geometry import frame_corners, homography_from_corners
from link.layout import Layout, make_layout
from link.types import Array, Image
from receiver.seen import SeenFrame

PATCHES = make_layout()


def states_of(
    message: bytes, layout: Layout, rng: np.random.Generator, kappa: int = 4
) -> list[Image]:
    """Display states of a loop over one smooth random picture."""
    coarse = rng.integers(30, 220, (6, 8, 3)).astype(np.uint8)
    picture = cv2.resize(coarse, (layout.width, layout.height), interpolation=cv2.INTER_CUBIC)
    pairs = [embed(picture, bits, layout, kappa) for bits in encode(message, layout.n_bits)]
    return [frame for pair in pairs for frame in (pair.original, pair.embedded)]


@dataclass(frozen=True)
class Stream:
    """Camera and display clocks, and the pose."""

    state_hz: float = 15.0
    fps: float = 30.0
    readout: float = 0.01
    shutter: float = 1 / 64
    phase: float = 0.37
    """Of the display when the camera starts, in states."""
    turn: int = 0
    """Quarter turns of the camera."""
    noise: float = 1.0
    size: tuple[int, int] = (640, 480)

    def corners(self, time: float) -> Array:
        """(4, 2) of a display that drifts by a few pixels a second."""
        width, height = self.size
        sides = np.array([[0.2, 0.18], [0.83, 0.14], [0.8, 0.84], [0.22, 0.8]]) * [width, height]
        sides += 4 * np.sin(1.3 * time + np.arange(8).reshape(4, 2) / 9)
        return np.roll(sides, self.turn, axis=0)

    def frames(
        self, states: list[Image], seconds: float, rng: np.random.Generator
    ) -> Iterator[tuple[float, Image, Array]]:
        """Time, RGB image and true corners of each camera frame."""
        width, height = self.size
        room = cv2.GaussianBlur(rng.random((height, width, 3), np.float32), (0, 0), 6) * 0.4
        noise = self.noise * rng.standard_normal((2 * height, 2 * width, 3), np.float32)
        light = [(state / np.float32(255)) ** np.float32(2.2) for state in states]
        rows = np.arange(height) / height
        for number in range(int(seconds * self.fps)):
            time = number / self.fps
            corners = self.corners(time)
            layout_height, layout_width = states[0].shape[:2]
            H = homography_from_corners(corners, layout_width, layout_height)
            begin = (time + rows * self.readout) * self.state_hz + self.phase
            end = begin + self.shutter * self.state_hz
            image = room.copy()
            inside = cv2.warpPerspective(np.ones((layout_height, layout_width)), H, self.size)
            image *= 1 - np.asarray(inside, np.float32)[:, :, None]
            for state in range(int(begin.min()), int(end.max()) + 1):
                share = np.clip(np.minimum(end, state + 1) - np.maximum(begin, state), 0, None)
                share = (share / (end - begin)).astype(np.float32)[:, None, None]
                if share.max() > 0:
                    shown = light[state % len(light)]
                    image += share * cv2.warpPerspective(shown, H, self.size)
            encoded = 235 * cv2.pow(np.clip(image, 0, 1), 1 / 2.2)
            top, left = rng.integers(0, (height, width))  # a frame takes a part of the noise
            encoded += noise[top : top + height, left : left + width]
            yield time, np.clip(encoded + 0.5, 0, 255).astype(np.uint8), corners


def write_film(path: Path, images: Iterable[Image], fps: float = 30.0, codec: str = "MJPG") -> Path:
    """A film of gray or RGB images in a file, by a codec that OpenCV writes."""
    writer = None
    for image in images:
        height, width = image.shape[:2]
        writer = writer or cv2.VideoWriter(
            str(path), cv2.VideoWriter.fourcc(*codec), fps, (width, height)
        )
        order = cv2.COLOR_GRAY2BGR if image.ndim == 2 else cv2.COLOR_RGB2BGR
        writer.write(cv2.cvtColor(image, order))
    assert writer is not None
    writer.release()
    return path


def seen_frame(
    time: float,
    rectified: Image,
    in_view: NDArray[np.bool_] | None = None,
    layout: Layout = PATCHES,
) -> SeenFrame:
    """A frame with a display at some time, which shows an image there."""
    return SeenFrame(layout, time, frame_corners(640, 480), rectified, in_view)


def events_of(text: str) -> list[dict[str, Any]]:
    """What the receiver's command printed."""
    return [json.loads(line) for line in text.splitlines()]
