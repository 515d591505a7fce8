"""The page shrinks, warps and rectifies images, and does small algebra, as Python does."""

import cv2
import numpy as np
import pytest
import tolerances as within
from conftest import cases
from port import Port, differences, same

from link.errors import InputError
from link.geometry import (
    Lens,
    check_corners,
    frame_corners,
    homography_from_corners,
    in_image,
    rectify,
    transform,
)
from link.images import fit_picture
from link.types import Array, Image
from receiver.pilots.stabilise import FLOW_ENDS

SQUARE = np.array([[20.0, 15.0], [140.0, 12.0], [150.0, 100.0], [18.0, 95.0]])


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(0)


def photo(height: int, width: int, rng: np.random.Generator) -> Image:
    """Blurred noise over a slope, with the contrast of a picture."""
    noise = cv2.GaussianBlur(rng.normal(0, 1, (height, width)), (0, 0), 1.5)
    slope = np.linspace(0, 120, width)
    return np.clip(60 + slope + 120 * noise, 0, 255).astype(np.uint8)


def is_sound(corners: Array, outside: float) -> bool:
    try:
        check_corners(corners, (110, 160), outside)
    except InputError:
        return False
    return True


def test_homographies_and_corners_that_are_sound(port: Port, rng: np.random.Generator) -> None:
    geometry = port("link/geometry.js")
    H = homography_from_corners(SQUARE, 128, 96)
    found = geometry.homographyFromCorners(SQUARE.tolist(), 128, 96)
    same(found, H, within.FLOAT64)
    points = rng.uniform(-20, 140, (30, 2))
    same(geometry.transform(found, points.tolist()), transform(H, points), within.FLOAT64)
    same(geometry.inImage(points.tolist(), 128, 96), in_image(points, (96, 128)))
    moved = [SQUARE + np.array([30, 0]) * step for step in range(6)]
    odd = [SQUARE[::-1], SQUARE[[0, 2, 1, 3]], SQUARE / 10, np.full((4, 2), 1e9)]
    for corners in (*moved, *odd):
        for outside in (0.0, 0.25):
            sound = geometry.checkCorners(corners.tolist(), 160, 110, outside)
            assert sound == is_sound(corners, outside), (corners, outside)


@pytest.mark.parametrize(
    "size", [(96, 68), (40, 30), (64, 45), (129, 90), (127, 91), (256, 180), (300, 90)], ids=str
)
def test_pictures_are_fitted(port: Port, rng: np.random.Generator, size: tuple[int, int]) -> None:
    """Cut, and averaged down or interpolated up, to the same levels in every pixel."""
    picture = rng.integers(0, 256, (90, 128, 3), dtype=np.uint8)
    given = {"width": 128, "height": 90, "data": picture.reshape(-1)}
    same(port("image/fit.js").fitPicture(given, *size), fit_picture(picture, *size))


@pytest.mark.parametrize(
    "size",
    [(64, 45), (32, 30), (8, 6), (40, 31), (127, 45), (128, 90), (200, 100), (100, 180)],
    ids=str,
)
def test_areas_are_averaged(port: Port, rng: np.random.Generator, size: tuple[int, int]) -> None:
    image, resize = photo(90, 128, rng), port("image/shrink.js").resizeArea
    shrunk = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    most, mean = differences(resize(image, *size), shrunk)
    grows = size[0] > 128 or size[1] > 90
    assert most <= within.ROUNDED_LEVELS
    assert mean < (within.GROWN_MEAN if grows else within.SHRUNK_MEAN)
    floats = image.astype(np.float32)
    shrunk = cv2.resize(floats, size, interpolation=cv2.INTER_AREA)
    same(resize(floats, *size), shrunk, within.SHRUNK_LEVELS)


RECTIFIED = {
    "coarser than the display": ((110, 160), SQUARE, (128, 96)),
    "finer than twice": ((330, 480), 3 * SQUARE, (64, 48)),
    "partly out of view": ((330, 480), 3.8 * SQUARE - 60, (128, 96)),
    "turned": ((330, 480), np.roll(3 * SQUARE + 10, 1, axis=0), (96, 128)),
}
"""Shape of a photograph, corners in it, and size of the rectified image."""


