"""The study of lost and wrong messages."""

from pathlib import Path

import numpy as np
import pytest
from conftest import Command

from lab import __main__ as lab
from lab.comparison import framing
from lab.study import read_results

SMALL = ("--trials", 4, "--ber", 0.02, 0.2, "--jobs", 1)


def test_the_code_holds_at_few_and_fails_at_many_wrong_bits(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(framing, "RANDOM", 6)
    monkeypatch.setattr(framing, "NOISY", 4)
    monkeypatch.setattr(framing, "BATCH", 4)
    done = command(lab.main, "framing", *SMALL, "--wrong", "--out", tmp_path)
    assert done.status == 0, done.stderr
    content = read_results(framing.STUDY, tmp_path / "framing.json").content
    rows = [row for row in content.rows if row.code.startswith("LDPC")]
    assert [(row.loops, row.ber) for row in rows] == [
        (loops, ber) for loops in (1, 2, 3) for ber in (0.02, 0.2)
    ]
    assert [row.failed for row in rows if row.ber == 0.02] == [0, 0, 0]
    assert rows[1].failed == 4
    assert [(row.decodes, row.wrong) for row in content.wrong] == [(6, 0), (4, 0)]
    assert (tmp_path / "framing.png").is_file()
    (stored,) = tmp_path.glob("count_decoded_*.jsonl")
    before = stored.read_bytes()
    assert command(lab.main, "framing", *SMALL, "--wrong", "--out", tmp_path).status == 0
    assert stored.read_bytes() == before


def test_a_batch_begins_where_the_one_before_ended() -> None:
    flags = framing.FramingFlags(trials=3, ber=(0.05, 0.1))
    (code,) = [name for name in framing.CODES if name.startswith("LDPC")]
    batches = list(framing.curve_batches(flags, [code]).values())
    rng = np.random.default_rng(flags.seed)
    for batch in batches:
        again = np.random.default_rng()
        again.bit_generator.state = dict(batch.state)
        pairs = zip(framing.draw_trials(batch, rng), framing.draw_trials(batch, again), strict=True)
        for one, other in pairs:
            assert one.message == other.message
            assert np.array_equal(one.scores, other.scores)
