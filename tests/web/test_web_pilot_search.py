"""The page finds displays by their pilots in the films in which Python does, and in no other."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from pilot_films import FINE, OTHER, filmed, panned_to
from web_fixtures import run_node_tests, write_fixture

from export.locate.pilots.search import PilotSearch
from export.web.tables import layout_table
from link.layout import Layout

FPS = 60.0
FILMS = ["edges", "upside down", "parallax", "turned to", "no edges", "still", "other layout"]
LATER, NO_EDGES_LATER = 3, 6
"""Largest number of frames by which the page may find a display later than Python: its steps are
finer, and what toggles is outlined in several of them."""


def found_by_python(images: list[NDArray[np.uint8]], layouts: list[Layout]) -> object:
    search = PilotSearch(layouts, FPS)
    for number, image in enumerate(images):
        display = search.push(image, number / FPS)
        if display is not None:
            return {
                "frame": number,
                "layout": layouts.index(display.layout),
                "corners": display.corners,
            }
    return None


def film(name: str) -> dict[str, object]:
    layouts, corners = [OTHER, FINE], None
    if name == "edges":
        images, corners = filmed(FINE, 30, seed=0)
    elif name == "upside down":
        images, corners = filmed(FINE, 30, seed=1)
        images = [np.ascontiguousarray(image[::-1, ::-1]) for image in images]
        corners = [639, 479] - corners
    elif name == "parallax":
        images, corners = filmed(FINE, 30, seed=2, parallax=1.0)
    elif name == "turned to":
        images, corners = filmed(FINE, 80, seed=0)
        images = panned_to(images, 45)
    elif name == "no edges":
        images, corners = filmed(FINE, 54, seed=7, dark=True)
    elif name == "still":
        images, _ = filmed(FINE, 30, seed=2, hold=10**6)
    else:
        layouts = [FINE]
        images, _ = filmed(OTHER, 40, seed=3)
    return {
        "fps": FPS,
        "later": NO_EDGES_LATER if name == "no edges" else LATER,
        "images": np.array(images),
        "truth": corners,
        "layouts": [layout_table(layout) for layout in layouts],
        "python": found_by_python(images, layouts),
    }


@pytest.mark.slow
@pytest.mark.parametrize("name", FILMS)
def test_page_finds_what_python_finds(tmp_path: Path, name: str) -> None:
    fixture = film(name)
    assert (fixture["python"] is None) == (fixture["truth"] is None)
    write_fixture(tmp_path, "film", fixture)
    run_node_tests("pilotSearch", tmp_path)
