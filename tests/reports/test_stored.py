"""Results that are stored as they end."""

from pathlib import Path

import pytest
from conftest import exhaustive

from reports.engine.backends import Backend
from reports.engine.checked import seal
from reports.engine.stored import resume


def kept(items: dict[str, int], file: Path, jobs: int = 1) -> dict[str, int]:
    results, failed = resume(double, items, file, Backend(jobs), "double")
    assert not failed
    return results


def double(number: int) -> int:
    if number < 0:
        raise ValueError("made to fail")
    return 2 * number


@pytest.mark.parametrize("jobs", [1, exhaustive(2)])
def test_results_come_in_the_order_of_the_items(jobs: int, tmp_path: Path) -> None:
    items = {"three": 3, "one": 1, "two": 2}
    found = kept(items, tmp_path / "double.jsonl", jobs)
    assert list(found.items()) == [("three", 6), ("one", 2), ("two", 4)]


def test_what_is_stored_is_not_computed_again(tmp_path: Path) -> None:
    file = tmp_path / "made" / "double.jsonl"
    assert kept({"one": 1}, file) == {"one": 2}
    file.write_text(seal({"name": "one", "result": 7}))
    found = kept({"two": 2, "one": 1}, file)
    assert list(found.items()) == [("two", 4), ("one", 7)]


DAMAGED = ["", "{}", "[]", "null", "2", '{"name": "one"}', '{"name": "one", "result": 7}', "NaN"]
DAMAGED += ['{"name": "one", "result": NaN}', "[" * 10**5, "\xff", '{"name": 1, "result": 2}']


@pytest.mark.parametrize("line", DAMAGED, ids=lambda line: line[:20])
def test_a_damaged_line_is_made_again(tmp_path: Path, line: str) -> None:
    file = tmp_path / "double.jsonl"
    items = {"one": 1, "two": 2}
    kept(items, file)
    whole = file.read_bytes()
    first, second = whole.splitlines(keepends=True)
    file.write_bytes(line.encode("latin-1") + b"\n" + second)
    assert kept(items, file) == {"one": 2, "two": 4}
    assert file.read_bytes() == second + first
    file.write_bytes(first.replace(b'"result": 2', b'"result": 3') + second)
    assert kept(items, file) == {"one": 2, "two": 4}


def test_a_line_that_was_cut_off_is_made_again(tmp_path: Path) -> None:
    file = tmp_path / "double.jsonl"
    kept({"one": 1, "two": 2}, file)
    file.write_text(file.read_text()[:-9])
    assert kept({"one": 1, "two": 2}, file) == {"one": 2, "two": 4}
    assert len(file.read_text().splitlines()) == 2


def test_one_that_fails_is_named_after_the_others_were_stored(tmp_path: Path) -> None:
    file = tmp_path / "double.jsonl"
    items = {"one": 1, "bad": -1, "two": 2}
    results, failed = resume(double, items, file, Backend(), "double")
    assert (results, list(failed)) == ({"one": 2, "two": 4}, ["bad"])
    assert failed["bad"].reason == "ValueError: made to fail"
    assert len(file.read_text().splitlines()) == 2
