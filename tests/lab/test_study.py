"""What all studies share: flags, resuming, the file of the results, and the pages of docs/."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import pytest
from conftest import ROOT, Command

from lab import __main__ as lab
from lab.study import Results, Study, StudyFlags, Workshop, read_results, stored_results
from link.errors import InputError


@dataclass(frozen=True)
class SquareFlags(StudyFlags):
    """Squares of numbers."""

    numbers: tuple[int, ...] = (1, 2)
    """What is squared."""


@dataclass(frozen=True)
class Squares:
    squares: list[int]


def count_and_square(number: int) -> int:
    if number > 99:
        raise InputError(f"{number} is too large")
    return number**2


def measure(flags: SquareFlags, workshop: Workshop) -> Squares:
    items = {f"number {number}": number for number in flags.numbers}
    return Squares(list(workshop.each(count_and_square, items).values()))


def blocks(results: Mapping[str, Results[Squares]]) -> dict[str, str]:
    return {"squares": " and ".join(f"{name}: {r.content.squares}" for name, r in results.items())}


SQUARES = Study(
    "squares", SquareFlags, Squares, measure, blocks, lambda _: "squares", Path("docs/squares.md")
)
FLAGS = ["--jobs", "1"]


@pytest.fixture
def workplace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(lab, "find_study", lambda name: SQUARES)
    return tmp_path


def test_a_study_writes_its_results_and_shows_them(workplace: Path, command: Command) -> None:
    done = command(lab.main, "squares", *FLAGS, "--numbers", "3", "4")
    assert done.stdout == "squares: [9, 16]\n"
    out = workplace / "runs" / "squares"
    stored = json.loads((out / "squares.json").read_text())
    assert stored["squares"] == [9, 16]
    assert stored["meta"]["flags"] == {"seed": 0, "numbers": [3, 4]}
    assert (out / "squares.md").read_text() == done.stdout
    assert read_results(SQUARES, out / "squares.json").content == Squares([9, 16])
    assert not (workplace / "docs").exists()


def test_other_flags_find_the_results_that_they_share(workplace: Path, command: Command) -> None:
    command(lab.main, "squares", *FLAGS, "--numbers", "3", "4")
    (kept,) = (workplace / "runs" / "squares").glob("*.jsonl")
    first = kept.read_text()
    command(lab.main, "squares", *FLAGS, "--numbers", "4", "5")
    assert kept.read_text().startswith(first)
    assert len(kept.read_text().splitlines()) == 3


def test_a_task_that_fails_costs_no_other_its_result(workplace: Path, command: Command) -> None:
    done = command(lab.main, "squares", *FLAGS, "--numbers", "3", "100", "4", status=2)
    assert done.stdout == ""
    assert done.stderr.splitlines()[-1].startswith("error: count and square: 1 of 3 failed: number")
    out = workplace / "runs" / "squares"
    (kept,) = out.glob("*.jsonl")
    assert len(kept.read_text().splitlines()) == 2
    assert not (out / "squares.json").exists()


def test_results_are_kept_in_docs_where_that_is_asked(workplace: Path, command: Command) -> None:
    page = workplace / "docs" / "squares.md"
    page.parent.mkdir()
    page.write_text("By hand.\n<!-- squares -->\n<!-- /squares -->\n")
    command(lab.main, "squares", *FLAGS, "--numbers", "3", "--keep")
    assert "-->\nsquares: [9]\n<!--" in page.read_text()
    assert (page.parent / "squares" / "squares.json").is_file()


def test_results_of_other_flags_stand_beside_each_other_by_their_labels(
    workplace: Path, command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    labelled = replace(SQUARES, label=lambda flags: f"of_{flags.numbers[0]}")
    monkeypatch.setattr(lab, "find_study", lambda name: labelled)
    command(lab.main, "squares", *FLAGS, "--numbers", "3")
    done = command(lab.main, "squares", *FLAGS, "--numbers", "2")
    assert done.stdout == "of_2: [4] and of_3: [9]\n"


@pytest.mark.parametrize("content", ["{}", '{"meta": {}, "squares": ["x"]}', '{"squares": [1]}'])
def test_results_that_something_else_wrote_are_refused(content: str, tmp_path: Path) -> None:
    (tmp_path / "squares.json").write_text(content)
    with pytest.raises(InputError, match=r"squares\.json"):
        stored_results(SQUARES, tmp_path)


def test_the_list_names_every_study(command: Command) -> None:
    said = command(lab.main).stdout
    assert all(f"\n{name} " in said for name in lab.STUDIES)


@pytest.mark.parametrize("name", list(lab.STUDIES))
def test_a_study_bears_the_name_by_which_it_is_run(name: str) -> None:
    assert lab.find_study(name).name == name


@pytest.mark.parametrize("name", list(lab.STUDIES))
def test_what_docs_show_of_a_study_is_what_docs_store(name: str) -> None:
    chosen = lab.find_study(name)
    folder = ROOT / chosen.kept
    if chosen.page is None or not stored_results(chosen, folder):
        pytest.skip("docs store no results of it")
    page = (ROOT / chosen.page).read_text()
    for block, text in chosen.blocks(stored_results(chosen, folder)).items():
        if block in chosen.printed_alone:
            continue
        assert f"<!-- {block} -->\n{text}\n<!-- /{block} -->" in page
