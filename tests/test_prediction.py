"""Protocols, the prediction report's arithmetic, and the sensitivity's paired change."""

import numpy as np
import pytest
from tolerances import FLOAT64

from link.errors import InputError
from models.classical.naive import Naive
from models.classical.two_step import TwoStep
from reports.engine import protocols
from reports.engine.predict import Method
from reports.score.metrics import Row, make_row
from reports.score.paper import METHODS, paper_accuracy
from reports.studies import prediction, sensitivity

CELL = ("canon-lg", 45.0, 3)
BITS = 10_000


def rows(**accuracies: float) -> list[Row]:
    """One cell's four rows, accuracies in per cent."""
    made = []
    for method in METHODS:
        correct = round(BITS * accuracies[method] / 100)
        made.append(make_row(method, *CELL, 100, BITS, correct, 100 * (correct // 100) ** 2))
    return made


def as_printed() -> dict[str, float]:
    return {m: 100 * (paper_accuracy(*CELL, m) or 0.0) for m in METHODS}


def test_a_perfect_prediction_has_no_error_and_the_printed_ranking() -> None:
    perfect = rows(**as_printed())
    assert prediction.error(perfect) < 0.01
    assert prediction.rankings(perfect) == (1, 1, 1)


def test_the_error_is_in_points_and_absolute() -> None:
    shifted = as_printed()
    shifted["naive"] += 3.0
    shifted["two_step"] -= 1.0
    assert prediction.error(rows(**shifted)) == pytest.approx(1.0, abs=0.01)


def test_a_wrong_winner_is_counted() -> None:
    wrong = as_printed() | {"hidden_ratex": 99.9}
    assert prediction.rankings(rows(**wrong)) == (1, 0, 0)


def test_a_tie_for_first_counts_for_both() -> None:
    tied = as_printed() | {"oorc": 99.0, "hidden_ratex": 99.0}
    assert prediction.rankings(rows(**tied)) == (1, 1, 1)


def test_every_disagreement_gets_a_reason() -> None:
    table = prediction.worst(rows(naive=99.0, two_step=50.0, oorc=60.0, hidden_ratex=50.0), 4)
    cells = [line.strip("| ").split(" | ") for line in table.splitlines()[2:]]
    assert [len(cell) for cell in cells] == [5] * 4
    assert all(len(cell[4]) > 20 for cell in cells)


def test_the_paper_protocol_fixes_thresholds_of_the_baselines_alone() -> None:
    methods = protocols.apply("paper", [Method(name) for name in (*METHODS, "phi")])
    built = {method.name: method.build() for method in methods}
    naive, two_step = built["naive"], built["two_step"]
    assert isinstance(naive, Naive) and naive.threshold == 2.5
    assert isinstance(two_step, TwoStep) and two_step.threshold == 2.5
    assert dict(methods[2].options) == dict(methods[4].options) == {}


@pytest.mark.parametrize("name", protocols.PROTOCOLS)
def test_every_protocol_builds_its_decoders(name: str) -> None:
    for method in protocols.apply(name, [Method(m) for m in METHODS]):
        method.build()


def test_an_unknown_protocol_lists_the_valid_ones() -> None:
    with pytest.raises(InputError, match=r"protocol 'papr'.*fair, paper"):
        protocols.apply("papr", [Method("naive")])


def test_the_paired_change_cancels_what_frames_share() -> None:
    rng = np.random.default_rng(0)
    base = rng.uniform(60, 90, 50)
    same = sensitivity.change(base + 2.0, base)
    assert same.mean == pytest.approx(2.0) and same.half < FLOAT64
    noisy = sensitivity.change(base + 2.0 + rng.normal(0, 1, 50), base)
    assert noisy.half == pytest.approx(1.96 / np.sqrt(50), rel=0.3)
