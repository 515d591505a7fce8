"""Displays in rooms: where they lie, what the truth says, and that the channel is the usual one."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from conftest import cases
from filming import even_scene, only, photograph, scene
from hypothesis import given, settings
from hypothesis import strategies as st
from tolerances import FLOAT32, SUBPIXEL_PX

from data_gen.channel.composition import Shot
from data_gen.channel.moire import moire_gain
from data_gen.channel.optics import (
    CAPTURE_HEIGHT,
    CAPTURE_WIDTH,
    SURROUNDINGS,
    Pose,
    draw_pose,
    project,
    scene_camera,
)
from data_gen.channel.stills import draw_shots
from data_gen.effects import with_parameter
from data_gen.film.rooms import ROOMS
from data_gen.film.scenes import PaintedRoom, Scene, SceneSettings, draw_scene
from data_gen.pairs import get_pair
from data_gen.pictures.library import Picture
from link.geometry import frame_corners, transform
from link.layout import make_layout
from link.types import Array, Image

LAYOUT = make_layout(4, 4, 128, 96, 2)
SMALL = SceneSettings(size=(320, 180), margin_px=8)
PICTURES = [Picture(str(k), np.full((12, 16, 3), 60 * k, np.uint8)) for k in range(4)]


def background(made: Scene) -> Array:
    """The room's canvas within the image, (height, width, 3)."""
    (width, height), margin = made.size, made.painted.margin
    return made.painted.light[margin : margin + height, margin : margin + width]


def drawn(seed: int = 0, view: float = 0.0, chosen: SceneSettings = SMALL) -> Scene:
    return draw_scene(LAYOUT, get_pair("canon-lg"), view, np.random.default_rng(seed), chosen)


def even(level: int) -> Image:
    return even_scene(level, LAYOUT).original


@pytest.mark.slow
@settings(max_examples=15)
@given(seed=st.integers(0, 10_000), view=st.floats(-60, 60), coverage=st.floats(0.05, 0.9))
def test_the_whole_picture_is_in_view(seed: int, view: float, coverage: float) -> None:
    made = drawn(seed, view, replace(SMALL, coverage=coverage))
    assert (made.corners > -0.5).all()
    assert (made.corners < np.array([319.5, 179.5])).all()
    edges = np.roll(made.corners, -1, axis=0) - made.corners
    following = np.roll(edges, -1, axis=0)
    assert (edges[:, 0] * following[:, 1] > edges[:, 1] * following[:, 0]).all()  # not mirrored
    assert made.coverage < 1.02 * coverage


@pytest.mark.parametrize("coverage", [0.05, 0.2, 0.4])
@pytest.mark.parametrize("seed", range(5))
def test_coverage_is_what_was_asked_for_where_it_fits(coverage: float, seed: int) -> None:
    made = drawn(seed, 10.0, replace(SMALL, coverage=coverage, turn=0.0))
    assert made.coverage == pytest.approx(coverage, rel=0.02)


def test_more_than_fits_gives_the_largest_that_fits() -> None:
    made = drawn(3, 0.0, replace(SMALL, coverage=0.9, turn=0.0))
    assert 0.45 < made.coverage < 0.75  # 4:3 in 16:9, seen up to 8 degrees from below
    low, high = made.corners.min(axis=0), made.corners.max(axis=0)
    assert min(low[1], 179 - high[1]) < 3


@pytest.mark.slow
def test_turns_views_places_rooms_and_screens_vary() -> None:
    made = [drawn(seed, 20.0) for seed in range(20)]
    quarters = {round(s.pose.roll_deg / 90) % 4 for s in made}
    assert quarters == {0, 1, 2, 3}
    assert {s.room for s in made} == set(ROOMS)
    centres = np.array([s.corners.mean(axis=0) for s in made])
    assert (np.ptp(centres, axis=0) > [60, 15]).all()
    assert len({background(s).tobytes() for s in made}) == 20


@pytest.mark.parametrize("room", ROOMS)
def test_rooms_are_as_bright_as_they_say(room: str) -> None:
    low, high = ROOMS[room]
    for seed in range(3):
        made = drawn(seed, 0.0, replace(SMALL, room=room, second_display=False, window=False))
        assert low <= made.level <= high
        assert 0.02 * low < np.median(background(made)) < high
        assert made.pair.display.haze == pytest.approx(0.006 * made.level / 0.19)


