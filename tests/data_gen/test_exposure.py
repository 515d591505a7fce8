"""Automatic exposure: the light that it wants, how shutter and ISO share it, and how fast."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from data_gen.film.exposure import BRIGHTEST_LEVEL, MEAN_LEVEL, MOST_ISO, ExposureProgram
from data_gen.pairs import get_pair

PHONE = replace(get_pair("phone-tv").camera, anti_banding_hz=0.0)


def settled(program: ExposureProgram, light: float, frames: int = 6) -> None:
    """Let the program meter an even scene whose light fills this share of the sensor at gain 1."""
    for _ in range(frames):
        gain = program.exposure().gain
        program.meter(np.full((64, 96, 3), min(1.0, light * gain), np.float32), gain)
        program.step(5.0)


@given(st.floats(1e-3, 50))
def test_an_even_scene_comes_to_the_mean_level_or_to_the_end_of_the_range(light: float) -> None:
    program = ExposureProgram(PHONE, 300.0, 30.0, None)
    settled(program, light, 40)
    now = program.exposure()
    reached = light * now.gain
    if 1.0 < now.iso < MOST_ISO or 1e-4 < now.shutter_s < 1 / 30 - 1e-6:
        assert reached == pytest.approx(MEAN_LEVEL, rel=1e-3)
    assert 1.0 <= now.iso <= MOST_ISO
    assert now.shutter_s <= 1 / 30 + 1e-9
    assert now.iso == 1.0 or now.shutter_s == pytest.approx(1 / 30)


def test_white_fills_the_share_of_iso_12232() -> None:
    """0.65 L t / N^2 * S / 78 of 300 cd/m^2, 1/120 s, f/1.8, ISO 50: 0.32 of saturation."""
    program = ExposureProgram(PHONE, 300.0, 30.0, 1 / 120)
    white = PHONE.white_level * program.gain_of(1 / 120, 1.0)
    assert white == pytest.approx(0.65 * 300 / 120 / 1.8**2 * 50 / 78, rel=1e-6)
    assert white == pytest.approx(0.32, abs=0.005)


def test_bright_parts_are_not_saturated() -> None:
    program = ExposureProgram(PHONE, 300.0, 30.0, None)
    scene = np.full((64, 96, 3), 0.001, np.float32)
    scene[:16] = 0.5
    for _ in range(10):
        gain = program.exposure().gain
        program.meter(np.minimum(scene * np.float32(gain), 1), gain)
        program.step(5.0)
    assert 0.5 * program.exposure().gain == pytest.approx(BRIGHTEST_LEVEL, rel=1e-3)


@pytest.mark.parametrize("hz", [100.0, 120.0])
@given(st.floats(0.005, 20))
def test_beside_lamps_the_shutter_is_a_whole_number_of_their_periods(
    hz: float, light: float
) -> None:
    program = ExposureProgram(replace(PHONE, anti_banding_hz=hz), 300.0, 30.0, None)
    settled(program, light, 20)
    periods = program.exposure().shutter_s * hz
    assert periods < 1 or periods == pytest.approx(round(periods), abs=1e-6)


def test_a_chosen_shutter_stays_and_the_iso_follows() -> None:
    program = ExposureProgram(PHONE, 300.0, 60.0, 1 / 500)
    settled(program, 0.05)
    now = program.exposure()
    assert now.shutter_s == 1 / 500
    assert now.iso > 2
    assert 0.05 * now.gain == pytest.approx(MEAN_LEVEL, rel=1e-3)
    assert ExposureProgram(PHONE, 300.0, 60.0, 0.5).exposure().shutter_s == 1 / 60


def test_the_exposure_follows_smoothly() -> None:
    program = ExposureProgram(PHONE, 300.0, 30.0, None)
    settled(program, 0.2)
    before = program.exposure().gain
    program.meter(np.full((64, 96, 3), min(1, 0.4 * before), np.float32), before)
    gains = []
    for _ in range(15):
        program.step(1 / 30)
        gains.append(program.exposure().gain)
    assert (np.diff([before, *gains]) < 0).all()
    assert gains[0] > 0.85 * before
    assert gains[-1] == pytest.approx(before / 2, rel=0.1)


def test_a_shorter_exposure_chosen_by_the_program_is_as_noisy_as_its_iso_says() -> None:
    """The full well stays that of the lowest ISO; the frame's amplification makes the noise."""
    assert PHONE.filming(240.0).full_well_e == PHONE.full_well_e
    assert PHONE.filming(240.0, 1 / 1000).full_well_e == PHONE.full_well_e
    assert PHONE.filming(240.0).readout_s == 1 / 240
    fixed = replace(PHONE, auto_exposure=False)
    assert fixed.filming(240.0).full_well_e == pytest.approx(PHONE.full_well_e / 4)
