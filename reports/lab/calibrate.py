"""Fit what no data sheet tells to the paper's tables: python -m reports.lab.calibrate.

Fitted are exposure drift, jitter and noise scale for each camera and view, and each display's
fall-off with angle, all on grids inside stated bounds. They are fitted to the paper's *naive* and
*two-step* columns alone (72 numbers), on training pictures and training channel draws. OORC and
hidden ratex are held out. The fit is repeated for each way in which the paper may have set the
thresholds (`THRESHOLDS`); the way that fits the two columns best decides the values in
nuisances.json. `python -m reports.studies.prediction` then predicts all four columns on test
pictures.
"""

import json
import os
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from numpy.typing import NDArray

from data_gen.frame_pair import Cell, FramePair, Source
from data_gen.pairs import CAMERAS, DISPLAYS, FALLOFF_BOUNDS, FITTED_FILE
from link.cli import read_flags, run_cli
from link.errors import at_least
from link.images import intensity
from link.layout import block_mean, make_layout
from link.ratex import tile_labels
from models.classical.common import fit_svm, require_ratex, tile_mean
from models.classical.two_step import fit_inverse_response
from reports.engine.backends import Backend, one_thread
from reports.engine.checked import write_json
from reports.engine.digest import code_digest, package_versions, short_digest
from reports.engine.provenance import command
from reports.engine.stored import resume
from reports.score.paper import paper_accuracy

BOUNDS = {
    "drift": (0.01, 0.05),  # shutter and diaphragm repeat to 1 or 2 %; mains, auto-exposure add
    "jitter_px": (0.05, 0.3),  # a hand between two shots, after registration
    "noise_scale": (0.2, 1.0),  # 4 to 7 native pixels a captured one and axis, pooled or skipped
}
"""Least and largest value of each nuisance that the fit may choose."""
GRID = {
    "drift": (0.01, 0.015, 0.02, 0.03, 0.05),
    "jitter_px": (0.05, 0.15, 0.3),
    "noise_scale": (0.2, 0.5, 1.0),
}
"""Values of each nuisance that are tried."""
NOMINAL = {"drift": 0.02, "jitter_px": 0.15, "noise_scale": 0.5}
"""Values that are assumed where the columns do not tell, and the jitter and noise at which the
fall-off is fitted."""
TOLERANCE = 0.3
"""Difference of misfits, in points, that does not tell: of the grid points this close to the best,
the one nearest to nominal is taken. A camera and view has twelve numbers, and the paper's cells
alone scatter by more."""
FITTED_METHODS = ("naive", "two_step")
"""Methods to whose columns the channel is fitted."""
VIEWS, KAPPAS = (0.0, 45.0), (5, 3)
"""Angles, in degrees, and kappas of the paper's tables."""
STORED_VERSION = 1
"""Raise it when `observe_cell` changes what it does, so that older cells are not read again."""
THRESHOLDS = {
    "frame": "learned in each frame pair on its ratex patches",
    "once": "learned once, on the ratex patches of all captures",
    "frontal": "learned once, on the ratex patches of all frontal captures",
    "constant": "fixed: 2 captured gray levels for naive, kappa / 2 after g for two-step",
    "held": "fixed: 2.5 gray levels for both, half of kappa 5, captured and after g",
}
"""Ways in which the paper may have set the thresholds of the two methods, by name."""
Array = NDArray[np.float64]
"""Numbers of any shape."""
GridPoint = tuple[tuple[str, Any], ...]
"""Values of parameters of the channel, by name."""


@dataclass(frozen=True)
class CalibrateConfig:
    """Fit the channel to the paper's columns, on the training split."""

    frames: int = 8
    """Number of frame pairs in each cell at each grid point."""
    seed: int = 0
    """Seed of messages, poses and noise."""
    work: Path = Path("runs/calibration")
    """Folder of finished cells, from which a command that was cut off goes on."""
    out: Path = FITTED_FILE
    """File of the fitted values."""
    jobs: int = os.cpu_count() or 1
    """Number of processes."""


