"""Films without compression (.y4m), which the page reads and Chromium's simulated camera plays."""

from collections.abc import Iterator
from os import SEEK_CUR
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from link.errors import InputError

CHROMA = {"mono": (0, 0), "420jpeg": (2, 2), "422": (2, 1), "444": (1, 1)}
"""Number of columns and of rows of pixels that share a chroma sample, by the name of the format; 0
where there is no chroma."""
GRAY = 128
"""Level of both chroma planes where the picture is gray."""
MAX_LINE_BYTES = 4096
"""Largest number of bytes in a line of a film."""


class Y4mFile:
    r"""A film of gray frames without compression, written frame by frame.

    >>> from io import BytesIO
    >>> film = Y4mFile(stream := BytesIO(), fps=25, chroma="420jpeg")
    >>> film.write(np.zeros((2, 2), np.uint8))
    >>> stream.getvalue()
    b'YUV4MPEG2 W2 H2 F25000:1000 Ip A1:1 C420jpeg\nFRAME\n\x00\x00\x00\x00\x80\x80'

    Args:
        stream: takes the bytes; who opened it closes it.
        fps: frames a second.
        chroma: name of the format, a key of `CHROMA`. Chromium's simulated camera plays "420jpeg".
        tag: more words at the end of the first line.
    """

    def __init__(self, stream: BinaryIO, fps: float, chroma: str = "mono", tag: str = "") -> None:
        self._stream = stream
        self._rate = f"F{round(1000 * fps)}:1000"
        self._chroma = chroma
        self._tag = tag
        self._begun = False

    def write(self, gray: NDArray[np.uint8], time: float | None = None) -> None:
        """Append a frame.

        Args:
            gray: (H, W) uint8 luma.
            time: time of the frame, in seconds, which the page takes for its own. Without it, the
                frame's number and the rate say when it is shown. Chromium's simulated camera plays
                only films without times.
        """
        height, width = gray.shape
        if not self._begun:
            line = f"YUV4MPEG2 W{width} H{height} {self._rate} Ip A1:1 C{self._chroma} {self._tag}"
            self._stream.write(f"{line.rstrip()}\n".encode())
            self._begun = True
        stated = "" if time is None else f" XTIME={time:.6f}"
        self._stream.write(f"FRAME{stated}\n".encode())
        self._stream.write(gray.tobytes())
        across, down = CHROMA[self._chroma]
        if across:
            self._stream.write(bytes([GRAY]) * (2 * -(-width // across) * -(-height // down)))


def read_y4m(path: Path) -> Iterator[NDArray[np.uint8]]:
    """Give the frames, (H, W) uint8 luma, of a film that `Y4mFile` wrote.

    Raises:
        InputError: the file is no such film.
    """
    with path.open("rb") as stream:
        words = stream.readline(MAX_LINE_BYTES).decode(errors="replace").split()
        stated = {word[0]: word[1:] for word in words[1:]}
        try:
            width, height = int(stated["W"]), int(stated["H"])
            across, down = CHROMA[stated["C"]]
        except (KeyError, ValueError):
            raise InputError(f"{path}: no film that this program wrote") from None
        chroma = 2 * -(-width // across) * -(-height // down) if across else 0
        while stream.readline(MAX_LINE_BYTES).startswith(b"FRAME"):
            luma = stream.read(width * height)
            stream.seek(chroma, SEEK_CUR)
            if len(luma) < width * height:
                return
            yield np.frombuffer(luma, np.uint8).reshape(height, width)
