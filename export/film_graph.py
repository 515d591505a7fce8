"""Decode windows of film with numpy and onnxruntime: the graph of `models.film.decoder`."""

from pathlib import Path

import numpy as np

from export.runtime import OWN_TIME_LIMIT_S, load_session, run_session
from link.errors import InputError
from link.frames import SoftBits
from link.observation import Observation
from models.film.window import film_inputs

FILM_FORMAT = "film 4"
"""Version of the graph's inputs and outputs that this code reads."""


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

    def decode(self, observation: Observation) -> SoftBits:
        """Score the message blocks of all frame pairs of a window of film.

        Returns:
            natural log-likelihood ratios, positive for bit 1.

        Raises:
            InputError: onnxruntime failed, took too long, or returned what is not finite.
            UnsuitedError: the layout is none that the film decoder reads.
        """
        inputs = film_inputs(observation)
        (scores,) = run_session(self._session, ["scores"], inputs, OWN_TIME_LIMIT_S)
        if not np.isfinite(scores).all():
            raise InputError("the film decoder returned no valid scores; export it again")
        message = observation.layout.message_mask
        return SoftBits(np.asarray(scores[:, message], np.float64).reshape(-1))
