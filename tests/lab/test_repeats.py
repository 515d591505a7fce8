"""The study of repeated captures."""

import json
from pathlib import Path

import numpy as np
import pytest
from conftest import Command

from lab import __main__ as lab
from link.errors import InputError
from link.frames import SoftBits, combined
from models import PRETRAINED


def test_combined_adds_log_likelihood_ratios() -> None:
    one, two = SoftBits(np.array([1.0, -2, 0.5])), SoftBits(np.array([-3.0, 1, 0.5]))
    np.testing.assert_array_equal(combined([one, two]).scores, [-2, -1, 1])
    np.testing.assert_array_equal(combined([one]).bits, one.bits)


@pytest.mark.parametrize("lengths", [(), (3, 4)])
def test_captures_that_cannot_be_combined_are_refused(lengths: tuple[int, ...]) -> None:
    with pytest.raises(InputError, match="equally many bits"):
        combined([SoftBits(np.zeros(n)) for n in lengths])


@pytest.mark.slow
def test_repeats_counts_the_errors_of_added_captures(command: Command, tmp_path: Path) -> None:
    flags = ["--frames", 1, "--captures", 1, 2, "--conditions", "kappa1", "--jobs", 1]
    flags += ["--layouts", "ratex", "--checkpoint", PRETRAINED, "--out", tmp_path]
    done = command(lab.main, "repeats", *flags)
    assert done.status == 0, done.stderr
    (row,) = json.loads((tmp_path / "repeats.json").read_text())["rows"]
    bits = row["bits"]
    assert (row["layout"], row["condition"], bits) == ("ratex", "kappa1", 9 * 59)
    once, twice = row["wrong"]["scores added"]
    assert 0 <= twice <= bits
    assert 0 < once < bits / 2
    fitted_once, fitted_twice = row["wrong"]["one fit"]
    assert fitted_once == once
    assert 0 <= fitted_twice <= bits
    for way in row["wrong"]:
        assert f"| ratex | kappa1 | 531 | {way} |" in done.stdout
    assert done.stdout == (tmp_path / "repeats.md").read_text()
    (decoded,) = tmp_path.glob("*.jsonl")
    stored = decoded.read_bytes()
    again = command(lab.main, "repeats", *flags)
    assert again.stdout == done.stdout and decoded.read_bytes() == stored


def test_an_unknown_condition_lists_the_valid_ones(command: Command, tmp_path: Path) -> None:
    done = command(lab.main, "repeats", "--conditions", "fog", "--out", tmp_path)
    assert done.status != 0
    assert "kappa1" in done.stderr
