from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from tolerances import (
    FLOAT32,
    FLOAT64,
    IDENTITY_LEVELS,
    NOISE_RELATIVE,
    QUIET_TWIN_LEVELS,
    SUBPIXEL_PX,
)

import data_gen.camera
from data_gen.camera import RESPONSE_STEPS, expose, jpeg, response_curve
from data_gen.channel import capture
from data_gen.display import emitted_light
from data_gen.optics import (
    CAPTURE_HEIGHT,
    CAPTURE_WIDTH,
    FILL,
    MAX_VIEW_DEG,
    ROOM_LIGHT,
    Pose,
    draw_pose,
    image_of,
    jitter,
    project,
    view_angles,
    vignette,
)
from data_gen.pairs import CAMERAS, DISPLAYS, PAIRS, Camera, Pair, get_pair
from data_gen.pictures import load_pictures
from link.embed import embed
from link.errors import InputError
from link.frames import Captured, Displayed
from link.geometry import frame_corners, transform
from link.layout import Layout, make_layout

IDENTITY_CURVE = ((0.0, 0.0), (1.0, 1.0))
NO_CROSSTALK = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
QUIET = Camera(
    name="quiet",
    full_well_e=1e6,
    read_noise_e=0.0,
    white_level=1.0,
    tone_curve=IDENTITY_CURVE,
    blur_px=0.0,
    vignetting=0.0,
    jpeg_quality=100,
)
NOISY = replace(QUIET, full_well_e=500.0)