@dataclass(frozen=True)
class GridCell:
    """One cell at one grid point."""

    cell: Cell
    """Camera-display pair, view and kappa."""
    point: GridPoint
    """Values of the nuisances there."""


@dataclass(frozen=True)
class Observation:
    """A cell at a grid point that is to be simulated."""

    where: GridCell
    """Cell and grid point."""
    frames: int
    """Number of frame pairs."""
    seed: int
    """Seed of messages, poses and noise."""


def observe_cell(task: Observation) -> dict[str, Any]:
    """Simulate a cell, and keep what every threshold needs, so that thresholds cost no simulation.

    Returns:
        lists of ``truth`` (N, bits) and ``labels`` (tiles,); and for naive and two_step, in
        captured and in displayed gray levels, of ``blocks`` (N, bits), the mean difference of each
        block, and ``tiles`` (N, tiles), that of each ratex tile.
    """
    one_thread()
    source = Source(make_layout(), "train", task.seed, parameters=task.where.point)
    found: dict[str, Any] = defaultdict(list)
    for index in range(task.frames):
        frame_pair = FramePair(source, task.where.cell, index)
        pair = frame_pair.rectified
        pixels = require_ratex(pair)
        frames_01 = intensity(pair.original), intensity(pair.embedded)
        g = fit_inverse_response(pair, pixels, 4)
        found["truth"].append(frame_pair.displayed.bits.tolist())
        for method, (o, e) in (
            ("naive", [255 * frame for frame in frames_01]),
            ("two_step", [g(frame) for frame in frames_01]),
        ):
            grid = block_mean(e - o, pair.layout.rows, pair.layout.cols)
            found[f"{method}_blocks"].append(grid[pair.layout.message_mask].tolist())
            tiles = tile_mean((e - o)[pixels.y, pixels.x])
            found[f"{method}_tiles"].append(tiles.tolist())
    labels = tile_labels(source.layout).reshape(-1)  # (patches, 4, 4) -> (tiles,)
    return {**found, "labels": labels.tolist()}


def svm_threshold(differences: Array, labels: NDArray[np.intp]) -> float:
    """Learn the threshold of a 1-D SVM on differences (N,) with labels (N,) of 0 or 1."""
    head = fit_svm(differences[:, None], labels, C=10.0)
    return -head.bias / float(head.weights[0])


Observed = Mapping[GridCell, Mapping[str, NDArray[Any]]]
"""What `observe_cell` kept of each cell at each grid point, as arrays."""


def shared_threshold(
    observed: Observed, tasks: Sequence[GridCell], kind: str, method: str
) -> float:
    """Learn one threshold on the ratex tiles of all cells, or, for "frontal", of those at 0°."""
    chosen = [task for task in tasks if kind == "once" or task.cell.view_deg == 0]
    tiles = np.concatenate([observed[task][f"{method}_tiles"] for task in chosen])
    return svm_threshold(tiles.reshape(-1), np.tile(observed[chosen[0]]["labels"], len(tiles)))


def cell_accuracies(
    observed: Observed, tasks: Sequence[GridCell], kind: str
) -> dict[tuple[Cell, str], float]:
    """Accuracy in [0, 1] of naive and two-step in each cell, with thresholds of one kind."""
    result = {}
    for method in FITTED_METHODS:
        shared = (
            shared_threshold(observed, tasks, kind, method) if kind in ("once", "frontal") else 0.0
        )
        for task in tasks:
            seen = observed[task]
            threshold: Any = shared
            if kind == "constant":
                threshold = 2.0 if method == "naive" else task.cell.kappa / 2
            elif kind == "held":
                threshold = 2.5
            elif kind == "frame":
                cuts = [svm_threshold(row, seen["labels"]) for row in seen[f"{method}_tiles"]]
                threshold = np.array(cuts)[:, None]
            decided = seen[f"{method}_blocks"] > threshold
            result[task.cell, method] = float((decided == seen["truth"]).mean())
    return result


