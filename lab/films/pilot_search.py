"""How often displays are found by their pilots.

Nothing visible marks a display with pilots. Here `PilotSearch` looks for it in simulated hand-held
films of rooms: of displays that show a preset, from the first frame on or later, of displays that
stand still, that show a film, and that toggle blocks of another layout. In the last three it must
find nothing.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from math import lcm
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import quantile_test

from data_gen.film.scenes import SceneSettings
from data_gen.film.stream import States, VideoSettings, film
from data_gen.frame_pair import Source, shuffled_pictures
from data_gen.pairs import GROUPS, pair_names
from lab.study import Results, Study, StudyFlags, Workshop
from link.embed import embed
from link.errors import ParameterError, at_least, choose
from link.geometry import frame_corners, transform
from link.layout import Layout, make_layout
from link.presets import PRESETS
from receiver.pilots.search.pilot_search import PilotSearch
from reports.engine.backends import one_thread
from reports.render.tables import Table
from reports.score.intervals import wilson

CAMERAS = {
    "hidden": ("hidden", 120.0),
    "hidden, 60 fps": ("hidden", 60.0),
    "hidden, 30 fps": ("hidden", 30.0),
    "fast": ("fast", 60.0),
    "robust": ("robust", 30.0),
}
"""Preset, and number of camera frames a second, by the name of the setting."""
MAX_VIEW_DEG = 60.0
"""Largest angle of observation that is drawn, degrees."""
COVERAGE = 0.15, 0.6
"""Least and largest share of the image that the display covers; drawn between them."""
PATTERNS = 40
"""Number of frame pairs that a display shows before they repeat."""
SCENE, PAN_PX = 20, 6
"""Number of states that a scene of a film lasts, and pixels by which it moves from one to the next
at most."""
SEEN = {
    "display": "a display that shows the preset",
    "late": "a display that begins to show the preset late",
    "still": "a display that stands still",
    "film": "a display that shows a film",
    "other": "a display that toggles the paper's layout",
}
"""What the films show, and how the table calls it."""
SHOWN = "display", "late"
"""Films in which a display is to be found."""
LATE_S = 0.3, 3.5
"""Least and largest time, in seconds, for which a display stands still that begins late."""


@dataclass(frozen=True)
class PilotSearchFlags(StudyFlags):
    """How often displays are found by their pilots, and how often where there are none."""

    presets: tuple[str, ...] = tuple(CAMERAS)
    """Presets that displays show, before which cameras; keys of CAMERAS in
    lab/films/pilot_search.py."""
    seen: tuple[str, ...] = tuple(SEEN)
    """What the films show, keys of SEEN in lab/films/pilot_search.py."""
    films: int = 40
    """Number of films of each preset and of each thing they show."""
    seconds: float = 2.0
    """Length of each film from the time on at which the display begins to toggle, seconds."""
    pairs: tuple[str, ...] = GROUPS["paper"]
    """Camera-display pairs, which film in turn."""


@dataclass(frozen=True)
class SearchTake:
    """One film in which a display is looked for."""

    preset: str
    """Name of the display's preset and the camera's rate; a key of `CAMERAS`."""
    seen: str
    """What the film shows; a key of `SEEN`."""
    number: int
    """Number of the film among those of its preset and kind."""
    seconds: float
    """Length of the film from the time on at which the display begins to toggle, seconds."""
    pair: str
    """Camera-display pair."""
    seed: int
    """Seed of all draws."""


@dataclass(frozen=True)
class SearchOutcome:
    """What the search found in one film."""

    preset: str
    """Name of the display's preset and the camera's rate; a key of `CAMERAS`."""
    seen: str
    """What the film shows; a key of `SEEN`."""
    number: int
    """Number of the film among those of its preset and kind."""
    view_deg: float
    """Angle of observation, degrees."""
    coverage: float
    """Share of the image that the display covers."""
    found_s: float | None
    """Time from the display's beginning to the frame in which one was found, seconds, or None."""
    error_px: float | None
    """Mean distance of the corners found from the true ones, pixels of the frame; None where
    nothing was found."""
    right: bool
    """Whether the layout found is the one shown."""


