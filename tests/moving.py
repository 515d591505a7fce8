"""Films that tests show: small, and never the same from picture to picture."""

from fractions import Fraction
from pathlib import Path

import av
import numpy as np

FRAMES, RATE = 12, 6
QUICKLY = {"deadline": "realtime", "cpu-used": "8"}


def write_moving(file: Path, width: int, height: int) -> Path:
    """Write a film of shapes and noise that move, from black to white."""
    rng = np.random.default_rng(0)
    ramp = np.linspace(0, 255, width)[None, :, None]
    with av.open(file, "w") as out:
        stream = out.add_stream("libvpx", RATE, options=QUICKLY)
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        stream.bit_rate = 4_000_000
        for number in range(FRAMES):
            image = np.roll(np.broadcast_to(ramp, (height, width, 3)), 9 * number, axis=1).copy()
            image[: height // 2] += rng.normal(0, 40, (height // 2, width, 3))
            image[:, : width // 4] = 20 * number, 255 - 20 * number, 128
            levels = np.clip(image, 0, 255).astype(np.uint8)
            frame = av.VideoFrame.from_ndarray(levels, "rgb24")
            frame.pts, frame.time_base = number, Fraction(1, RATE)
            out.mux(stream.encode(frame))
        out.mux(stream.encode())
    return file
