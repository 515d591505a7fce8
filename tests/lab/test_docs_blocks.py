import json
import re
import sys
import sysconfig
from pathlib import Path

import pytest
from conftest import ROOT, run_process

from lab.docs import METRICS, STEPS
from lab.docs_blocks import BLOCKS
from lab.study import DOCS
from reports.render.tables import cell_tables
from reports.score.accuracy import read_scores

README = (ROOT / "README.md").read_text()
FEW = "--views 45 --kappas 3 --pairs"
"""Flags of `evaluate.py` for one cell of a camera-display pair."""


def shell_blocks() -> list[str]:
    return re.findall(r"```bash\n(.*?)```", README, re.DOTALL)


@pytest.mark.parametrize("name", sorted(BLOCKS))
def test_each_block_is_that_of_the_stored_results(name: str) -> None:
    page = (ROOT / BLOCKS[name].page).read_text()
    _, _, rest = page.partition(f"<!-- {name} -->\n")
    block, end, _ = rest.partition(f"\n<!-- /{name} -->")
    assert end
    assert block == BLOCKS[name].render(ROOT / DOCS)


def asked(command: str) -> str:
    """The study and flags of a command, whichever folder held the study when it was run."""
    words = re.sub(r"python -m |\b(reports\.(\w+\.)?|lab[ .])(?=\w)", "", command)
    return re.split(r" --(?:out|jobs|keep|page)", words)[0].replace("readme", "docs")


def test_every_stored_result_is_of_a_step_that_is_listed() -> None:
    """What the README quotes was made by a command that ``lab.docs --steps all`` runs."""
    listed = {asked(command) for command in STEPS.values()}
    files = (ROOT / DOCS).rglob("*.json")
    for file in files:
        stored = json.loads(file.read_text())["meta"]["command"]
        assert asked(stored) in listed | {"docs"}, file


def test_the_stored_metrics_are_the_papers_36_cells() -> None:
    scores, meta = read_scores(ROOT / METRICS)
    assert meta["simulated"] is True
    assert asked(meta["command"]) == "docs"
    assert [table.rows[1][0] for table in cell_tables(scores)] == ["canon-lg"] * 4
    assert len(scores[["pair", "view_deg", "kappa"]].drop_duplicates()) == 36


def test_the_first_screen_has_the_two_commands() -> None:
    first, second = shell_blocks()[0].strip().splitlines()
    assert first.endswith("pip install -e . && .venv/bin/python train.py --pair canon-lg")
    assert second.endswith("pip install -e '.[test]' && .venv/bin/pytest")


@pytest.mark.exhaustive
@pytest.mark.timeout(900)  # three minutes on an idle machine
def test_the_commands_of_the_readme_run(tmp_path: Path) -> None:
    """With fewer cells and frames; the Python block reads what the commands wrote."""
    script = "".join(shell_blocks()[1:]).replace(".venv/bin/python", sys.executable)
    script = script.replace(".venv/lib/python3*/site-packages", sysconfig.get_path("purelib"))
    script = script.replace("runs/", f"{tmp_path}/")
    script = re.sub(r"--frames (10|5|3)\b", "--frames 1", script)
    for said, run in (
        ("--pairs canon-lg nikon-samsung --views 0 45 --kappas 5 3", f"{FEW} canon-lg"),
        ("--pairs sony-lg", f"{FEW} sony-lg --no-html"),
        ("--films hidden:60", "--films robust:30 --methods naive film"),
    ):
        assert script.count(said) == 1
        script = script.replace(said, run)
    done = run_process("bash", "-ec", script, limit_s=900)
    assert '"text": "Hello"' in done.stdout
    assert list((tmp_path / "mine" / "pictures").glob("*_learned.png"))
    (code,) = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    shown = run_process(sys.executable, "-c", code.replace("runs/", f"{tmp_path}/")).stdout
    assert re.fullmatch(r"(9\d|100)% of 59 bits are right\n", shown)
