from typing import Any

import numpy as np
import pytest
from conftest import cases
from tolerances import FLOAT64, IDENTITY_LEVELS, SUBPIXEL_PX

from link.errors import InputError
from link.frames import Captured
from link.geometry import (
    Lens,
    check_corners,
    frame_corners,
    homography_from_corners,
    rectify,
    transform,
)
from link.layout import make_layout
from link.types import Array, Image

WIDTH, HEIGHT = 96, 64
TILTED = np.array([[30.25, 20.5], [170.5, 41.0], [161.75, 140.25], [18.0, 118.5]])


def noise(width: int, height: int, *channels: int) -> Image:
    return np.random.default_rng(3).integers(0, 256, (height, width, *channels), np.uint8)


def scene(points: Array) -> Array:
    """Gray levels of a smooth picture of WIDTH x HEIGHT at any points (..., 2) of it."""
    x, y = points[..., 0], points[..., 1]
    return 128 + 60 * np.sin(x / 9) * np.cos(y / 7) + 0.5 * x - 0.4 * y


def grid(width: int, height: int) -> Array:
    """(height, width, 2) pixel centres (x, y)."""
    return np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).astype(float)


def photograph(H: Array, width: int, height: int, lens: Lens | None = None) -> Image:
    """What a camera sees of `scene` through the homography, sampled without any image library."""
    seen = grid(width, height).reshape(-1, 2)
    points = transform(np.linalg.inv(H), seen if lens is None else lens.undistort(seen))
    levels = scene(np.clip(points, -20, WIDTH + 20)).reshape(height, width)
    return np.asarray(levels.round().clip(0, 255), np.uint8)


def levels_apart(a: Image, b: Image) -> int:
    assert a.shape == b.shape
    return int(np.abs(a.astype(int) - b).max())


def test_corners_of_a_frame_are_the_outer_corners_of_its_corner_pixels() -> None:
    expected = [[-0.5, -0.5], [3.5, -0.5], [3.5, 2.5], [-0.5, 2.5]]
    assert frame_corners(4, 3).tolist() == expected


@pytest.mark.parametrize("channels", [(), (3,)], ids=["gray", "colour"])
def test_a_frame_that_fills_the_image_stays_as_it_is(channels: tuple[int, ...]) -> None:
    image = noise(WIDTH, HEIGHT, *channels)
    H = homography_from_corners(frame_corners(WIDTH, HEIGHT), WIDTH, HEIGHT)
    assert levels_apart(rectify(image, H, WIDTH, HEIGHT), image) <= IDENTITY_LEVELS


@pytest.mark.parametrize("factor", [2, 5])
def test_every_pixel_of_a_finer_capture_counts(factor: int) -> None:
    fine = noise(factor * WIDTH, factor * HEIGHT)
    H = homography_from_corners(frame_corners(factor * WIDTH, factor * HEIGHT), WIDTH, HEIGHT)
    expected = fine.reshape(HEIGHT, factor, WIDTH, factor).mean(axis=(1, 3)).round()
    found = rectify(fine, H, WIDTH, HEIGHT)
    assert levels_apart(found, expected.astype(np.uint8)) <= IDENTITY_LEVELS


