"""The page finds displays by their pilots in the films in which Python does, and in no other."""

from typing import Any

import cv2
import numpy as np
import pytest
from conftest import exhaustive, slow
from pilot_films import FINE, OTHER, filmed, leaving, panned_to
from port import Port
from tolerances import LENS_FOUND_K, PILOTS_FOUND_PX

from link.geometry import Lens
from link.layout import Layout
from link.types import Array, Image
from receiver.pilots.search.pilot_search import PilotSearch

FPS = 60.0
FILMS = [
    exhaustive("bent"),
    exhaustive("upside down, parallax"),
    exhaustive("turned to"),
    exhaustive("late"),
    exhaustive("leaving"),
    slow("moving picture"),
    exhaustive("no edges"),
    exhaustive("no edges, slow camera"),
    slow("still"),
    exhaustive("other layout"),
]
LATER, NO_EDGES_LATER = 6, 8
"""Largest number of frames by which the page may find a display later than Python: edges are looked
at every sixth frame, and what toggles is outlined in several steps."""


def film(name: str) -> tuple[list[Image], Array | None, list[Layout]]:
    """Images, the display's corners in each or None where none is to be found, and layouts."""
    if name == "bent":
        images, corners = filmed(FINE, 48, seed=0)
        lens, (y, x) = Lens(-0.1, (640, 480)), np.indices((480, 640))
        places = lens.undistort(np.column_stack([x.ravel(), y.ravel()]).astype(np.float64))
        there = places.reshape(480, 640, 2).astype(np.float32)  # (480 640, 2) -> (480, 640, 2)
        images = [cv2.remap(image, there, None, cv2.INTER_LINEAR) for image in images]
        corners = np.array([lens.distort(seen) for seen in corners])
    elif name == "upside down, parallax":
        images, corners = filmed(FINE, 30, seed=2, parallax=1.0)
        images = [np.ascontiguousarray(image[::-1, ::-1]) for image in images]
        corners = [639, 479] - corners
    elif name == "turned to":
        images, corners = filmed(FINE, 80, seed=0)
        images = panned_to(images, 45)
    elif name == "late":
        images, corners = filmed(FINE, 80, seed=0)
        images[:30] = filmed(FINE, 30, seed=0, hold=10**6)[0]
    elif name == "leaving":
        images, corners = leaving(*filmed(FINE, 30, seed=3))
    elif name == "moving picture":
        images, corners = filmed(FINE, 40, seed=1, pan=3.0)
    elif name.startswith("no edges"):
        images, corners = filmed(FINE, 54, seed=7, dark=True)
    elif name == "still":
        return filmed(FINE, 30, seed=2, hold=10**6)[0], None, [OTHER, FINE]
    else:
        return filmed(OTHER, 40, seed=3)[0], None, [FINE]
    return images, corners, [OTHER, FINE]


def first_found(search: Any, images: list[Image], fps: float) -> tuple[int, Any] | None:
    """The frame in which a search, Python's or the page's, finds a display, and the display."""
    for number, image in enumerate(images):
        display = search.push(image, number / fps)
        if display is not None:
            return number, display
    return None


@pytest.mark.parametrize("name", FILMS)
def test_page_finds_what_python_finds(port: Port, name: str) -> None:
    images, truth, layouts = film(name)
    fps = FPS / 2 if "slow" in name else FPS
    known = first_found(PilotSearch(layouts, fps), images, fps)
    found = first_found(
        port("receiver/pilots/search/pilotSearch.js").PilotSearch(layouts, fps), images, fps
    )
    assert (found is None) == (known is None) == (truth is None)
    if known is None:
        return
    (frame, display), (known_frame, known_display) = found, known
    assert frame <= known_frame + (NO_EDGES_LATER if "no edges" in name else LATER)
    assert display.layout.rows == known_display.layout.rows
    assert display.pictureMoves == known_display.picture_moves
    assert known_display.picture_moves == (name == "moving picture")
    assert (display.k == 0) == (known_display.k == 0) == (name != "bent")
    assert display.k == pytest.approx(known_display.k, abs=LENS_FOUND_K)
    known_off = np.abs(known_display.corners - truth[known_frame]).max()
    assert np.abs(display.corners - truth[frame]).max() <= known_off + PILOTS_FOUND_PX
