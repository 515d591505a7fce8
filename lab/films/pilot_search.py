"""Measure how often, how soon and how well displays are found by their pilots.

Nothing visible marks a display with pilots. Here `PilotSearch` looks for it in simulated hand-held
films of rooms: of displays that show a preset, from the first frame on or later, of displays that
stand still, that show a film, and that toggle blocks of another layout. In the last three it must
find nothing.

Films of other cameras, whose corners are known, can be searched instead. Of each film that shows a
display it is told when corners near the true ones came how far in the search, and what they waited
for.
"""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from math import lcm
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from data_gen.film.scenes import SceneSettings
from data_gen.film.stream import States, VideoSettings, film
from data_gen.frame_pair import Source, shuffled_pictures
from data_gen.pairs import GROUPS, pair_names
from data_gen.video import TRUTH
from lab.study import Results, Study, StudyFlags, Workshop
from link.embed import embed
from link.errors import ParameterError, at_least, choose
from link.geometry import frame_corners, transform
from link.images import image_files
from link.images.files import read_image
from link.layout import Layout, make_layout
from link.outside import read_json_lines
from link.presets import PRESETS
from link.types import Corners, Image
from receiver.decoders import open_decoders
from receiver.pilots.search.pilot_search import PilotDisplay, PilotSearch
from receiver.pilots.search.proposals import PROMISING
from receiver.pilots.search.watch import Trial
from receiver.receiver import Receiver
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
"""Kinds of films, and their names in the table."""
SHOWN = "display", "late"
"""Films in which a display is to be found."""
LATE_S = 0.3, 3.5
"""Least and largest time, in seconds, for which a display stands still that begins late."""
STAGES = {
    "proposed": "a proposal within a block",
    "weighed": f"evidence of {PROMISING:g}",
    "verified": "corners that fit",
    "found": "frames that agree, or the clock",
    "read": "the message",
}
"""Stages through which the true corners pass, and what each of them waits for."""
STAGE_OF_TRIAL = {"weighed": "proposed", "verifying": "weighed", "verified": "verified"}
"""Stage of `STAGES` that corners have reached, by the stage of a trial (`Trial.stage`)."""
NEAR = 1 / 55
"""Largest distance of corners from the true ones, as a share of the root of the display's area, at
which they are taken for them: a block of the preset `hidden`, of 48 x 64."""
SOON_S = 1.0
"""Time, in seconds, within which a display is to be found."""


@dataclass(frozen=True)
class PilotSearchFlags(StudyFlags):
    """How often displays are found by their pilots, and how often where there are none."""

    presets: tuple[str, ...] = tuple(CAMERAS)
    """Presets that displays show, before which cameras; keys of CAMERAS in
    lab/films/pilot_search.py."""
    seen: tuple[str, ...] = tuple(SEEN)
    """Kinds of films, keys of SEEN in lab/films/pilot_search.py."""
    films: int = 40
    """Number of films of each preset and of each thing they show."""
    seconds: float = 2.0
    """Length of each film from the time on at which the display begins to toggle, seconds."""
    pairs: tuple[str, ...] = GROUPS["paper"]
    """Camera-display pairs, which film in turn."""
    folders: tuple[Path, ...] = ()
    """Films that are searched instead, and read: folders of PNGs with truth.jsonl, as
    data_gen.video writes them of a display of the preset's own size."""


@dataclass(frozen=True)
class SearchTake:
    """One film in which a display is looked for."""

    preset: str
    """Name of the display's preset and the camera's rate; a key of `CAMERAS`."""
    seen: str
    """Kind of the film; a key of `SEEN`."""
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
    """Result of the search in one film."""

    preset: str
    """Name of the display's preset and the camera's rate; a key of `CAMERAS`; or of a folder."""
    seen: str
    """Kind of the film; a key of `SEEN`."""
    number: int
    """Number of the film among those of its preset and kind."""
    view_deg: float | None
    """Angle of observation, degrees; None where it is not known."""
    coverage: float
    """Share of the image that the display covers."""
    found_s: float | None
    """Time from the display's beginning to the frame in which one was found, seconds, or None."""
    error_px: float | None
    """Mean distance of the corners found from the true ones, pixels of the frame; None where
    nothing was found."""
    right: bool
    """Whether the layout found is the one shown."""
    stages: dict[str, float]
    """Time from the display's beginning to the frame with which the true corners reached each of
    `STAGES`, seconds; those not reached are left out."""
    evidence: float
    """Largest evidence by which corners near the true ones were weighed; 0 where there were
    none."""


@dataclass(frozen=True)
class SearchContent:
    """Results of all films."""

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
    pair = source.pair(take.pair)
    display = frame_corners(layout.width, layout.height)
    filmed = (
        (frame.rgb, frame.time_s, transform(frame.H_captured_from_display, display))
        for frame in film(states, layout, pair, view, settings, rng)
    )
    found, error, stages, evidence = trace_search(filmed, fps, begins_s)
    found_s = stages.get("found")
    right = seen in SHOWN and found is not None and found.layout == layout and stages["found"] >= 0
    return SearchOutcome(
        take.preset, seen, number, view, coverage, found_s, error, right, stages, evidence
    )


