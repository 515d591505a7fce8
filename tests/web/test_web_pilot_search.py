"""The page finds displays by their pilots in the films in which Python does, and in no other."""

from typing import Any

import numpy as np
import pytest
from pilot_films import FINE, OTHER, filmed
from port import Port, page_graphs
from tolerances import PILOTS_FOUND_PX

from link.types import Image
from receiver.pilots.search.pilot_search import PilotSearch

FPS = 60.0
LATER = 6
"""Largest number of frames by which the page may find a display later than Python: edges are looked
at every sixth frame."""


def first_found(search: Any, images: list[Image]) -> tuple[int, Any] | None:
    """The frame in which a search, Python's or the page's, finds a display, and the display."""
    for number, image in enumerate(images):
        display = search.push(image, number / FPS)
        if display is not None:
            return number, display
    return None


@pytest.mark.slow
@pytest.mark.parametrize("is_still", [False, True])
def test_page_finds_what_python_finds(port: Port, is_still: bool) -> None:
    """A display whose picture moves, and none where nothing toggles."""
    layouts = [OTHER, FINE]
    hold, pan = (10**6, 0.0) if is_still else (2, 3.0)
    images, truth = filmed(FINE, 26 if is_still else 40, seed=1, hold=hold, pan=pan)
    known = first_found(PilotSearch(layouts, FPS), images)
    search = port("receiver/pilots/search/pilotSearch.js").PilotSearch
    found = first_found(search(layouts, page_graphs(port)["region"], FPS), images)
    assert (found is None) == (known is None) == is_still
    if known is None or found is None:
        return
    (frame, display), (known_frame, known_display) = found, known
    assert frame <= known_frame + LATER
    assert display.layout.rows == known_display.layout.rows
    assert display.pictureMoves and known_display.picture_moves
    assert display.k == known_display.k == 0
    known_off = np.abs(known_display.corners - truth[known_frame]).max()
    assert np.abs(display.corners - truth[frame]).max() <= known_off + PILOTS_FOUND_PX
