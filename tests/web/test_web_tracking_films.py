"""The page finds displays in films, follows and loses them as Python does."""

from pathlib import Path

import numpy as np
import pytest
from pilot_films import FINE, filmed
from test_web_tracking import WHOLE, hand, picture
from test_web_tracking import filmed as photographed
from web_fixtures import run_node_tests, write_fixture

from export.receive.tracking.patches import Tracker
from export.receive.tracking.pilots import PilotTracker
from export.web.tables import layout_table
from link.layout import make_layout

PATCHES = make_layout(8, 8, 256, 192)
CLOSE_PX = 4.0
"""Largest distance of pilots' corners: a third of a block. Decoded blocks mend what is left."""
STILL, MOVING = 6, 8
"""Numbers of frames at first, and after that with a camera that moves."""


def patches_film() -> dict[str, object]:
    tracker, images, corners, seen = Tracker(PATCHES), [], [], []
    shown = picture(PATCHES, 0)
    for number in range(STILL + MOVING):
        there = hand(WHOLE, max(0, number - STILL + 1))
        images.append(photographed(shown, there, number))
        corners.append(there)
        tracked = tracker.follow(images[-1], number / 60)
        assert tracked is None or np.abs(tracked.corners - there).max() < 0.7
        seen.append(np.full((4, 2), np.nan) if tracked is None else tracked.corners)
    assert np.isfinite(seen[STILL:]).all()
    return {
        "layout": layout_table(PATCHES),
        "images": images,
        "corners": np.array(corners),
        "seen": np.array(seen),
    }


def pilots_film() -> dict[str, object]:
    images, corners = filmed(FINE, 40, seed=0, kappa=5.0)
    tracker, found = PilotTracker([FINE], 60.0), []
    for number, (image, there) in enumerate(zip(images, corners, strict=True)):
        tracked = tracker.follow(image, number / 60)
        assert tracked is None or np.abs(tracked.corners - there).max() < CLOSE_PX
        found.append(tracked is not None)
    assert found == sorted(found)
    assert found[-1]
    return {
        "layout": layout_table(FINE),
        "images": images,
        "corners": corners,
        "first": found.index(True),
    }


@pytest.mark.slow
def test_displays_are_found_and_followed(tmp_path: Path) -> None:
    for part in (patches_film, pilots_film):
        write_fixture(tmp_path, part.__name__, part())
    run_node_tests("trackingFilms", tmp_path)
