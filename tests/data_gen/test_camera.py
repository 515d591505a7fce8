from dataclasses import replace

import numpy as np
import pytest
from filming import CAMERAS, PLAIN, develop_plainly, even_light, scene
from hypothesis import given
from hypothesis import strategies as st
from tolerances import DEMOSAIC_RAMP, FLOAT32, IDENTITY_LEVELS, NOISE_RELATIVE

from data_gen.channel.camera import RESPONSE_STEPS, collect, develop, jpeg, response_curve
from data_gen.effects import EFFECTS
from data_gen.pairs import PAIRS
from data_gen.parameters import IDENTITY, Camera
from link.types import Array, Floats

LINEAR = EFFECTS["transfer"]["tone_curve"]
NOISY = replace(PLAIN, read_noise_e=20.0)
BIG = 768, 576
EXPOSURE = np.linspace(0, 1, RESPONSE_STEPS + 1)
signals = st.floats(0.0, 0.5)


def file_of(light: Floats, camera: Camera = PLAIN) -> Array:
    """Developed without noise, in [0, 255]."""
    return develop(light, camera, np.random.default_rng(0), 0.0).astype(np.float64)


def raw_of(light: Floats, camera: Camera, scale: float = 1.0, iso: float = 1.0) -> Array:
    """Developed with noise, in [0, 1]: without tone curve, so linear."""
    return develop(light, camera, np.random.default_rng(3), scale, iso) / 255.0


def flat(signal: float) -> Floats:
    return np.full((BIG[1], BIG[0], 3), signal, np.float32)


# Response


def test_the_linear_response_is_the_identity() -> None:
    np.testing.assert_allclose(response_curve(LINEAR, "linear") / 255, EXPOSURE, atol=FLOAT32)


