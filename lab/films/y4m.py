r"""Gray films without compression (.y4m), as Chromium's simulated camera plays them.

A film is a line that describes it, then for each frame the line "FRAME" and its planes, luma first.
"""

import re
from collections.abc import Iterable, Iterator
from os import SEEK_CUR
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from link.errors import InputError

GRAY = 128
"""Level of both chroma planes where the picture is gray."""
MAX_LINE_BYTES = 4096
"""Largest number of bytes in the first line of a film."""
FRAME = b"FRAME\n"
"""Line before each frame."""


def chroma_bytes(width: int, height: int) -> int:
    """Bytes of both chroma planes of a frame, whose samples two columns and two rows share."""
    return 2 * -(-width // 2) * -(-height // 2)


def write_y4m(stream: BinaryIO, frames: Iterable[NDArray[np.uint8]], fps: float) -> None:
    r"""Write a film of at least one frame.

    >>> from io import BytesIO
    >>> write_y4m(stream := BytesIO(), [np.zeros((2, 2), np.uint8)], fps=25)
    >>> stream.getvalue()
    b'YUV4MPEG2 W2 H2 F25000:1000 Ip A1:1 C420jpeg\nFRAME\n\x00\x00\x00\x00\x80\x80'

    Args:
        stream: takes the bytes; who opened it closes it.
        frames: (H, W) uint8 luma, all of one size.
        fps: frames a second.
    """
    for number, gray in enumerate(frames):
        height, width = gray.shape
        if number == 0:
            rate = f"{round(1000 * fps)}:1000"
            stream.write(f"YUV4MPEG2 W{width} H{height} F{rate} Ip A1:1 C420jpeg\n".encode())
        stream.write(FRAME + gray.tobytes() + bytes([GRAY]) * chroma_bytes(width, height))


def read_y4m(path: Path) -> Iterator[NDArray[np.uint8]]:
    """Give the frames, (H, W) uint8 luma, of a film that `write_y4m` wrote.

    Raises:
        InputError: the file is no such film.
    """
    with path.open("rb") as stream:
        first = stream.readline(MAX_LINE_BYTES).decode(errors="replace")
        said = re.fullmatch(r"YUV4MPEG2 W(\d+) H(\d+) .* C420jpeg\n", first)
        if said is None:
            raise InputError(f"{path}: no film that this program wrote")
        width, height = map(int, said.groups())
        while stream.read(len(FRAME)) == FRAME:
            luma = stream.read(width * height)
            stream.seek(chroma_bytes(width, height), SEEK_CUR)
            if len(luma) < width * height:
                return
            yield np.frombuffer(luma, np.uint8).reshape(height, width)
