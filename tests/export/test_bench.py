"""The benchmark of a decoder against two warps."""

import json

import pytest
from conftest import Command

from export import bench
from models import PRETRAINED, PRETRAINED_PILOTS


@pytest.mark.slow
def test_bench_prints_ratios_to_two_warps(command: Command) -> None:
    done = command(bench.main, PRETRAINED / "decoder.onnx", "--rounds", 2, "--warmup", 0)
    result = json.loads(done.stdout.splitlines()[-1])
    assert result["rounds"] == 2
    assert result["ratios"][bench.REFERENCE] == [1, 1, 1]
    assert len(result["ratios"]) == 5
    assert all(low <= middle <= high for low, middle, high in result["ratios"].values())


def test_only_patches_are_fitted_by_scikit_learns_svms(command: Command) -> None:
    graph = PRETRAINED_PILOTS / "24x32.onnx"
    done = command(bench.main, graph, "--rounds", 1, "--warmup", 0)
    ratios = json.loads(done.stdout.splitlines()[-1])["ratios"]
    assert not [name for name in ratios if "scikit-learn" in name]