def linear(pixels: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Decode sRGB (IEC 61966-2-1): (..., 3) uint8 -> [0, 1]."""
    encoded = pixels / 255
    low, high = encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4
    return np.where(encoded <= 0.04045, low, high)


def encoded(light: NDArray[np.float64] | float) -> NDArray[np.float64]:
    """Encode as sRGB: [0, 1] -> gray levels, not rounded."""
    x = np.clip(light, 0, 1)
    return 255 * np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)


def even_light(*rgb: float) -> NDArray[np.float32]:
    return np.full((CAPTURE_HEIGHT, CAPTURE_WIDTH, 3), rgb if len(rgb) == 3 else rgb[0], np.float32)


@pytest.fixture
def no_jpeg(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(data_gen.camera, "jpeg", lambda pixels, quality: pixels)


@pytest.fixture(scope="module")
def displayed() -> Displayed:
    layout = make_layout()
    picture = load_pictures("test", layout.width, layout.height)[0].rgb
    bits = np.random.default_rng(0).integers(0, 2, layout.n_bits)
    return embed(picture, bits, layout, 5)


# Display: emitted light


def emitted(level: int, name: str, degrees: float) -> NDArray[np.float64]:
    """Light of one even pixel in R, G, B."""
    frame = np.full((1, 1, 3), level, np.uint8)
    return emitted_light(frame, DISPLAYS[name], np.full((1, 1), np.radians(degrees)))[0, 0]


@pytest.mark.parametrize("name", DISPLAYS)
def test_frontal_white_is_one_and_black_is_the_display_black(name: str) -> None:
    np.testing.assert_allclose(emitted(255, name, 0.0), 1.0, atol=FLOAT32)
    np.testing.assert_allclose(emitted(0, name, 0.0), DISPLAYS[name].black, atol=FLOAT32)


@pytest.mark.parametrize("name", DISPLAYS)
def test_white_falls_with_the_angle_and_black_never_goes_dark(name: str) -> None:
    white = np.array([emitted(255, name, degrees) for degrees in range(0, 80, 5)])
    black = np.array([emitted(0, name, degrees) for degrees in range(0, 80, 5)])
    assert np.all(np.diff(white, axis=0) < 0)
    assert np.all(black > 0)
    assert np.all(black < white)


def test_white_falls_faster_on_the_tn_than_on_the_ips_display() -> None:
    angles = range(0, 80, 5)
    tn = np.array([emitted(255, "samsung", degrees).sum() for degrees in angles])
    ips = np.array([emitted(255, "imac", degrees).sum() for degrees in angles])
    assert np.all(np.diff(tn / ips) < 0)


@pytest.mark.parametrize("degrees", [0.0, 30.0, 60.0, 75.0])
@pytest.mark.parametrize("name", DISPLAYS)
def test_light_rises_with_rho_up_to_the_clip_and_stays_there(name: str, degrees: float) -> None:
    ramp = np.repeat(np.arange(256, dtype=np.uint8)[None, :, None], 3, axis=2)
    theta = np.full(ramp.shape[:2], np.radians(degrees))
    light = emitted_light(ramp, DISPLAYS[name], theta)[0]
    last = int(255 * DISPLAYS[name].clip)
    assert np.all(np.diff(light[: last + 1], axis=0) > 0)
    assert np.ptp(light[last + 1 :], axis=0).max() < FLOAT32 if last < 255 else last == 255


# Optics: pose, projection, blur, vignetting


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


def pinhole(pose: Pose, points: NDArray[np.float64], width: int, height: int) -> NDArray:
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


@pytest.mark.parametrize(
    "pose",
    [
        Pose(0.0, 0.0, 0.0, 2.0),
        Pose(45.0, 0.0, 0.0, 2.5),
        Pose(-45.0, 2.0, -2.0, 3.0),
        Pose(30.0, -10.0, 5.0, 2.2),
        Pose(75.0, 1.5, 2.0, 2.0),
    ],
)
def test_project_agrees_with_explicit_pinhole_geometry(pose: Pose) -> None:
    points = np.vstack([frame_corners(512, 384), [[100.0, 50.0], [255.5, 191.5], [400.0, 333.0]]])
    H = project(pose, 512, 384)
    expected = pinhole(pose, points, 512, 384)
    np.testing.assert_allclose(transform(H, points), expected, atol=SUBPIXEL_PX)


def test_a_frontal_picture_lies_in_the_middle_and_fills_its_share() -> None:
    corners = transform(project(Pose(0.0, 0.0, 0.0, 2.0), 512, 384), frame_corners(512, 384))
    middle = [(CAPTURE_WIDTH - 1) / 2, (CAPTURE_HEIGHT - 1) / 2]
    np.testing.assert_allclose(corners.mean(axis=0), middle, atol=FLOAT64)
    np.testing.assert_allclose(np.ptp(corners[:, 0]), FILL * CAPTURE_WIDTH, atol=SUBPIXEL_PX)
    np.testing.assert_allclose(np.ptp(corners[:, 1]), FILL * CAPTURE_WIDTH * 0.75, atol=SUBPIXEL_PX)


@pytest.mark.parametrize("view", [20.0, 45.0, 75.0])
def test_the_edge_on_the_side_of_the_camera_appears_larger(view: float) -> None:
    def edges(pose: Pose) -> tuple[float, float]:
        corners = transform(project(pose, 512, 384), frame_corners(512, 384))
        left = float(np.linalg.norm(corners[3] - corners[0]))
        right = float(np.linalg.norm(corners[2] - corners[1]))
        return left, right

    left, right = edges(Pose(view, 0.0, 0.0, 2.0))
    assert right > left
    mirrored = edges(Pose(-view, 0.0, 0.0, 2.0))
    np.testing.assert_allclose(mirrored, (right, left), atol=SUBPIXEL_PX)


def test_drawn_poses_keep_to_what_is_promised_and_vary() -> None:
    rng = np.random.default_rng(0)
    poses = [draw_pose(30.0, rng) for _ in range(200)]
    assert all(abs(pose.view_deg - 30) <= 1 and abs(pose.pitch_deg) <= 2 for pose in poses)
    assert all(abs(pose.roll_deg) <= 2 and 2 <= pose.distance <= 3 for pose in poses)
    assert len({pose.distance for pose in poses}) == 200


def test_no_jitter_is_the_identity() -> None:
    np.testing.assert_allclose(jitter(0.0, np.random.default_rng(0)), np.eye(3), atol=FLOAT64)


def test_jitter_moves_the_centre_by_its_sigma_and_the_corner_by_the_same_order() -> None:
    rng = np.random.default_rng(0)
    points = np.array([[(CAPTURE_WIDTH - 1) / 2, (CAPTURE_HEIGHT - 1) / 2], [0.0, 0.0]])
    moves = np.array([transform(jitter(0.15, rng), points) - points for _ in range(2000)])
    centre, corner = np.sqrt((moves**2).mean(axis=0))  # (2,) each: along x and along y
    np.testing.assert_allclose(centre, 0.15, rtol=0.07)  # 2000 draws: 1.6 % standard error
    assert np.all(corner > 0.15)
    assert np.all(corner < 0.3)


def test_image_of_copies_the_display_under_the_identity() -> None:
    light = np.random.default_rng(0).random((48, 64, 3), np.float32)
    image = image_of(light, np.eye(3), 0.0)
    assert image.shape == (CAPTURE_HEIGHT, CAPTURE_WIDTH, 3)
    np.testing.assert_allclose(image[:48, :64], light, atol=FLOAT32)
    np.testing.assert_allclose(image[49:, :], ROOM_LIGHT, atol=FLOAT32)
    np.testing.assert_allclose(image[:, 65:], ROOM_LIGHT, atol=FLOAT32)


def test_image_of_averages_what_is_smaller_than_a_captured_pixel() -> None:
    board = np.indices((384, 512)).sum(axis=0) % 2  # sampled at every other pixel it would be even
    light = np.repeat(board[:, :, None], 3, axis=2).astype(np.float32)
    image = image_of(light, np.diag([0.5, 0.5, 1.0]), 0.0)[20:-20, 20:-20][:140, :200]
    np.testing.assert_allclose(image, 0.5, atol=0.01)


def test_blur_keeps_even_light_and_spreads_a_point() -> None:
    light = np.zeros((48, 64, 3), np.float32)
    light[24, 32] = 1.0
    point = image_of(light, np.eye(3), 0.8)[:48, :64]
    np.testing.assert_allclose(point[10:40, 10:50].sum(axis=(0, 1)), 1.0, atol=1e-3)
    assert point.max() < 0.3
    even = image_of(np.full((48, 64, 3), 0.5, np.float32), np.eye(3), 0.8)
    np.testing.assert_allclose(even[5:43, 5:59], 0.5, atol=FLOAT32)


def test_vignette_is_one_in_the_middle_and_loses_its_share_at_the_corners() -> None:
    field = vignette(0.3)
    assert field.shape == (CAPTURE_HEIGHT, CAPTURE_WIDTH)
    np.testing.assert_allclose(field[CAPTURE_HEIGHT // 2, CAPTURE_WIDTH // 2], 1.0, atol=FLOAT32)
    np.testing.assert_allclose(field[[0, 0, -1, -1], [0, -1, 0, -1]], 0.7, atol=FLOAT32)
    np.testing.assert_allclose(field, field[::-1, ::-1], atol=FLOAT32)
    assert np.all(np.diff(field[CAPTURE_HEIGHT // 2 :], axis=0) < 0)
    assert np.array_equal(vignette(0.0), np.ones_like(field))


# Camera: response, exposure, noise


@pytest.mark.parametrize("name", CAMERAS)
def test_response_rises_from_black_to_white(name: str) -> None:
    table = response_curve(CAMERAS[name].tone_curve)
    assert table.shape == (RESPONSE_STEPS + 1,)
    assert (table[0], table[-1]) == (0.0, 255.0)
    assert np.all(np.diff(table) >= 0)


def test_response_of_the_identity_tone_curve_is_srgb() -> None:
    table = response_curve(IDENTITY_CURVE)
    exposure = np.linspace(0, 1, RESPONSE_STEPS + 1)
    np.testing.assert_allclose(linear(table.astype(np.float64)), exposure, atol=FLOAT32)
    assert round(float(table[RESPONSE_STEPS // 2])) == 188  # as printed in tables of sRGB


@pytest.mark.usefixtures("no_jpeg")
def test_without_noise_and_jpeg_light_comes_back_up_to_rounding() -> None:
    levels = np.random.default_rng(0).integers(0, 256, (CAPTURE_HEIGHT, CAPTURE_WIDTH, 3))
    light = linear(levels.astype(np.uint8)).astype(np.float32)
    pixels = expose(light, QUIET, NO_CROSSTALK, 1.0, np.random.default_rng(1))
    assert pixels.dtype == np.uint8
    assert np.abs(pixels.astype(int) - levels).max() <= IDENTITY_LEVELS


def test_doubling_the_gain_doubles_the_signal_until_it_saturates() -> None:
    camera = replace(QUIET, white_level=0.15)
    for gain in (1.0, 2.0, 4.0, 8.0):
        pixels = expose(even_light(1.0), camera, NO_CROSSTALK, gain, np.random.default_rng(0))
        expected = encoded(0.15 * gain)  # 0.15, 0.3, 0.6, then saturated
        assert abs(float(pixels.mean()) - expected) <= IDENTITY_LEVELS
    assert pixels.min() == 255


@pytest.mark.usefixtures("no_jpeg")
def test_noise_variance_is_signal_over_full_well_plus_read_noise() -> None:
    camera = replace(NOISY, read_noise_e=20.0)
    signals = np.array([0.3, 0.4, 0.5, 0.6])
    variance = []
    for number, signal in enumerate(signals):
        rng = np.random.default_rng(number)
        variance.append(linear(expose(even_light(signal), camera, NO_CROSSTALK, 1.0, rng)).var())
    slope, intercept = np.polyfit(signals, variance, 1)
    np.testing.assert_allclose(slope, 1 / 500, rtol=NOISE_RELATIVE)
    np.testing.assert_allclose(intercept, (20 / 500) ** 2, rtol=NOISE_RELATIVE)


@pytest.mark.usefixtures("no_jpeg")
def test_gain_amplifies_the_noise_of_the_electrons_it_does_not_add() -> None:
    def variance(light: float, gain: float) -> float:
        rng = np.random.default_rng(0)
        return float(linear(expose(even_light(light), NOISY, NO_CROSSTALK, gain, rng)).var())

    ratio = variance(0.2, 2.0) / variance(0.4, 1.0)  # the same exposure
    np.testing.assert_allclose(ratio, 2.0, rtol=NOISE_RELATIVE)


@pytest.mark.parametrize("primary", [0, 1, 2])
def test_one_primary_reaches_every_channel_by_its_column_of_the_crosstalk(primary: int) -> None:
    M = get_pair("canon-lg").crosstalk
    light = even_light(*(float(c == primary) for c in range(3)))
    pixels = expose(light, QUIET, M, 1.0, np.random.default_rng(0))
    expected = encoded(np.array(M)[:, primary])
    # chroma passes through JPEG's integer colour transform, another level of rounding
    assert np.abs(pixels.mean(axis=(0, 1)) - expected).max() <= 2 * IDENTITY_LEVELS


def test_vignetting_darkens_the_corners_of_the_frame() -> None:
    camera = replace(QUIET, white_level=0.5, vignetting=0.4)
    pixels = expose(even_light(1.0), camera, NO_CROSSTALK, 1.0, np.random.default_rng(0))
    corner, centre = pixels[0, 0], pixels[CAPTURE_HEIGHT // 2, CAPTURE_WIDTH // 2]
    assert np.abs(corner - encoded(0.3)).max() <= 2 * IDENTITY_LEVELS
    assert np.abs(centre - encoded(0.5)).max() <= 2 * IDENTITY_LEVELS


def test_jpeg_keeps_even_frames_and_loses_more_at_lower_quality(displayed: Displayed) -> None:
    gray = np.full((32, 48, 3), 100, np.uint8)
    assert np.array_equal(jpeg(gray, 90), gray)
    frame = displayed.original.astype(int)
    errors = [np.abs(jpeg(displayed.original, q) - frame).mean() for q in (95, 80, 40)]
    assert 0 < errors[0] < errors[1] < errors[2]


# The whole channel


def inside(captured: Captured) -> bool:
    height, width = captured.original.shape[:2]
    high = [width - 0.5, height - 0.5]
    return bool((captured.corners >= -0.5).all() and (captured.corners <= high).all())


@pytest.mark.parametrize("view", [0.0, 45.0, 70.0])
@pytest.mark.parametrize("name", PAIRS)
def test_every_pair_films_the_picture_inside_the_image(
    name: str, view: float, displayed: Displayed
) -> None:
    captured = capture(displayed, get_pair(name), view, np.random.default_rng(3))
    shape = (CAPTURE_HEIGHT, CAPTURE_WIDTH, 3)
    assert captured.original.shape == captured.embedded.shape == shape
    assert captured.original.dtype == captured.embedded.dtype == np.uint8
    assert inside(captured)
    assert captured.bits is not None
    assert np.array_equal(captured.bits, displayed.bits)
    picture = captured.rectified().original
    assert np.mean(picture == 255) < 0.5  # metered: neither burnt out
    assert picture.std() > 10  # nor dark
    assert captured.original[:, :10].mean() < picture.mean()  # the room beside it is darker


def test_the_same_seed_gives_the_same_bytes_and_another_does_not(displayed: Displayed) -> None:
    pair = get_pair("nikon-imac")
    first, again, other = (
        capture(displayed, pair, 20.0, np.random.default_rng(seed)) for seed in (7, 7, 8)
    )
    assert first.original.tobytes() == again.original.tobytes()
    assert first.embedded.tobytes() == again.embedded.tobytes()
    assert np.array_equal(first.corners, again.corners)
    assert first.original.tobytes() != other.original.tobytes()
    assert not np.allclose(first.corners, other.corners)


def still(pair: Pair) -> Pair:
    camera = replace(pair.camera, full_well_e=1e6, read_noise_e=0.0)
    return replace(pair, camera=camera, drift=0.0, jitter_px=0.0)


@pytest.fixture(scope="module")
def empty() -> Displayed:
    """A message of zeros and no ratex: both frames show the same."""
    layout = Layout(8, 8, 512, 384, ())
    picture = load_pictures("test", layout.width, layout.height)[0].rgb
    return embed(picture, np.zeros(layout.n_bits, int), layout, 5)


@pytest.mark.usefixtures("no_jpeg")
@pytest.mark.parametrize("name", ["canon-samsung", "nikon-lg", "sony-imac"])
def test_without_drift_motion_noise_and_message_both_frames_agree(
    name: str, empty: Displayed
) -> None:
    captured = capture(empty, still(get_pair(name)), 30.0, np.random.default_rng(0))
    change = np.abs(captured.original.astype(int) - captured.embedded)
    assert change.max() <= QUIET_TWIN_LEVELS


def test_drift_changes_the_exposure_of_the_embedded_frame_alone(empty: Displayed) -> None:
    def levels(drift: float) -> list[float]:
        pair = replace(still(get_pair("sony-imac")), drift=drift)
        captured = capture(empty, pair, 0.0, np.random.default_rng(0))
        return [float(frame.mean()) for frame in (captured.original, captured.embedded)]

    steady, drifting = levels(0.0), levels(0.3)
    assert abs(steady[0] - drifting[0]) < 0.1
    assert abs(steady[1] - drifting[1]) > 2


def test_jitter_moves_the_embedded_frame_alone(empty: Displayed) -> None:
    def frames(jitter_px: float) -> Captured:
        pair = replace(still(get_pair("sony-imac")), jitter_px=jitter_px)
        return capture(empty, pair, 0.0, np.random.default_rng(0))

    steady, moved = frames(0.0), frames(3.0)
    assert np.array_equal(steady.original, moved.original)
    change = np.abs(moved.original.astype(int) - moved.embedded)
    assert change.max() > 50  # at an edge of the picture


def test_a_gray_picture_is_filmed_as_its_rgb_twin() -> None:
    layout = make_layout()
    gray = np.random.default_rng(0).integers(0, 256, (layout.height, layout.width), np.uint8)
    bits = np.ones(layout.n_bits, int)
    both = [
        capture(embed(frame, bits, layout, 5), PAIRS["canon-lg"], 10.0, np.random.default_rng(0))
        for frame in (gray, np.repeat(gray[:, :, None], 3, axis=2))
    ]
    assert np.array_equal(both[0].embedded, both[1].embedded)


@pytest.mark.parametrize("view", [89.0, -89.0, 90.0, 180.0, float("nan")])
def test_a_view_out_of_range_is_refused(view: float, displayed: Displayed) -> None:
    with pytest.raises(InputError, match="--view: need an angle within ±75 degrees"):
        capture(displayed, get_pair("canon-lg"), view, np.random.default_rng(0))


def test_the_refusal_quotes_the_angle_that_was_asked_for(displayed: Displayed) -> None:
    with pytest.raises(InputError, match=r"got 89$"):
        capture(displayed, get_pair("canon-lg"), 89.0, np.random.default_rng(0))


def test_the_largest_view_is_allowed_whatever_the_draw() -> None:
    for seed in range(20):
        pose = draw_pose(MAX_VIEW_DEG, np.random.default_rng(seed))
        assert abs(pose.view_deg - MAX_VIEW_DEG) <= 1


def test_a_tall_picture_is_filmed_whole_or_refused() -> None:
    layout = make_layout(width=384, height=512)
    picture = np.full((512, 384, 3), 128, np.uint8)
    tall = embed(picture, np.zeros(layout.n_bits, int), layout, 5)
    try:
        captured = capture(tall, get_pair("canon-lg"), 0.0, np.random.default_rng(0))
    except InputError:
        return
    assert inside(captured)
