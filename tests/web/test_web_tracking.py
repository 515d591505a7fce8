"""The page follows a display, and corrects its corners, as Python does."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from web_fixtures import run_node_tests, write_fixture

from export.locate.pilots.evidence import pilot_signs
from export.receive.tracking.corners import CornerShift
from export.receive.tracking.follow import Follower
from export.web.tables import layout_table
from link.geometry import homography_from_corners
from link.layout import Layout, make_layout
from link.ratex import draw_patches
from link.types import Array, Image

PATCHES = make_layout(8, 8, 256, 192)
PILOTS = make_layout(12, 16, 256, 192, modulation="antipodal", pilots="auto")
FINE = make_layout(24, 32, 256, 192, modulation="antipodal", pilots="auto")
SURE = 4.0
"""Score of a block that is decoded without doubt, in log-likelihood units."""
SIZE = (360, 270)
"""Width and height of the filmed frames."""
WHOLE = np.array([[60.0, 40.0], [290.0, 52.0], [300.0, 230.0], [52.0, 218.0]])


def picture(layout: Layout, seed: int) -> Image:
    noise = np.random.default_rng(seed).normal(0, 1, (layout.height, layout.width))
    smooth = cv2.GaussianBlur(noise, (0, 0), 3)
    drawn = np.clip(130 + 40 * smooth / smooth.std(), 0, 255).astype(np.uint8)
    draw_patches(drawn, layout, 3, embedded=False)
    return drawn


def filmed(shown: Image, corners: Array, seed: int) -> Image:
    """A frame with the display at the corners, over a dim room, with noise."""
    height, width = shown.shape
    H = homography_from_corners(corners, width, height)
    view = np.full(SIZE[::-1], 60, np.uint8)
    cv2.warpPerspective(shown, H, SIZE, view, borderMode=cv2.BORDER_TRANSPARENT)
    return noisy(view, seed)


def noisy(image: NDArray[np.generic], seed: int) -> Image:
    noise = np.random.default_rng(seed).normal(0, 1.5, image.shape)
    return np.clip(image + noise + 0.5, 0, 255).astype(np.uint8)


def hand(start: Array, number: int) -> Array:
    """The corners as a hand moves the camera."""
    middle = start.mean(axis=0)
    angle = 0.02 * np.sin(number / 3)
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    growth = 1 + 0.004 * number
    moved = (start - middle) @ turn * growth + middle
    return np.asarray(moved + np.array([4 * np.sin(number / 2), 2.5 * number / 3]))


def followed(layout: Layout, start: Array, changed_after: int = 99) -> dict[str, object]:
    """Ten frames of a hand-held camera, and where Python's follower sees the display."""
    follower = Follower(layout)
    images, found, fresh = [], [], []
    for number in range(11):
        shown = picture(layout, int(number > changed_after))
        images.append(filmed(shown, hand(start, number), number))
        if number == 0:
            view = follower.rectified(images[0], start)
            assert view is not None
            follower.begin(images[0], start, view)
            continue
        step = follower.step(images[-1])
        assert step is not None, number
        corners, anew = step
        assert np.abs(corners - hand(start, number)).max() < 1.0
        follower.advance(corners)
        if anew:
            view = follower.rectified(images[-1], corners)
            assert view is not None
            follower.begin(images[-1], corners, view)
        found.append(corners)
        fresh.append(anew)
    return {
        "layout": layout_table(layout),
        "start": start,
        "images": images,
        "corners": np.array(found),
        "fresh": fresh,
    }


def shifting() -> dict[str, object]:
    """Frame pairs that are rectified wrongly, and how Python moves the display's corners.

    All of them were rectified before the first move, as frames are that wait for the clock.
    """
    rng, layout = np.random.default_rng(3), FINE
    shifts, pairs = CornerShift(layout), []
    H = np.array([[1.004, 0.002, 1.5], [-0.001, 0.997, -1.0], [1e-5, 0, 1]])
    size = layout.width, layout.height
    for number in range(4):
        grid = rng.choice([-1.0, 1.0], (layout.rows, layout.cols))
        grid.reshape(-1)[layout.pilot_blocks] = pilot_signs(layout)
        change = cv2.resize(grid, size, interpolation=cv2.INTER_NEAREST)
        shown = 130 + 0.4 * (picture(layout, 5) - 130.0)
        seen = [cv2.warpPerspective(shown + 4 * s * change, H, size) for s in (-1, 1)]
        images = [noisy(image, 10 * number + i) for i, image in enumerate(seen)]
        scores = SURE * grid[layout.message_mask] * (number != 2)
        shifts.take(images[0], images[1], scores, np.zeros(8))
        shift = shifts.shift()
        pairs.append({"images": images, "scores": scores, "shift": shift})
    flat = np.full((layout.height, layout.width), 90, np.uint8)
    shifts.take(flat, flat, np.zeros(layout.n_bits), np.zeros(8))
    still = {"images": [flat, flat], "scores": np.zeros(layout.n_bits), "shift": shifts.shift()}
    pairs.append(still)
    assert pairs[0]["shift"] is not None
    return {"layout": layout_table(layout), "pairs": pairs}


@pytest.mark.slow
def test_displays_are_followed_as_in_python(tmp_path: Path) -> None:
    cases = {
        "patches": followed(PATCHES, WHOLE),
        "pilots": followed(PILOTS, np.roll(WHOLE, 1, axis=0)),
        "partly out of view": followed(PILOTS, WHOLE - [80.0, 20.0]),
        "another picture": followed(PATCHES, WHOLE, changed_after=5),
    }
    assert cases["another picture"]["fresh"].count(True) == 1
    write_fixture(tmp_path, "followed", cases)
    write_fixture(tmp_path, "shifting", shifting())
    run_node_tests("tracking", tmp_path)
