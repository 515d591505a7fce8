"""The fit's arithmetic on toy observations, and one real cell."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from data_gen.frame_pair import Cell
from data_gen.pairs import FITTED_FILE
from reports.lab import calibrate
from reports.lab.calibrate import BOUNDS, GRID, NOMINAL, CalibrateConfig, GridCell, Observation
from reports.score.paper import paper_accuracy

CELL = Cell("canon-lg", 45.0, 3)
TASK = GridCell(CELL, (("drift", 0.02),))


def toy(naive: float, two_step: float) -> dict[str, NDArray[Any]]:
    """One frame of two bits, 0 and 1; the block of bit 1 differs by the value given."""
    tiles = np.array([[0.0, 0.0, 4.0, 4.0]])
    return {
        "truth": np.array([[0, 1]]),
        "labels": np.array([0, 0, 1, 1]),
        "naive_blocks": np.array([[0.0, naive]]),
        "two_step_blocks": np.array([[0.0, two_step]]),
        "naive_tiles": tiles,
        "two_step_tiles": tiles,
    }


def test_the_cut_lies_between_two_separate_classes() -> None:
    rng = np.random.default_rng(0)
    labels = rng.integers(0, 2, 400)
    differences = 3.0 * labels + rng.normal(0, 0.1, 400)
    assert calibrate.svm_threshold(differences, labels) == pytest.approx(1.5, abs=0.1)


@pytest.mark.parametrize(
    ("kind", "naive", "two_step"),
    [("constant", 2.0, 1.5), ("held", 2.5, 2.5), ("frame", 2.0, 2.0), ("once", 2.0, 2.0)],
)
def test_thresholds_lie_where_their_kind_says(kind: str, naive: float, two_step: float) -> None:
    for offset, right in ((-0.2, 0.5), (0.2, 1.0)):
        observed = {TASK: toy(naive + offset, two_step + offset)}
        found = calibrate.cell_accuracies(observed, [TASK], kind)
        assert found == {(CELL, "naive"): right, (CELL, "two_step"): right}


def test_frontal_thresholds_are_learned_on_frontal_captures_alone() -> None:
    frontal = GridCell(Cell("canon-lg", 0.0, 3), TASK.point)
    oblique = toy(3.0, 3.0)
    oblique["naive_tiles"] = oblique["naive_tiles"] * 100
    observed = {TASK: oblique, frontal: toy(3.0, 3.0)}
    assert calibrate.cell_accuracies(observed, [TASK, frontal], "frontal")[CELL, "naive"] == 1.0
    assert calibrate.cell_accuracies(observed, [TASK, frontal], "once")[CELL, "naive"] == 0.5


def test_the_misfit_is_in_points_of_the_printed_number() -> None:
    printed = paper_accuracy(CELL.pair, CELL.view_deg, CELL.kappa, "naive")
    assert printed is not None
    off = calibrate.cell_misfits({(CELL, "naive"): printed + 0.03})
    assert off[CELL, "naive"] == pytest.approx(3.0)


def test_a_clearly_better_point_wins_and_a_tie_goes_to_nominal() -> None:
    edge = {"drift": 0.05, "jitter_px": 0.3, "noise_scale": 1.0}
    points = [edge, dict(NOMINAL)]
    assert calibrate.choose_point([1.0, 1.0 + 2 * calibrate.TOLERANCE], points) == 0
    assert calibrate.choose_point([1.0, 1.0 + calibrate.TOLERANCE / 2], points) == 1


def test_the_grid_lies_within_its_bounds_and_holds_nominal() -> None:
    for name, (low, high) in BOUNDS.items():
        assert low <= min(GRID[name]) and max(GRID[name]) <= high
        assert NOMINAL[name] in GRID[name]


def test_the_committed_fit_came_from_this_grid() -> None:
    stored = json.loads(FITTED_FILE.read_text())
    assert {k: tuple(v) for k, v in stored["bounds"].items() if k != "falloff"} == BOUNDS
    for views in stored["fitted"].values():
        for values in views.values():
            assert all(values[name] in GRID[name] for name in GRID)
    assert stored["meta"]["threshold"] == min(
        stored["meta"]["misfit_points"], key=lambda kind: stored["meta"]["misfit_points"][kind]
    )


def test_a_cell_is_observed_the_same_whoever_looks() -> None:
    kept, again = (calibrate.observe_cell(Observation(TASK, 1, 0)) for _ in range(2))
    assert kept == again
    first = {key: np.array(values) for key, values in kept.items()}
    bright = first["labels"] == 1
    for method in ("naive", "two_step"):
        tiles = first[f"{method}_tiles"][0]
        assert tiles[bright].mean() > tiles[~bright].mean()
        assert first[f"{method}_blocks"].shape == first["truth"].shape == (1, 59)


def test_a_fit_goes_on_with_the_cells_that_are_missing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    frontal = GridCell(Cell("canon-lg", 0.0, 3), TASK.point)
    config = CalibrateConfig(frames=1, work=tmp_path, jobs=1)
    looked = []

    def observe(task: Observation) -> dict[str, Any]:
        looked.append(task.where)
        return {key: values.tolist() for key, values in toy(3.0, 3.0).items()}

    monkeypatch.setattr(calibrate, "observe_cell", observe)
    first = calibrate.observe_all(config, [TASK], "fall-off")
    both = calibrate.observe_all(config, [TASK, frontal], "fall-off")
    assert looked == [TASK, frontal]
    assert first.keys() == {TASK} and both.keys() == {TASK, frontal}
    assert np.array_equal(both[TASK]["naive_blocks"], first[TASK]["naive_blocks"])
    calibrate.observe_all(replace(config, seed=1), [TASK], "fall-off")
    assert looked == [TASK, frontal, TASK]
