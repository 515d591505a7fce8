"""How often a clock is found where there is none, in the shortest windows: measured once.

Noise of each frame's own, noise that lasts as a codec's does, noise that wanders, and the toggles of
a real clock in shuffled order, at the places of displays with patches and with pilots.
"""

from dataclasses import astuple

import numpy as np

from export.pilots.clock import DisplayClock, embedded_share
from export.receive.timing.fit import ToggleWindow
from export.receive.timing.synchronise import MIN_FRAMES, needed_evidence
from export.receive.timing.toggles import make_toggles
from link.layout import make_layout
from link.presets import PRESETS
from link.types import Array

LAYOUTS = {"patches": make_layout(), "pilots": PRESETS["robust"].layout}
KINDS = {"noise": [0.0], "codec": [0.65, 0.65, 0, 0, 0.3], "slow": [0.95], "shuffled": [0.0]}


def draw(
    rng: np.random.Generator, fps: float, places: Array, strength: float, lags: list[float]
) -> tuple[Array, Array]:
    """Draw times and toggles of a random clock in noise that differs from place to place."""
    times = np.arange(MIN_FRAMES) / fps
    state_hz = rng.uniform(0.2, 0.9) * fps
    across, down = rng.uniform(-0.5, 0.5, 2) / fps
    shutter = rng.uniform(0.2, 0.9) / fps
    clock = DisplayClock(1 / state_hz, rng.uniform(0, 2 / state_hz), across, down, shutter)
    wave = embedded_share(np.array([astuple(clock)]), times, places)[0].T
    lag, fresh = np.resize(lags, len(places)), rng.normal(size=wave.shape)
    noise = fresh.copy()
    for now in range(1, len(times)):
        noise[now] = lag * noise[now - 1] + np.sqrt(1 - lag**2) * fresh[now]
    return times, strength * wave + np.exp(rng.normal(0, 0.5, len(places))) * noise


for fps in (30.0, 60.0):
    for name, layout in LAYOUTS.items():
        places = make_toggles(layout).places
        for kind, lags in KINDS.items():
            rng = np.random.default_rng([int(fps), 61])
            shares = []
            for _ in range(1000):
                strength = float(rng.uniform(2, 12)) if kind == "shuffled" else 0.0
                times, toggles = draw(rng, fps, places, strength, lags)
                toggles = rng.permutation(toggles) if strength else toggles
                fit = ToggleWindow(times, toggles, places, fps).search()
                shares.append(fit.evidence / needed_evidence(times[-1], fps))
            print(fps, name, kind, sum(share >= 1 for share in shares), max(shares), flush=True)