def trace_search(
    film: Iterable[tuple[Image, float, Corners]], fps: float, begins_s: float
) -> tuple[PilotDisplay | None, float | None, dict[str, float], float]:
    """Look for a display in a film until one is found, and note when the true corners came how far.

    Args:
        film: images, their times in seconds, and the true corners in them.
        fps: nominal number of frames of the camera in a second.
        begins_s: time at which the display begins to toggle, seconds.

    Returns:
        the display found, the mean distance of its corners from the true ones in pixels, and
        `SearchOutcome.stages` and `SearchOutcome.evidence`.
    """
    true: dict[float, Corners] = {}
    stages: dict[str, float] = {}
    evidence = [0.0]

    def note(trial: Trial) -> None:
        corners = true[trial.time]
        turned = (np.roll(trial.corners, turn, axis=0) for turn in range(4))
        off = min(float(np.abs(each - corners).max()) for each in turned)
        if off <= NEAR * np.sqrt(cv2.contourArea(corners.astype(np.float32))):
            stages.setdefault(STAGE_OF_TRIAL[trial.stage], now - begins_s)
            evidence.append(trial.evidence)

    search = PilotSearch(searched_layouts(), fps, note)
    for image, now, corners in film:
        true[now] = corners
        found = search.push(image, now)
        if found is not None:
            stages["found"] = now - begins_s
            error = float(np.linalg.norm(found.corners - corners, axis=1).mean())
            return found, error, stages, max(evidence)
    return None, None, stages, max(evidence)


def folder_outcome(folder: str) -> dict[str, Any]:
    """Search and read a film whose frames lie in a folder; the fields of a `SearchOutcome`."""
    one_thread()
    layout = PRESETS["hidden"].layout  # all presets have its size
    display = frame_corners(layout.width, layout.height)
    truth = [line for _, line in read_json_lines(Path(folder) / TRUTH)]
    times = [float(line["time_s"]) for line in truth]
    corners = [transform(np.array(line["H_captured_from_display"]), display) for line in truth]
    images = [read_image(file) for file in image_files(Path(folder))]
    fps = round(1 / float(np.median(np.diff(times))), 2)
    film = zip(images, times, corners, strict=True)
    found, error, stages, evidence = trace_search(film, fps, times[0])
    decoders, window_decoder = open_decoders(None, threads=1)
    receiver = Receiver(decoders, fps, window_decoder)
    for image, time in zip(images, times, strict=True):
        if found is not None and receiver.push(image, time).message is not None:
            stages["read"] = time - times[0]
            break
    outcome = SearchOutcome(
        preset=Path(folder).name,
        seen="display",
        number=0,
        view_deg=None,
        coverage=cv2.contourArea(corners[0].astype(np.float32)) / images[0][..., 0].size,
        found_s=stages.get("found"),
        error_px=error,
        right=found is not None,
        stages=stages,
        evidence=evidence,
    )
    return asdict(outcome)


def waited_for(outcome: SearchOutcome) -> str:
    """Say what the true corners never got, or else waited for longest.

    The message is read in films of folders alone, so it counts where the film was read.
    """
    waits, before = {}, 0.0
    for stage, wait in STAGES.items():
        if stage in outcome.stages:  # some are skipped: corners that were off may move to the true
            waits[wait], before = outcome.stages[stage] - before, outcome.stages[stage]
        elif outcome.found_s is None:
            return wait
    return max(waits, key=lambda wait: waits[wait])


def stages_table(outcomes: Sequence[SearchOutcome]) -> Table:
    """Show when the true corners of each film came how far, and what they waited for longest."""
    rows = []
    for o in outcomes:
        times = [f"{o.stages[stage]:.2f}" if stage in o.stages else "–" for stage in STAGES]
        name = f"{o.preset}, film {o.number}" if o.view_deg is not None else o.preset
        rows.append([name, f"{o.coverage:.2f}", *times, f"{o.evidence:.1f}", waited_for(o)])
    heads = "film", "coverage", *STAGES, "evidence", "waited longest for"
    late = [o for o in outcomes if not o.right or o.stages["found"] > SOON_S]
    causes = Counter(waited_for(o) for o in late).most_common()
    text = f"Found later than {SOON_S:g} s or never: {len(late)} of {len(outcomes)} films"
    text += "".join(f"; {count} waited for {cause}" for cause, count in causes) + "."
    return Table(heads, rows, text)


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
            row.append(f"{np.median(errors):.2f}" if errors else "–")
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
    if flags.folders:
        inputs = [folder / TRUTH for folder in flags.folders]
        folders = {str(folder): str(folder) for folder in flags.folders}
        found = workshop.each(folder_outcome, folders, inputs)
    else:
        found = workshop.each(search_outcome, takes)
    return SearchContent([SearchOutcome(**fields) for fields in found.values()])


def search_blocks(results: Mapping[str, Results[SearchContent]]) -> dict[str, str]:
    """Show how often displays were found, and where the time went where they were to be found."""
    outcomes = results["pilot_search"].content.outcomes
    simulated = [o for o in outcomes if o.view_deg is not None]
    tables = [search_table(simulated)] if simulated else []
    tables.append(stages_table([o for o in outcomes if o.seen in SHOWN]))
    return {"pilot_search": "\n\n".join(table.markdown() for table in tables)}


STUDY = Study(
    name="pilot_search",
    flags=PilotSearchFlags,
    content=SearchContent,
    measure=measure_search,
    blocks=search_blocks,
    check=check_search,
)
"""The study that `python -m lab pilot_search` runs."""
