"""The study of how much must be received until a message is read."""

import json
from pathlib import Path

import numpy as np
import pytest
from conftest import Command

from link.code.collect_fine import information_of
from reports.studies import information
from reports.studies.framing import received_llr

SMALL = ("--trials", 1, "--ber", 0.05, 0.2, "--n-bytes", 100, "--jobs", 1)


@pytest.mark.slow
def test_a_message_needs_its_information_and_a_little_more(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(information, "SPEED_BYTES", 300)
    done = command(information.main, *SMALL, "--out", tmp_path)
    assert done.status == 0, done.stderr
    content = json.loads((tmp_path / "information.json").read_text())
    rows = {(row["code"], row["ber"]): row for row in content["rows"]}
    assert list(rows) == [(code, ber) for code in information.LOOP for ber in (0.05, 0.2)]
    for row in rows.values():
        assert 1 <= row["least"] <= row["median"] <= row["most"] < 2.2
    assert [row["ber"] for row in content["speed"]] == [0.05, 0.2]
    assert information.information_table(content).count("\n") == 8
    assert (tmp_path / "information.png").is_file()


def test_the_information_is_that_of_the_received_scores() -> None:
    """What the study takes for granted is what the collector measures."""
    rng = np.random.default_rng(0)
    for ber in (0.02, 0.1, 0.2):
        llr = received_llr(np.ones(50_000, np.int64), ber, 1, rng)
        mean = information_of(llr.astype(np.float32)) / llr.size
        assert mean == pytest.approx(information.capacity_of(ber), abs=1e-4)