def cell_misfits(predicted: Mapping[tuple[Cell, str], float]) -> dict[tuple[Cell, str], float]:
    """Absolute difference of accuracies in [0, 1] from the paper's, in points."""
    return {
        (cell, method): 100
        * abs(value - (paper_accuracy(cell.pair, cell.view_deg, cell.kappa, method) or 0.0))
        for (cell, method), value in predicted.items()
    }


def observe_all(config: CalibrateConfig, tasks: Sequence[GridCell], title: str) -> Observed:
    """Observe every cell at its grid point, in parallel; each is stored as it ends."""
    code = code_digest("data_gen.frame_pair", "models.classical.two_step")
    parts = (STORED_VERSION, config.frames, config.seed, code, *package_versions())
    mark = short_digest(repr(parts))
    named = {
        f"{task.cell.pair} {task.cell.view_deg:g} {task.cell.kappa} {task.point}": task
        for task in tasks
    }
    items = {name: Observation(task, config.frames, config.seed) for name, task in named.items()}
    found = resume(
        observe_cell, items, config.work / f"cells_{mark}.jsonl", Backend(config.jobs), title
    )
    return {
        named[name]: {key: np.array(values) for key, values in lists.items()}
        for name, lists in found.items()
    }


def falloff_value(display: str, green: float) -> tuple[float, float, float]:
    """Fall-off exponents of red, green and blue, with green set and the others in proportion."""
    red, middle, blue = DISPLAYS[display].falloff
    return (round(red * green / middle, 3), green, round(blue * green / middle, 3))


Losses = dict[tuple[str, float], float]
"""Mean misfit, in points, by camera and view."""


def camera_losses(predicted: Mapping[tuple[Cell, str], float]) -> Losses:
    """Average misfits over displays, kappas and the two methods, for each camera and view."""
    groups = defaultdict(list)
    for (cell, _), off in cell_misfits(predicted).items():
        groups[cell.pair.split("-")[0], cell.view_deg].append(off)
    return {group: float(np.mean(offs)) for group, offs in groups.items()}


def cells_at(point: Mapping[str, float], display: str, green: float) -> list[GridCell]:
    """List all cells of one display at a grid point with a fall-off exponent of green."""
    full = (*point.items(), ("falloff", falloff_value(display, green)))
    pairs = [f"{camera}-{display}" for camera in CAMERAS]
    return [GridCell(Cell(p, v, k), full) for p, v, k in product(pairs, VIEWS, KAPPAS)]


def fit_falloff(config: CalibrateConfig) -> dict[str, tuple[float, dict[str, float]]]:
    """Fit each display's fall-off, for each kind of threshold.

    Jitter and noise stay `NOMINAL`; each camera and view has its own best drift.

    Returns:
        by kind of threshold, the mean misfit in points, and the fall-off exponent of green of each
        display.
    """
    options = {d: (low, (low + high) / 2, high) for d, (low, high) in FALLOFF_BOUNDS.items()}
    points = [{**NOMINAL, "drift": drift} for drift in GRID["drift"]]
    every = [
        task
        for display, greens in options.items()
        for green, point in product(greens, points)
        for task in cells_at(point, display, green)
    ]
    observed = observe_all(config, every, "fall-off")
    fits = {}
    for kind in THRESHOLDS:
        chosen, total = {}, []
        for display, greens in options.items():
            scores = {}
            for green in greens:
                losses = [
                    camera_losses(cell_accuracies(observed, cells_at(point, display, green), kind))
                    for point in points
                ]
                scores[green] = float(np.mean([min(x[g] for x in losses) for g in losses[0]]))
            chosen[display] = min(scores, key=lambda green: scores[green])
            total.append(scores[chosen[display]])
        fits[kind] = float(np.mean(total)), chosen
    return fits


