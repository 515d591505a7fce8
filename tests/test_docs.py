"""The Python code that the documents show runs as it stands, from the first block to the last."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
BLOCK = re.compile(r"^```python\n(.*?)^```$", re.DOTALL | re.MULTILINE)
SHOWN = {file: BLOCK.findall(file.read_text()) for file in sorted((ROOT / "docs").glob("*.md"))}


@pytest.mark.parametrize(
    "file", [file for file, found in SHOWN.items() if found], ids=lambda f: f.name
)
def test_the_code_of_a_document_runs(file: Path, tmp_path: Path) -> None:
    """In a process and a folder of its own, where a document may write files and import them."""
    (tmp_path / "script.py").write_text("\n".join(SHOWN[file]))
    done = subprocess.run(
        [sys.executable, "script.py"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT), "MPLBACKEND": "Agg"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
