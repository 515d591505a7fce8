"""Visibility: the model of the eye, the light of a display over time, and its pages."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import cases
from hypothesis import given
from hypothesis import strategies as st

from link.errors import InputError
from sender.visibility.elatcsf import (
    POOLING_EXPONENT,
    THRESHOLD_ENERGY,
    flicker_sensitivity,
    spot_sensitivity,
)
from sender.visibility.flicker import (
    contrast_over_threshold,
    flicker_spectrum,
    random_message,
    stroboscopic_visibility,
)
from sender.visibility.viewing import Viewing

AUTHORS = [
    (0, 2, 0.8, 0.6, 3.75, 112.091),
    (0, 2, 48.0, 28.0, 60, 2.23818),
    (0, 20, 1.5, 1.2, 30, 22.3676),
    (0, 100, 6.0, 3.5, 15, 247.655),
    (0, 100, 48.0, 28.0, 7.5, 586.776),
    (0, 300, 0.8, 0.6, 60, 1.62169),
    (10, 2, 0.8, 0.6, 60, 0.118239),
    (10, 20, 48.0, 28.0, 15, 394.26),
    (10, 100, 1.5, 1.2, 3.75, 58.7106),
    (10, 300, 6.0, 3.5, 30, 78.5628),
]
"""Sensitivities of rectangles by the code of elaTCSF's authors (https://github.com/gfxdisp/elaTCSF,
MIT licence): eccentricity, luminance, width, height, frequency, sensitivity."""
FINE = Viewing(rows=48, cols=64, kappa=1)
ONE_GAZE = replace(FINE, gazes_deg=(0.0,))


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def message_visibility(viewing, code, rng, seconds, where="block"):
    shown = random_message(viewing, code, rng, seconds)
    return contrast_over_threshold(shown, viewing, where).mean()


# The eye


@pytest.mark.parametrize("row", AUTHORS, ids=str)
def test_sensitivities_are_those_of_the_authors(row: tuple[float, ...]) -> None:
    eccentricity, luminance, width, height, hz, expected = row
    found = flicker_sensitivity(hz, luminance, width, height, eccentricity)
    assert found[0] == pytest.approx(expected, rel=2e-5)


@pytest.mark.parametrize("eccentricity", [0.0, 1.0, 12.0])
def test_the_integral_is_that_of_many_small_squares(eccentricity: float) -> None:
    width, height, count = 6.0, 3.0, 600
    x = eccentricity + ((np.arange(count) + 0.5) / count - 0.5) * width
    y = ((np.arange(count) + 0.5) / count - 0.5) * height
    spots = spot_sensitivity(np.hypot(x[:, None], y), 50.0, 20.0)
    energy = (spots**POOLING_EXPONENT).sum() * width * height / count**2
    expected = (energy / THRESHOLD_ENERGY) ** (1 / POOLING_EXPONENT)
    found = flicker_sensitivity(20.0, 50.0, width, height, eccentricity)[0]
    assert found == pytest.approx(expected, rel=1e-5)


def test_a_small_square_is_its_spot_times_the_root_of_its_area() -> None:
    side = 0.01
    spot = spot_sensitivity(0.0, 50.0, 12.0)
    expected = spot * (side**2 / THRESHOLD_ENERGY) ** (1 / POOLING_EXPONENT)
    assert flicker_sensitivity(12.0, 50.0, side, side)[0] == pytest.approx(
        float(expected), rel=1e-3
    )


# The light


@given(st.lists(st.floats(-1, 1), min_size=2, max_size=40), st.floats(10, 200))
def test_parseval_over_all_frequencies(values: list[float], sample_hz: float) -> None:
    """Half the sum of the squared amplitudes is the variance of the held light."""
    samples = np.array(values)
    _, amplitudes = flicker_spectrum(samples, sample_hz, 4000 * sample_hz)
    assert np.square(amplitudes).sum() / 2 == pytest.approx(samples.var(), rel=1e-3, abs=1e-9)


def test_a_held_square_wave_has_its_odd_harmonics() -> None:
    hz, amplitudes = flicker_spectrum(np.tile([1, 1, -1, -1], 10), 60, 100)
    found = dict(zip(hz.round(6), amplitudes, strict=True))
    for odd in (1, 3, 5):
        assert found[15.0 * odd] == pytest.approx(4 / np.pi / odd)
    assert sum(amplitudes > 1e-9) == 3


def test_light_is_that_of_the_standard_curve() -> None:
    dark, white = Viewing().light([0, 255])
    assert (dark, white) == pytest.approx((0.6, 200.4))


def test_degrees_of_blocks_and_screen() -> None:
    square = Viewing(rows=2, cols=2, aspect=1, diagonal_inch=2**0.5 / 0.0254, distance_m=0.5)
    assert square.degrees("screen") == pytest.approx((90, 90))
    assert square.degrees("block")[0] == pytest.approx(2 * np.degrees(np.arctan(0.5)))


# A sequence


def test_a_sine_is_its_contrast_times_its_sensitivity() -> None:
    """A sine at 10 Hz, finely sampled, and so small that the display's curve is straight."""
    view = replace(ONE_GAZE, kappa=0.01, refresh_hz=600, states_hz=600)
    amplitudes = 0.5 * np.sin(2 * np.pi * 10 * np.arange(600) / 600)
    seen = contrast_over_threshold(amplitudes, view)
    mean, half = view.light(128), np.ptp(view.light([127.995, 128.005])) / 2
    sensitivity = flicker_sensitivity(10.0, float(f"{mean:.3g}"), *view.degrees("block"))[0]
    expected = half / mean * sensitivity * np.sinc(10 / 600)
    np.testing.assert_allclose(seen, expected, rtol=1e-4)


