"""The lowest versions that wheel and project declare do: graphs load, films and pairs are read."""

import os
import re
import sys
import sysconfig
import tomllib
from collections.abc import Callable
from pathlib import Path

import pytest
from conftest import ROOT, run_process
from pilot_films import robust_film
from streams import write_film

from web.package.wheel import write_wheel

READ = """
import cv2
from oorc_receiver import Receiver, read_pair
from oorc_receiver._checkout.export.runtime import load_session
from oorc_receiver._checkout.models import FILM_GRAPH, REGION_GRAPH, shipped_graphs

for graph in (*shipped_graphs().values(), FILM_GRAPH, REGION_GRAPH):
    load_session(graph, 2, 60)
film, receiver, frames, texts = cv2.VideoCapture("film.avi"), Receiver(30), [], []
while (frame := film.read()[1]) is not None:
    frames.append(frame[..., ::-1])
    events = receiver.push(frames[-1], len(frames) / 30)
    texts += [event["text"] for event in events if event["event"] == "message"]
print(texts[0], read_pair(frames[0], frames[2])["confidence"] > 0.9)
"""


PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
ALONE = {name: None for name in os.environ if name.startswith(("PYTHON", "PYTEST"))}
"""Variables without which a process finds its own environment's packages alone."""


@pytest.fixture
def environment(tmp_path: Path) -> Callable[..., str]:
    """Makes a fresh environment with the lowest versions that a list of packages declares.

    A package that is listed as ``package>=version`` is installed as ``package==version``. It takes
    a minute or two and a package index; `.github/workflows/tests.yml` runs these tests.
    """
    found = run_process(sys.executable, "-m", "pip", "index", "versions", "numpy", status=None)
    if found.status:
        pytest.skip("no package index can be reached")

    def make(listed: list[str], *more: str) -> str:
        lowest = [re.sub(r">=([\d.]+)$", r"==\1.*", each) for each in listed]
        assert all("==" in each for each in lowest)
        python = str(tmp_path / "venv" / "bin" / "python")
        run_process(sys.executable, "-m", "venv", "venv", cwd=tmp_path, **ALONE)
        words = (python, "-m", "pip", "install", "-q", *more, *lowest)
        run_process(*words, cwd=tmp_path, **ALONE)
        return python

    return make


@pytest.mark.exhaustive
def test_the_lowest_versions_of_the_wheel_read_a_film_and_a_pair(
    tmp_path: Path, environment: Callable[..., str]
) -> None:
    python = environment(
        PROJECT["dependency-groups"]["receive"], f"{write_wheel(tmp_path)}[opencv]"
    )
    write_film(tmp_path / "film.avi", robust_film(36)[0], codec="FFV1")
    assert run_process(python, "-c", READ, cwd=tmp_path, **ALONE).stdout == "no marks True\n"


@pytest.mark.exhaustive
def test_the_lowest_versions_of_the_project_pass_the_tests_of_its_core(
    environment: Callable[..., str],
) -> None:
    """PyTorch, of which one version is declared, and what only tests need come from here."""
    listed = PROJECT["project"]["dependencies"]
    python = environment([each for each in listed if not each.startswith("torch=")])
    (packages,) = Path(python).parents[1].glob("lib/python*/site-packages")
    (packages / "others.pth").write_text(f"{sysconfig.get_path('purelib')}\n")  # are found last
    words = (python, "-m", "pytest", "-m", "core", "-n", "2")
    found = run_process(*words, limit_s=2000, **ALONE)
    assert " passed" in found.stdout and "failed" not in found.stdout
