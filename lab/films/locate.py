"""How well displays are found in photographs.

It searches simulated photographs of held-out pictures in drawn rooms, with ratex patches and
without; held-out photographs that show no display; and, where a folder is given, real photographs
whose corners are known.
"""

import io
import time
import zipfile
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from data_gen.film.scenes import SceneSettings, draw_scene, photograph
from data_gen.pairs import PAIRS, get_pair
from data_gen.pictures.library import Picture, load_pictures
from export.locate.find import locate
from lab.study import Results, Study, StudyFlags, Workshop
from link.embed import embed
from link.errors import InputError, at_least
from link.geometry import as_corners
from link.images import IMAGE_SUFFIXES, read_image
from link.layout import Layout, make_layout
from link.outside import read_bounded
from reports.engine.backends import one_thread
from reports.engine.checked import Share
from reports.render.tables import Table, TableCell, percent, share_interval
from reports.score.intervals import wilson

VIEWS = (0.0, 15.0, 30.0, 45.0, 60.0)
"""Angles, in degrees, between camera and display that are simulated."""
FOUND_PX = 10.0
"""Largest distance of a corner from the true one, in pixels of an image 1280 wide, at which a
display counts as found."""
COVERS = (("5 to 15 %", 0.0, 0.15), ("15 to 40 %", 0.15, 0.4), ("over 40 %", 0.4, 1.0))
"""Groups of photographs by the share of the image that the display covers: name, least, most."""
SHOWN_KAPPA = 3
"""Gray levels added to a block that carries a 1, in simulated photographs."""
MAX_CORNERS_BYTES = 4096
"""Largest size, in bytes, of a file of true corners; eight numbers and a header take 192."""


@dataclass(frozen=True)
class LocateFlags(StudyFlags):
    """What is photographed."""

    photos: Path | None = None
    """Folder of photographs, each with a (4, 2) array of corners: NAME.jpeg and NAME.npy."""
    frames: int = 200
    """Number of simulated photographs with patches; there are as many without."""
    size: tuple[int, int] = (1280, 720)
    """Width and height of the simulated photographs, pixels."""


@dataclass(frozen=True)
class Search:
    """A photograph in which the display is to be found."""

    kind: str
    """What it shows: "patches" for a display with ratex patches, "edges" for one without."""
    index: int
    """Number of the photograph among those of its kind."""
    layout: Layout
    """Layout of what is displayed."""
    size: tuple[int, int]
    """Width and height of the photograph, pixels."""
    seed: int
    """Seed of the scene."""


@dataclass(frozen=True)
class EmptySearch:
    """A photograph of the test pictures that shows no display."""

    number: int
    """Number of the picture among the photographs of the test pictures."""
    layout: Layout
    """Layout of what is looked for."""
    size: tuple[int, int]
    """Width and height of the photograph, pixels."""


@dataclass(frozen=True)
class Sighting:
    """What the search found in one photograph."""

    kind: str
    """What the photograph shows: "patches", "edges" or "empty"."""
    room: str
    """Kind of room; empty where none was drawn."""
    view_deg: float
    """Angle between the camera and the normal of the display, degrees."""
    coverage: float
    """Share of the image that the display covers, in [0, 1]."""
    found: bool
    """Whether a display was reported."""
    errors_px: list[float]
    """Distances of the four corners from the true ones, pixels; empty where nothing was reported.
    Without patches, they are those of the turn of the corners that is nearest."""
    seconds: float
    """Time of the search on one thread, seconds."""


@lru_cache(maxsize=4)
def split_pictures(split: str, width: int, height: int) -> list[Picture]:
    """Load the pictures of a split once a process."""
    return load_pictures(split, width, height)


def bare_photographs(size: tuple[int, int]) -> list[Picture]:
    """List the test pictures that are photographs, and so show no display."""
    pictures = split_pictures("test", *size)
    return [picture for picture in pictures if picture.name.startswith("photo/")]


def search_scene(search: Search) -> dict[str, Any]:
    """Draw a scene, photograph it and look for the display; return the fields of a `Sighting`."""
    layout = search.layout
    pictures = split_pictures("test", layout.width, layout.height)
    rng = np.random.default_rng([search.seed, search.index, len(search.kind)])
    pair = get_pair(str(rng.choice(list(PAIRS))))
    view = float(rng.choice(VIEWS))
    plain = search.kind == "edges"  # then a window in a screen, or a second display, is one too
    settings = SceneSettings(
        size=search.size,
        window=False if plain else None,
        second_display=False if plain else None,
        pictures=pictures,
    )
    scene = draw_scene(layout, pair, view, rng, settings)
    picture = pictures[int(rng.integers(len(pictures)))]
    shown = embed(picture.rgb, rng.integers(0, 2, layout.n_bits), layout, SHOWN_KAPPA)
    image = photograph(shown.embedded if search.index % 2 else shown.original, scene, rng)
    found, seconds = timed_search(image, layout)
    errors: list[float] = []
    if found is not None:
        off = [
            np.linalg.norm(np.roll(found, turn, axis=0) - scene.corners, axis=1)
            for turn in range(4 if plain else 1)
        ]
        errors = [float(e) for e in min(off, key=np.max)]
    sighted = found is not None
    found_here = Sighting(search.kind, scene.room, view, scene.coverage, sighted, errors, seconds)
    return asdict(found_here)


