"""The page finds the display's clock in the toggles in which Python finds it."""

from dataclasses import astuple, replace

import numpy as np
import pytest
from port import same
from streams import seen_frame
from tolerances import CLOCK_EVIDENCE, CLOCK_STATE, FITTED, FLOAT32_SUM, FLOAT64, SAME_STEPS

from link.clock import DisplayClock, embedded_share
from link.embed import embed
from link.pilot_code import PilotCode
from link.pilots import pilot_centres, pilot_signs
from link.presets import PRESETS
from receiver.seen import SeenFrames
from receiver.timing.fit import ToggleWindow
from receiver.timing.synchronise import AWAY_S, Synchroniser, needed_evidence
from receiver.timing.toggles import PilotToggles

LAYOUT = PRESETS["robust"].layout
TOGGLES = PilotToggles(LAYOUT)
GRID = np.stack(np.meshgrid(*2 * [np.arange(4) / 4 + 0.125]), axis=-1).reshape(-1, 2)
"""Places, x and y in [0, 1], as those of pilots."""


def numbers_of(clock):
    """Period, start, delays and shutter of a clock of the page, in the order of Python's."""
    return [clock.period, clock.start, clock.delayX, clock.delayY, clock.shutter]


def toggles_of(clock, times, places, rng, noise, correlation=0.0, amplitude=3.0):
    """Toggles (n, P) of a clock in noise that is correlated from frame to frame."""
    wave = embedded_share(np.array([astuple(clock)]), times, places)[0].T
    left = rng.normal(size=wave.shape)
    for after in range(1, len(times)):
        left[after] = np.sqrt(1 - correlation**2) * left[after] + correlation * left[after - 1]
    drift = np.sin(2 * np.pi * 0.12 * times)[:, None] * np.linspace(-2, 2, len(places))
    return amplitude * wave + noise * left + drift + np.arange(len(places))


def values_of(toggles):
    """Values (n, pilots) of pilots whose places show toggles (n, P)."""
    apart = pilot_centres(LAYOUT)[:, None] - TOGGLES.places
    return toggles[:, np.abs(apart).max(axis=2).argmin(axis=1)] * pilot_signs(LAYOUT) / 2


def test_shares_of_exposures(port):
    clock, module = DisplayClock(0.1, 0.02, 0.003, 0.02, 0.04), port("link/clock.js")
    numbers, times = np.array(astuple(clock)), np.arange(9) / 7
    ported = module.DisplayClock(*numbers)
    embedded = embedded_share(numbers[None], times, GRID)[0]
    same(module.embeddedShare(numbers, times, GRID), embedded, SAME_STEPS)
    same(ported.number(0.3), clock.number(0.3), SAME_STEPS)
    for name in ("latest", "earliest", "centre"):
        same(getattr(ported, name), getattr(clock, name), SAME_STEPS)
    for at in ((1.0, 30.0), (4.0, 30.0), (4.0, 240.0)):
        needed = port("receiver/timing/synchronise.js").neededEvidence(*at)
        same(needed, needed_evidence(*at), FLOAT64)


WINDOWS = {
    "fast": (DisplayClock(1 / 15.1, 0.1, 0.004, -0.012, 1 / 60), 30.0, 1.5, TOGGLES.places),
    "slow": (DisplayClock(1 / 2.1, 0.3, 0.0, 0.015, 1 / 60), 30.0, 4.0, TOGGLES.places),
    "hidden": (DisplayClock(1 / 29.8, 0.123, 0.0, 0.01, 0.01), 60.0, 1.0, GRID),
    "open": (DisplayClock(1 / 60.3, 0.1, -0.001, -0.021, 1 / 120), 120.0, 1.0, GRID),
}
"""A clock, frames a second, seconds, and places that toggle."""
NOISE = {
    "fast": {"noise": 0.4},
    "slow": {"noise": 0.6, "correlation": 0.6, "amplitude": 1.5},
    "hidden": {"noise": 1.0},
    "open": {"noise": 0.5},
}


@pytest.mark.parametrize("name", WINDOWS)
def test_clocks_are_fitted_to_windows(name, port):
    clock, fps, seconds, places = WINDOWS[name]
    rng = np.random.default_rng([*WINDOWS].index(name) + 1)
    times = np.arange(int(seconds * fps)) / fps + 7.3
    if name == "slow":
        times += rng.uniform(-0.2, 0.2, len(times)) / fps
    toggles = toggles_of(clock, times, places, rng, **NOISE[name])
    if name == "hidden":
        toggles[rng.random(toggles.shape) < 0.05] = np.nan
        toggles[5:, 1] = np.nan
        toggles[9, 0] += 60
    window = ToggleWindow(times, toggles, places, fps)
    ported = port("receiver/timing/fit.js").ToggleWindow(times, list(toggles), places, fps)
    same(ported.placesSeen, window.places_seen)
    same(ported.deviation, window.deviation, FLOAT64)
    start = replace(clock, start=clock.start - window.middle, period=1.0004 * clock.period)
    begun = port("link/clock.js").DisplayClock(*astuple(start))
    for found, fit in (
        (ported.search(), window.search()),
        (ported.follow(begun), window.follow(start)),
    ):
        period = fit.clock.period
        same(numbers_of(found.clock), astuple(fit.clock), FITTED * period)
        same(found.covariance, fit.covariance, FITTED * period**2)
        same(found.evidence, fit.evidence, CLOCK_EVIDENCE)
        same(found.amplitude, fit.amplitude, FITTED)
        same(found.r2, fit.r2, FITTED)
        same([noise.deviation for noise in found.noise], fit.noise.deviation, FITTED)
        same([noise.correlation for noise in found.noise], fit.noise.correlation, FITTED)
        same(found.phaseError(1.5), fit.phase_error(1.5), CLOCK_STATE)


