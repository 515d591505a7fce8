from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from tolerances import FLOAT32, FLOAT64, PHASE_MEAN

from data_gen.channel.shutter import pwm_gain
from data_gen.pairs import PAIRS
from data_gen.parameters import Camera, Display

ROWS = 40
hz, duty, depth = st.floats(60, 1000), st.floats(0.05, 1.0), st.floats(0.0, 1.0)
shutter_s, readout_s, phase = st.floats(1e-3, 0.04), st.floats(0.0, 0.03), st.floats(0.0, 1.0)


def backlight(hz: float, duty: float, depth: float = 1.0) -> Display:
    return replace(PAIRS["sony-imac"].display, pwm_hz=hz, pwm_duty=duty, pwm_depth=depth)


def shutter(shutter_s: float, readout_s: float = 0.0) -> Camera:
    return replace(PAIRS["sony-imac"].camera, shutter_s=shutter_s, readout_s=readout_s)


def pulses(display: Display, camera: Camera, row: int, phase: float) -> float:
    """The same gain as a sum over the pulses of light that the open shutter overlaps, seconds."""
    period = 1 / display.pwm_hz
    opens = phase * period + row / ROWS * camera.readout_s
    closes = opens + camera.shutter_s
    lit = 0.0
    for k in range(int(closes / period) + 2):
        on, off = k * period, (k + display.pwm_duty) * period
        lit += max(0.0, min(closes, off) - max(opens, on))
    share = lit / (display.pwm_duty * camera.shutter_s)
    return 1 - display.pwm_depth + display.pwm_depth * share


@given(hz, duty, depth, shutter_s, readout_s, phase, st.integers(0, ROWS - 1))
def test_gain_counts_the_pulses_that_the_shutter_sees(
    hz: float, duty: float, depth: float, open_s: float, readout: float, phase: float, row: int
) -> None:
    display, camera = backlight(hz, duty, depth), shutter(open_s, readout)
    expected = pulses(display, camera, row, phase)
    assert pwm_gain(display, camera, ROWS, phase)[row] == pytest.approx(expected, abs=1e-4)


@given(st.integers(1, 10), duty, phase, st.floats(1e-3, 0.03), readout_s)
def test_whole_periods_give_even_light(
    periods: int, duty: float, phase: float, open_s: float, readout: float
) -> None:
    assume(30 <= periods / open_s <= 1e5)
    gain = pwm_gain(backlight(periods / open_s, duty), shutter(open_s, readout), ROWS, phase)
    np.testing.assert_allclose(gain, 1.0, atol=FLOAT32)


@pytest.mark.slow
@settings(max_examples=30)
@given(hz, duty, depth, shutter_s, readout_s)
def test_the_mean_over_phases_is_one(
    hz: float, duty: float, depth: float, open_s: float, readout: float
) -> None:
    display, camera = backlight(hz, duty, depth), shutter(open_s, readout)
    gains = [pwm_gain(display, camera, 3, number / 2000) for number in range(2000)]
    np.testing.assert_allclose(np.mean(gains, axis=0, dtype=np.float64), 1.0, atol=PHASE_MEAN)


@given(hz, duty, shutter_s, phase)
def test_a_global_shutter_has_no_bands(hz: float, duty: float, open_s: float, phase: float) -> None:
    gain = pwm_gain(backlight(hz, duty), shutter(open_s), ROWS, phase)
    assert np.ptp(gain) == 0


def test_a_rolling_shutter_has_a_band_for_each_period_of_its_readout() -> None:
    gain = pwm_gain(backlight(200.0, 0.5), shutter(1 / 800, 0.015), 600)  # three periods
    spectrum = np.abs(np.fft.rfft(gain - gain.mean()))
    assert np.argmax(spectrum) == 3
    assert np.ptp(gain) > 1


@given(hz, duty, shutter_s, readout_s, phase)
def test_a_lamp_that_glows_on_gives_even_light(
    hz: float, duty: float, open_s: float, readout: float, phase: float
) -> None:
    gain = pwm_gain(backlight(hz, duty, 0.0), shutter(open_s, readout), ROWS, phase)
    np.testing.assert_allclose(gain, 1.0, atol=FLOAT64)


@given(hz, duty, depth, shutter_s, phase)
def test_modulation_is_proportional_to_the_depth(
    hz: float, duty: float, depth: float, open_s: float, phase: float
) -> None:
    whole, part = (
        pwm_gain(backlight(hz, duty, share), shutter(open_s), 1, phase)[0] - 1
        for share in (1.0, depth)
    )
    assert part == pytest.approx(depth * whole, abs=FLOAT32)
