"""Moire against a brute-force oracle: finely drawn stripes, sampled as the mosaic samples them."""

import numpy as np
import pytest
from filming import only
from hypothesis import given
from hypothesis import strategies as st
from tolerances import FLOAT64, MOIRE_AMPLITUDE, MOIRE_MEAN

from data_gen.channel.moire import moire_gain
from data_gen.effects import with_parameter
from data_gen.pairs import PAIRS
from data_gen.parameters import Pair
from link.layout import make_layout
from link.types import Array

LAYOUT = make_layout()
SIZE = (768, 32)
NATIVE = 5.5  # sensor pixels a captured pixel
FINE = 16  # samples a sensor pixel
PAIR = with_parameter(only("canon-imac", "moire", "crosstalk"), "native_width", int(768 * NATIVE))
COLUMNS = 1080 / 384  # of the panel a display pixel


def frontal(frequency: float) -> Array:
    """Scaling under which a sensor pixel spans ``frequency`` panel columns."""
    scale = COLUMNS / (frequency * NATIVE)
    return np.diag([scale, scale, 1.0])


def gain_row(pair: Pair, frequency: float, channel: int) -> Array:
    gain = moire_gain(pair, LAYOUT, frontal(frequency), SIZE)
    return gain[16, :, channel].astype(np.float64)


def sampled_row(pair: Pair, frequency: float, channel: int) -> Array:
    """Light at the sensor's R, G or B pixels of a row: stripes, blur, aperture, mosaic."""
    edge = frequency * (np.arange(int(SIZE[0] * NATIVE) * FINE + 1) / FINE - 0.5)  # columns
    phase = edge[:, None] - np.arange(3) / 3 + 1 / 6  # of each primary's stripe, a third wide
    lit = np.floor(phase) / 3 + np.minimum(phase % 1, 1 / 3)
    light = 3 * FINE / frequency * np.diff(lit, axis=0) @ np.array(pair.crosstalk)[channel]
    sigma, reach = pair.camera.native_blur_px * FINE, 6 * FINE
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    blurred = np.convolve(light, kernel / kernel.sum(), mode="same")
    pixels = blurred.reshape(-1, FINE).mean(axis=1)
    inner = np.pad(pixels[10:-10], 10, mode="wrap")  # without the ends, where the blur lacks light
    return np.asarray((inner[0::2], inner, inner[1::2])[channel])


def peak(row: Array, spacing: float) -> tuple[float, float]:
    """Frequency, cycles per captured pixel, and amplitude of the strongest wave below 0.5."""
    window = np.hanning(len(row))
    spectrum = np.abs(np.fft.rfft((row - row.mean()) * window, 8 * len(row)))
    frequency = np.fft.rfftfreq(8 * len(row), spacing)
    spectrum[frequency > 0.5] = 0
    best = int(spectrum.argmax())
    return float(frequency[best]), float(2 * spectrum[best] / window.sum())


@pytest.mark.parametrize("frequency", [0.465, 0.48, 0.49, 0.51, 0.52])
@pytest.mark.parametrize("channel", [0, 2])
def test_red_and_blue_modulation_is_that_of_sampled_stripes(channel: int, frequency: float) -> None:
    found, amplitude = peak(gain_row(PAIR, frequency, channel), 1.0)
    expected, sampled = peak(sampled_row(PAIR, frequency, channel), 2 / NATIVE)
    predicted = abs(frequency - 0.5) * NATIVE
    assert found == pytest.approx(predicted, abs=0.5 / SIZE[0])
    assert found == pytest.approx(expected, abs=0.5 / SIZE[0])
    reduction = np.exp(-2 * (np.pi * 0.5 * predicted) ** 2)
    assert amplitude == pytest.approx(sampled * reduction, rel=MOIRE_AMPLITUDE)


def test_green_samples_every_pixel_and_so_sees_no_moire_at_half_a_cycle() -> None:
    assert peak(sampled_row(PAIR, 0.49, 1), 1 / NATIVE)[1] < 0.01
    assert np.ptp(gain_row(PAIR, 0.49, 1)) < 0.01
    assert np.ptp(gain_row(PAIR, 0.49, 0)) > 0.05


def test_green_beats_with_columns_near_one_a_pixel() -> None:
    pair = with_parameter(PAIR, "native_blur_px", 0.0)
    found, _ = peak(gain_row(pair, 0.97, 1), 1.0)
    assert found == pytest.approx(0.03 * NATIVE, abs=0.5 / SIZE[0])


def test_red_and_blue_of_one_light_beat_in_opposition_as_their_columns_alternate() -> None:
    mixed = ((0.6, 0.3, 0.1),) * 3  # every channel sees the same stripes
    pair = with_parameter(PAIR, "crosstalk", mixed)
    for row in (sampled_row, gain_row):
        red, blue = (row(pair, 0.49, channel) for channel in (0, 2))
        assert np.corrcoef(red, blue)[0, 1] < -0.9


@given(st.sampled_from(sorted(PAIRS)), st.floats(0.7, 1.4), st.floats(-0.03, 0.03))
def test_the_mean_is_about_one(name: str, scale: float, tilt: float) -> None:
    H = np.array([[scale, tilt, 3.0], [-tilt, scale, 5.0], [tilt / 1e3, 0.0, 1.0]])
    gain = moire_gain(PAIRS[name], LAYOUT, H, (768, 96))
    assert gain.shape == (96, 768, 3)
    assert gain.min() >= 0
    np.testing.assert_allclose(gain.mean(axis=(0, 1)), 1.0, atol=MOIRE_MEAN)


def test_without_contrast_there_is_no_moire() -> None:
    flat = with_parameter(PAIR, "grid_contrast", 0.0)
    assert np.array_equal(gain_row(flat, 0.49, 0), np.ones(SIZE[0]))


def test_amplitude_falls_with_the_blur_as_its_transfer_does() -> None:
    blurs = (0.3, 0.6, 0.9)
    rows = [gain_row(with_parameter(PAIR, "native_blur_px", blur), 0.49, 0) for blur in blurs]
    found = np.array([np.ptp(row) for row in rows])
    transfer = np.exp(-2 * (np.pi * 0.49 * np.array(blurs)) ** 2)
    np.testing.assert_allclose(found / found[0], transfer / transfer[0], rtol=1e-3)


def test_a_camera_that_sees_all_primaries_alike_sees_no_stripes() -> None:
    alike = with_parameter(PAIR, "crosstalk", ((1 / 3, 1 / 3, 1 / 3),) * 3)
    np.testing.assert_allclose(gain_row(alike, 0.49, 0), 1.0, atol=FLOAT64)


def test_stripes_finer_than_the_sensor_can_show_leave_no_trace() -> None:
    assert np.ptp(gain_row(PAIR, 0.25, 0)) < 0.01  # the alias is averaged by the reduction
