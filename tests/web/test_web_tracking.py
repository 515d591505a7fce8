"""The page follows a display, and corrects its corners, as Python does."""

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from port import Port, same
from tolerances import CORNERS_PX, DECODED_PX, FOLLOWED_PX

from link.geometry import frame_corners, homography_from_corners, transform
from link.layout import Layout, make_layout
from link.pilots import expected_changes, pilot_signs
from link.types import Array, Image
from receiver.tracking.corners import CornerShift
from receiver.tracking.follow import Follower

PILOTS = make_layout(12, 16, 256, 192, modulation="antipodal", pilots="auto")
FINE = make_layout(24, 32, 256, 192, modulation="antipodal", pilots="auto")
SIZE = (360, 270)
"""Width and height of the filmed frames."""
WHOLE = np.array([[60.0, 40.0], [290.0, 52.0], [300.0, 230.0], [52.0, 218.0]])


def picture(layout: Layout, seed: int) -> Image:
    noise = np.random.default_rng(seed).normal(0, 1, (layout.height, layout.width))
    smooth = cv2.GaussianBlur(noise, (0, 0), 3)
    return np.clip(130 + 40 * smooth / smooth.std(), 0, 255).astype(np.uint8)


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


FOLLOWED = {
    "in view": np.roll(WHOLE, 1, axis=0),
    "partly out of view": WHOLE - [80.0, 20.0],
}
"""The corners at first."""


@pytest.mark.slow
@pytest.mark.parametrize("name", FOLLOWED)
def test_displays_are_followed_as_in_python(port: Port, name: str) -> None:
    """In ten frames of a hand-held camera."""
    corners, follower = FOLLOWED[name], Follower(PILOTS)
    ported = port("receiver/tracking/follow.js").Follower(PILOTS)
    shown = picture(PILOTS, 0)
    images = [filmed(shown, hand(corners, number), number) for number in range(11)]

    view = follower.rectified(images[0], corners)
    assert view is not None
    follower.begin(images[0], corners, view)
    ported.begin(images[0], corners.tolist(), ported.rectified(images[0], corners.tolist()))
    for number, image in enumerate(images[1:], 1):
        step, found = follower.step(image), ported.step(image)
        assert step is not None, number
        known, fresh = step
        assert np.abs(known - hand(corners, number)).max() < FOLLOWED_PX
        same(found.corners, known, CORNERS_PX)
        assert found.fresh == fresh
        follower.advance(known)
        ported.advance(found.corners)


@pytest.mark.slow
def test_corners_move_to_where_decoded_blocks_lie(port: Port) -> None:
    """All frame pairs were rectified before the first move, as frames are that wait for the clock.

    Of the third nothing but the pilots is known, and the last shows nothing.
    """
    rng, layout = np.random.default_rng(3), FINE
    shifts = CornerShift(layout)
    first = shifts.placement
    ported = port("receiver/tracking/corners.js").CornerShift(layout)
    H = np.array([[1.004, 0.002, 1.5], [-0.001, 0.997, -1.0], [1e-5, 0, 1]])
    size = layout.width, layout.height
    corners, moves = frame_corners(*size), []

    def compare(images: list[Image], changes: Array) -> None:
        before = shifts.placement
        expected = np.stack([-changes / 2, changes / 2, -changes / 2])[: len(images)]
        shifts.take(images, expected, len(images) * [first])
        blocks = expected.reshape(len(images), -1).astype(np.float32)
        ported.take(images, list(blocks), len(images) * [np.zeros(8)])
        found, is_moved = ported.shift(), shifts.placement is not before
        moves.append(is_moved)
        assert (found is not None) == is_moved
        if is_moved:
            after = shifts.placement.H_followed_from_shown
            known = np.linalg.inv(before.H_followed_from_shown) @ after
            moved = transform(found.reshape(3, 3), corners)
            same(moved, transform(known, corners), DECODED_PX)
            assert ported.shift() is None

    for number in range(4):
        grid = rng.choice([-1.0, 1.0], (layout.rows, layout.cols))
        grid.reshape(-1)[layout.pilot_blocks] = pilot_signs(layout)
        change = cv2.resize(grid, size, interpolation=cv2.INTER_NEAREST)
        shown = 130 + 0.4 * (picture(layout, 5) - 130.0)
        seen = [cv2.warpPerspective(shown + 4 * s * change, H, size) for s in (-1, 1, -1)]
        images = [noisy(image, 10 * number + i) for i, image in enumerate(seen)]
        compare(images, expected_changes(layout) if number == 2 else grid)
    flat = np.full((layout.height, layout.width), 90, np.uint8)
    compare([flat, flat], expected_changes(layout))
    assert moves[0]
