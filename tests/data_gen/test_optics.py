import numpy as np
import pytest
from conftest import cases
from hypothesis import given
from hypothesis import strategies as st
from tolerances import FLOAT32, SUBPIXEL_PX

from data_gen.channel.optics import (
    CAPTURE_HEIGHT,
    CAPTURE_WIDTH,
    FILL,
    SURROUNDINGS,
    Pose,
    draw_pose,
    image_of,
    project,
    residual_motion,
    view_angles,
)
from link.geometry import frame_corners, transform
from link.types import Array

SIZE = (CAPTURE_WIDTH, CAPTURE_HEIGHT)


@pytest.mark.parametrize("view", [-60.0, 0.0, 20.0, 75.0])
def test_the_angle_at_the_centre_is_that_of_the_pose(view: float) -> None:
    angles = view_angles(Pose(view, 0.0, 0.0, 2.5), 65, 49)
    np.testing.assert_allclose(angles[24, 32], np.radians(abs(view)), atol=1e-3)


def test_pitch_and_view_combine_at_the_centre() -> None:
    angles = view_angles(Pose(40.0, 15.0, 0.0, 2.5), 65, 49)
    expected = np.arccos(np.cos(np.radians(40)) * np.cos(np.radians(15)))
    np.testing.assert_allclose(angles[24, 32], expected, atol=FLOAT32)


def test_the_far_edge_is_seen_at_a_wider_angle() -> None:
    angles = view_angles(Pose(45.0, 0.0, 0.0, 2.0), 64, 48)  # the camera stands to the right
    assert np.all(np.diff(angles, axis=1) < 0)


def pinhole(pose: Pose, points: Array, width: int, height: int) -> Array:
    """Project display pixels (N, 2) by explicit 3-D geometry, without a homography."""
    world = np.zeros((len(points), 3))  # x right, y down, z towards the camera, width 1
    world[:, :2] = (points - [(width - 1) / 2, (height - 1) / 2]) / width
    view, pitch = np.radians([pose.view_deg, pose.pitch_deg])
    out = np.array([np.cos(pitch) * np.sin(view), -np.sin(pitch), np.cos(pitch) * np.cos(view)])
    forward = -out
    right = np.array([-forward[2], 0.0, forward[0]])  # horizontal, across the line of sight
    right /= np.linalg.norm(right)
    down = np.array([0.0, 1.0, 0.0])
    down -= (down @ forward) * forward  # what is left of the vertical across the line of sight
    down /= np.linalg.norm(down)
    ray = world - pose.distance * out
    depth = ray @ forward
    x, y = ray @ right / depth, ray @ down / depth
    roll = np.radians(pose.roll_deg)
    x, y = np.cos(roll) * x + np.sin(roll) * y, np.cos(roll) * y - np.sin(roll) * x
    focal = FILL * CAPTURE_WIDTH * pose.distance  # frontal, a width of 1 covers FILL of the image
    centre = [(CAPTURE_WIDTH - 1) / 2, (CAPTURE_HEIGHT - 1) / 2]
    return focal * np.column_stack([x, y]) + centre


@cases(
    Pose(0.0, 0.0, 0.0, 2.0),
    Pose(-45.0, 2.0, -2.0, 3.0),
    Pose(75.0, 1.5, 2.0, 2.0),
)
def test_project_agrees_with_explicit_pinhole_geometry(pose: Pose) -> None:
    points = np.vstack([frame_corners(512, 384), [[100.0, 50.0], [255.5, 191.5], [400.0, 333.0]]])
    H = project(pose, 512, 384)
    expected = pinhole(pose, points, 512, 384)
    np.testing.assert_allclose(transform(H, points), expected, atol=SUBPIXEL_PX)


def test_drawn_poses_keep_to_what_is_promised_and_vary() -> None:
    rng = np.random.default_rng(0)
    poses = [draw_pose(30.0, rng) for _ in range(200)]
    assert all(abs(pose.view_deg - 30) <= 1 and abs(pose.pitch_deg) <= 2 for pose in poses)
    assert all(abs(pose.roll_deg) <= 2 and 2 <= pose.distance <= 3 for pose in poses)
    assert len({pose.distance for pose in poses}) == 200


