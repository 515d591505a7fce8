"""The study of visibility: its tables."""

from pathlib import Path

import pytest
from conftest import ROOT

from lab import visibility
from lab.study import read_results, run_study


@pytest.mark.slow
def test_what_docs_store_is_what_the_command_computes(tmp_path: Path) -> None:
    run_study(visibility.STUDY, ["--out", str(tmp_path)])
    stored = read_results(visibility.STUDY, ROOT / "docs" / "visibility.json")
    assert read_results(visibility.STUDY, tmp_path / "visibility.json").content == stored.content
