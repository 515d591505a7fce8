"""Protocols, the prediction report's arithmetic, and the sensitivity's paired change."""

import numpy as np
import pandas as pd
import pytest
from tolerances import FLOAT64

from lab.simulation import prediction, sensitivity
from lab.simulation.prediction import PredictionContent, Rankings
from lab.study import Results
from link.errors import InputError
from models.classical.naive import Naive
from models.classical.two_step import TwoStep
from reports.engine import protocols
from reports.engine.methods import Method
from reports.engine.records import to_records
from reports.score.accuracy import SCORES, score, to_score_rows
from reports.score.paper import METHODS, paper_accuracy

CELL = ("canon-lg", 45.0, 3)
FRAMES, BITS = 100, 100


def compared(**accuracies: float) -> pd.DataFrame:
    """One cell's four methods beside the paper, accuracies in per cent."""
    lines = []
    for index in range(FRAMES):
        for method in METHODS:
            right = round(accuracies[method] * (index + 1)) - round(accuracies[method] * index)
            lines.append(
                {
                    "method": method,
                    "pair": CELL[0],
                    "view_deg": CELL[1],
                    "kappa": CELL[2],
                    "picture": None,
                    "scores": [1.0] * right + [-1.0] * (BITS - right),
                    "bits": [1] * BITS,
                    "index": index,
                }
            )
    return prediction.compare_with_paper(score(to_records(lines)))


def as_printed() -> dict[str, float]:
    return {m: 100 * (paper_accuracy(*CELL, m) or 0.0) for m in METHODS}


def test_a_perfect_prediction_has_no_error_and_the_printed_ranking() -> None:
    perfect = compared(**as_printed())
    assert prediction.mean_error(perfect) < 0.01
    assert prediction.rank_methods(perfect) == Rankings(1, 1, 1, 1)


def test_the_error_is_in_points_and_absolute() -> None:
    shifted = as_printed()
    shifted["naive"] += 3.0
    shifted["two_step"] -= 1.0
    table = compared(**shifted)
    assert prediction.mean_error(table) == pytest.approx(1.0, abs=0.01)
    assert table["method"].tolist() == list(METHODS)
    assert table["difference"].tolist() == pytest.approx([3.0, -1.0, 0.0, 0.0], abs=0.01)


def test_a_wrong_winner_is_counted() -> None:
    wrong = as_printed() | {"hidden_ratex": 99.9}
    assert prediction.rank_methods(compared(**wrong)) == Rankings(1, 0, 1, 0)


def test_a_tie_for_first_counts_for_both() -> None:
    tied = as_printed() | {"oorc": 99.0, "hidden_ratex": 99.0}
    assert prediction.rank_methods(compared(**tied)) == Rankings(1, 1, 1, 1)


def test_the_largest_disagreements_come_first() -> None:
    table = compared(naive=99.0, two_step=50.0, oorc=60.0, hidden_ratex=50.0)
    rows = prediction.worst_table(table, 3).rows
    assert [row[:3] for row in rows] == [
        ["canon-lg, 45°, κ 3", "hidden_ratex", "50.0"],
        ["canon-lg, 45°, κ 3", "naive", "99.0"],
        ["canon-lg, 45°, κ 3", "oorc", "60.0"],
    ]
    assert [row[4] for row in rows] == ["-45.7", "+40.1", "-38.4"]


def test_the_tables_are_those_of_the_stored_numbers() -> None:
    table = compared(**as_printed())
    content = PredictionContent(to_score_rows(table[SCORES]))
    blocks = prediction.prediction_blocks({"prediction": Results({"seed": 7}, content)})
    assert "1 cells × 100 frame pairs (10000 bits a method)" in blocks["prediction_sample"]
    assert "seed 7" in blocks["prediction_sample"]
    assert blocks["prediction_errors"] == prediction.error_table(table).markdown()
    assert blocks["prediction_means"] == prediction.mean_table(table).markdown()
    assert "| naive | 58.9 / 58.9 |" in blocks["prediction_means"]
    assert "58.9 ±" in blocks["prediction_cells"]


def test_the_paper_protocol_fixes_thresholds_of_the_baselines_alone() -> None:
    methods = protocols.apply_protocol("paper", [Method(name) for name in (*METHODS, "phi")])
    built = {method.name: method.build() for method in methods}
    naive, two_step = built["naive"], built["two_step"]
    assert isinstance(naive, Naive) and naive.threshold == 2.5
    assert isinstance(two_step, TwoStep) and two_step.threshold == 2.5
    assert dict(methods[2].options) == dict(methods[4].options) == {}


@pytest.mark.parametrize("name", protocols.PROTOCOLS)
def test_every_protocol_builds_its_decoders(name: str) -> None:
    for method in protocols.apply_protocol(name, [Method(m) for m in METHODS]):
        method.build()


def test_an_unknown_protocol_lists_the_valid_ones() -> None:
    with pytest.raises(InputError, match=r"protocol 'papr'.*fair, paper"):
        protocols.apply_protocol("papr", [Method("naive")])


def test_the_paired_change_cancels_what_frames_share() -> None:
    rng = np.random.default_rng(0)
    base = rng.uniform(60, 90, 50)
    same = sensitivity.paired_change((base + 2.0) - base)
    assert same.mean == pytest.approx(2.0) and same.half < FLOAT64
    noisy = sensitivity.paired_change((base + 2.0 + rng.normal(0, 1, 50)) - base)
    assert noisy.half == pytest.approx(1.96 / np.sqrt(50), rel=0.3)