def test_a_synchroniser_finds_the_clock_holds_it_and_keeps_its_numbers(port):
    """Through a weak spell, a pause, and a new start."""
    rng, fps, seconds = np.random.default_rng(5), 30.0, 9.0
    clock = DisplayClock(1 / 14.93, 0.123, 0.004, -0.012, 0.016)
    times = np.arange(int(seconds * fps)) / fps
    toggles = toggles_of(clock, times, TOGGLES.places, rng, 0.4)
    weak = (times > 0.4 * seconds) & (times < 0.6 * seconds)
    toggles[weak] = rng.normal(0, 1.5, toggles[weak].shape)
    toggles[times < 0.1] = np.nan
    late = replace(clock, start=clock.start + 1.1 * clock.period)
    again = times > 0.7 * seconds + 1.5 * AWAY_S
    toggles[again] = toggles_of(late, times[again], TOGGLES.places, rng, 0.4)
    seen = (times < 0.7 * seconds) | again
    sync = Synchroniser(fps, TOGGLES)
    meter = port("receiver/timing/toggles.js").PilotToggles(LAYOUT)
    ported = port("receiver/timing/synchronise.js").Synchroniser(fps, meter)
    kept = SeenFrames()
    for time, values in zip(times[seen], values_of(toggles[seen]), strict=True):
        if np.isfinite(values).any():
            kept.toggles.append((time, values))
        sync.update(kept.toggles, time)
        ported.add(time, values)
        found = ported.clock and numbers_of(ported.clock)
        same(found, sync.clock and astuple(sync.clock), FITTED)
        errors = [min(error, 1e9) for error in (ported.phaseError(time), sync.phase_error(time))]
        same([ported.slips, errors[0]], [sync.slips, errors[1]], CLOCK_STATE)
    best = ported.best
    found = [best.strength, best.amplitude, best.stateHz, best.deviation]
    same(found, astuple(sync.best), CLOCK_STATE)


@pytest.mark.parametrize(("off", "kept"), [(1.5, False), (30.0, True)])
def test_a_code_s_clock_is_put_right_where_frames_are_missing(off, kept, port):
    """One that is found with too little evidence is taken if it is about the one that is held."""
    rng, code = np.random.default_rng(7), PilotCode()
    true = DisplayClock(1 / 59.64, 0.02, 0.0, 0.01, 1 / 64)
    held = replace(true, period=1 / 60, start=true.start + (off - 120) / 60 + 120 / 59.64)
    times = np.sort(rng.choice(120, 22, replace=False)) / 30
    wave = embedded_share(np.array([astuple(true)]), times, TOGGLES.places, code)[0].T
    toggles = 3 * wave + 1.5 * rng.normal(size=wave.shape)
    sync = Synchroniser(30.0, TOGGLES, code)
    meter = port("receiver/timing/toggles.js").PilotToggles(LAYOUT)
    signs = port("link/pilotCode.js").PilotCode(code.signs.tolist())
    ported = port("receiver/timing/synchronise.js").Synchroniser(30.0, meter, signs)
    seen = SeenFrames()
    for time, values in zip(times, values_of(toggles), strict=True):
        seen.toggles.append((time, values))
        ported.add(time, values, False)
    sync.begin(held, times[-1])
    ported.begin(port("link/clock.js").DisplayClock(*astuple(held)), times[-1])
    nothing = np.full(LAYOUT.pilots, np.nan)
    sync.update(seen.toggles, times[-1] + 0.01)
    ported.add(times[-1] + 0.01, nothing)
    assert 30 / needed_evidence(4.0, 30.0, code) < sync.best.strength < 1
    same(numbers_of(ported.clock), astuple(sync.clock), FITTED)
    assert (sync.clock == held) == kept
    assert kept or abs(sync.clock.number(4.0) - true.number(4.0)) < 0.3


def test_toggles_are_those_of_python(port):
    rng, layout = np.random.default_rng(7), LAYOUT
    picture = rng.integers(90, 160, (layout.height // 32, layout.width // 32), np.uint8)
    picture = picture.repeat(32, axis=0).repeat(32, axis=1)
    shown = embed(picture, rng.integers(0, 2, layout.n_bits), layout, 3)
    frames = [
        (frame + rng.normal(0, 2, frame.shape)).clip(0, 255).astype(np.uint8)
        for frame in (shown.original, shown.embedded, shown.original)
    ]
    ported = port("receiver/timing/toggles.js").PilotToggles(layout)
    same(ported.places, TOGGLES.places, SAME_STEPS)
    measured = [seen_frame(0.0, frame, layout=layout).toggles for frame in frames]
    found = [ported.measure(frame) for frame in frames]
    same(found, measured, FLOAT32_SUM)
    same(ported.overTime(found), TOGGLES.over_time(np.array(measured)), FLOAT32_SUM)