def choose_point(losses: Sequence[float], points: Sequence[Mapping[str, float]]) -> int:
    """Find the index of the point nearest to nominal, in shares of the bounds, among the best."""

    def distance(point: Mapping[str, float]) -> float:
        return sum(
            abs(point[name] - NOMINAL[name]) / (high - low) for name, (low, high) in BOUNDS.items()
        )

    close = [i for i, loss in enumerate(losses) if loss <= min(losses) + TOLERANCE]
    return min(close, key=lambda i: (distance(points[i]), losses[i]))


@dataclass(frozen=True)
class NuisanceFit:
    """Nuisances fitted under one kind of threshold."""

    misfit: float
    """Mean misfit over the 72 numbers, points."""
    chosen: dict[tuple[str, float], dict[str, float]]
    """Chosen grid point by camera and view."""
    learned: dict[str, float]
    """Threshold in gray levels by method, where it is learned once for all."""


def fit_nuisances(config: CalibrateConfig, falloff: dict[str, float]) -> dict[str, NuisanceFit]:
    """Find the best grid point of each camera and view, for each kind of threshold."""
    points = [
        {**NOMINAL, "drift": drift, name: value}
        for drift, name in product(GRID["drift"], ("jitter_px", "noise_scale"))
        for value in GRID[name]
        if name == "jitter_px" or value != NOMINAL[name]
    ]  # at each drift a cross through nominal: the columns hardly tell jitter or noise
    tasks = {
        i: [task for d in DISPLAYS for task in cells_at(point, d, falloff[d])]
        for i, point in enumerate(points)
    }
    observed = observe_all(
        config, [task for group in tasks.values() for task in group], "nuisances"
    )
    fits = {}
    for kind in THRESHOLDS:
        losses = [camera_losses(cell_accuracies(observed, group, kind)) for group in tasks.values()]
        best = {g: choose_point([x[g] for x in losses], points) for g in losses[0]}
        fitted = [
            task
            for i, group in tasks.items()
            for task in group
            if best[task.cell.pair.split("-")[0], task.cell.view_deg] == i
        ]
        learned = {
            method: round(shared_threshold(observed, fitted, kind, method), 3)
            for method in FITTED_METHODS
            if kind in ("once", "frontal")
        }
        total = float(np.mean([losses[i][g] for g, i in best.items()]))
        fits[kind] = NuisanceFit(total, {g: points[i] for g, i in best.items()}, learned)
    return fits


def main() -> None:
    """Fit under every kind of threshold, keep the best, write it."""
    config = read_flags(lambda: tyro.cli(CalibrateConfig))
    at_least(1, frames=config.frames, jobs=config.jobs)
    at_least(0, seed=config.seed)
    angles = fit_falloff(config)
    falloff = min(angles.values(), key=lambda fit: fit[0])[1]
    fits = fit_nuisances(config, falloff)
    kind = min(fits, key=lambda name: fits[name].misfit)
    chosen = fits[kind].chosen
    content = {
        "meta": {
            "command": command(),
            "fitted_to": "naive and two-step columns of the paper's Tables 1-4",
            "frames": config.frames,
            "seed": config.seed,
            "threshold": kind,
            "misfit_points": {name: round(fit.misfit, 2) for name, fit in fits.items()},
            "learned_thresholds": {name: fit.learned for name, fit in fits.items() if fit.learned},
            "drift": {
                name: {f"{c} {v:g}": point["drift"] for (c, v), point in fit.chosen.items()}
                for name, fit in fits.items()
            },
        },
        "bounds": {**BOUNDS, "falloff": FALLOFF_BOUNDS},
        "fitted": {
            camera: {f"{view:g}": chosen[camera, view] for view in VIEWS} for camera in CAMERAS
        },
        "falloff": {d: falloff_value(d, green) for d, green in falloff.items()},
    }
    write_json(config.out, content)
    print(json.dumps(content["meta"], indent=1))
    print(f"written: {config.out}; next: python -m reports.studies.prediction")


if __name__ == "__main__":
    run_cli(main)
