"""The page follows a display, and corrects its corners, as Python does."""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from web_fixtures import run_node_tests, write_fixture

from export.receive.tracking.follow import Follower
from export.web.tables import layout_table
from link.geometry import homography_from_corners
from link.layout import Layout, make_layout
from link.ratex import draw_patches

Array = NDArray[np.float64]
Image = NDArray[np.uint8]

PATCHES = make_layout(8, 8, 256, 192)
PILOTS = make_layout(12, 16, 256, 192, modulation="antipodal", pilots="auto")
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
    noisy = view + np.random.default_rng(seed).normal(0, 1.5, view.shape)
    return np.clip(noisy + 0.5, 0, 255).astype(np.uint8)


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


def optical_flow() -> dict[str, object]:
    """Points of an image, some of them near its border, and where OpenCV follows them."""
    first = picture(PATCHES, 0)
    H = np.array([[1.02, 0.015, -4.0], [-0.01, 0.99, 3.5], [1e-5, 0, 1]])
    second = cv2.warpPerspective(first, H, (256, 192), borderMode=cv2.BORDER_REPLICATE)
    mask = np.zeros_like(first)
    mask[30:120, 20:200] = 255
    few = cv2.goodFeaturesToTrack(first, 50, 0.05, 4, mask=mask)
    many = cv2.goodFeaturesToTrack(first, 300, 0.005, 8)
    edge = np.array([[[0.0, 0.0]], [[255.0, 100.2]], [[40.5, 190.7]], [[300.0, 10.0]]], np.float32)
    points = np.concatenate([many, edge])
    moved, status, _ = cv2.calcOpticalFlowPyrLK(
        first, second, points, points.copy(), winSize=(13, 13), maxLevel=2
    )
    guess = points + np.array([2.0, -3.0], np.float32)
    guessed, guessed_status, _ = cv2.calcOpticalFlowPyrLK(
        *(first, second, points, guess.copy()),
        winSize=(15, 15),
        maxLevel=2,
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )
    return {
        **{"first": first, "second": second, "mask": mask},
        **{"few": few[:, 0], "many": many[:, 0], "points": points[:, 0], "guess": guess[:, 0]},
        **{"moved": moved[:, 0], "status": status[:, 0]},
        **{"guessed": guessed[:, 0], "guessed_status": guessed_status[:, 0]},
    }


def test_displays_are_followed_as_in_python(tmp_path: Path) -> None:
    write_fixture(tmp_path, "optical_flow", optical_flow())
    cases = {
        "patches": followed(PATCHES, WHOLE),
        "pilots": followed(PILOTS, np.roll(WHOLE, 1, axis=0)),
        "partly out of view": followed(PILOTS, WHOLE - [80.0, 20.0]),
        "another picture": followed(PATCHES, WHOLE, changed_after=5),
    }
    assert cases["another picture"]["fresh"].count(True) == 1  # type: ignore[attr-defined]
    write_fixture(tmp_path, "followed", cases)
    run_node_tests("tracking", tmp_path)