@cases((512, 384), (384, 512), (800, 200), (256, 256))
@given(view=st.floats(-76, 76), pitch=st.floats(-2, 2), roll=st.floats(-2, 2), far=st.floats(2, 3))
def test_a_picture_of_any_shape_lies_inside_the_image(
    width: int, height: int, view: float, pitch: float, roll: float, far: float
) -> None:
    H = project(Pose(view, pitch, roll, far), width, height)
    corners = transform(H, frame_corners(width, height))
    assert np.all(corners > 0)
    assert np.all(corners < np.array(SIZE) - 1)


def test_no_jitter_and_no_breathing_is_the_identity() -> None:
    assert np.array_equal(residual_motion(0.0, 0.0, SIZE, np.random.default_rng(0)), np.eye(3))


@pytest.mark.parametrize("size", [SIZE, (128, 96)])
def test_jitter_moves_the_centre_by_its_sigma_and_the_corner_by_the_same_order(
    size: tuple[int, int],
) -> None:
    rng = np.random.default_rng(0)
    points = np.array([[(size[0] - 1) / 2, (size[1] - 1) / 2], [0.0, 0.0]])
    moves = [transform(residual_motion(0.15, 0.0, size, rng), points) - points for _ in range(2000)]
    centre, corner = np.sqrt(np.square(moves).mean(axis=0))  # (2,) each: along x and along y
    np.testing.assert_allclose(centre, 0.15, rtol=0.07)  # 2000 draws: 1.6 % standard error
    assert np.all(corner > 0.15)
    assert np.all(corner < 0.3)


def test_breathing_scales_about_the_centre_by_its_sigma() -> None:
    rng = np.random.default_rng(0)
    moves = [residual_motion(0.0, 0.01, SIZE, rng) for _ in range(2000)]
    middle = np.array([[(CAPTURE_WIDTH - 1) / 2, (CAPTURE_HEIGHT - 1) / 2]])
    assert all(np.allclose(transform(move, middle), middle) for move in moves)
    assert all(move[0, 1] == move[1, 0] == 0 and move[0, 0] == move[1, 1] for move in moves)
    assert np.std([move[0, 0] - 1 for move in moves]) == pytest.approx(0.01, rel=0.07)


def test_image_of_copies_the_display_under_the_identity() -> None:
    light = np.random.default_rng(0).random((48, 64, 3), np.float32)
    assert np.array_equal(image_of(light, np.eye(3), 0.0, (64, 48)), light)
    image = image_of(light, np.eye(3), 0.0, SIZE)
    assert image.shape == (CAPTURE_HEIGHT, CAPTURE_WIDTH, 3)
    assert np.array_equal(image[:48, :64], light)
    np.testing.assert_allclose(image[49:, :], SURROUNDINGS, atol=FLOAT32)
    np.testing.assert_allclose(image[:, 65:], SURROUNDINGS, atol=FLOAT32)


@pytest.mark.parametrize("scale", [(0.5, 0.5), (0.5, 1.0), (1.0, 0.5)])
def test_image_of_averages_what_is_smaller_than_a_captured_pixel(
    scale: tuple[float, float],
) -> None:
    y, x = np.indices((384, 512))  # stripes that sampled at every other pixel would be even
    board = (x * (scale[0] < 1) + y * (scale[1] < 1)) % 2
    light = np.repeat(board[:, :, None], 3, axis=2).astype(np.float32)
    image = image_of(light, np.diag([*scale, 1.0]), 0.0, (256, 192))
    np.testing.assert_allclose(image[20:-20, 20:-20], 0.5, atol=0.03)  # Gaussian: 0.025


def test_blur_keeps_even_light_and_spreads_a_point_by_its_sigma() -> None:
    light = np.zeros((49, 65, 3), np.float32)
    light[24, 32] = 1.0
    point = image_of(light, np.eye(3), 1.5, (65, 49))[:, :, 0].astype(np.float64)
    y, x = np.indices(point.shape)
    assert point.sum() == pytest.approx(1.0, abs=1e-3)
    for offset in (x - 32, y - 24):
        assert np.sqrt((point * offset**2).sum()) == pytest.approx(1.5, rel=0.02)
    even = image_of(np.full((49, 65, 3), 0.5, np.float32), np.eye(3), 1.5, (65, 49))
    np.testing.assert_allclose(even, 0.5, atol=FLOAT32)