def test_the_srgb_response_is_that_of_the_standard() -> None:
    table = response_curve(LINEAR, "srgb") / np.float64(255)
    low, high = table / 12.92, ((table + 0.055) / 1.055) ** 2.4
    decoded = np.where(table <= 0.04045, low, high)
    np.testing.assert_allclose(decoded, EXPOSURE, atol=FLOAT32)
    assert round(255 * float(table[RESPONSE_STEPS // 2])) == 188  # as printed in tables of sRGB


@pytest.mark.parametrize("encoding", ["srgb", "linear"])
@pytest.mark.parametrize("name", CAMERAS)
def test_response_rises_from_black_to_white_through_its_nodes(name: str, encoding: str) -> None:
    curve = CAMERAS[name].tone_curve
    table = response_curve(curve, encoding)
    assert table.shape == (RESPONSE_STEPS + 1,)
    assert table[0] == 0
    assert table[-1] == pytest.approx(255, abs=255 * FLOAT32)
    assert np.all(np.diff(table) >= 0)
    assert np.all(np.diff(table[:: RESPONSE_STEPS // 255]) > 0)
    at_nodes = np.interp([x for x, _ in curve], EXPOSURE, table)
    if encoding == "linear":
        np.testing.assert_allclose(at_nodes / 255, [y for _, y in curve], atol=1e-4)


@given(st.lists(st.tuples(st.floats(0.01, 0.99), st.floats(0.01, 0.99)), min_size=1, max_size=6))
def test_every_increasing_tone_curve_gives_an_increasing_response(
    nodes: list[tuple[float, float]],
) -> None:
    x, y = (sorted({round(value, 2) for value in axis}) for axis in zip(*nodes, strict=True))
    curve = ((0.0, 0.0), *zip(x, y, strict=False), (1.0, 1.0))
    table = response_curve(curve)
    assert np.all(np.diff(table) >= 0)
    assert (table.min(), round(float(table.max()), 3)) == (0, 255)


# Exposure


@given(signals, st.floats(0.05, 1.0))
def test_doubling_the_exposure_doubles_the_signal(signal: float, white_level: float) -> None:
    camera = replace(PLAIN, white_level=white_level)
    for gain in (1.0, 2.0, 4.0, 64.0):
        light = collect(even_light(signal), camera, IDENTITY, gain)
        np.testing.assert_allclose(light, signal * white_level * gain, rtol=FLOAT32, atol=FLOAT32)


@given(st.floats(0.0, 1.0))
def test_a_plain_camera_stores_255_times_the_exposure(signal: float) -> None:
    assert np.abs(file_of(even_light(signal)) - 255 * signal).max() <= 0.5 + 255 * FLOAT32


@pytest.mark.parametrize("name", PAIRS)
@pytest.mark.parametrize("primary", [0, 1, 2])
def test_one_primary_reaches_every_channel_by_its_column_of_the_crosstalk(
    primary: int, name: str
) -> None:
    M = np.array(PAIRS[name].crosstalk)
    light = even_light(*(float(c == primary) for c in range(3)))
    collected = collect(light, replace(PLAIN, white_level=0.5), PAIRS[name].crosstalk)
    np.testing.assert_allclose(collected[3, 5], 0.5 * M[:, primary], atol=FLOAT32)


def test_a_field_of_gains_scales_each_pixel() -> None:
    gain = np.random.default_rng(0).random((96, 128, 3), np.float32)
    np.testing.assert_allclose(collect(even_light(0.5), PLAIN, IDENTITY, gain), 0.5 * gain)


# Noise


def test_noise_variance_grows_linearly_with_the_signal() -> None:
    points = np.array([0.3, 0.4, 0.5, 0.6])
    variance = [raw_of(flat(point), NOISY).var() for point in points]
    slope, offset = np.polyfit(points, variance, 1)
    assert slope == pytest.approx(1 / 500, rel=NOISE_RELATIVE)
    assert offset == pytest.approx((20 / 500) ** 2, rel=0.05)  # from 0.3 back to 0
    assert np.ptp(np.polyval((slope, offset), points) - variance) < 0.02 * variance[0]


def test_noise_scale_scales_the_standard_deviation() -> None:
    once, half = (raw_of(flat(0.5), NOISY, scale) - 0.5 for scale in (1.0, 0.5))
    assert half.std() == pytest.approx(once.std() / 2, rel=NOISE_RELATIVE)
    assert np.abs(half - once / 2).max() < 1 / 255  # the same draws


def test_amplification_costs_electrons() -> None:
    camera = replace(PLAIN, full_well_e=2000.0)
    usual, four = (raw_of(flat(0.5), camera, iso=iso).var() for iso in (1.0, 4.0))
    assert four == pytest.approx(4 * usual, rel=NOISE_RELATIVE)


def test_noise_is_independent_between_pixels_and_channels() -> None:
    noise = raw_of(flat(0.5), NOISY) - 0.5
    for other in (np.roll(noise, 1, axis=0), np.roll(noise, 1, axis=1), np.roll(noise, 1, axis=2)):
        assert abs(np.corrcoef(noise.ravel(), other.ravel())[0, 1]) < 0.005  # 1.3 million: 0.0009


# Mosaic


@given(st.tuples(st.floats(0, 1), st.floats(0, 1), st.floats(0, 1)))
def test_mosaic_and_demosaicing_leave_an_even_colour(rgb: tuple[float, float, float]) -> None:
    developed = file_of(even_light(*rgb), replace(PLAIN, bayer=True))
    assert np.abs(developed - 255 * np.array(rgb)).max() <= 0.5 + 255 * DEMOSAIC_RAMP
    assert np.ptp(developed, axis=(0, 1)).max() <= IDENTITY_LEVELS


@pytest.mark.parametrize("size", [(96, 128), (95, 127), (17, 16)])
@pytest.mark.parametrize("slope", [(1.0, 0.0), (0.0, 1.0), (0.6, 0.4), (0.5, -0.5)])
def test_mosaic_and_demosaicing_recover_a_ramp(
    slope: tuple[float, float], size: tuple[int, int]
) -> None:
    y, x = np.mgrid[-0.5 : 0.5 : size[0] * 1j, -0.5 : 0.5 : size[1] * 1j]
    ramp = 0.5 + 0.8 * (slope[0] * x + slope[1] * y)
    light = np.stack([ramp, 0.9 * ramp, 0.5 * ramp], axis=2).astype(np.float32)
    developed = file_of(light, replace(PLAIN, bayer=True))
    assert developed.shape == light.shape
    error = np.abs(developed - 255 * light)[2:-2, 2:-2]
    assert error.max() <= IDENTITY_LEVELS


def test_the_mosaic_takes_red_first() -> None:
    red = np.zeros((16, 16, 3), np.float32)
    red[0::2, 0::2, 0] = 1.0  # red light where RGGB has its red pixels, and nowhere else
    developed = file_of(red, replace(PLAIN, bayer=True))[4:-4, 4:-4]
    np.testing.assert_allclose(developed, np.broadcast_to([255.0, 0, 0], developed.shape), atol=1)


# Colour, sharpening, JPEG


@pytest.mark.parametrize("name", CAMERAS)
@given(signal=st.floats(0.0, 1.0))
def test_the_colour_matrix_keeps_gray(name: str, signal: float) -> None:
    camera = develop_plainly(CAMERAS[name])
    gray = file_of(even_light(signal), camera)
    identity = file_of(even_light(signal), replace(camera, color_matrix=IDENTITY))
    assert np.abs(gray - identity).max() <= IDENTITY_LEVELS


@pytest.mark.parametrize("name", CAMERAS)
def test_the_colour_matrix_makes_colours_stronger(name: str) -> None:
    camera = replace(PLAIN, color_matrix=CAMERAS[name].color_matrix)
    rgb = np.array([0.4, 0.5, 0.45])
    expected = 255 * np.array(camera.color_matrix) @ rgb
    developed = file_of(even_light(*rgb), camera)[0, 0]
    assert np.abs(developed - expected).max() <= 0.5 + 255 * FLOAT32
    assert np.ptp(developed) > 255 * np.ptp(rgb)


@given(st.floats(0.0, 1.0), st.floats(0.0, 3.0))
def test_sharpening_leaves_even_fields(signal: float, amount: float) -> None:
    sharp = file_of(even_light(signal), replace(PLAIN, sharpening=amount))
    assert np.abs(sharp - 255 * signal).max() <= 0.5 + 255 * FLOAT32


@given(st.floats(0.1, 1.0))
def test_sharpening_overshoots_on_both_sides_of_an_edge(amount: float) -> None:
    step = np.repeat(np.where(np.arange(128) < 64, 0.4, 0.6).astype(np.float32)[None], 96, axis=0)
    row = file_of(np.dstack([step] * 3), replace(PLAIN, sharpening=amount))[40, :, 1]
    assert row[63] < 102 - 10 * amount
    assert row[64] > 153 + 10 * amount
    assert (row[50], row[80]) == (102, 153)


def test_jpeg_keeps_even_frames_and_loses_more_at_lower_quality() -> None:
    gray = np.full((32, 48, 3), 100, np.uint8)
    assert np.array_equal(jpeg(gray, 90), gray)
    frame = scene().original
    errors = [np.abs(jpeg(frame, q).astype(int) - frame).mean() for q in (95, 80, 40)]
    assert 0 < errors[0] < errors[1] < errors[2]


def test_quality_0_stores_without_loss_and_another_as_jpeg_does() -> None:
    frame = scene().original
    light = (frame / np.float32(255)).astype(np.float32)
    assert np.array_equal(file_of(light), frame)
    assert np.array_equal(file_of(light, replace(PLAIN, jpeg_quality=70)), jpeg(frame, 70))


def test_jpeg_keeps_red_red() -> None:
    red = np.full((32, 48, 3), (200, 30, 40), np.uint8)
    assert np.abs(jpeg(red, 95).astype(int) - red).max() <= 2 * IDENTITY_LEVELS
