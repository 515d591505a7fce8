"""Every file of a stored run, damaged in every place: a page, or one line."""

import json
import pickle
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from conftest import Command, cases, slow
from runs import write_run

from reports.evaluation import page
from reports.evaluation.page import write_report
from reports.evaluation.versus import compare_runs
from reports.run import Run

JSON = ("run.json", "stories.json")
"""Files that --report reads, and that the tests damage."""
CONTENTS: dict[str, bytes | None] = {
    "empty": b"",
    "{}": b"{}",
    "[]": b"[]",
    "[{}]": b"[{}]",
    "NaN": b"NaN",
    "huge": b"9" * 5000,
    "deep": b"[" * 10**5,
    "binary": b"\xff\xfe\0",
    "truncated": None,
    "removed": None,
    "folder": None,
}
"""What stands in place of a file's content; those without content are made otherwise."""
VALUES: list[Any] = [
    None, "x", True, -1, 0, 0.5, 2, 1e9, 1e308, -1e308, 10**60, [], {}, [[]], {"x": 1},
    "../../secret", "{0.x} {", "n" * 300,
]  # fmt: skip


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("damage") / "good"
    write_run(path)
    write_report(path)
    return path


CHARTS = ("chart",)
FINDINGS = ("ranked_comparisons",)


@pytest.fixture(scope="module", autouse=True)
def what_takes_long_is_made_once_of_the_same_numbers() -> Iterator[None]:
    """A damaged run is mostly as it was, and charts and comparisons take most of a page's time."""
    drawn: dict[bytes, Any] = {}

    def shown_of(run: Run) -> object:
        return run.about, run.records, run.scores

    def once(name: str, draw: Callable[..., Any]) -> Callable[..., Any]:
        def remembered(*numbers: Any) -> Any:
            used = [shown_of(part) if isinstance(part, Run) else part for part in numbers]
            key = pickle.dumps((name, used))
            if key not in drawn:
                drawn[key] = draw(*numbers)
            return drawn[key]

        return remembered

    with pytest.MonkeyPatch.context() as patch:
        for name in (*CHARTS, *FINDINGS):
            patch.setattr(page, name, once(name, getattr(page, name)))
        yield


@pytest.fixture
def shown(good: Path, tmp_path: Path, command: Command) -> Iterator[Callable[..., bool]]:
    """Copy the run, damage it, and look at it: whether there is a page, in place of one line."""
    bad = tmp_path / "bad"

    mains: dict[str, Callable[[], object]] = {  # without flags, which take longest to read
        "report": lambda: write_report(bad),
        "compare with": lambda: compare_runs(good, bad),
        "compare to": lambda: compare_runs(bad, good),
    }

    def look(damage: Callable[[Path], None], what: object, how: str = "report") -> bool:
        shutil.rmtree(bad, ignore_errors=True)
        shutil.copytree(good, bad)
        damage(bad)
        done = command(lambda: mains[how]() and None, status=None)
        assert "Traceback" not in done.stderr, what
        if done.status == 0:
            return True
        assert done.status == 2, (what, done.stderr)
        lines = done.stderr.splitlines()
        assert len(lines) == 1 and lines[0].startswith("error: "), (what, done.stderr)
        assert len(lines[0]) < 1000, what
        assert str(bad) in lines[0] or str(good) in lines[0] or "were" in lines[0], what
        return False

    yield look
    (good / "compare.html").unlink(missing_ok=True)


LOOKS = ("report", "compare with", "compare to")


def put(file: Path, kind: str) -> None:
    """Replace a file's content by one of `CONTENTS`."""
    content = CONTENTS[kind]
    if content is not None:
        file.write_bytes(content)
    elif kind == "truncated":
        file.write_bytes(file.read_bytes()[: file.stat().st_size * 2 // 3])
    else:
        file.unlink()
        if kind == "folder":
            file.mkdir()


def test_a_whole_run_is_shown(shown: Callable[..., bool]) -> None:
    for how in LOOKS:
        assert shown(lambda folder: None, "nothing", how)


@pytest.mark.parametrize("name", [JSON[0], *map(slow, JSON[1:])])
def test_a_file_of_other_content_is_refused(shown: Callable[..., bool], name: str) -> None:
    optional = name != "run.json"
    for kind in CONTENTS:
        page = shown(lambda folder, kind=kind: put(folder / name, kind), (name, kind))
        allowed = kind in ("removed", "folder") and optional
        allowed |= kind == "[]" and optional
        assert page <= allowed, (name, kind)


def places(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Every place in a document; of a list its ends alone."""
    yield path
    keys: list[Any] = []
    if isinstance(value, dict):
        keys = list(value)
    elif isinstance(value, list) and value:
        keys = sorted({0, len(value) - 1})
    for key in keys:
        yield from places(value[key], (*path, key))


def changed(value: Any, path: tuple[Any, ...], new: Any) -> Any:
    """The document with another value in one place; with ``removed`` without that place."""
    if not path:
        return new
    copy = value.copy()
    if len(path) == 1 and new is REMOVED:
        del copy[path[0]]
    else:
        copy[path[0]] = changed(value[path[0]], path[1:], new)
    return copy


REMOVED = object()


def damages(file: Path) -> Iterator[tuple[tuple[Any, ...], Any, bytes]]:
    """Each place of a file with each value in it: the place, the value, and the file's bytes."""
    text = file.read_text()
    lines = text.split("\n") if file.suffix == ".jsonl" else [text]
    document = json.loads(lines[0])
    for path in places(document):
        for new in [*VALUES, *([REMOVED] if path else [])]:
            lines[0] = json.dumps(changed(document, path, new))
            yield path, new, "\n".join(lines).encode()


@pytest.mark.slow
@pytest.mark.parametrize("name", JSON)
def test_many_places_of_every_file_may_hold_anything(
    shown: Callable[..., bool], good: Path, name: str
) -> None:
    """Some 20 cases a file, drawn evenly; all of them, 3,510, take many minutes."""
    cases = list(damages(good / name))
    for path, new, data in cases[:: max(1, len(cases) // 20)]:
        shown(lambda folder, data=data: (folder / name).write_bytes(data), (name, path, new))


@cases("removed", "truncated", slow("folder"))
def test_a_damaged_picture_is_shown_or_refused(kind: str, shown: Callable[..., bool]) -> None:
    page = shown(lambda folder: put(folder / "stories" / "a.jpg", kind), kind)
    assert page == (kind not in ("removed", "folder"))
    page = shown(lambda folder: put(folder / "config.json", kind), kind)
    assert page
