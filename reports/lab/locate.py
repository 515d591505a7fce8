"""How well the display is found: python -m reports.lab.locate [--photos DIR] [--frames 200].

Simulated photographs of held-out pictures in drawn rooms, with ratex patches and without; held-out
photographs that show no display; and real photographs whose corners are known, where a folder is
given.
"""

import json
import os
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import tyro
from joblib import Parallel, delayed
from numpy.typing import NDArray
from tqdm import tqdm

from data_gen.film.scenes import SceneSettings, draw_scene, photograph
from data_gen.pairs import PAIRS, get_pair
from data_gen.pictures.library import Picture, load_pictures
from export.locate.find import locate
from export.locate.patches import image_pyramid
from export.locate.refine import corners_on_patches
from link.embed import embed
from link.errors import InputError, at_least, run_cli
from link.geometry import as_corners
from link.images import read_image, write_bytes
from link.layout import Layout, make_layout
from reports.score.metrics import provenance, wilson

VIEWS = (0.0, 15.0, 30.0, 45.0, 60.0)
FOUND_PX = 10.0
"""A display counts as found where no corner is farther off, at a width of 1280."""
COVERS = (("5 to 15 %", 0.0, 0.15), ("15 to 40 %", 0.15, 0.4), ("over 40 %", 0.4, 1.0))
SUFFIXES = (".jpeg", ".jpg", ".png")
KAPPA = 3


@dataclass(frozen=True)
class LocateConfig:
    """What is photographed."""

    photos: Path | None = None
    """Folder of photographs, each with a (4, 2) array of corners: NAME.jpeg and NAME.npy."""
    frames: int = 200
    """Simulated photographs with patches, and as many without."""
    size: tuple[int, int] = (1280, 720)
    seed: int = 0
    jobs: int = os.cpu_count() or 1
    out: Path = Path("runs/locate")


@dataclass(frozen=True)
class Outcome:
    """One photograph."""

    kind: str
    """"patches", "edges" or "empty"."""
    room: str
    view_deg: float
    coverage: float
    found: bool
    """Something was returned."""
    errors_px: list[float]
    """Of the four corners; empty where nothing was returned. Without patches, in the turn that is
    nearest."""
    seconds: float


def film(
    kind: str, index: int, layout: Layout, pictures: Sequence[Picture], config: LocateConfig
) -> Outcome:
    """Draw a scene, photograph it and look for the display."""
    rng = np.random.default_rng([config.seed, index, len(kind)])
    pair = get_pair(str(rng.choice(list(PAIRS))))
    view = float(rng.choice(VIEWS))
    plain = kind == "edges"  # then a window in a screen, or a second display, is a display too
    settings = SceneSettings(
        size=config.size,
        window=False if plain else None,
        second_display=False if plain else None,
        pictures=pictures,
    )
    scene = draw_scene(layout, pair, view, rng, settings)
    picture = pictures[int(rng.integers(len(pictures)))]
    shown = embed(picture.rgb, rng.integers(0, 2, layout.n_bits), layout, KAPPA)
    image = photograph(shown.embedded if index % 2 else shown.original, scene, rng)
    found, seconds = timed(image, layout)
    errors: list[float] = []
    if found is not None:
        turns = 4 if plain else 1
        off = [
            np.linalg.norm(np.roll(found, turn, axis=0) - scene.corners, axis=1)
            for turn in range(turns)
        ]
        errors = [float(e) for e in min(off, key=np.max)]
    return Outcome(kind, scene.room, view, scene.coverage, found is not None, errors, seconds)


def look_at_nothing(picture: Picture, layout: Layout) -> Outcome:
    """A photograph that shows no display."""
    found, seconds = timed(picture.rgb, layout)
    kind = "empty, patches sought" if layout.ratex else "empty"
    return Outcome(kind, "", 0.0, 0.0, found is not None, [], seconds)


def timed(image: NDArray[np.uint8], layout: Layout) -> tuple[NDArray[np.float64] | None, float]:
    """Corners found, and the seconds it took on one thread."""
    cv2.setNumThreads(1)
    start = time.perf_counter()
    found = locate(image, layout)
    return (None if found is None else found.corners), time.perf_counter() - start


