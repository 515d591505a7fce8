"""The smaller studies: repeated captures, tuning, leave-one-pair-out, and the benchmark."""

import json
from pathlib import Path

import numpy as np
import pytest
import torch
from conftest import Command

from data_gen.episodes import EpisodeSet
from data_gen.pairs import PAIRS
from export import bench
from link.errors import InputError
from link.frames import SoftBits, combined
from models import PRETRAINED
from reports.engine.records import to_records
from reports.score.accuracy import score
from reports.studies import leave_one_out, tune
from reports.studies.leave_one_out import without


def test_combined_adds_log_likelihood_ratios() -> None:
    one, two = SoftBits(np.array([1.0, -2, 0.5])), SoftBits(np.array([-3.0, 1, 0.5]))
    np.testing.assert_array_equal(combined([one, two]).scores, [-2, -1, 1])
    np.testing.assert_array_equal(combined([one]).bits, one.bits)


@pytest.mark.parametrize("lengths", [(), (3, 4)])
def test_captures_that_cannot_be_combined_are_refused(lengths: tuple[int, ...]) -> None:
    with pytest.raises(InputError, match="equally many bits"):
        combined([SoftBits(np.zeros(n)) for n in lengths])


def test_tuning_ranks_the_grid_best_first() -> None:
    labels = [method.label for method in tune.grid_methods()]
    assert len(set(labels)) == len(labels) == 3 * 16 + 6
    assert labels[0] == "naive C=0.1 pooling=mean train_on=tile"
    assert labels[-1] == "hidden_ratex threshold=constant"
    columns = ["naive worst", "naive best", "naive as good"]
    lines = [
        {
            "method": label, "pair": "canon-lg", "view_deg": view, "kappa": 3, "picture": None,
            "index": 0, "bits": [1] * 10, "scores": [-1.0] * wrong + [1.0] * (10 - wrong),
        }
        for view in (0.0, 45.0)
        for label, wrong in zip(columns, (5, 1, 1), strict=True)
    ]  # fmt: skip
    table = tune.ranked_table(score(to_records(lines)), "naive", columns)
    assert [row[0] for row in table.rows] == ["naive best", "naive as good", "naive worst"]


def test_without_leaves_out_the_episodes_of_one_pair() -> None:
    number = torch.arange(20)
    episodes = EpisodeSet(number, number, number)
    left_out = list(PAIRS)[1]
    assert without(episodes, left_out).bits.tolist() == [k for k in range(20) if k % 9 != 1]
    assert len(without(episodes, leave_one_out.ALL).bits) == 20


@pytest.mark.slow
def test_leave_one_out_trains_ten_decoders_and_resumes(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    flags = ["--episodes", 9, "--steps", 1, "--frames", 1, "--jobs", 1, "--out", tmp_path]
    two = dict(list(PAIRS.items())[:2])
    monkeypatch.setattr(leave_one_out, "PAIRS", two)
    done = command(leave_one_out.main, *flags)
    assert done.status == 0, done.stderr
    found = json.loads((tmp_path / "leave_one_out.json").read_text())["pairs"]
    assert set(found) == set(two)
    assert all(result["bits"] == 4 * 59 for result in found.values())
    made = {file.parent.name: file.stat().st_mtime_ns for file in tmp_path.rglob("decoder.pt")}
    assert set(made) == {"all_nine", *two}
    assert command(leave_one_out.main, *flags).stdout == done.stdout
    again = {file.parent.name: file.stat().st_mtime_ns for file in tmp_path.rglob("decoder.pt")}
    assert again == made


def test_bench_prints_ratios_to_two_warps(command: Command) -> None:
    done = command(bench.main, PRETRAINED / "decoder.onnx", "--rounds", 2, "--warmup", 0)
    assert done.status == 0, done.stderr
    result = json.loads(done.stdout.splitlines()[-1])
    assert result["rounds"] == 2
    assert result["ratios"][bench.REFERENCE] == [1, 1, 1]
    assert len(result["ratios"]) == 5
    assert all(low <= middle <= high for low, middle, high in result["ratios"].values())


def test_bench_bounds_the_pixels_of_scikit_learns_svms_and_says_so(
    command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bench, "MAX_SVM_SAMPLES", 100)
    done = command(bench.main, PRETRAINED / "decoder.onnx", "--rounds", 1, "--warmup", 0)
    assert done.status == 0, done.stderr
    names = json.loads(done.stdout.splitlines()[-1])["ratios"]
    assert sum(name.endswith("fit alone, 100 of 2880 pixels") for name in names) == 2
