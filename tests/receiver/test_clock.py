"""The display's clock from the toggles of the patches, and states from camera frames."""

from dataclasses import astuple, replace
from itertools import pairwise

import numpy as np
import pytest
from conftest import cases, slow
from numpy.typing import ArrayLike
from streams import seen_frame

from link.clock import DisplayClock, embedded_share
from link.embed import embed
from link.layout import make_layout
from link.pilot_code import PilotCode
from link.ratex import match_patches
from link.types import Array
from receiver.reading.states import compose_state
from receiver.seen import SeenFrames
from receiver.timing.fit import ToggleWindow
from receiver.timing.synchronise import (
    AWAY_S,
    HOLD_S,
    MIN_TOGGLE,
    WINDOW_S,
    Synchroniser,
    needed_evidence,
)
from receiver.timing.toggles import PatchToggles, patch_toggles

PATCHES = PatchToggles(make_layout())
PLACES = PATCHES.places


def test_shares_of_an_exposure_over_a_change() -> None:
    clock = DisplayClock(period=0.1, start=0.0, delay_x=0.0, delay_y=0.02, shutter=0.04)
    places = np.array([[0.3, 0.0], [0.9, 0.5], [0.1, 1.0]])
    # exposed from 0.08, 0.09 and 0.10 s on, for 0.04 s; the state changes at 0.1 s
    assert clock.shares(0.08, places, 0) == pytest.approx([0.5, 0.25, 0.0])
    assert clock.shares(0.08, places, 1) == pytest.approx([0.5, 0.75, 1.0])
    assert clock.shares(0.08, places, 2) == pytest.approx([0, 0, 0])
    total = embedded_share(np.array([astuple(clock)]), np.array([0.08]), places)
    assert total[0, :, 0] == pytest.approx([0.5, 0.75, 1.0])


def test_shares_of_all_states_add_to_one() -> None:
    clock = DisplayClock(period=0.021, start=0.4, delay_x=-0.01, delay_y=0.03, shutter=0.031)
    for time in np.linspace(0, 1, 11):
        first = int(np.floor(clock.number(time)))
        total = sum(clock.shares(time, PLACES, state) for state in range(first - 2, first + 6))
        assert total == pytest.approx(np.ones(5))


