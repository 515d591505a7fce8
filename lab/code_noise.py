"""Count how often noise is taken for the clock of a display with a code.

Run: python -m lab.code_noise --windows 10000
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import tyro
from numpy.typing import NDArray
from tqdm import tqdm

from export.receive.timing.fit import ToggleWindow
from export.receive.timing.synchronise import needed_evidence
from export.receive.timing.toggles import PilotToggles
from link.presets import PRESETS
from reports.engine.backends import one_thread
from reports.score.intervals import wilson

FPS = (30.0, 60.0)
"""Numbers of frames a second."""
SECONDS = (0.5, 1.0, 2.0, 4.0)
"""Lengths of windows."""
LASTING = {"of each frame's own": 0.0, "that lasts as a codec's does": 0.6, "that wanders": 1.0}
"""Kinds of noise, and the share of it that goes on from frame to frame."""


@dataclass(frozen=True)
class Config:
    """Look for the clock of the preset `hidden` in windows of noise."""

    windows: int = 1000
    """Number of windows, in turn of each kind, length and rate."""
    seed: int = 0
    """Seed of the noise."""


def noise(frames: int, places: int, lasts: float, rng: np.random.Generator) -> NDArray[np.float64]:
    """Draw (frames, places) toggles, each place with a deviation of its own."""
    fresh = rng.standard_normal((frames, places)) * np.exp(rng.normal(0, 0.5, places))
    if lasts == 1.0:
        return np.asarray(0.3 * np.cumsum(fresh, axis=0) + fresh)
    for before, now in pairwise(fresh):
        now[:] = lasts * before + np.sqrt(1 - lasts**2) * now
    return fresh


def main() -> None:
    """Print how many windows hold a clock, and the largest share of the evidence that it needs."""
    config = tyro.cli(Config)
    one_thread()
    layout, rng = PRESETS["hidden"].layout, np.random.default_rng(config.seed)
    places = PilotToggles(layout).places
    shares = []
    for number in tqdm(range(config.windows)):
        kind, rest = number % len(LASTING), number // len(LASTING)
        fps, seconds = FPS[rest % len(FPS)], SECONDS[rest // len(FPS) % len(SECONDS)]
        times = np.arange(int(seconds * fps) + 1) / fps
        toggles = noise(len(times), len(places), list(LASTING.values())[kind], rng)
        window = ToggleWindow(times, toggles, places, fps, layout.code)
        shares.append(window.search().evidence / needed_evidence(times[-1], fps, layout.code))
    found = int((np.array(shares) >= 1).sum())
    low, high = wilson(found, len(shares))
    print(f"{found} of {len(shares)} windows hold a clock ({100 * low:.3f} to {100 * high:.3f} %)")
    print(f"largest share of the evidence that is needed: {max(shares):.2f}")


if __name__ == "__main__":
    main()
