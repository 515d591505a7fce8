"""Results that are stored as they end."""

from pathlib import Path

import pytest
from conftest import slow

from link.errors import InputError
from reports.engine.backends import Backend
from reports.engine.checked import seal
from reports.engine.stored import resume


def double(number: int) -> int:
    if number < 0:
        raise ValueError("made to fail")
    return 2 * number


@pytest.mark.parametrize("jobs", [1, slow(2)])
def test_results_come_in_the_order_of_the_items(jobs: int, tmp_path: Path) -> None:
    items = {"three": 3, "one": 1, "two": 2}
    found = resume(double, items, tmp_path / "double.jsonl", Backend(jobs), "double")
    assert list(found.items()) == [("three", 6), ("one", 2), ("two", 4)]


def test_what_is_stored_is_not_computed_again(tmp_path: Path) -> None:
    file = tmp_path / "made" / "double.jsonl"
    assert resume(double, {"one": 1}, file, Backend(), "double") == {"one": 2}
    file.write_text(seal({"name": "one", "result": 7}))
    found = resume(double, {"two": 2, "one": 1}, file, Backend(), "double")
    assert list(found.items()) == [("two", 4), ("one", 7)]


DAMAGED = ["", "{}", "[]", "null", "2", '{"name": "one"}', '{"name": "one", "result": 7}', "NaN"]
DAMAGED += ['{"name": "one", "result": NaN}', "[" * 10**5, "\xff", '{"name": 1, "result": 2}']


@pytest.mark.parametrize("line", DAMAGED, ids=lambda line: line[:20])
def test_a_damaged_line_is_made_again(tmp_path: Path, line: str) -> None:
    file = tmp_path / "double.jsonl"
    items = {"one": 1, "two": 2}
    resume(double, items, file, Backend(), "double")
    whole = file.read_bytes()
    first, second = whole.splitlines(keepends=True)
    file.write_bytes(line.encode("latin-1") + b"\n" + second)
    assert resume(double, items, file, Backend(), "double") == {"one": 2, "two": 4}
    assert file.read_bytes() == second + first
    file.write_bytes(first.replace(b'"result": 2', b'"result": 3') + second)
    assert resume(double, items, file, Backend(), "double") == {"one": 2, "two": 4}


def test_a_line_that_was_cut_off_is_made_again(tmp_path: Path) -> None:
    file = tmp_path / "double.jsonl"
    resume(double, {"one": 1, "two": 2}, file, Backend(), "double")
    file.write_text(file.read_text()[:-9])
    assert resume(double, {"one": 1, "two": 2}, file, Backend(), "double") == {"one": 2, "two": 4}
    assert len(file.read_text().splitlines()) == 2


def test_one_that_fails_is_named_after_the_others_were_stored(tmp_path: Path) -> None:
    file = tmp_path / "double.jsonl"
    with pytest.raises(InputError, match=r"double: 1 of 3 failed: bad: ValueError: made to fail"):
        resume(double, {"one": 1, "bad": -1, "two": 2}, file, Backend(), "double")
    assert len(file.read_text().splitlines()) == 2