def test_a_capture_of_half_the_size_is_interpolated_at_the_right_places() -> None:
    H = homography_from_corners(frame_corners(WIDTH // 2, HEIGHT // 2), WIDTH, HEIGHT)
    half = photograph(H, WIDTH // 2, HEIGHT // 2)
    expected = scene(grid(WIDTH, HEIGHT)).round().astype(np.uint8)
    inner = np.s_[2:-2, 2:-2]  # at the border there is nothing to interpolate from
    assert levels_apart(rectify(half, H, WIDTH, HEIGHT)[inner], expected[inner]) <= 2
    ramp = (2 * np.arange(WIDTH // 2) + 10).astype(np.uint8)[None].repeat(HEIGHT // 2, axis=0)
    exact = np.arange(WIDTH) - 0.5 + 10  # pixel x of the frame lies at (x - 1/2) / 2 of the capture
    found = rectify(ramp, H, WIDTH, HEIGHT).astype(float)
    np.testing.assert_allclose(found[:, 1:-1], exact[None, 1:-1].repeat(HEIGHT, 0), atol=0.51)


@pytest.mark.parametrize("turns", [1, 2, 3])
def test_a_picture_filmed_sideways_or_upside_down_is_brought_upright(turns: int) -> None:
    image = noise(WIDTH, HEIGHT, 3)
    seen = np.ascontiguousarray(np.rot90(image, turns))  # counter-clockwise
    corners = np.roll(frame_corners(seen.shape[1], seen.shape[0]), turns, axis=0)
    H = homography_from_corners(check_corners(corners, seen.shape), WIDTH, HEIGHT)
    assert levels_apart(rectify(seen, H, WIDTH, HEIGHT), image) <= IDENTITY_LEVELS


@pytest.mark.parametrize("turns", range(4))
@pytest.mark.parametrize("scale", [1.0, 2.5])
def test_a_tilted_capture_of_a_smooth_picture_is_undone(turns: int, scale: float) -> None:
    corners = scale * np.roll(TILTED, turns, axis=0)
    H = homography_from_corners(corners, WIDTH, HEIGHT)
    image = photograph(H, int(scale * 200), int(scale * 160))
    expected = scene(grid(WIDTH, HEIGHT)).round().astype(np.uint8)
    assert levels_apart(rectify(image, H, WIDTH, HEIGHT), expected) <= 2


@pytest.mark.parametrize("turns", range(4))
def test_the_homography_of_corners_off_the_float32_grid_is_good_to_a_subpixel(turns: int) -> None:
    corners = np.roll(TILTED, turns, axis=0) + 1 / 3
    mapped = transform(homography_from_corners(corners, 512, 384), frame_corners(512, 384))
    np.testing.assert_allclose(mapped, corners, rtol=0, atol=SUBPIXEL_PX)


def test_transform_divides_by_the_third_coordinate() -> None:
    H = np.array([[1.0, 0, 3], [0, 2, 0], [0.5, 0, 1]])
    np.testing.assert_allclose(transform(H, [[2, 4], [0, 1]]), [[2.5, 4], [3, 2]], atol=FLOAT64)


def moved(corner: int, x: float, y: float) -> Array:
    corners = TILTED.copy()
    corners[corner] = x, y
    return corners


@cases(
    (moved(2, np.nan, 140), "need four"),
    (np.zeros((4, 3)), "need four"),
    ("here", "need four finite points"),
    (moved(1, 199.51, 41), r"\(199.51, 41\) lies outside the 200x160 image"),
    (moved(0, -0.6, 20), r"\(-0.6, 20\) lies outside the 200x160 image"),
    (TILTED[[1, 0, 3, 2]], "order top-left, top-right"),  # mirrored
    (TILTED[[0, 2, 1, 3]], "not a convex quadrilateral"),  # edges cross
    (moved(2, 60, 60), "not a convex quadrilateral"),
    ([[10, 10], [20, 10], [30, 10], [10, 90]], "not a convex quadrilateral"),
    (frame_corners(15, 15) + 20, "covers only 225 square pixels"),
)
def test_bad_corners_are_refused(corners: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        check_corners(corners, (160, 200, 3))


def test_a_capture_is_rectified_by_the_corners_of_each_frame() -> None:
    layout = make_layout(4, 4, WIDTH, HEIGHT, ratex=0)
    image = noise(WIDTH + 10, HEIGHT + 10, 3)
    first = frame_corners(WIDTH, HEIGHT) + 2
    second = first + np.array([3, 1])
    pair = Captured(image, image, layout, first, second, kappa=4).rectified()
    np.testing.assert_array_equal(pair.original, image[2 : 2 + HEIGHT, 2 : 2 + WIDTH])
    np.testing.assert_array_equal(pair.embedded, image[3 : 3 + HEIGHT, 5 : 5 + WIDTH])
    assert (pair.layout, pair.kappa) == (layout, 4)


@cases((0, (), "original is 96x64 and embedded is 96x66"), (-2, (3,), "original is"))
def test_frames_of_two_sizes_or_kinds_are_no_pair(
    shorter: int, channels: tuple[int, ...], says: str
) -> None:
    layout = make_layout(4, 4, WIDTH, HEIGHT, ratex=0)
    frames = noise(WIDTH, HEIGHT), noise(WIDTH, HEIGHT + 2 + shorter, *channels)
    corners = frame_corners(WIDTH, HEIGHT)
    with pytest.raises(InputError, match=says):
        Captured(*frames, layout, corners, corners).rectified()


def test_what_a_lens_distorts_can_be_undone() -> None:
    size, points = (160, 96), np.random.default_rng(0).uniform(-5, 165, (50, 2))
    for k in (-0.12, -0.02, 0.0, 0.05, 0.12):
        lens = Lens(k, size)
        np.testing.assert_allclose(lens.distort(lens.undistort(points)), points, atol=1e-6)
    corner, half = np.array([[-0.5, -0.5]]), np.array([80.0, 48.0])
    np.testing.assert_allclose(Lens(-0.1, size).distort(corner), corner + 0.1 * half)
    assert (Lens(0.0, size).distort(points) == points).all()


@pytest.mark.parametrize("finer", [1, 3])
def test_a_display_is_rectified_through_a_lens(finer: int) -> None:
    """Where the image is averaged down first, too."""
    size, lens = (200 * finer, 160 * finer), Lens(-0.1, (200 * finer, 160 * finer))
    corners = finer * (TILTED + 0.5) - 0.5
    H = lens.homography(corners, WIDTH, HEIGHT)
    image = photograph(H, *size, lens=lens)
    expected = scene(grid(WIDTH, HEIGHT))[2:-2, 2:-2]
    through, without = (
        np.abs(found[2:-2, 2:-2] - expected).max()
        for found in (
            rectify(image, H, WIDTH, HEIGHT, lens),
            rectify(image, homography_from_corners(corners, WIDTH, HEIGHT), WIDTH, HEIGHT),
        )
    )
    assert through < 3
    assert without > 3 * through
