"""The page finds the display's clock in the toggles in which Python finds it."""

from dataclasses import astuple, replace

import numpy as np
import pytest
from web_fixtures import run_node_tests, write_fixture

from export.receive.timing.clock import DisplayClock, embedded_share
from export.receive.timing.fit import ToggleWindow
from export.receive.timing.synchronise import AWAY_S, Synchroniser, needed_evidence
from export.receive.timing.toggles import PatchToggles, make_toggles
from export.web.tables import layout_table
from link.embed import embed
from link.layout import make_layout
from link.presets import PRESETS

PATCHES = PatchToggles(make_layout())
GRID = np.stack(np.meshgrid(*2 * [np.arange(4) / 4 + 0.125]), axis=-1).reshape(-1, 2)
"""Places, x and y in [0, 1], as those of pilots."""


def toggles_of(clock, times, places, rng, noise, correlation=0.0, amplitude=3.0):
    """Toggles (n, P) of a clock in noise that is correlated from frame to frame."""
    wave = embedded_share(np.array([astuple(clock)]), times, places)[0].T
    left = rng.normal(size=wave.shape)
    for after in range(1, len(times)):
        left[after] = np.sqrt(1 - correlation**2) * left[after] + correlation * left[after - 1]
    drift = np.sin(2 * np.pi * 0.12 * times)[:, None] * np.linspace(-2, 2, len(places))
    return amplitude * wave + noise * left + drift + np.arange(len(places))


def fit_values(fit):
    return {
        "clock": np.array(astuple(fit.clock)),
        "evidence": fit.evidence,
        "amplitude": fit.amplitude,
        "r2": fit.r2,
        "covariance": fit.covariance,
        "deviation": fit.noise.deviation,
        "correlation": fit.noise.correlation,
        "phase_error": fit.phase_error(1.5),
    }


def window_fixture(clock, fps, seconds, places, seed, hidden=0.0, jitter=0.0, **noise):
    rng = np.random.default_rng(seed)
    times = np.arange(int(seconds * fps)) / fps + 7.3
    times += rng.uniform(-jitter, jitter, len(times)) / fps
    toggles = toggles_of(clock, times, places, rng, **noise)
    toggles[rng.random(toggles.shape) < hidden] = np.nan
    if hidden:
        toggles[5:, 1] = np.nan
        toggles[9, 0] += 60
    window = ToggleWindow(times, toggles, places, fps)
    found = window.search()
    start = replace(clock, start=clock.start - window.middle, period=1.0004 * clock.period)
    return {
        "times": times,
        "toggles": toggles,
        "places": places,
        "fps": fps,
        "start": np.array(astuple(start)),
        "deviation": window.deviation,
        "places_seen": window.places_seen,
        "search": fit_values(found),
        "follow": fit_values(window.follow(start)),
    }


def run_fixture(fps, seconds, seed):
    """A synchroniser's clock after each frame, through a weak spell, a pause, and a new start."""
    rng = np.random.default_rng(seed)
    clock = DisplayClock(1 / 14.93, 0.123, 0.004, -0.012, 0.016)
    times = np.arange(int(seconds * fps)) / fps
    toggles = toggles_of(clock, times, PATCHES.places, rng, 0.4)
    weak = (times > 0.4 * seconds) & (times < 0.6 * seconds)
    toggles[weak] = rng.normal(0, 1.5, toggles[weak].shape)
    toggles[times < 0.1] = np.nan
    late = replace(clock, start=clock.start + 1.1 * clock.period)
    again = times > 0.7 * seconds + 1.5 * AWAY_S
    toggles[again] = toggles_of(late, times[again], PATCHES.places, rng, 0.4)
    seen = (times < 0.7 * seconds) | again
    times, toggles = times[seen], toggles[seen]
    sync = Synchroniser(fps, PATCHES)
    clocks, states = [], []
    for time, values in zip(times, toggles, strict=True):
        sync.add(time, values)
        clocks.append(5 * [-1.0] if sync.clock is None else list(astuple(sync.clock)))
        error = min(sync.phase_error(time), 1e9)
        states.append([sync.slips, sync.r2, float(sync.held), error])
    best = sync.best
    return {
        "fps": fps,
        "times": times,
        "toggles": toggles,
        "layout": layout_table(PATCHES.layout),
        "clocks": np.array(clocks),
        "states": np.array(states),
        "best": [best.strength, best.amplitude, best.state_hz, best.deviation],
    }


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("clock")
    clock = DisplayClock(0.1, 0.02, 0.003, 0.02, 0.04)
    write_fixture(
        folder,
        "shares",
        {
            "clock": np.array(astuple(clock)),
            "places": GRID,
            "shares": np.array([clock.shares(0.08, GRID, state) for state in range(3)]),
            "embedded": embedded_share(np.array([astuple(clock)]), np.arange(9) / 7, GRID)[0],
            "numbers": [clock.number(0.3), clock.latest, clock.earliest, clock.centre],
            "needed": [needed_evidence(*at) for at in ((1.0, 30.0), (4.0, 30.0), (4.0, 240.0))],
        },
    )
    camera = 1 / 30
    write_fixture(
        folder,
        "windows",
        [
            window_fixture(
                DisplayClock(1 / 15.1, 0.1, 0.004, -0.012, camera / 2),
                30.0,
                1.5,
                PATCHES.places,
                1,
                noise=0.4,
            ),
            window_fixture(
                DisplayClock(1 / 2.1, 0.3, 0.0, 0.015, camera / 2),
                30.0,
                4.0,
                PATCHES.places,
                2,
                noise=0.6,
                correlation=0.6,
                jitter=0.2,
                amplitude=1.5,
            ),
            window_fixture(
                DisplayClock(1 / 29.8, 0.123, 0.0, 0.01, 0.01),
                60.0,
                1.0,
                GRID,
                3,
                noise=1.0,
                hidden=0.05,
            ),
        ],
    )
    write_fixture(folder, "run", run_fixture(30.0, 9.0, 5))
    return folder


def test_toggles_are_those_of_python(tmp_path):
    rng = np.random.default_rng(7)
    known = []
    for name in ("paper", "robust"):
        layout = PRESETS[name].layout
        picture = rng.integers(90, 160, (layout.height // 32, layout.width // 32), np.uint8)
        picture = picture.repeat(32, axis=0).repeat(32, axis=1)
        shown = embed(picture, rng.integers(0, 2, layout.n_bits), layout, 3)
        frames = [
            (frame + rng.normal(0, 2, frame.shape)).clip(0, 255).astype(np.uint8)
            for frame in (shown.original, shown.embedded, shown.original)
        ]
        frames[2][: layout.height // 8, : layout.width // 8] = 90  # covers a patch
        toggles = make_toggles(layout)
        measured = [toggles.measure(frame) for frame in frames]
        known.append(
            {
                "layout": layout_table(layout),
                "frames": frames,
                "places": toggles.places,
                "measured": measured,
                "toggles": toggles.over_time(np.array(measured)),
            }
        )
    write_fixture(tmp_path, "toggles", known)
    run_node_tests("toggles", tmp_path)


def test_clocks_are_those_of_python(folder):
    run_node_tests("clock", folder)
