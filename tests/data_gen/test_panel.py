"""Panels in time: dither, refreshes, response by level, scan and pulses, against sums over time."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tolerances import FLOAT32, PHASE_MEAN

from data_gen.channel.panel import LEAST_SHARE, Panel, dithered
from data_gen.pairs import PAIRS, TODAY
from data_gen.parameters import SCANS, Display
from link.types import Floats, Image

SIZE = 64, 48
STEADY = replace(
    PAIRS["canon-lg"].display, scan="none", rise_s=(0, 0, 0), fall_s=(0, 0, 0), pwm_depth=0.0
)


def pictures(levels: list[int]) -> list[Image]:
    return [np.full((SIZE[1], SIZE[0], 3), level, np.uint8) for level in levels]


def exposed(
    display: Display, levels: list[int], state_hz: float, opens: float, shutter_s: float
) -> tuple[Floats, dict[int, float]]:
    """Mean level, (H, W), of a panel whose light is its level, and the states' shares."""
    states = pictures(levels)
    panel = Panel(
        display,
        SIZE,
        lambda number: states[number % len(states)],
        lambda picture: picture.astype(np.float32),
        state_hz,
        0.25,
    )
    times = np.full(panel.points.shape[:2], opens)
    light, shares = panel.exposed(times, shutter_s)
    return np.asarray(light[:, :, 1]), shares


@given(st.integers(0, 255), st.sampled_from([1, 2]))
def test_dithered_levels_have_the_right_mean_over_turns_and_over_a_block(
    level: int, bits: int
) -> None:
    picture = pictures([level])[0]
    turns = np.array([dithered(picture, bits, turn) for turn in range(4)], np.float64)
    steps = 2**bits
    top = 255 // steps
    wanted = min(level / steps, top) * 255 / top
    np.testing.assert_allclose(turns.mean(axis=0), wanted, atol=0.5)  # the panel's own rounding
    blocks = turns[:, 4:6, 8:10].mean(axis=(1, 2))
    np.testing.assert_allclose(blocks, wanted, atol=0.5)
    assert len(np.unique(turns)) <= 2


def test_a_state_is_held_for_whole_refreshes() -> None:
    # 60 refreshes of 25 states: state 1 begins with refresh 3, at 1/20 s and not at 1/25 s
    level, shares = exposed(STEADY, [0, 100, 0, 100], 25.0, 0.045, 0.01)
    assert level.max() == pytest.approx(50, abs=0.1)
    assert shares == pytest.approx({0: 0.5, 1: 0.5}, abs=1e-6)


def test_a_panel_refreshes_as_often_as_states_come() -> None:
    level, _ = exposed(STEADY, [0, 100], 240.0, 1 / 240, 1 / 240)
    assert level.min() == pytest.approx(100, abs=0.1)


@settings(max_examples=30)
@given(
    st.lists(st.integers(0, 255), min_size=3, max_size=3),
    st.floats(0.05, 0.2),
    st.floats(0.002, 0.03),
)
def test_the_response_is_that_of_a_sum_over_time(
    levels: list[int], opens: float, shutter_s: float
) -> None:
    """The oracle adds up the changes of three states, each with the constants of its level."""
    slow, fast = 0.012, 0.005
    display = replace(STEADY, rise_s=(0.012, 0.009, 0.006), fall_s=(0.008, 0.006, 0.005))
    found, shares = exposed(display, levels, 30.0, opens, shutter_s)
    t = opens + (np.arange(4000) + 0.5) / 4000 * shutter_s
    light = np.full_like(t, float(levels[0]))
    for refresh in range(-60, 60):  # of 60 a second; two to a state
        before, now = (levels[(k // 2) % 3] for k in (refresh - 1, refresh))
        if refresh == -60:
            light[:] = now
            continue
        table = display.rise_s if now >= before else display.fall_s
        own = np.interp(round((before + now) / 2), (0, 128, 255), table)
        share = (slow - own) / (slow - fast)
        lag = np.maximum(t - refresh / 60, 0.0)
        step = share * -np.expm1(-lag / fast) + (1 - share) * -np.expm1(-lag / slow)
        light += (now - before) * step
    np.testing.assert_allclose(found, light.mean(), atol=255 * LEAST_SHARE + 1.0)
    assert sum(shares.values()) == pytest.approx(1.0, abs=1e-5)


@pytest.mark.parametrize("scan", SCANS)
def test_the_scan_runs_in_its_order(scan: str) -> None:
    level, _ = exposed(replace(STEADY, scan=scan), [0, 100], 60.0, 1 / 60, 1 / 60)
    rows, cols = level.mean(axis=1), level.mean(axis=0)
    for name, profile in (
        ("down", rows), ("up", rows[::-1]), ("right", cols), ("left", cols[::-1])
    ):  # fmt: skip
        # what is written first shows the second state for the whole exposure
        falls = profile[0] - profile[-1] > 50
        assert falls == (scan == name)
    assert scan != "none" or np.ptp(level) == 0


def test_pulses_of_an_oled_run_with_its_scan_and_those_of_a_backlight_do_not() -> None:
    pulsed = replace(STEADY, pwm_hz=240.0, pwm_duty=0.5, pwm_depth=1.0, scan="down")
    lamp, _ = exposed(pulsed, [100], 60.0, 0.1, 1 / 960)
    oled, _ = exposed(replace(pulsed, pwm_scans=True), [100], 60.0, 0.1, 1 / 960)
    assert np.ptp(lamp) < 1e-3
    assert np.ptp(oled) > 100
    whole, _ = exposed(replace(pulsed, pwm_scans=True), [100], 60.0, 0.1, 1 / 240)
    np.testing.assert_allclose(whole, 100, atol=100 * PHASE_MEAN)


def test_a_laptop_shows_a_steady_picture_as_it_is() -> None:
    level, shares = exposed(TODAY["phone-laptop"].display, [77], 15.0, 0.3, 1 / 60)
    np.testing.assert_allclose(level, 77, rtol=4 * FLOAT32)
    assert sum(shares.values()) == pytest.approx(1.0)


def test_a_fast_fall_after_a_slow_rise_ends_no_darker_than_dark() -> None:
    level, _ = exposed(TODAY["phone-tv"].display, [0, 0, 255], 60.0, 0.0786, 0.004)
    assert level.min() == 0
