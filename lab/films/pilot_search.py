"""Measure how often, how soon and how well displays are found by their pilots.

Nothing visible marks a display with pilots. Here `PilotSearch` looks for it in simulated hand-held
films of rooms: of displays that show a preset over a picture or a film, of displays that show these
without a message, and of displays that toggle blocks of another layout. In the last two it must
find nothing.

Films of other cameras, whose corners are known, can be searched instead. Of each film that shows a
display it is told when corners near the true ones came how far in the search, and what they waited
for.
"""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import takewhile
from math import inf
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from data_gen.film.message import FilmSettings, Take, film_message
from data_gen.pairs import GROUPS, pair_names
from data_gen.video import TRUTH
from lab.study import Results, Study, StudyFlags, Workshop
from link.errors import ParameterError, at_least, each_known
from link.geometry import corners_apart, transform
from link.images import image_files
from link.images.files import read_image
from link.outside import read_json_lines
from link.presets import PRESETS
from link.types import Corners, Image
from receiver.decoders import open_decoders
from receiver.pilots.search.pilot_search import PilotDisplay, PilotSearch
from receiver.pilots.search.proposals import PROMISING
from receiver.pilots.search.watch import Trial
from receiver.receiver import Receiver
from reports.render.tables import Table
from reports.score.intervals import wilson

CAMERAS = {
    "hidden": ("hidden", 120),
    "hidden, 60 fps": ("hidden", 60),
    "hidden, 30 fps": ("hidden", 30),
    "fast": ("fast", 60),
    "robust": ("robust", 30),
}
"""Preset, and number of camera frames a second, by the name of the setting."""
SEEN: dict[str, dict[str, Any]] = {
    "display": {},
    "moving": {"carriers": "moving"},
    "still": {"shows_message": False},
    "film": {"shows_message": False, "carriers": "moving"},
    "other": {"name": "paper"},
}
"""What films show, by the arguments of `FilmSettings.of_preset` that are unlike those of a still
picture that carries a message in the preset. In "still" and "film" nothing toggles, and "other"
toggles in a layout that is not looked for: there nothing is to be found."""
SHOWN = "display", "moving"
"""Films in which a display is to be found."""
MAX_VIEW_DEG = 60.0
"""Largest angle of observation that is drawn, degrees."""
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
    """Length of each film, seconds."""
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
    """Length of the film, seconds."""
    pair: str
    """Camera-display pair."""
    seed: int
    """Seed of all draws."""


@dataclass(frozen=True, kw_only=True)
class Trace:
    """How far the search came in a film."""

    coverage: float
    """Share of the image that the display covers in the first frame."""
    error_px: float | None
    """Mean distance of the corners found from the true ones, pixels of the frame; None where
    nothing was found."""
    stages: dict[str, float]
    """Time from the first frame to the one with which the true corners reached each of `STAGES`,
    seconds; those not reached are left out. Anything that is found counts as "found"."""
    evidence: float
    """Largest evidence by which corners near the true ones were weighed; 0 where there were
    none."""


@dataclass(frozen=True, kw_only=True)
class SearchOutcome(Trace):
    """What the search found in one film."""

    preset: str
    """Name of the display's preset and the camera's rate; a key of `CAMERAS`; or of a folder."""
    seen: str
    """Kind of the film; a key of `SEEN`."""
    number: int
    """Number of the film among those of its preset and kind."""
    view_deg: float | None
    """Angle of observation, degrees; None where it is not known."""
    right: bool
    """Whether the layout found is the one shown."""

    @property
    def found_s(self) -> float | None:
        """Time from the first frame to the one in which a display was found, seconds, or None."""
        return self.stages.get("found")


@dataclass(frozen=True)
class SearchContent:
    """Results of all films."""

    outcomes: list[SearchOutcome]
    """One entry for each film."""