def visibilities(index: int, patches: int, pictures: list[Picture], seed: int) -> list[float]:
    """After aligning from 4 % off: in the right turn of the corners and in the three wrong ones."""
    cv2.setNumThreads(1)
    rng = np.random.default_rng([seed, index, patches])
    layout = make_layout(ratex=patches)
    pair = get_pair(str(rng.choice(list(PAIRS))))
    scene = draw_scene(layout, pair, float(rng.choice(VIEWS)), rng, SceneSettings())
    picture = pictures[int(rng.integers(len(pictures)))].rgb
    shown = embed(picture, rng.integers(0, 2, layout.n_bits), layout, KAPPA)
    image = photograph(shown.embedded, scene, rng)
    pyramid = image_pyramid(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY))
    side = np.sqrt(cv2.contourArea(scene.corners.astype(np.float32)))
    start = scene.corners + rng.uniform(-0.04, 0.04, (4, 2)) * side
    turned = [np.roll(start, turn, axis=0) for turn in range(4)]
    return [corners_on_patches(image, pyramid, corners, layout)[1] for corners in turned]


def visibility_levels(config: LocateConfig) -> list[dict[str, Any]]:
    """What right and wrong turns reach, by number of patches: what `export.locate` accepts by."""
    layout = make_layout()
    pictures = load_pictures("train", layout.width, layout.height)
    rows = []
    for patches in (1, 2, 3, 5):
        work = (
            delayed(visibilities)(i, patches, pictures, config.seed)
            for i in range(-(-config.frames // 5))
        )
        seen = np.array(Parallel(config.jobs)(work))
        right, wrong = np.quantile(seen[:, 0], (0, 0.05, 0.5)), np.quantile(seen[:, 1:], (0.95, 1))
        rows.append(
            {
                "patches": patches,
                "photographs": len(seen),
                "right_least_q05_median": right.tolist(),
                "wrong_q95_most": wrong.tolist(),
            }
        )
    return rows


def overlap(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    """Intersection over union of two convex quadrilaterals."""
    one, two = a.astype(np.float32), b.astype(np.float32)
    shared = cv2.intersectConvexConvex(one, two)[0]
    return float(shared / (cv2.contourArea(one) + cv2.contourArea(two) - shared))


def measure_photos(folder: Path) -> list[dict[str, Any]]:
    """Overlap and corner errors on real photographs, without a layout.

    Raises:
        InputError: no such folder, or no photograph with corners in it.
    """
    if not folder.is_dir():
        raise InputError(f"--photos: {folder} is no folder")
    rows = []
    for path in sorted(p for p in folder.iterdir() if p.suffix.lower() in SUFFIXES):
        if not path.with_suffix(".npy").is_file():
            continue
        truth = as_corners(np.load(path.with_suffix(".npy")))
        found = locate(read_image(path))
        iou = 0.0 if found is None else overlap(found.corners, truth)
        off = [] if found is None else np.linalg.norm(found.corners - truth, axis=1).tolist()
        rows.append({"image": path.name, "iou": iou, "errors_px": off})
    if not rows:
        raise InputError(f"--photos: no NAME.jpeg with NAME.npy in {folder}")
    return rows


def summary(name: str, outcomes: list[Outcome], scale: float) -> dict[str, Any]:
    """Detection rate and corner errors of a group, with 95 % intervals."""
    right = [o for o in outcomes if o.found and max(o.errors_px) < FOUND_PX * scale]
    errors = np.array([o.errors_px for o in right]).reshape(-1, 4)
    rng = np.random.default_rng(0)  # photographs are drawn anew, with all four corners
    medians = [
        np.median(errors[rng.integers(len(errors), size=len(errors))])
        for _ in range(500 * (len(right) > 0))
    ]
    low, high = wilson(len(right), len(outcomes))
    return {
        "group": name,
        "photographs": len(outcomes),
        "found": len(right),
        "found_low": low,
        "found_high": high,
        "wrong": sum(o.found for o in outcomes) - len(right),
        "median_px": float(np.median(errors)) if len(right) else None,
        "median_low": float(np.quantile(medians, 0.025)) if medians else None,
        "median_high": float(np.quantile(medians, 0.975)) if medians else None,
        "q95_px": float(np.quantile(errors, 0.95)) if len(right) else None,
        "median_ms": 1000 * float(np.median([o.seconds for o in outcomes])),
    }


def groups(outcomes: list[Outcome]) -> dict[str, list[Outcome]]:
    """Name -> photographs of one kind: all, by coverage, view and room."""
    split: dict[str, list[Outcome]] = {"all": outcomes}
    for name, low, high in COVERS:
        split[f"covers {name}"] = [o for o in outcomes if low <= o.coverage < high]
    for view in VIEWS:
        split[f"{view:g}°"] = [o for o in outcomes if o.view_deg == view]
    for room in sorted({o.room for o in outcomes}):
        split[f"{room} room"] = [o for o in outcomes if o.room == room]
    return {name: some for name, some in split.items() if some}


def table(rows: list[dict[str, Any]]) -> str:
    """Markdown."""
    lines = [
        "| photographs | n | found % | 95 % interval | wrong | corner error, px (95 % of median) | "
        "95 % below | ms |",
        "|---|---:|---:|---:|---:|---:|---:|---:|",
    ]
    for row in rows:
        share = 100 * row["found"] / max(1, row["photographs"])
        error, tail = "–", "–"
        if row["median_px"] is not None:
            error = f"{row['median_px']:.2f} ({row['median_low']:.2f} – {row['median_high']:.2f})"
            tail = f"{row['q95_px']:.2f}"
        lines.append(
            f"| {row['group']} | {row['photographs']} | {share:.1f} | "
            f"{100 * row['found_low']:.1f} – {100 * row['found_high']:.1f} | {row['wrong']} | "
            f"{error} | {tail} | {row['median_ms']:.0f} |"
        )
    return "\n".join(lines)


def main() -> None:
    """Photograph, look, print and write locate.json."""
    config = tyro.cli(LocateConfig)
    at_least(1, frames=config.frames, jobs=config.jobs)
    at_least(0, seed=config.seed)
    real = [] if config.photos is None else measure_photos(config.photos)
    kinds = {"patches": make_layout(), "edges": make_layout(ratex=0)}
    work = []
    for kind, layout in kinds.items():
        pictures = load_pictures("test", layout.width, layout.height)
        work += [delayed(film)(kind, i, layout, pictures, config) for i in range(config.frames)]
    photographs = [p for p in load_pictures("test", *config.size) if p.name.startswith("photo/")]
    work += [delayed(look_at_nothing)(p, layout) for layout in kinds.values() for p in photographs]
    done = list(tqdm(Parallel(config.jobs, return_as="generator")(work), total=len(work)))

    levels = visibility_levels(config)
    rows, empty = [], []
    for kind in kinds:
        outcomes = [o for o in done if o.kind == kind]
        for name, some in groups(outcomes).items():
            rows.append(summary(f"{kind}: {name}", some, max(config.size) / 1280))
    for kind in dict.fromkeys(o.kind for o in done if o.kind.startswith("empty")):
        outcomes = [o for o in done if o.kind == kind]
        empty.append(
            {"group": kind, "photographs": len(outcomes), "found": sum(o.found for o in outcomes)}
        )
    print(f"Simulated, {config.size[0]}x{config.size[1]}, held-out pictures.\n\n{table(rows)}\n")
    for row in empty:
        print(f"{row['group']}: a display is reported in {row['found']} of {row['photographs']}")
    for row in levels:
        right = ", ".join(f"{value:.2f}" for value in row["right_least_q05_median"])
        wrong = ", ".join(f"{value:.2f}" for value in row["wrong_q95_most"])
        print(
            f"visibility of {row['patches']} patches in {row['photographs']} training scenes: "
            f"right (least, 5 %, median) {right}; wrong turns (95 %, most) {wrong}"
        )
    if real:
        overlaps = [row["iou"] for row in real]
        print(
            f"real photographs: {len(real)}, IoU mean {np.mean(overlaps):.3f}, "
            f"least {min(overlaps):.3f}"
        )
    content = {
        "meta": provenance(config.seed, simulated=True),
        "rows": rows,
        "empty": empty,
        "visibility": levels,
        "photos": real,
        "outcomes": [asdict(o) for o in done],
    }
    path = config.out / "locate.json"
    write_bytes(path, (json.dumps(content, indent=1, allow_nan=False) + "\n").encode())
    print(path)


if __name__ == "__main__":
    run_cli(main)