def search_empty(search: EmptySearch) -> dict[str, Any]:
    """Look for a display where there is none; return the fields of a `Sighting`."""
    picture = bare_photographs(search.size)[search.number]
    found, seconds = timed_search(picture.rgb, search.layout)
    kind = "empty, patches sought" if search.layout.ratex else "empty"
    return asdict(Sighting(kind, "", 0.0, 0.0, found is not None, [], seconds))


def timed_search(
    image: NDArray[np.uint8], layout: Layout
) -> tuple[NDArray[np.float64] | None, float]:
    """Search an image on one thread.

    Returns:
        (4, 2) corners of the display, or None where none was found, and the seconds it took.
    """
    one_thread()
    start = time.perf_counter()
    found = locate(image, layout)
    return (None if found is None else found.corners), time.perf_counter() - start


def overlap(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    """Intersection over union of two convex quadrilaterals, each (4, 2); in [0, 1].

    >>> square = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]])
    >>> round(overlap(square, square + [1.0, 0.0]), 3)
    0.333
    """
    one, two = a.astype(np.float32), b.astype(np.float32)
    shared = cv2.intersectConvexConvex(one, two)[0]
    return float(shared / (cv2.contourArea(one) + cv2.contourArea(two) - shared))


def read_corners(file: Path) -> NDArray[np.float64]:
    """Read the true corners of a display from a NumPy file.

    Returns:
        (4, 2) corners (x, y) in pixels.

    Raises:
        InputError: the file is missing or damaged, or holds no four corners.
    """
    data = read_bounded(file, MAX_CORNERS_BYTES)
    try:
        return as_corners(np.load(io.BytesIO(data), allow_pickle=False))
    except (ValueError, EOFError, TypeError, zipfile.BadZipFile) as error:
        raise InputError(f"{file}: no four corners ({error})") from None


@dataclass(frozen=True)
class PhotoFound:
    """What the search found in a real photograph."""

    image: str
    """Name of the file."""
    iou: Share
    """Intersection over union of the display found and the true one, in [0, 1]."""
    errors_px: list[float]
    """Distances of the four corners from the true ones, pixels; empty where nothing was found."""


@dataclass(frozen=True)
class LocateContent:
    """What was found."""

    sightings: list[Sighting]
    """One entry for each simulated photograph of a display."""
    empty: list[Sighting]
    """One entry for each photograph that shows no display, by what was sought."""
    photos: list[PhotoFound]
    """One entry for each real photograph; empty where no folder was named."""


def measure_photos(folder: Path) -> list[PhotoFound]:
    """Measure overlap and corner errors on real photographs, which are searched without a layout.

    Raises:
        InputError: no such folder, or no photograph with corners in it.
    """
    if not folder.is_dir():
        raise InputError(f"--photos: {folder} is no folder")
    rows = []
    for path in sorted(p for p in folder.iterdir() if p.suffix.lower() in IMAGE_SUFFIXES):
        if not path.with_suffix(".npy").is_file():
            continue
        truth = read_corners(path.with_suffix(".npy"))
        found = locate(read_image(path))
        iou = 0.0 if found is None else overlap(found.corners, truth)
        off = [] if found is None else np.linalg.norm(found.corners - truth, axis=1).tolist()
        rows.append(PhotoFound(path.name, iou, off))
    if not rows:
        raise InputError(f"--photos: no NAME.jpeg with NAME.npy in {folder}")
    return rows


def summarise_sightings(name: str, sightings: list[Sighting], scale: float) -> dict[str, Any]:
    """Summarise a group of photographs, with 95 % intervals.

    Args:
        name: name of the group.
        sightings: what was found in each photograph.
        scale: width of the photographs relative to 1280 pixels, by which `FOUND_PX` is scaled.

    Returns:
        numbers of photographs, of displays ``found``, and of ``wrong`` reports; median and 95 %
        quantile of the corner errors of those found, pixels (None where there are none); median
        time of a search, milliseconds.
    """
    right = [o for o in sightings if o.found and max(o.errors_px) < FOUND_PX * scale]
    errors = np.array([o.errors_px for o in right]).reshape(-1, 4)
    rng = np.random.default_rng(0)  # photographs are drawn anew, with all four corners
    medians = [
        np.median(errors[rng.integers(len(errors), size=len(errors))])
        for _ in range(500 * (len(right) > 0))
    ]
    low, high = wilson(len(right), len(sightings))
    return {
        "group": name,
        "photographs": len(sightings),
        "found": len(right),
        "found_low": low,
        "found_high": high,
        "wrong": sum(o.found for o in sightings) - len(right),
        "median_px": float(np.median(errors)) if len(right) else None,
        "median_low": float(np.quantile(medians, 0.025)) if medians else None,
        "median_high": float(np.quantile(medians, 0.975)) if medians else None,
        "q95_px": float(np.quantile(errors, 0.95)) if len(right) else None,
        "median_ms": 1000 * float(np.median([o.seconds for o in sightings])),
    }


def group_sightings(sightings: list[Sighting]) -> dict[str, list[Sighting]]:
    """Group photographs of one kind: all of them, and by coverage, view and room."""
    split: dict[str, list[Sighting]] = {"all": sightings}
    for name, low, high in COVERS:
        split[f"covers {name}"] = [s for s in sightings if low <= s.coverage < high]
    for view in VIEWS:
        split[f"{view:g}°"] = [s for s in sightings if s.view_deg == view]
    for room in sorted({s.room for s in sightings}):
        split[f"{room} room"] = [s for s in sightings if s.room == room]
    return {name: some for name, some in split.items() if some}


def sighting_table(rows: list[dict[str, Any]]) -> Table:
    """Show what `summarise_sightings` says of each group."""
    heads = ["n", "found %", "95 % interval", "wrong", "corner error, px (95 % of median)"]
    entries: list[list[str | TableCell]] = []
    for row in rows:
        error, tail = TableCell("–"), "–"
        if row["median_px"] is not None:
            interval = f"{row['median_low']:.2f} – {row['median_high']:.2f}"
            error, tail = TableCell(f"{row['median_px']:.2f}", interval), f"{row['q95_px']:.2f}"
        entries.append(
            [
                row["group"],
                str(row["photographs"]),
                percent(row["found"] / max(1, row["photographs"]), 1),
                share_interval(row["found_low"], row["found_high"], 1),
                str(row["wrong"]),
                error,
                tail,
                f"{row['median_ms']:.0f}",
            ]
        )
    return Table(["photographs", *heads, "95 % below", "ms"], entries)


def check_locate(flags: LocateFlags) -> None:
    """Raise an `InputError` that names the first flag with a wrong value."""
    at_least(1, frames=flags.frames)
    SceneSettings(size=flags.size).check()


def measure_locate(flags: LocateFlags, workshop: Workshop) -> LocateContent:
    """Photograph, and look."""
    photos = [] if flags.photos is None else measure_photos(flags.photos)
    kinds = {"patches": make_layout(), "edges": make_layout(ratex=0)}
    searches = {
        f"{kind} {index}": Search(kind, index, layout, flags.size, flags.seed)
        for kind, layout in kinds.items()
        for index in range(flags.frames)
    }
    bare = {
        f"{kind} {number}": EmptySearch(number, layout, flags.size)
        for kind, layout in kinds.items()
        for number in range(len(bare_photographs(flags.size)))
    }
    seen = workshop.each(search_scene, searches)
    empty = workshop.each(search_empty, bare)
    return LocateContent(
        [Sighting(**fields) for fields in seen.values()],
        [Sighting(**fields) for fields in empty.values()],
        photos,
    )


def locate_blocks(results: Mapping[str, Results[LocateContent]]) -> dict[str, str]:
    """Tabulate what was found, by kind, coverage, view and room."""
    flags, content = results["locate"].meta["flags"], results["locate"].content
    width, height = flags["size"]
    kinds = dict.fromkeys(s.kind for s in content.sightings)
    rows = [
        summarise_sightings(f"{kind}: {name}", some, max(width, height) / 1280)
        for kind in kinds
        for name, some in group_sightings([s for s in content.sightings if s.kind == kind]).items()
    ]
    parts = [f"Simulated, {width}x{height}, held-out pictures.", sighting_table(rows).markdown()]
    for kind in dict.fromkeys(s.kind for s in content.empty):
        found = [s.found for s in content.empty if s.kind == kind]
        parts.append(f"{kind}: a display is reported in {sum(found)} of {len(found)}")
    if content.photos:
        overlaps = [photo.iou for photo in content.photos]
        parts.append(
            f"real photographs: {len(overlaps)}, IoU mean {np.mean(overlaps):.3f}, "
            f"least {min(overlaps):.3f}"
        )
    return {"locate": "\n\n".join(parts)}


STUDY = Study(
    name="locate",
    flags=LocateFlags,
    content=LocateContent,
    measure=measure_locate,
    blocks=locate_blocks,
    check=check_locate,
)
"""The study that `python -m lab locate` runs."""
