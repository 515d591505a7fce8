"""The study of how many pilots a fit needs."""

from pathlib import Path

import pytest
from conftest import Command

from lab import __main__ as lab
from lab.study import read_results
from lab.visibility import pilots
from lab.visibility.frontier_results import ReadRow
from lab.visibility.pilots import PILOTS, STUDY, PilotRow, pilots_table
from link.layout import count_pilots


def test_every_grid_is_compared_around_what_auto_takes() -> None:
    for (rows, cols), numbers in PILOTS.items():
        auto = count_pilots("auto", rows, cols)
        assert auto in numbers
        assert min(numbers) < auto < max(numbers) < rows * cols


def test_each_further_pilot_costs_a_block_in_the_table() -> None:
    def row(number: int) -> PilotRow:
        read = [
            ReadRow(45.0, method, 4, 100, 90, 0.9, 0.85, 0.95, 0.5, None)
            for method in ("oorc", "learned")
        ]
        return PilotRow(8, 8, number, 3, 45.0, read)

    few, auto = pilots_table([row(4), row(16)]).markdown().splitlines()[2:]
    assert few == "| 8 × 8 | 4 | 90.00 (85.00 – 95.00) | 90.00 (85.00 – 95.00) | 30 |"
    assert auto == "| 8 × 8 | 16, auto | 90.00 (85.00 – 95.00) | 90.00 (85.00 – 95.00) | 24 |"


@pytest.mark.parametrize(
    ("flags", "says"),
    [
        (["--kappas", "0"], "--kappas: need 1 to 64"),
        (["--view", "90"], "--view: need an angle"),
        (["--frames", "0"], "--frames: need"),
        (["--pairs", "x"], "unknown name in --pairs 'x'"),
    ],
)
def test_a_wrong_flag_is_refused_before_any_work(
    flags: list[str], says: str, command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    done = command(lab.main, "pilots", *flags)
    assert (done.status, done.stderr.count("\n")) == (2, 1), done.stderr
    assert done.stderr.startswith(f"error: {says}")
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_the_table_is_made_of_what_is_stored(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pilots, "PILOTS", {(8, 8): (4, 32)})
    flags = ["--pairs", "canon-lg", "--kappas", "3", "--frames", "2", "--jobs", "1"]
    done = command(lab.main, "pilots", *flags, "--out", tmp_path)
    assert done.status == 0, done.stderr
    file = tmp_path / "pilots.json"
    stored = read_results(STUDY, file).content.rows
    assert [(row.pilots, row.layout.n_bits) for row in stored] == [(4, 60), (32, 32)]
    assert [entry.bits for entry in stored[0].read] == [120, 120]
    assert "| 8 × 8 | 4 |" in done.stdout == (tmp_path / "pilots.md").read_text()
    cells = {cell: cell.stat().st_mtime_ns for cell in (tmp_path / "cells").iterdir()}
    assert command(lab.main, "pilots", *flags, "--out", tmp_path).stdout == done.stdout
    assert {cell: cell.stat().st_mtime_ns for cell in (tmp_path / "cells").iterdir()} == cells