def test_the_background_has_the_image_size_and_is_light() -> None:
    made = drawn(1, 30.0, replace(SMALL, pictures=PICTURES))
    assert background(made).shape == (180, 320, 3)
    assert made.painted.light.shape == (196, 336, 3)
    assert background(made).dtype == np.float32
    assert np.isfinite(made.painted.light).all()
    assert (made.painted.light >= 0).all()


def test_a_seed_gives_the_same_scene_and_still() -> None:
    first, again, other = (
        drawn(seed, 20.0, replace(SMALL, pictures=PICTURES)) for seed in (5, 5, 6)
    )
    assert np.array_equal(first.painted.light, again.painted.light)
    assert not np.array_equal(first.painted.light, other.painted.light)
    stills = [
        photograph(even(90), s, np.random.default_rng(seed)) for s, seed in ((first, 1), (again, 1))
    ]
    assert np.array_equal(*stills)
    assert not np.array_equal(stills[0], photograph(even(90), first, np.random.default_rng(2)))


@cases((0, 0.0), (1, 40.0), (2, -55.0), (3, 20.0))
def test_the_truth_lies_on_the_edges_of_the_drawn_display(seed: int, view: float) -> None:
    size = SceneSettings(size=(640, 360), coverage=0.2, room="dark")
    made = draw_scene(
        LAYOUT, only("canon-lg", "perspective"), view, np.random.default_rng(seed), size
    )
    rng = np.random.default_rng(0)
    white, black = (photograph(even(level), made, rng).astype(int) for level in (255, 0))
    shown = ((white - black)[:, :, 1] > 127).astype(np.uint8)
    outline = max(cv2.findContours(shown, 0, cv2.CHAIN_APPROX_NONE)[0], key=len)[:, 0]
    corners = made.corners
    truth = corners.astype(np.float32)[:, None]
    distances = [cv2.pointPolygonTest(truth, p.astype(float).tolist(), True) for p in outline]
    assert min(distances) > -0.6  # outermost lit pixel centres lie within a pixel of the edge
    assert max(distances) < 1.1
    for corner in corners:
        assert np.hypot(*(outline - corner).T).min() < 1.6


@pytest.mark.parametrize("centre", [(300.0, 100.0), (639.5, 359.5), (1000.0, 650.0)])
def test_a_turned_camera_sees_the_centre_where_it_should(centre: tuple[float, float]) -> None:
    camera = scene_camera(Pose(35.0, -5.0, 92.0, 2.2), 1100.0, (1280, 720), centre)
    seen = camera @ [0, 0, 0, 1]
    assert seen[2] > 0
    np.testing.assert_allclose(seen[:2] / seen[2], centre, atol=SUBPIXEL_PX)


def test_a_camera_that_is_not_turned_is_the_usual_one() -> None:
    pose = draw_pose(30.0, np.random.default_rng(0))
    size = CAPTURE_WIDTH, CAPTURE_HEIGHT
    focal = 0.70 * CAPTURE_WIDTH * pose.distance
    camera = scene_camera(pose, focal, size, ((size[0] - 1) / 2, (size[1] - 1) / 2))
    corners = frame_corners(512, 384)
    plane = np.array([[1 / 512, 0, -511 / 1024], [0, 1 / 512, -383 / 1024], [0, 0, 1]])
    seen = transform(camera[:, [0, 1, 3]] @ plane, corners)
    np.testing.assert_allclose(seen, transform(project(pose, 512, 384), corners), atol=SUBPIXEL_PX)


@pytest.mark.parametrize("name", ["canon-lg", "sony-imac"])
def test_a_viewpoint_sees_the_display_as_the_channel_of_stills_does(name: str) -> None:
    pair = get_pair(name)
    still = replace(pair, display=replace(pair.display, pwm_depth=0.0, grid_contrast=0.0))
    shot = draw_shots(LAYOUT, still, 30.0, np.random.default_rng(0))[0]
    size = CAPTURE_WIDTH, CAPTURE_HEIGHT
    canvas = np.full((*size[::-1], 3), SURROUNDINGS, np.float32)
    pose = Pose(30.0, 0.0, 0.0, 2.5)
    H = shot.H_captured_from_display
    painted = PaintedRoom(canvas, canvas, np.zeros(size[::-1], np.float32), 1.0, 0)
    made = Scene(LAYOUT, still, 30.0, pose, "dark", 0.01, size, H, np.eye(3, 4), painted)
    view = made.viewpoint(np.random.default_rng(0))
    view = replace(view, room=shot.viewpoint.room, theta=shot.viewpoint.theta)
    picture = scene(LAYOUT).original
    seen = Shot(view, H).expose(picture)
    usual = shot.expose(picture)
    shown = cv2.fillConvexPoly(np.zeros(size[::-1], np.uint8), made.corners.astype(int), 1)
    reach = np.ones((13, 13), np.uint8)
    inner = cv2.erode(shown, reach) > 0
    assert inner.mean() > 0.2
    np.testing.assert_allclose(seen[inner], usual[inner], atol=20 * FLOAT32)
    outside = cv2.dilate(shown, reach) == 0
    white = pair.camera.white_level * view.lens[outside]
    np.testing.assert_allclose(seen[outside], SURROUNDINGS * white, rtol=3e-3)
    np.testing.assert_allclose(seen[outside], usual[outside], atol=20 * FLOAT32)


