"""A coded display is found, and its clock, by cameras of any rate; and noise is none."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import cases, exhaustive, slow
from pilot_films import filmed, leaving, without_a_side

from link.clock import DisplayClock, embedded_share
from link.layout import Layout, make_layout
from link.pilot_code import STATE_HZ, PilotCode
from link.pilots import pilot_centres, pilot_signs
from link.robust import MAD_TO_SIGMA
from link.types import Array
from receiver.pilots.code import MOST_STEPS, PHASES, SLOPES, CodeSearch, longest_delay
from receiver.pilots.search.pilot_search import PilotSearch
from receiver.pilots.signal import CLIPPED, LEAST_DEVIATION, LIMIT, NEAR
from receiver.timing.fit import ToggleWindow

CODE = PilotCode()
CODED = make_layout(24, 32, modulation="antipodal", pilots="auto", code=CODE)
PILOTS = make_layout(48, 64, modulation="antipodal", pilots="auto", code=CODE)
"""As many pilots as the preset hidden has."""


def seen_by(fps: float, clock: DisplayClock, frames: int, strength: float, seed: int) -> Array:
    """Values of `PILOTS`' pilots in the frames of a camera, with noise of 1."""
    rng, times = np.random.default_rng(seed), np.arange(frames) / fps
    numbers = [[clock.period, clock.start, clock.delay_x, clock.delay_y, clock.shutter]]
    shares = embedded_share(np.array(numbers), times, pilot_centres(PILOTS), CODE)[0].T
    toggles = strength * (2 * shares - 1) * pilot_signs(PILOTS)
    return np.asarray(toggles + rng.standard_normal((frames, PILOTS.pilots)))


@pytest.mark.parametrize("fps", [24.0, 30.0, 50.0, 60.0, 120.0])
@pytest.mark.parametrize("state_hz", [50.0, 60.0, 75.0, 120.0])
def test_the_clock_is_found_at_any_ratio_of_rates(fps: float, state_hz: float) -> None:
    """Within a state, with rows that are exposed in turn, and clocks that differ by 1 %."""
    frames = max(24, int(0.6 * fps))
    period = 1 / (1.007 * state_hz)
    clock = DisplayClock(period, -0.31, 0.0, 0.012, min(0.4 / fps, 0.7 * period))
    values = seen_by(fps, clock, frames, 1.0, seed=int(fps))
    times = np.arange(frames) / fps
    search = CodeSearch(CODE, pilot_signs(PILOTS), pilot_centres(PILOTS), times, fps)
    (lock,) = search.strongest(values)
    assert lock.evidence > 35
    assert 1 / lock.clock.period == pytest.approx(state_hz, rel=0.0101)
    middle = times.mean()
    apart = lock.clock.number(middle + lock.clock.centre) - clock.number(middle + clock.centre)
    assert abs((apart + CODE.period) % (2 * CODE.period) - CODE.period) < 1.0


def test_noise_brings_no_evidence() -> None:
    """Evidence e comes by chance once in exp(e) trials or less: in 200, hardly ever 8."""
    times = np.arange(24) / 30
    search = CodeSearch(CODE, pilot_signs(PILOTS), pilot_centres(PILOTS), times, 30.0)
    rng = np.random.default_rng(0)
    drift = np.linspace(0, 5, 24)[:, None] * rng.standard_normal(PILOTS.pilots)
    noise = [rng.standard_normal((24, PILOTS.pilots)) + drift for _ in range(200)]
    assert max(search.strongest(each)[0].evidence for each in noise) < 8


def apart_from_near_frames(series):
    """(T, n) series, each value less the mean of those within `NEAR` frames."""
    parts = (series[max(0, at - NEAR) : at + NEAR + 1] for at in range(len(series)))
    return series - np.array([part.mean(axis=0) for part in parts])


def test_evidence_is_what_a_regression_of_the_signs_says() -> None:
    clock = DisplayClock(1 / 60, 0.0, 0.0, 0.0, 0.008)
    values, times = seen_by(30.0, clock, 24, 1.0, seed=3), np.arange(24) / 30
    search = CodeSearch(CODE, pilot_signs(PILOTS), np.full((PILOTS.pilots, 2), 0.5), times, 30.0)
    (lock,) = search.strongest(values)
    numbers = [[lock.clock.period, lock.clock.start, 0.0, 0.0, lock.clock.shutter]]
    wave = embedded_share(np.array(numbers), times, np.zeros((1, 2)), CODE)[0, 0]
    wave, values = apart_from_near_frames(wave[:, None])[:, 0], apart_from_near_frames(values)
    values = values / (MAD_TO_SIGMA * np.median(np.abs(values), axis=0) + LEAST_DEVIATION)
    values = np.clip(values, -CLIPPED, CLIPPED)
    signs = pilot_signs(PILOTS)
    X = wave @ values
    X /= np.hypot(X, LIMIT * np.median(np.abs(X)))
    explained = np.corrcoef(np.append(X, -X), np.append(signs, -signs))
    chance = (PILOTS.pilots - 1) / 2 * np.log(1 - explained[0, 1] ** 2)
    tried = len(search.waves) * len(SLOPES)
    assert lock.evidence == pytest.approx(-chance - np.log(tried), rel=1e-3)