def search_film(take: SearchTake) -> SearchOutcome:
    """Film a room and look for a display until one is found."""
    preset, fps = CAMERAS[take.preset]
    settings = FilmSettings.of_preset(
        **{"name": preset, "fps": fps, "loops": inf, **SEEN[take.seen]}
    )
    kind = list(CAMERAS).index(take.preset), list(SEEN).index(take.seen)
    view = float(np.random.default_rng([take.seed, *kind, take.number]).uniform(0, MAX_VIEW_DEG))
    layout = settings.layout
    filmed = (
        (frame.rgb, frame.time_s, transform(frame.H_captured_from_display, layout.corners))
        for frame in film_message(Take(settings, take.pair, view, take.number, take.seed)).frames
    )
    seen = takewhile(lambda frame: frame[1] < take.seconds, filmed)
    found, trace = trace_search(seen, settings.fps)
    right = take.seen in SHOWN and found is not None and found.layout == layout
    return SearchOutcome(
        preset=take.preset,
        seen=take.seen,
        number=take.number,
        view_deg=view,
        right=right,
        **vars(trace),
    )


def trace_search(
    film: Iterable[tuple[Image, float, Corners]], fps: float
) -> tuple[PilotDisplay | None, Trace]:
    """Look for a display in a film until one is found, and note when the true corners came how far.

    Args:
        film: images, their times in seconds, and the true corners in them.
        fps: nominal number of frames of the camera in a second.

    Returns:
        the display found, if any, and how far the search came.
    """
    true: dict[float, Corners] = {}
    stages: dict[str, float] = {}
    evidence, coverage = [0.0], 0.0

    def note(trial: Trial) -> None:
        corners = true[trial.time]
        size = np.sqrt(cv2.contourArea(corners.astype(np.float32)))
        if corners_apart(trial.corners, corners) <= NEAR * size:
            stages.setdefault(STAGE_OF_TRIAL[trial.stage], now - min(true))
            evidence.append(trial.evidence)

    layouts = [preset.layout for preset in PRESETS.values() if preset.layout.pilots]
    search, error, found = PilotSearch(layouts, fps, note), None, None
    for image, now, corners in film:
        if not true:
            coverage = cv2.contourArea(corners.astype(np.float32)) / image[..., 0].size
        true[now] = corners
        found = search.push(image, now)
        if found is not None:
            stages["found"] = now - min(true)
            error = float(np.linalg.norm(found.corners - corners, axis=1).mean())
            break
    trace = Trace(coverage=coverage, error_px=error, stages=stages, evidence=max(evidence))
    return found, trace


def folder_outcome(folder: str) -> SearchOutcome:
    """Search and read a film whose frames lie in a folder."""
    display = PRESETS["hidden"].layout.corners  # all presets have its size
    truth = [line for _, line in read_json_lines(Path(folder) / TRUTH)]
    times = [float(line["time_s"]) for line in truth]
    corners = [transform(np.array(line["H_captured_from_display"]), display) for line in truth]
    images = [read_image(file) for file in image_files(Path(folder))]
    fps = round(1 / float(np.median(np.diff(times))), 2)
    found, trace = trace_search(zip(images, times, corners, strict=True), fps)
    decoders, window_decoder = open_decoders(None, threads=1)
    receiver = Receiver(decoders, fps, window_decoder)
    for image, time in zip(images, times, strict=True):
        if found is not None and receiver.push(image, time).message is not None:
            trace.stages["read"] = time - times[0]
            break
    return SearchOutcome(
        preset=Path(folder).name,
        seen="display",
        number=0,
        view_deg=None,
        right=found is not None,
        **vars(trace),
    )


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
        for seen in SEEN:
            mine = [o for o in outcomes if preset in (o.preset, "all") and o.seen == seen]
            if not mine:
                continue
            right = sum(o.right for o in mine)
            wrong = sum(o.found_s is not None and not o.right for o in mine)
            low, high = wilson(right, len(mine))
            times = [o.found_s for o in mine if o.right and o.found_s is not None]
            errors = [o.error_px for o in mine if o.right and o.error_px is not None]
            row = [preset, "–" if preset == "all" else f"{CAMERAS[preset][1]}", seen]
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
    each_known(CAMERAS, presets=flags.presets)
    each_known(SEEN, seen=flags.seen)
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
        found = workshop.each(search_film, takes)
    return SearchContent(list(found.values()))


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
    label=lambda _: "pilot_search",
    check=check_search,
)
"""The study that `python -m lab pilot_search` runs."""
