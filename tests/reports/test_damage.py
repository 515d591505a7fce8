"""A stored run whose files hold something else: a page or one line. tests/fuzz.py changes parts."""

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from conftest import Command, cases, slow
from runs import write_run

from reports.evaluation.page import write_report
from reports.evaluation.versus import compare_runs

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


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("damage") / "good"
    write_run(path)
    write_report(path)
    return path


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


@cases("removed", "truncated", slow("folder"))
def test_a_damaged_picture_is_shown_or_refused(kind: str, shown: Callable[..., bool]) -> None:
    page = shown(lambda folder: put(folder / "stories" / "a.jpg", kind), kind)
    assert page == (kind not in ("removed", "folder"))
    page = shown(lambda folder: put(folder / "config.json", kind), kind)
    assert page
