"""Map where displays toggle with numpy and onnxruntime: the graph of `models.region.region`."""

from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from export.runtime import OWN_TIME_LIMIT_S, load_session, run_session
from link.errors import InputError
from models import REGION_GRAPH

REGION_FORMAT = "region 1"
"""Version of the graph's inputs and outputs that this code reads."""


class RegionGraph:
    """The network `DisplayRegion` in an ONNX file.

    Args:
        path: file that `export.to_onnx.export_region` wrote.

    Raises:
        InputError: the file is missing, damaged, or of another version.
    """

    def __init__(self, path: Path) -> None:
        self._session, metadata = load_session(path, 1, OWN_TIME_LIMIT_S)
        if metadata.get("format") != REGION_FORMAT:
            raise InputError(f"{path}: no map of displays of this version; export it again")

    def log_odds(self, stills: NDArray[np.uint8]) -> NDArray[np.float32]:
        """Map where a display toggles.

        Args:
            stills: (T, H, W) gray levels of at least three frames, held still, no side of which is
                shorter than `models.region.LEAST_PX`.

        Returns:
            (H // 8, W // 8) natural log-odds.

        Raises:
            InputError: onnxruntime failed, took too long, or returned what is not finite.
        """
        inputs = {"frames": np.asarray(stills[:, None], np.float32)}
        (found,) = run_session(self._session, ["log_odds"], inputs, OWN_TIME_LIMIT_S)
        if not np.isfinite(found).all():
            raise InputError("the map of displays is not finite; export it again")
        return np.asarray(found, np.float32)


@cache
def shipped_region_graph() -> RegionGraph:
    """Load the graph that ships; later calls give the same one."""
    return RegionGraph(REGION_GRAPH)