@dataclass(frozen=True)
class SearchContent:
    """What was found."""

    outcomes: list[SearchOutcome]
    """One entry for each film."""


def searched_layouts() -> list[Layout]:
    """List the layouts that the receiver looks for: those of all presets with pilots."""
    return [preset.layout for preset in PRESETS.values() if preset.layout.pilots]


def displayed_states(
    seen: str, pictures: Sequence[NDArray[np.uint8]], preset: str, rng: np.random.Generator
) -> tuple[list[NDArray[np.uint8]], Layout]:
    """Make what a display shows, state after state, and its layout.

    Args:
        seen: a key of `SEEN`.
        pictures: each (height, width, 3) uint8, encoded RGB, of the layouts' size; a film shows
            several, anything else the first.
        preset: preset whose grid and kappa the display shows, if it shows one.
        rng: draws the bits, and how the scenes of a film move.
    """
    chosen = PRESETS[preset]
    layout, picture = make_layout() if seen == "other" else chosen.layout, pictures[0]
    if seen == "still":
        return [picture], layout
    if seen == "film":
        moves = rng.integers(-PAN_PX, PAN_PX + 1, (2 * PATTERNS // SCENE, 2))
        return [
            np.roll(pictures[scene % len(pictures)], number * move, axis=(0, 1))
            for scene, move in enumerate(moves)
            for number in range(SCENE)
        ], layout
    kappa = 3 if seen == "other" else chosen.kappa
    bits = rng.integers(0, 2, (PATTERNS, layout.n_bits))
    pairs = [embed(picture, pattern, layout, kappa) for pattern in bits]
    states = [
        state
        for number in range(lcm(PATTERNS, layout.code.period))
        for pair in [pairs[number % PATTERNS]]
        for state in (pair.original, pair.embedded)[:: layout.code.sign(number)]
    ]
    return states, layout


def search_outcome(take: SearchTake) -> dict[str, Any]:
    """Film a room and look for a display; return the fields of a `SearchOutcome`."""
    one_thread()
    return asdict(search_film(take))


def search_film(take: SearchTake) -> SearchOutcome:
    """Film a room and look for a display until one is found."""
    (preset, fps), seen, number = CAMERAS[take.preset], take.seen, take.number
    rng = np.random.default_rng(
        [take.seed, list(PRESETS).index(preset), list(SEEN).index(seen), number]
    )
    view, coverage = float(rng.uniform(0, MAX_VIEW_DEG)), float(rng.uniform(*COVERAGE))
    source = Source(PRESETS[preset].layout, "test", take.seed)
    pictures = shuffled_pictures(source)
    first = int(rng.integers(len(pictures)))
    shown = [picture.rgb for picture in (*pictures[first:], *pictures[:first])]
    loop, layout = displayed_states(seen, shown, preset, rng)
    state_hz = PRESETS[preset].state_hz
    still = round(rng.uniform(*LATE_S) * state_hz) if seen == "late" else 0
    begins_s = still / state_hz

    def late_states(number: int) -> NDArray[np.uint8]:
        return shown[0] if number < still else loop[(number - still) % len(loop)]

    states: States = late_states if still else loop
    settings = VideoSettings(
        scene=SceneSettings(coverage=coverage, pictures=pictures, free=0.03),
        fps=fps,
        state_hz=state_hz,
        seconds=begins_s + take.seconds,
        start_s=0.0 if begins_s else None,
    )
    search, found_s, error, right = PilotSearch(searched_layouts(), fps), None, None, False
    pair = source.pair(take.pair)
    for frame in film(states, layout, pair, view, settings, rng):
        found = search.push(frame.rgb, frame.time_s)
        if found is not None:
            corners = transform(
                frame.H_captured_from_display, frame_corners(layout.width, layout.height)
            )
            found_s = frame.time_s - begins_s
            right = seen in SHOWN and found_s >= 0 and found.layout == layout
            error = float(np.linalg.norm(found.corners - corners, axis=1).mean())
            break
    return SearchOutcome(take.preset, seen, number, view, coverage, found_s, error, right)


def search_table(outcomes: Sequence[SearchOutcome]) -> Table:
    """Show how many displays were found, how soon, and how well; and what should not have been.

    The last rows are for all presets together, if there are several.
    """
    rows = []
    presets = list(dict.fromkeys(outcome.preset for outcome in outcomes))
    for preset in [*presets, *(["all"] if len(presets) > 1 else [])]:
        for seen, name in SEEN.items():
            mine = [o for o in outcomes if preset in (o.preset, "all") and o.seen == seen]
            if not mine:
                continue
            right = sum(o.right for o in mine)
            wrong = sum(o.found_s is not None and not o.right for o in mine)
            low, high = wilson(right, len(mine))
            times = [o.found_s for o in mine if o.right and o.found_s is not None]
            errors = [o.error_px for o in mine if o.right and o.error_px is not None]
            row = [preset, "–" if preset == "all" else f"{CAMERAS[preset][1]:g}", name]
            row.append(str(len(mine)))
            row.append(f"{right} ({low:.1%} – {high:.1%})" if seen in SHOWN else "–")
            row.append(f"{wrong} (at most {wilson(wrong, len(mine))[1]:.1%})")
            row.append(f"{np.median(times):.2f}" if times else "–")
            off = "–"
            if errors:
                off = f"{np.median(errors):.2f}"
                interval = quantile_test(errors, p=0.5).confidence_interval()
                if np.isfinite(interval.low):  # five values and fewer bound no median
                    off += f" ({interval.low:.2f} – {interval.high:.2f})"
            row.append(off)
            rows.append(row)
    heads = (
        "preset", "frames/s", "film of", "films", "found", "found wrongly", "median s",
        "corners off, px",
    )  # fmt: skip
    text = "Corners: median over the films of the mean distance of four corners, in pixels."
    return Table(heads, rows, text, left=3)


def check_search(flags: PilotSearchFlags) -> None:
    """Raise an `InputError` that names the first flag with a wrong value."""
    at_least(1, films=flags.films)
    pair_names(flags.pairs)
    for preset in flags.presets:
        choose(CAMERAS, preset, "name in --presets")
    for seen in flags.seen:
        choose(SEEN, seen, "name in --seen")
    if not 0.5 <= flags.seconds <= 60:
        raise ParameterError("seconds", f"need 0.5 to 60, got {flags.seconds:g}")


def measure_search(flags: PilotSearchFlags, workshop: Workshop) -> SearchContent:
    """Search all films."""
    pairs = pair_names(flags.pairs)
    takes = {
        f"{preset} {seen} {number}": SearchTake(
            preset=preset,
            seen=seen,
            number=number,
            seconds=flags.seconds,
            pair=pairs[number % len(pairs)],
            seed=flags.seed,
        )
        for number in range(flags.films)
        for preset in flags.presets
        for seen in flags.seen
    }
    found = workshop.each(search_outcome, takes)
    return SearchContent([SearchOutcome(**fields) for fields in found.values()])


def search_blocks(results: Mapping[str, Results[SearchContent]]) -> dict[str, str]:
    """Show the table, and where displays were not found."""
    outcomes = results["pilot_search"].content.outcomes
    missed = [
        f"Not found: {o.preset}, film {o.number}, {o.view_deg:.0f}°, coverage {o.coverage:.2f}."
        for o in outcomes
        if o.seen == "display" and not o.right
    ]
    return {"pilot_search": "\n\n".join([search_table(outcomes).markdown(), *missed])}


STUDY = Study(
    name="pilot_search",
    flags=PilotSearchFlags,
    content=SearchContent,
    measure=measure_search,
    blocks=search_blocks,
    check=check_search,
)
"""The study that `python -m lab pilot_search` runs."""