def test_moire_of_a_part_is_that_of_the_whole() -> None:
    H = project(Pose(20.0, 1.0, 2.0, 2.5), 128, 96)
    whole = moire_gain(get_pair("canon-lg"), LAYOUT, H, (768, 576))
    part = moire_gain(get_pair("canon-lg"), LAYOUT, H, (300, 200), (211, 160), 768)
    assert np.ptp(part) > 0.01
    np.testing.assert_allclose(part, whole[160:360, 211:511], atol=0.01)  # coarse amplitudes


def test_a_second_display_shows_a_photograph_in_a_dark_room() -> None:
    dark = replace(SMALL, room="dark", coverage=0.05, window=False, turn=0.0)
    bright = [Picture("white", np.full((12, 16, 3), 255, np.uint8))]
    without, beside = (
        drawn(4, 0.0, replace(dark, pictures=bright, second_display=flag)) for flag in (False, True)
    )
    assert background(without).max() < 0.3
    assert (background(beside) > 0.9).mean() > 0.01


def test_a_window_surrounds_the_picture() -> None:
    chosen = replace(SMALL, room="dark", coverage=0.1, turn=0.0, second_display=False)
    means = []
    for seed in range(12):
        made = drawn(seed, 0.0, replace(chosen, window=True))
        grown = transform(
            made.H_captured_from_display, 1.01 * (frame_corners(128, 96) - 64) + 64
        ).round()
        ring = background(made)[grown[:, 1].astype(int), grown[:, 0].astype(int)]
        means.append(ring.mean())
    assert max(means) > 0.5  # a white surround
    assert min(means) < 0.2


# Depth


def test_a_camera_that_moves_sees_the_wall_move_behind_the_display() -> None:
    """Both planes move as a camera that stands elsewhere projects them, turned to the picture."""
    made = drawn(seed=3, view=30.0)
    way = np.array([0.05, -0.02, 0.03])
    moved = made.camera.copy()
    moved[:, 3] -= made.camera[:, :3] @ way

    def seen(camera: Array, depth: float) -> Array:
        points = np.array([[0, 0, -depth, 1], [0.4, 0.1, -depth, 1], [-0.3, 0.2, -depth, 1]])
        image = points @ camera.T
        return np.asarray(image[:, :2] / image[:, 2:])

    wall, display = made.parallax(way)
    turn = seen(made.camera, 0.0)[0] - seen(moved, 0.0)[0]
    for motion, depth in ((display, 0.0), (wall, made.painted.depth)):
        expected = seen(moved, depth) + turn
        found = transform(motion, seen(made.camera, depth))
        np.testing.assert_allclose(found, expected, atol=SUBPIXEL_PX)
    still = made.parallax(np.zeros(3))
    for motion in still:
        np.testing.assert_allclose(motion / motion[2, 2], np.eye(3), atol=SUBPIXEL_PX)


def test_layers_of_a_camera_at_rest_are_the_room() -> None:
    flat = drawn(seed=5)
    deep = replace(flat, pair=with_parameter(flat.pair, "sway", 0.02))
    rng = np.random.default_rng
    (one,), two = (made.viewpoint(rng(0)).surroundings for made in (flat, deep))
    image, layered = (np.empty((180, 320, 3), np.float32) for _ in range(2))
    one.lay_over(image, None)
    for layer in two:
        layer.lay_over(layered, None)
    # the lens blurs the layers one by one, which differs a little where the wall has an edge
    np.testing.assert_allclose(layered, image, atol=0.01)
    assert np.abs(layered - image).mean() < 1e-4