@cases((50, 0.0), (100, 1 / 0.260), (400, 1 / 0.522))
def test_moving_eyes_see_a_sine_by_the_thresholds_of_iec_tr_63158(hz: int, over: float) -> None:
    view = replace(ONE_GAZE, kappa=0.01, refresh_hz=6000, states_hz=6000)
    sine = 0.5 * np.sin(2 * np.pi * hz * np.arange(6000) / 6000)
    contrast = np.ptp(view.light([127.995, 128.005])) / 2 / view.light(128) * np.sinc(hz / 6000)
    assert stroboscopic_visibility(sine, view) == pytest.approx(contrast * over, rel=2e-3, abs=1e-8)


def test_the_gaze_that_sees_most_counts() -> None:
    gazes = (0.0, 4.0, 10.0)
    shown = np.tile([-0.5, 0.5], 30)
    alone = [contrast_over_threshold(shown, replace(FINE, gazes_deg=(g,))).mean() for g in gazes]
    together = contrast_over_threshold(shown, replace(FINE, gazes_deg=gazes)).mean()
    assert together == max(alone) > alone[0]


def test_all_blocks_in_phase_are_more_visible_than_one() -> None:
    one, all_of_them = (
        message_visibility(FINE, "antipodal", rng(), 4, where) for where in ("block", "screen")
    )
    assert all_of_them > 2 * one


def test_a_short_sequence_is_refused() -> None:
    with pytest.raises(InputError, match="shorter than one window"):
        contrast_over_threshold(np.zeros(29), FINE)


@cases((8, 8, 30, 7.8, 7.6, 9.5), (8, 8, 60, 1.95, 5.6, 5.5),
     (48, 64, 30, 3.0, 3.0, 3.8), (48, 64, 60, 0.67, 2.2, 2.2),
)  # fmt: skip
def test_messages_are_as_visible_as_an_independent_computation_found(
    rows: int, cols: int, states_hz: int, square: float, on_off: float, toggle: float
) -> None:
    """Numbers of another program, for kappa 3, random messages and the same display, to 6 %."""
    view = Viewing(rows, cols, 3, states_hz)
    waves = contrast_over_threshold(np.tile(np.repeat([0, 1], view.refreshes), 300), view)
    assert waves.mean() == pytest.approx(square, rel=0.07)
    assert message_visibility(view, "on_off", rng(), 60) == pytest.approx(on_off, rel=0.06)
    assert message_visibility(view, "antipodal", rng(), 60) == pytest.approx(toggle, rel=0.06)
