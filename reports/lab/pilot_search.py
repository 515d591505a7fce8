"""Measure how often displays are found by their pilots: python -m reports.lab.pilot_search.

Nothing visible marks a display with pilots. Here `export.locate.pilots.search.PilotSearch` looks
for it in simulated hand-held films of rooms: of displays that show a preset, of displays that stand
still, and of displays that toggle blocks of another layout. In the last two it must find nothing.
A share of the frames may be dropped at random, as slow receivers and busy phones drop them.
"""

from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial

import numpy as np
import tyro
from numpy.typing import NDArray
from tqdm import tqdm

from data_gen.film.scenes import SceneSettings
from data_gen.film.stream import VideoSettings, film
from data_gen.frame_pair import Source, shuffled_pictures
from data_gen.pairs import PAIRS
from export.locate.pilots.search import PilotSearch
from link.embed import embed
from link.errors import ParameterError, at_least, choose, read_flags, run_cli
from link.geometry import frame_corners, transform
from link.layout import Layout, make_layout
from link.presets import PRESETS
from reports.engine.backends import one_thread
from reports.render.tables import Table
from reports.score.accuracy import wilson

CAMERA_FPS = {"hidden": 120.0, "fast": 60.0, "robust": 30.0}
"""Frames that the camera takes a second of each preset: two of each displayed state."""
MAX_VIEW_DEG = 60.0
"""Largest angle of observation that is drawn, degrees."""
COVERAGE = 0.15, 0.6
"""Least and largest share of the image that the display covers; drawn between them."""
PATTERNS = 40
"""Number of frame pairs that a display shows before they repeat."""
SEEN = {
    "display": "a display that shows the preset",
    "still": "a display that stands still",
    "other": "a display that toggles the paper's layout",
}
"""What the films show, and how the table calls it."""


@dataclass(frozen=True)
class PilotSearchConfig:
    """How often displays are found by their pilots, and how often where there are none."""

    presets: tuple[str, ...] = tuple(CAMERA_FPS)
    """Presets that displays show."""
    seen: tuple[str, ...] = tuple(SEEN)
    """What the films show, keys of SEEN in reports/lab/pilot_search.py."""
    films: int = 40
    """Number of films of each preset and of each thing they show."""
    seconds: float = 2.0
    """Length of each film, seconds."""
    drop: float = 0.0
    """Share of the frames that are dropped at random, from 0 to below 1."""
    seed: int = 0
    """Seed of all draws."""
    jobs: int = 2
    """Number of processes."""


@dataclass(frozen=True)
class SearchOutcome:
    """What the search found in one film."""

    preset: str
    """Preset of the camera's and the display's rates."""
    seen: str
    """What the film shows; a key of `SEEN`."""
    view_deg: float
    """Angle of observation, degrees."""
    coverage: float
    """Share of the image that the display covers."""
    found_s: float | None
    """Time of the frame in which a display was found, seconds, or None where none was."""
    error_px: float | None
    """Mean distance of the corners found from the true ones, pixels of the frame; None where
    nothing was found."""
    right: bool
    """Whether the layout found is the one shown."""


def searched_layouts() -> list[Layout]:
    """List the layouts that the receiver looks for: those of all presets with pilots."""
    return [preset.layout for preset in PRESETS.values() if preset.layout.pilots]


def displayed_states(
    seen: str, picture: NDArray[np.uint8], preset: str, rng: np.random.Generator
) -> tuple[list[NDArray[np.uint8]], Layout]:
    """Make what a display shows, state after state, and its layout.

    Args:
        seen: a key of `SEEN`.
        picture: (height, width, 3) uint8, encoded RGB, of the layouts' size.
        preset: preset whose grid and kappa the display shows, if it shows one.
        rng: draws the bits.
    """
    chosen = PRESETS[preset]
    layout = make_layout() if seen == "other" else chosen.layout
    if seen == "still":
        return [picture], layout
    kappa = 3 if seen == "other" else chosen.kappa
    bits = rng.integers(0, 2, (PATTERNS, layout.n_bits))
    pairs = [embed(picture, pattern, layout, kappa) for pattern in bits]
    return [state for pair in pairs for state in (pair.original, pair.embedded)], layout


