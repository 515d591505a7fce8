"""Expected calibration error on synthetic log-likelihood ratios of known truth."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pandas as pd
import pytest
from scipy.special import expit
from tolerances import FLOAT64

from reports.engine.records import to_records
from reports.render.charts import save_png
from reports.render.reliability import calibration_table, reliability_figure
from reports.score.reliability import (
    ALL,
    calibration_error,
    confidence_bins,
    known_scores,
    reliability_curves,
)


def calibrated(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Bits drawn as their log-likelihood ratios say."""
    generator = np.random.default_rng(0)
    scores = generator.normal(0, 2, count)
    return scores, (generator.random(count) < expit(scores)).astype(np.int64)


def test_calibrated_scores_have_hardly_any_error() -> None:
    assert calibration_error(confidence_bins(*calibrated(100_000))) < 0.005


@pytest.mark.parametrize("factor", [2.0, 0.5])
def test_scaled_scores_are_miscalibrated(factor: float) -> None:
    scores, bits = calibrated(100_000)
    assert calibration_error(confidence_bins(factor * scores, bits)) > 0.05


def test_bins_are_exact() -> None:
    p = np.array([0.52, 0.54, 0.98, 0.02, 0.99, 0.5])
    bins = confidence_bins(np.log(p / (1 - p)), np.array([1, 0, 1, 0, 0, 0]))
    assert [(b.count, b.correct) for b in bins] == [(3, 2), (3, 2)]
    assert [b.confidence for b in bins] == pytest.approx([0.52, 2.95 / 3], abs=FLOAT64)
    assert [(b.low, b.high) for b in bins] == [
        pytest.approx(edges, abs=FLOAT64) for edges in ((0.5, 0.55), (0.95, 1))
    ]
    expected = (abs(2 - 3 * 0.52) + abs(2 - 2.95)) / 6
    assert calibration_error(bins) == pytest.approx(expected, abs=FLOAT64)


def test_infinite_confidence_falls_into_the_last_bin() -> None:
    (only,) = confidence_bins(np.array([-1e3, np.inf]), np.array([0, 1]))
    assert (only.high, only.count, only.accuracy, only.confidence) == (1, 2, 1, 1)


def line(scores: list[float], bits: list[int], condition: str = "") -> dict[str, Any]:
    cell = {"method": "full", "pair": "p", "view_deg": 0.0, "kappa": 3, "index": 0}
    return {**cell, "condition": condition, "picture": None, "scores": scores, "bits": bits}


def test_unknown_bits_are_passed_over() -> None:
    records = to_records([line([1.0, 2.0], [1, -1]), line([-3.0], [0])])
    scores, bits = known_scores(records)
    assert (scores.tolist(), bits.tolist()) == ([1.0, -3.0], [1, 0])
    assert reliability_curves(to_records([line([1.0], [-1])]), ["full"]) == {}


@pytest.mark.slow
def test_tables_and_figure_show_every_method_and_condition(tmp_path: Path) -> None:
    lines = [line([1.0, 4.0], [1, 1], "paper"), line([-0.5], [1], "jpeg")]
    records = to_records(lines)
    everywhere = pd.concat([records, records.assign(condition=ALL)])
    curves = reliability_curves(everywhere, ["full"])
    assert [sum(b.count for b in bins) for bins in curves["full"].values()] == [2, 1, 3]
    errors = calibration_table(curves).markdown()
    assert errors.splitlines()[2] == "| method | paper | jpeg | all |"
    figure = reliability_figure(curves, ["paper", "jpeg", "all"])
    assert [panel.get_title() for panel in figure.axes] == [
        "paper, 2 bits",
        "jpeg, 1 bits",
        "all, 3 bits",
    ]
    save_png(figure, tmp_path / "new" / "diagram.png")
    assert cv2.imread(str(tmp_path / "new" / "diagram.png")) is not None
