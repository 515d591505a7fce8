"""Decode windows of film frames with numpy and onnxruntime: the graph of `models.film.decoder`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from export.runtime import OWN_TIME_LIMIT_S, load_session, run_session
from link.errors import InputError
from link.layout import Layout
from link.pilot_code import PLAIN, PilotCode
from link.types import Array, Map

LEAST_SIDE = 16
"""Smallest number of rows, and of columns, of blocks that the graph reads; it was trained on no
fewer."""
SHRINK = 2
"""Number of pixels, along each axis, that are averaged before the graph sees a frame."""
FILM_FORMAT = "film 2"
"""Version of the graph's inputs and outputs that this code reads."""


@dataclass(frozen=True)
class FilmWindow:
    """Successive frames of a display whose clock is known."""

    frames: Map
    """(T, 1, h, w) float32 gray levels in [0, 255] of the rectified display, shrunk."""
    seen: Map
    """(T, rows, cols) float32, 1 where a frame shows a block, else 0."""
    known: Map
    """(rows, cols) float32, -1 or 1 where a block is a pilot, else 0."""
    times: Array
    """(T,) float64 seconds."""
    clock: Array
    """(5,) float64 fields of `link.clock.DisplayClock`, seconds."""
    first: int
    """Number of the first frame pair of which a frame shows a part."""
    count: int
    """Number of frame pairs of which frames show a part."""
    code: PilotCode = PLAIN
    """Code of the order of each pair's states."""

    @property
    def inputs(self) -> dict[str, NDArray[Any]]:
        """What the graph and the module take, by the names and in the order of the inputs."""
        pairs = np.arange(self.first, self.first + self.count)
        named = {"frames": self.frames, "seen": self.seen, "known": self.known}
        order = self.code.signs[pairs % self.code.period].astype(np.float32)
        return {**named, "times": self.times, "clock": self.clock, "pairs": pairs, "order": order}


class FilmScorer(Protocol):
    """What a receiver asks of a decoder of films."""

    def prepare(self) -> None:
        """Get ready: windows will soon come."""
        ...

    def score(self, window: FilmWindow) -> Array:
        """Give (count, rows, cols) natural log-likelihood ratios of the blocks' bits."""
        ...


class FilmGraph:
    """The film decoder in an ONNX file; one serves all layouts that `reads_films` names.

    Args:
        path: file that `export.to_onnx` wrote.
        threads: number of threads of onnxruntime.

    Raises:
        InputError: the file is missing, damaged, or of another version.
    """

    def __init__(self, path: Path, threads: int = 2) -> None:
        self._session, metadata = load_session(path, threads, OWN_TIME_LIMIT_S)
        if metadata.get("format") != FILM_FORMAT:
            raise InputError(f"{path}: no film decoder of this version; export it again")

    def prepare(self) -> None:
        """Do nothing: the graph was loaded when it was opened."""

    def score(self, window: FilmWindow) -> Array:
        """Give the log-likelihood ratios of the bits of all pairs in a window.

        Returns:
            (count, rows, cols) natural log-likelihood ratios, positive for bit 1.

        Raises:
            InputError: onnxruntime failed, took too long, or returned what is not finite.
        """
        (scores,) = run_session(self._session, ["scores"], window.inputs, OWN_TIME_LIMIT_S)
        if not np.isfinite(scores).all():
            raise InputError("the film decoder returned no valid scores; export it again")
        return np.asarray(scores, np.float64)


def reads_films(layout: Layout) -> bool:
    """Return whether the film decoder reads a layout; others are read by their frame pairs.

    >>> from link.presets import PRESETS
    >>> [name for name, preset in PRESETS.items() if reads_films(preset.layout)]
    ['hidden', 'fast', 'robust']
    """
    plain = layout.modulation == "antipodal" and layout.colour == "gray"
    return bool(layout.pilots) and plain and min(layout.rows, layout.cols) >= LEAST_SIDE