@pytest.mark.parametrize("name", RECTIFIED)
def test_displays_are_rectified(port: Port, rng: np.random.Generator, name: str) -> None:
    shape, corners, size = RECTIFIED[name]
    image, H = photo(*shape, rng), homography_from_corners(corners, *size)
    most, mean = differences(
        port("link/geometry.js").rectify(image, H, *size), rectify(image, H, *size)
    )
    assert most <= within.ROUNDED_LEVELS
    assert mean < within.RECTIFIED_MEAN


@pytest.mark.parametrize("name", RECTIFIED)
def test_displays_are_rectified_through_a_lens(
    port: Port, rng: np.random.Generator, name: str
) -> None:
    (height, width), corners, size = RECTIFIED[name]
    lens, module = Lens(-0.1, (width, height)), port("link/geometry.js")
    ported = module.Lens(lens.k, width, height)
    for way in ("distort", "undistort"):
        same(getattr(ported, way)(corners.tolist()), getattr(lens, way)(corners), within.FLOAT64)
    image, H = photo(height, width, rng), lens.homography(corners, *size)
    found = np.reshape(ported.homography(corners.tolist(), *size), (3, 3))
    same(
        transform(found, frame_corners(*size)), transform(H, frame_corners(*size)), within.MOVED_PX
    )
    most, mean = differences(
        module.rectify(image, H, *size, ported), rectify(image, H, *size, lens)
    )
    assert most <= 2 * within.ROUNDED_LEVELS
    assert mean < within.GROWN_MEAN


def test_points_are_chosen(port: Port, rng: np.random.Generator) -> None:
    image, mask = photo(192, 256, rng), np.zeros((192, 256), np.uint8)
    mask[30:120, 20:200] = 255
    choose = port("image/points.js").chooseFeatures
    few = cv2.goodFeaturesToTrack(image, 50, 0.05, 4, mask=mask)[:, 0]
    many = cv2.goodFeaturesToTrack(image, 300, 0.005, 8)[:, 0]
    for found, expected in (
        (choose(image, 50, 0.05, 4, mask), few),
        (choose(image, 300, 0.005, 8), many),
    ):
        found = found.reshape(-1, 2)
        assert len(found) == len(expected)
        alike = set(map(tuple, found)) & set(map(tuple, expected))
        assert len(alike) >= 0.98 * len(
            expected
        )  # of two that are equally strong, rounding chooses


@cases((13, (0.0, 0.0), False), (15, (2.0, -3.0), False), (15, (2.0, -3.0), True))
def test_points_are_followed(
    window_px: int, guess: tuple[float, float], early: bool, port: Port, rng: np.random.Generator
) -> None:
    """Some of them near the border."""
    first = photo(192, 256, rng)
    H = np.array([[1.02, 0.015, -4.0], [-0.01, 0.99, 3.5], [1e-5, 0, 1]])
    second = cv2.warpPerspective(first, H, (256, 192), borderMode=cv2.BORDER_REPLICATE)
    many = cv2.goodFeaturesToTrack(first, 300, 0.005, 8)[:, 0]
    edge = np.array([[0.0, 0.0], [255.0, 100.2], [40.5, 190.7], [300.0, 10.0]], np.float32)
    points = np.concatenate([many, edge])
    begun = points + np.array(guess, np.float32)
    moved, status, _ = cv2.calcOpticalFlowPyrLK(
        *(first, second, points, begun.copy()),
        winSize=(window_px, window_px),
        maxLevel=2,
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
        **({"criteria": FLOW_ENDS} if early else {}),
    )
    follow = port("image/points.js").follow
    ends = [list(FLOW_ENDS[1:])] if early else []
    found = follow(first, second, points.reshape(-1), window_px, 2, begun.reshape(-1), *ends)
    same(found.found, status)
    kept = status[:, 0] == 1
    same(found.moved.reshape(-1, 2)[kept], moved[kept], within.SAME_PX)


def test_levels_are_spread_and_details_taken_off(port: Port, rng: np.random.Generator) -> None:
    image, levels = photo(50, 71, rng), port("image/levels.js")
    assert differences(levels.equalised(image), cv2.equalizeHist(image))[0] == 0
    square = np.ones((9, 9), np.uint8)
    for bright_first in (True, False):
        ways = [cv2.MORPH_OPEN, cv2.MORPH_CLOSE][:: 1 if bright_first else -1]
        plain = image
        for way in ways:
            plain = cv2.morphologyEx(plain, way, square)
        assert differences(levels.withoutDetails(image, 9, bright_first), plain)[0] == 0
