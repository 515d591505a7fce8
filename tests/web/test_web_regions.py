"""The page maps and outlines where displays toggle as Python does."""

import cv2
import numpy as np
import onnx
import pytest
from port import Port, PortError, same
from tolerances import LOG_ODDS, OUTLINE_CELLS

from export.region_graph import shipped_region_graph
from link.types import Array
from models import REGION_GRAPH
from receiver.locate.quads import upright
from receiver.pilots.search.regions import outline_regions

SIZE = 45, 80
"""Rows and columns of a map."""


def map_with(displays: list[list[list[float]]], seed: int) -> Array:
    """Log-odds, (45, 80) float32, of noise, which are larger within quadrilaterals."""
    rng = np.random.default_rng(seed)
    shown = np.zeros(SIZE, np.uint8)
    for display in displays:
        cv2.fillPoly(shown, [np.rint(display).astype(np.int32)], 1)
    noise = cv2.GaussianBlur(rng.normal(0, 6, SIZE), (0, 0), 1.5)
    return (4.0 * shown - 2 + noise).astype(np.float32)


MAPS = {
    "noise": [],
    "rectangles": [[[8, 5], [34, 5], [34, 20], [8, 20]], [[50, 18], [74, 18], [74, 40], [50, 40]]],
    "turned": [[[30, 8], [58, 20], [46, 42], [16, 30]]],
    "leaving": [[[-14, 6], [24, 2], [28, 30], [-10, 36]], [[60, 20], [95, 24], [92, 60], [58, 50]]],
}
"""Corners, in cells, of the displays of maps."""


@pytest.mark.parametrize("name", MAPS)
def test_displays_are_outlined_as_by_python(port: Port, name: str) -> None:
    outlined = port("receiver/pilots/search/regions.js").outlineRegions
    for seed in range(6):
        log_odds = map_with(MAPS[name], seed)
        found, known = outlined(log_odds.ravel(), SIZE[1]), outline_regions(log_odds)
        assert len(found) == len(known) >= len(MAPS[name])
        same(upright(np.reshape(found, (-1, 4, 2))), upright(np.array(known)), OUTLINE_CELLS)


def test_nothing_is_outlined_where_nothing_is_likely(port: Port) -> None:
    outlined = port("receiver/pilots/search/regions.js").outlineRegions
    assert outlined(np.full(45 * 80, -1, np.float32), 80) == []


@pytest.mark.parametrize("size", [(3, 96, 128), (13, 360, 640), (9, 357, 203)])
def test_frames_are_mapped_as_by_python(port: Port, size: tuple[int, int, int]) -> None:
    stills = np.random.default_rng(0).integers(0, 256, size, np.uint8)
    graph = port("export/regionGraph.js").RegionGraph(REGION_GRAPH.read_bytes())
    same(graph.logOdds(list(stills)), shipped_region_graph().log_odds(stills), LOG_ODDS)


def test_a_map_that_is_not_finite_is_refused(port: Port) -> None:
    """Weights that are not finite stand for a graph that is damaged on its way."""
    model = onnx.load(REGION_GRAPH)
    for weights in model.graph.initializer:
        if weights.data_type == onnx.TensorProto.FLOAT:
            infinite = np.full(tuple(weights.dims), np.nan, np.float32)
            weights.CopyFrom(onnx.numpy_helper.from_array(infinite, weights.name))
    graph = port("export/regionGraph.js").RegionGraph(model.SerializeToString())
    with pytest.raises(PortError, match="the model returned no valid log_odds"):
        graph.logOdds(list(np.zeros((3, 96, 128), np.uint8)))