def search_film(drawn: tuple[str, str, int], config: PilotSearchConfig) -> SearchOutcome:
    """Film a room and look for a display until one is found.

    Args:
        drawn: preset, a key of `SEEN`, and number of the film.
        config: seed and length of the films.
    """
    one_thread()
    preset, seen, number = drawn
    rng = np.random.default_rng(
        [config.seed, list(PRESETS).index(preset), list(SEEN).index(seen), number]
    )
    view, coverage = float(rng.uniform(0, MAX_VIEW_DEG)), float(rng.uniform(*COVERAGE))
    source = Source(PRESETS[preset].layout, "test", config.seed)
    pictures = shuffled_pictures(source)
    picture = pictures[int(rng.integers(len(pictures)))].rgb
    states, layout = displayed_states(seen, picture, preset, rng)
    settings = VideoSettings(
        scene=SceneSettings(coverage=coverage, pictures=pictures, free=0.03),
        fps=CAMERA_FPS[preset],
        state_hz=PRESETS[preset].state_hz,
        seconds=config.seconds,
    )
    search = PilotSearch(searched_layouts(), settings.fps)
    pair = source.pair(list(PAIRS)[number % len(PAIRS)])
    lost = np.random.default_rng([config.seed, number])
    for frame in film(states, layout, pair, view, settings, rng):
        if lost.random() < config.drop:
            continue
        found = search.push(frame.rgb, frame.time_s)
        if found is not None:
            corners = transform(
                frame.H_captured_from_display, frame_corners(layout.width, layout.height)
            )
            error = float(np.linalg.norm(found.corners - corners, axis=1).mean())
            right = seen == "display" and found.layout == layout
            return SearchOutcome(preset, seen, view, coverage, frame.time_s, error, right)
    return SearchOutcome(preset, seen, view, coverage, None, None, False)


def search_table(outcomes: Sequence[SearchOutcome]) -> Table:
    """Show how many displays were found, how soon, and how well; and what should not have been."""
    rows = []
    for preset in dict.fromkeys(outcome.preset for outcome in outcomes):
        for seen, name in SEEN.items():
            mine = [o for o in outcomes if (o.preset, o.seen) == (preset, seen)]
            if not mine:
                continue
            right = sum(o.right for o in mine)
            wrong = sum(o.found_s is not None and not o.right for o in mine)
            low, high = wilson(right, len(mine))
            times = [o.found_s for o in mine if o.right and o.found_s is not None]
            errors = [o.error_px for o in mine if o.right and o.error_px is not None]
            shown = seen == "display"
            rows.append(
                [
                    preset,
                    f"{CAMERA_FPS[preset]:g}",
                    name,
                    str(len(mine)),
                    f"{right} ({low:.1%} – {high:.1%})" if shown else "–",
                    f"{wrong} (at most {wilson(wrong, len(mine))[1]:.1%})",
                    f"{np.median(times):.2f}" if times else "–",
                    f"{np.median(errors):.1f}" if errors else "–",
                ]
            )
    heads = ["preset", "frames/s", "film of", "films", "found", "found wrongly", "median s"]
    return Table([*heads, "corners off, px"], rows, left=3)


def main() -> None:
    """Print the table, and where displays were not found."""
    config = read_flags(lambda: tyro.cli(PilotSearchConfig, description=__doc__))
    at_least(1, films=config.films, jobs=config.jobs)
    for preset in config.presets:
        choose(CAMERA_FPS, preset, "name in --presets")
    for seen in config.seen:
        choose(SEEN, seen, "name in --seen")
    if not 0.5 <= config.seconds <= 60:
        raise ParameterError("seconds", f"need 0.5 to 60, got {config.seconds:g}")
    if not 0 <= config.drop < 1:
        raise ParameterError("drop", f"need 0 or more and less than 1, got {config.drop:g}")
    films = [(p, s, n) for p in config.presets for s in config.seen for n in range(config.films)]
    with ProcessPoolExecutor(config.jobs) as pool:
        results = pool.map(partial(search_film, config=config), films)
        outcomes = list(tqdm(results, "films", len(films), unit="film"))
    print(search_table(outcomes).markdown())
    for o in outcomes:
        if o.seen == "display" and not o.right:
            print(f"not found: {o.preset}, {o.view_deg:.0f} degrees, coverage {o.coverage:.2f}")


if __name__ == "__main__":
    run_cli(main)