def test_the_toggle_is_kappa_between_the_frames_and_blind_to_exposure() -> None:
    layout = make_layout()
    rng = np.random.default_rng(0)
    picture = np.full((layout.height, layout.width), 128, np.uint8)
    shown = embed(picture, rng.integers(0, 2, layout.n_bits), layout, 5)
    before, after = (
        patch_toggles(match_patches(frame, layout)) for frame in (shown.original, shown.embedded)
    )
    assert after - before == pytest.approx(np.full(5, 5.0), abs=0.15)
    brighter = (1.1 * shown.original.astype(float)).clip(0, 255).astype(np.uint8)
    assert patch_toggles(match_patches(brighter, layout)) == pytest.approx(before, abs=0.3)
    covered = shown.embedded.copy()
    covered[: layout.height // 8, : layout.width // 8] = 90
    hidden = np.isnan(patch_toggles(match_patches(covered, layout)))
    assert hidden.tolist() == [True, False, False, False, False]


@cases(
    (30, 10.07, (0.0, 0.015)),
    (30, 15.1, (0.004, -0.012)),
    (60, 15.0, (0.012, 0.0)),
)
def test_the_clock_is_found_in_noisy_toggles(
    fps: float, state_hz: float, delays: tuple[float, float]
) -> None:
    rng = np.random.default_rng(1)
    true = DisplayClock(1 / state_hz, 0.123, *delays, 0.5 / fps)
    sync = Synchroniser(fps, PATCHES)
    times = np.arange(int(4 * fps)) / fps
    wave = embedded_share(np.array([astuple(true)]), times, PLACES)[0].T
    listen(sync, times, 3 * wave + rng.normal(0, 0.4, wave.shape) + [1, 5, -3, 0, 2])
    assert sync.clock is not None
    assert sync._fit is not None and sync._fit[0].r2 > 0.8
    assert sync.clock.period == pytest.approx(true.period, rel=0.004)
    error = (sync.clock.number(3.0) - true.number(3.0) + 1) % 2 - 1
    assert abs(error) < 0.2


@pytest.mark.slow
def test_states_keep_their_numbers_for_a_minute() -> None:
    rng = np.random.default_rng(2)
    true = DisplayClock(1 / 15.1, 0.123, 0.002, 0.01, 0.016)
    seen, sync = SeenFrames(), Synchroniser(30, PATCHES)
    offsets, slips = [], 0
    for number in range(60 * 30):
        time = number / 30
        wave = embedded_share(np.array([astuple(true)]), np.array([time]), PLACES)[0, :, 0]
        seen.toggles.append((time, 3 * wave + rng.normal(0, 0.4, 5)))
        sync.update(seen.toggles, time)
        if time == 5:
            slips = sync.slips
        if time > 5 and sync.clock is not None:
            offsets.append(sync.clock.number(time) - true.number(time))
    assert sync.slips == slips
    assert np.ptp(offsets) < 0.5


def toggles_of(
    clock: DisplayClock,
    times: Array,
    rng: np.random.Generator,
    amplitude: float,
    noise: ArrayLike,
    correlation: ArrayLike = 0.0,
) -> Array:
    """Toggles (n, 5) of a clock in noise, correlated from frame to frame, of each place."""
    wave = embedded_share(np.array([astuple(clock)]), times, PLACES)[0].T
    left = rng.normal(size=wave.shape)
    for before, after in pairwise(range(len(times))):
        left[after] *= np.sqrt(1 - np.square(correlation))
        left[after] += correlation * left[before]
    return np.asarray(amplitude * wave + noise * left)


def test_a_perfect_wave_is_explained_wholly_and_its_opposite_not_at_all() -> None:
    clock = DisplayClock(0.0913, 0.01, 0.01, -0.01, 0.02)
    times = np.arange(60) / 30
    rng = np.random.default_rng(4)
    wave = toggles_of(clock, times, rng, 3.0, 1e-3)
    for sign in (1, -1):
        window = ToggleWindow(times, sign * wave, PLACES, 30)
        fit = window.follow(replace(clock, start=clock.start - window.middle))
        if sign == 1:
            assert fit.r2 == pytest.approx(1, abs=1e-3)
            assert fit.amplitude == pytest.approx(3, abs=0.01)
            found = replace(fit.clock, start=fit.clock.start + window.middle)
            assert astuple(found) == pytest.approx(astuple(clock), abs=5e-4)
        else:
            shift = (fit.clock.start + window.middle - clock.start) / clock.period
            assert fit.amplitude == 0 or abs((shift + 1) % 2 - 1) > 0.5


TRUE = DisplayClock(1 / 14.93, 0.123, 0.004, -0.012, 0.016)
CODEC = np.array([0.65, 0.65, 0.0, 0.0, 0.3])


@pytest.mark.parametrize("seed", range(4))
def test_a_clock_is_followed_whose_exposures_are_as_long_as_frames(seed: int) -> None:
    """Held upside down, so that the delays of camera and panel add up to more than a frame."""
    code, rng = PilotCode(), np.random.default_rng(seed)
    clock = DisplayClock(1 / 60.3, 0.01 * seed, -0.001, -0.021, 1 / 120)
    places = np.stack(np.meshgrid(*2 * [np.arange(4) / 4 + 0.125]), axis=-1).reshape(-1, 2)
    times = np.arange(115) / 120
    wave = embedded_share(np.array([astuple(clock)]), times, places, code)[0].T
    window = ToggleWindow(times, 1.3 * wave + 0.4 * rng.normal(size=wave.shape), places, 120, code)
    true = replace(clock, start=clock.start - window.middle)
    # as a search for the code tells it: the rate to 0.5 %, the delays to some milliseconds
    known = replace(true, period=1.005 * true.period, delay_x=0.0025, delay_y=-0.0145)
    number = true.number(clock.centre)
    start = known.centre - known.period * number
    fit = window.follow(replace(known, start=start))
    assert fit.evidence > window.follow(true).evidence - 10
    assert fit.clock.delay_y == pytest.approx(clock.delay_y, abs=0.002)
    assert fit.clock.period == pytest.approx(clock.period, rel=0.001)


def listen(sync: Synchroniser, times: Array, toggles: Array) -> list[DisplayClock | None]:
    """Give the toggles frame by frame; the clock after each."""
    seen, clocks = SeenFrames(), []
    for time, values in zip(times, toggles, strict=True):
        seen.toggles.append((time, values))
        sync.update(seen.toggles, time)
        clocks.append(sync.clock)
    return clocks


def offset(clock: DisplayClock | None, time: float) -> float:
    """States by which a clock is ahead of the true one, as the display's centre is seen."""
    seen = clock.number(time + clock.centre)
    return seen - TRUE.number(time + TRUE.centre)


@pytest.mark.parametrize("state_hz", [2.1, 14.93, slow(24.1)])
def test_a_weak_clock_is_found_beside_drift_and_unequal_noise_that_lasts(state_hz: float) -> None:
    """A clock that explains a tenth to a third of the variance, as on compressed films."""
    rng = np.random.default_rng(8)
    true = replace(TRUE, period=1 / state_hz)
    times = np.arange(121) / 30
    deviation = np.array([1.4, 1.1, 0.5, 0.7, 0.4])
    toggles = toggles_of(true, times, rng, 1.0, deviation, CODEC)
    toggles += np.outer(np.sin(2 * np.pi * 0.15 * times), [2, -1, 1, 0, 3])
    fit = ToggleWindow(times, toggles, PLACES, 30).search()
    assert fit.evidence > needed_evidence(4.0, 30)
    assert fit.clock.period == pytest.approx(true.period, rel=0.01)
    assert fit.amplitude == pytest.approx(1, abs=0.25)
    assert fit.noise.deviation[0] > 2 * fit.noise.deviation[4]
    assert fit.noise.correlation[:2].min() > 0.4 > fit.noise.correlation[2:4].max()


def test_a_wave_that_one_place_alone_shows_is_no_clock() -> None:
    rng = np.random.default_rng(9)
    times = np.arange(121) / 30
    toggles = toggles_of(TRUE, times, rng, 3.0, 0.4)
    toggles[:, 1:] = rng.normal(0, 0.4, toggles[:, 1:].shape)
    fit = ToggleWindow(times, toggles, PLACES, 30).search()
    assert fit.evidence < needed_evidence(4.0, 30)


@cases(
    (0.0, 0.0), (0.0, CODEC), (0.0, 0.95), (5.0, 0.0), ids=["noise", "codec", "slow", "shuffled"]
)
def test_no_clock_is_found_where_there_is_none(amplitude: float, correlation: ArrayLike) -> None:
    """In a window of each length through which the receiver's grow."""
    rng = np.random.default_rng(16)
    for seconds in (1.0, 1.5, 2.0, 3.0, WINDOW_S):
        times = np.arange(int(seconds * 30) + 1) / 30
        deviation = np.exp(rng.normal(0, 0.5, 5))
        toggles = toggles_of(TRUE, times, rng, amplitude, deviation, correlation)
        toggles = rng.permutation(toggles) if amplitude else toggles
        fit = ToggleWindow(times, toggles, PLACES, 30).search()
        assert fit.evidence < 0.8 * needed_evidence(seconds, 30)


def test_more_evidence_is_needed_the_more_clocks_are_tried() -> None:
    needed = [needed_evidence(*at) for at in ((1.0, 30.0), (4.0, 30.0), (4.0, 60.0), (4.0, 240.0))]
    assert needed == sorted(needed)
    assert 40 < needed[0] < needed[-1] < 55


@pytest.mark.slow
def test_a_known_clock_runs_on_through_a_weak_spell_and_states_keep_their_numbers() -> None:
    rng = np.random.default_rng(10)
    times = np.arange(10 * 30) / 30
    toggles = toggles_of(TRUE, times, rng, 3.0, 0.4)
    weak = (times > 3) & (times < 7.5)
    toggles[weak] = rng.normal(0, 1.5, toggles[weak].shape)
    sync = Synchroniser(30, PATCHES)
    clocks = listen(sync, times, toggles)
    locked = next(k for k, clock in enumerate(clocks) if clock is not None)
    assert times[locked] < 1.1
    assert all(clock is not None for clock in clocks[locked:])
    assert sync.slips == 1
    offsets = [offset(clocks[k], times[k]) for k in range(locked + 30, len(times))]
    assert np.ptp(offsets) < 0.6
    assert abs((np.median(offsets) + 1) % 2 - 1) < 0.1


def test_a_display_out_of_view_for_a_while_keeps_its_clock() -> None:
    rng = np.random.default_rng(11)
    times = np.arange(14 * 30) / 30
    toggles = toggles_of(TRUE, times, rng, 3.0, 0.4)
    seen = (times < 5) | (times > 8)
    sync = Synchroniser(30, PATCHES)
    clocks = listen(sync, times[seen], toggles[seen])
    assert sync.slips == 1
    assert abs((offset(clocks[-1], times[-1]) + 1) % 2 - 1) < 0.1
    before, after = offset(clocks[140], times[140]), offset(clocks[-1], times[-1])
    assert before == pytest.approx(after, abs=0.3)


def test_a_display_that_starts_anew_while_it_is_out_of_view_is_read_soon() -> None:
    """As where a camera's film begins again; what was seen before does not fit any more."""
    rng = np.random.default_rng(14)
    times = np.arange(9 * 30) / 30
    late = replace(TRUE, start=TRUE.start + 1.1 * TRUE.period)
    before, after = (toggles_of(clock, times, rng, 3.0, 0.4) for clock in (TRUE, late))
    seen = (times < 5) | (times > 5 + 1.5 * AWAY_S)
    toggles = np.where(times[:, None] < 5, before, after)
    sync = Synchroniser(30, PATCHES)
    clocks = listen(sync, times[seen], toggles[seen])
    ahead = [offset(clock, time) for clock, time in zip(clocks[30:], times[seen][30:], strict=True)]
    apart = np.abs((np.array(ahead) + 1.1 + 1) % 2 - 1)
    wrong = times[seen][30:][apart > 0.2]
    assert wrong.max() < 5 + 1.5 * AWAY_S + 1.6


@pytest.mark.slow
def test_a_clock_that_nothing_confirms_ends_and_the_next_is_a_new_run() -> None:
    rng = np.random.default_rng(12)
    times = np.arange(22 * 30) / 30
    toggles = toggles_of(TRUE, times, rng, 3.0, 0.4)
    weak = (times > 5) & (times < 5 + HOLD_S + WINDOW_S + 2)
    toggles[weak] = rng.normal(0, 1.5, toggles[weak].shape)
    sync = Synchroniser(30, PATCHES)
    clocks = listen(sync, times, toggles)
    without = [
        time for time, clock in zip(times, clocks, strict=True) if clock is None and time > 5
    ]
    assert without
    assert 5 + HOLD_S <= min(without) <= 5 + HOLD_S + WINDOW_S
    assert sync.clock is not None
    assert sync.slips == 2


def test_the_strongest_toggling_is_kept_where_no_clock_is_found() -> None:
    rng = np.random.default_rng(14)
    times = np.arange(60) / 30
    noisy, still = Synchroniser(30, PATCHES), Synchroniser(30, PATCHES)
    listen(noisy, times, rng.normal(0, 1, (60, 5)))
    listen(still, times, rng.normal(3, 0.02, (60, 5)))
    assert 0.1 < noisy.best.strength < 0.75
    assert (still.best.strength, still.best.deviation < MIN_TOGGLE) == (0, True)


def test_a_state_is_put_together_from_the_pure_parts_of_two_frames() -> None:
    layout = make_layout()
    clock = DisplayClock(period=0.1, start=0.0, delay_x=0.0, delay_y=0.1, shutter=0.001)
    # state 1 lasts from 0.1 to 0.2 s: the lower half of the first frame, the upper of the second
    early, late = (
        seen_frame(time, np.full((layout.height, layout.width), level, np.uint8))
        for time, level in ((0.05, 100), (0.15, 200))
    )
    state = compose_state([early, late], clock, 1)
    assert state.purity.min() > 0.99
    upper, lower = state.image[: layout.height // 3], state.image[-layout.height // 3 :]
    assert (upper == 200).all()
    assert (lower == 100).all()
    assert compose_state([early, late], clock, 5) is None