@cases((0.0056, -0.0146), slow(0.001, -0.0125), slow(-0.013, 0.006))
def test_a_clock_is_fitted_from_the_rough_delays_of_the_code(across: float, down: float) -> None:
    """A display may be written from the side, while the camera reads from the top."""
    clock = DisplayClock(1 / 59.6, 0.3, across, down, 1 / 60)
    values, times = seen_by(60.0, clock, 40, 2.0, seed=0), np.arange(40) / 60
    signs, places = pilot_signs(PILOTS), pilot_centres(PILOTS)
    (lock,) = CodeSearch(CODE, signs, places, times[:20], 60.0).strongest(values[:20])
    assert max(abs(lock.clock.delay_x), abs(lock.clock.delay_y)) <= longest_delay(1 / 60)
    window = ToggleWindow(times, values * signs, places, 60.0, CODE)
    rough = replace(lock.clock, start=lock.clock.start - window.middle)
    fit = window.follow(rough, rough=True).clock
    assert (fit.delay_x, fit.delay_y) == pytest.approx((across, down), abs=0.002)
    assert fit.period == pytest.approx(clock.period, rel=2e-3)


def found_in(
    layout: Layout,
    layouts: list[Layout],
    fps: float,
    hold: float,
    frames: int,
    leaves: bool = False,
):
    """Find a display in a film, perhaps one that leaves a turned image with a corner."""
    images, corners = filmed(layout, frames, seed=4, hold=hold)
    images, corners = leaving(images, corners) if leaves else (images, corners)
    finder = PilotSearch(layouts, fps)
    for number, image in enumerate(images):
        display = finder.push(np.repeat(image[:, :, None], 3, axis=2), number / fps)
        if display is not None:
            assert np.abs(display.corners - corners[number]).max() < 1.0
            return number, display
    return None


@pytest.mark.slow
@cases((30.0, 0.5), (120.0, 2))
def test_a_display_is_found_by_its_code(fps: float, hold: float) -> None:
    """At half the display's rate, too, where pilots without a code stand still.

    Some tenths of a second do not tell apart rates that differ by some per cent.
    """
    number, display = found_in(CODED, [CODED], fps, hold, 40)
    clock = display.clock
    assert display.layout.code == CODE
    assert 1 / clock.period == pytest.approx(fps / hold, rel=0.05)
    shown = clock.number(number / fps + clock.centre) - number / hold
    assert abs((shown + CODE.period) % (2 * CODE.period) - CODE.period) < 1.5


@pytest.mark.slow
def test_a_display_with_a_corner_out_of_view_is_found_as_soon_as_others() -> None:
    """By the edges that are in view; its top left corner lies some 40 pixels outside the image."""
    whole, partly = (found_in(CODED, [CODED], 60.0, 1, 40, leaves) for leaves in (False, True))
    assert partly[1].corners.min() < -35
    assert partly[0] <= whole[0] + 3  # frames, of 60 a second: a twentieth of a second


@pytest.mark.slow
@pytest.mark.parametrize("share", [exhaustive(0.05), 0.12])
def test_a_display_with_a_side_out_of_view_is_found(share: float) -> None:
    """By three sides, and by pilots where the fourth is; its corners lie outside the image."""
    images, corners = without_a_side(*filmed(CODED, 80, seed=4, hold=1), share)
    finder = PilotSearch([CODED], 60.0)
    for number, image in enumerate(images):
        display = finder.push(np.repeat(image[:, :, None], 3, axis=2), number / 60.0)
        if display is not None:
            break
    assert display is not None
    assert np.abs(display.corners - corners[number]).max() < 2.0


def test_a_gap_between_frames_does_not_multiply_the_clocks_that_are_tried() -> None:
    signs, places = pilot_signs(PILOTS), pilot_centres(PILOTS)
    search = CodeSearch(CODE, signs, places, np.array([0.0, 1.0, 18000.0]), 1.0, 30.0)
    most = len(STATE_HZ) * (2 * MOST_STEPS + 1) * 2 * PHASES * CODE.period
    assert len(search.waves) <= most
