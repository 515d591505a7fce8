import re
import subprocess
import sys
from pathlib import Path

import pytest

from reports.delivery import readme_block as delivery_block
from reports.metrics import read_metrics
from reports.prediction import readme_block
from reports.readme import DELIVERY, METRICS, readme_table
from reports.tables import paper_tables

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text()


def shell_blocks() -> list[str]:
    return re.findall(r"```bash\n(.*?)```", README, re.DOTALL)


def test_the_table_is_that_of_the_stored_metrics() -> None:
    table = README.split("<!-- table -->\n")[1].split("<!-- /table -->")[0]
    assert table == readme_table(ROOT / METRICS) + "\n"


def test_the_prediction_is_that_of_the_stored_metrics() -> None:
    block = README.split("<!-- prediction -->\n")[1].split("<!-- /prediction -->")[0]
    assert block == readme_block(ROOT / "docs" / "prediction.json") + "\n"


def test_the_receivers_table_is_that_of_the_stored_runs() -> None:
    block = README.split("<!-- receiver -->\n")[1].split("<!-- /receiver -->")[0]
    assert block == delivery_block(ROOT / DELIVERY) + "\n"


def test_the_stored_metrics_are_the_papers_36_cells() -> None:
    rows, meta = read_metrics(ROOT / METRICS)
    assert meta["simulated"] is True
    assert meta["command"] == "python -m reports.readme"
    assert paper_tables(rows).count("| canon-lg |") == 4
    assert len({(row.pair, row.view_deg, row.kappa) for row in rows}) == 36


def test_the_first_screen_has_the_two_commands() -> None:
    first, second = shell_blocks()[0].strip().splitlines()
    assert first.endswith("pip install -e . && .venv/bin/python train.py --pair canon-lg")
    assert second.endswith("pip install -e '.[test]' && .venv/bin/pytest")


@pytest.mark.timeout(900)  # a minute or two on an idle machine
def test_the_commands_of_the_readme_run(tmp_path: Path) -> None:
    script = "".join(shell_blocks()[1:]).replace(".venv/bin/python", sys.executable)
    script = script.replace("runs/", f"{tmp_path}/").replace("--frames 10", "--frames 1")
    done = subprocess.run(
        ["bash", "-ec", script], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr[-2000:]
    assert '"bits": [' in done.stdout
    assert '"text": "Hello"' in done.stdout
    assert (tmp_path / "mine.onnx").is_file()
    assert list((tmp_path / "mine" / "pictures").glob("*_learned.png"))


@pytest.mark.parametrize("link", sorted(set(re.findall(r"\]\(([^)]+)\)", README))))
def test_every_link_of_the_readme_leads_somewhere(link: str) -> None:
    assert (ROOT / link).is_file()
