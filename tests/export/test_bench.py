"""The benchmark of a decoder against two warps."""

import json

import pytest
from conftest import Command

from export import bench
from models import PRETRAINED


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
