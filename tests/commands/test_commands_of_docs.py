"""Each command that the documents name is in the repository, or at a tag that the page names."""

import re
from pathlib import Path

import pytest
from conftest import ROOT

from lab.__main__ import STUDIES

TAG = "results-2026-11"
"""Tag of the commit that measured what the repository no longer measures."""
COMMAND = re.compile(r"python -m ([a-z_][\w.]*\w)")
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]
FOREIGN = ("venv", "pip", "http.server")
"""Modules of Python's own that the documents run."""


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_command_exists(page: Path) -> None:
    text = page.read_text("utf-8")
    missing = {name for name in COMMAND.findall(text) if not is_command(name)}
    assert not missing or TAG in text, f"{page.name}: no module {sorted(missing)}"
    assert set(re.findall(r"python -m lab ([a-z_]+)", text)) <= set(STUDIES), page.name


def is_command(name: str) -> bool:
    """Whether a module that can be run has this name."""
    path = ROOT / name.replace(".", "/")
    return name in FOREIGN or path.with_suffix(".py").is_file() or (path / "__main__.py").is_file()


def test_the_frozen_commands_are_gone() -> None:
    answered = (ROOT / "docs" / "answered.md").read_text("utf-8")
    frozen = set(re.findall(r"\| `(reports\.[\w.]+)", answered))
    assert len(frozen) >= 11
    assert not [name for name in frozen if is_command(name)]
