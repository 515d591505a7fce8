"""The page maps and outlines where displays toggle as Python does."""

import cv2
import numpy as np
import pytest
from port import Port, same
from tolerances import OUTLINE_CELLS

from link.types import Array
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
