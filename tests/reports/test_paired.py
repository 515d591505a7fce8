"""Paired comparison of two methods: exact toy cases, and coverage of the interval."""

from typing import Any

import numpy as np
import pytest
from conftest import cases
from scipy.stats import binomtest
from tolerances import FLOAT64

from link.errors import InputError
from reports.engine.records import to_records
from reports.score.paired import COUNTS, Counts, cells_behind, compare, tally

CELL = {"pair": "canon-lg", "view_deg": 45.0, "kappa": 3}


def lines(method: str, wrong: list[list[int]], **cell: Any) -> list[dict[str, Any]]:
    """One prediction a frame pair; all true bits are 1, ``wrong`` lists those decided 0 as 1."""
    return [
        {
            "method": method,
            **CELL,
            **cell,
            "index": index,
            "picture": None,
            "scores": [-1.0 if error else 1.0 for error in errors],
            "bits": [1] * len(errors),
        }
        for index, errors in enumerate(wrong)
    ]


def counted(made: list[dict[str, Any]], method: str = "a", reference: str = "b") -> Counts:
    """Counts of two methods on the frame pairs of both, (frames, 4)."""
    return tally(to_records(made), method, reference)[COUNTS].to_numpy()


def rng() -> np.random.Generator:
    return np.random.default_rng(0)


def test_identical_methods_differ_by_nothing() -> None:
    wrong = [[1, 0, 0, 0], [0, 0, 0, 0], [1, 1, 0, 0], [0, 0, 0, 1], [0, 0, 0, 0]]
    counts = counted(lines("a", wrong) + lines("b", wrong))
    result = compare(counts, rng())
    assert (result.difference, result.low, result.high, result.p_bits) == (0, 0, 0, 1)
    assert (result.ratio, result.frames, result.bits) == (1, 5, 20)
    assert (result.better, result.worse) == (0, 0)


def test_a_constant_gain_has_an_interval_without_width() -> None:
    counts = counted(lines("a", [[0, 0, 0, 0]] * 6) + lines("b", [[1, 0, 0, 0]] * 6))
    result = compare(counts, rng())
    assert (result.difference, result.low, result.high) == (25, 25, 25)
    assert (result.ratio, result.ratio_low, result.ratio_high) == (0, 0, 0)


def test_discordant_bits_are_mcnemars() -> None:
    a = [[1, 0, 0, 0, 0, 0, 0, 0], [1, 1, 0, 0, 0, 0, 0, 0]]
    b = [[1, 1, 1, 1, 1, 0, 0, 0], [0, 1, 1, 1, 1, 1, 0, 0]]
    result = compare(counted(lines("a", a) + lines("b", b)), rng())
    assert (result.better, result.worse) == (8, 1)
    assert result.p_bits == pytest.approx(binomtest(8, 9).pvalue, abs=FLOAT64)
    assert result.p_bits == pytest.approx(2 * (1 + 9) / 2**9, abs=FLOAT64)
    assert result.difference == pytest.approx(100 * (10 - 3) / 16, abs=FLOAT64)


def test_a_handful_of_frame_pairs_gives_no_interval() -> None:
    made = lines("a", [[0, 0]] * 4) + lines("b", [[1, 1]] * 4)
    result = compare(counted(made), rng())
    assert (result.low, result.high) == (-100, 100)
    assert (result.ratio_low, result.ratio_high) == (0, None)
    assert cells_behind(tally(to_records(made), "b", "a"), rng()) == 0


def test_no_error_of_the_reference_gives_no_ratio() -> None:
    made = lines("a", [[1, 0]] * 6) + lines("b", [[0, 0]] * 6)
    result = compare(counted(made), rng())
    assert (result.ratio, result.ratio_low, result.ratio_high) == (None, 0, None)


def test_unknown_bits_count_for_nothing() -> None:
    made = lines("a", [[0, 1, 1]]) + lines("b", [[1, 1, 0]])
    for line in made:
        line["bits"] = [1, 1, -1]
    assert counted(made).tolist() == [[2, 1, 2, 1]]


def test_frame_pairs_are_matched_whatever_their_order() -> None:
    a = lines("a", [[1, 1], [0, 0]])
    b = lines("b", [[1, 1], [0, 0]])
    assert compare(counted(a + b[::-1]), rng()).worse == 0


def test_behind_counts_the_cells_that_lose() -> None:
    good, bad = [[0, 0, 0, 0]] * 6, [[1, 0, 0, 0]] * 6
    records = to_records(
        [
            *lines("a", good),
            *lines("b", bad),
            *lines("a", bad, kappa=5),
            *lines("b", good, kappa=5),
            *lines("a", bad, condition="jpeg"),
            *lines("b", bad, condition="jpeg"),
        ]
    )
    assert cells_behind(tally(records, "a", "b"), rng()) == 1


@cases(
    ([], "unknown method 'b'; choose one of: a"),
    (lines("b", [[0, 0]]), "not decoded from the same frame pairs"),
    (lines("b", [[0, 0], [0, 0]], kappa=5), "not decoded from the same frame pairs"),
    (lines("b", [[0, 0], [0, 0, 0]]), r"bits of frame pair .* differ"),
    (lines("b", [[0, 0], [0, 0]]) * 2, "is there twice"),
)
def test_what_cannot_be_paired_is_refused(other: list[dict[str, Any]], message: str) -> None:
    with pytest.raises(InputError, match=message):
        counted(lines("a", [[0, 0], [0, 0]]) + other)


def drawn(generator: np.random.Generator, frames: int) -> Counts:
    """Clustered errors of two methods with 4 % and 6 % on average, in `tally`'s form."""
    severity = generator.gamma(0.7, 1 / 0.7, frames)
    p_method, p_reference = (np.minimum(mean * severity, 0.5)[:, None] for mean in (0.04, 0.06))
    uniform = generator.random((2, frames, 59))
    method, reference = uniform[0] < p_method, uniform[1] < p_reference
    counts = [np.full(frames, 59), method.sum(1), reference.sum(1), (method & reference).sum(1)]
    return np.stack(counts, axis=1).astype(np.int64)


@pytest.mark.exhaustive
@pytest.mark.parametrize("frames", [10, 40])
def test_the_interval_covers_the_truth_as_often_as_it_says(frames: int) -> None:
    generator = np.random.default_rng(7)
    total = drawn(generator, 200_000).sum(axis=0)
    truth, truth_ratio = 100 * (total[2] - total[1]) / total[0], total[1] / total[2]
    results = [compare(drawn(generator, frames), generator) for _ in range(200)]
    covered = np.mean([r.low <= truth <= r.high for r in results])
    ratio_covered = np.mean(
        [r.ratio_low <= truth_ratio <= (r.ratio_high or np.inf) for r in results]
    )
    assert 0.91 <= covered <= 0.99
    assert 0.91 <= ratio_covered <= 0.99
