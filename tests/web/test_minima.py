"""The lowest versions that the wheel declares do: all graphs load, a film and a pair are read."""

import os
import re
import sys
import tomllib
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
from oorc_receiver._checkout.models import FILM_GRAPH, shipped_graphs

for graph in (*shipped_graphs().values(), FILM_GRAPH):
    load_session(graph, 2, 60)
film, receiver, frames, texts = cv2.VideoCapture("film.avi"), Receiver(30), [], []
while (frame := film.read()[1]) is not None:
    frames.append(frame[..., ::-1])
    events = receiver.push(frames[-1], len(frames) / 30)
    texts += [event["text"] for event in events if event["event"] == "message"]
print(texts[0], read_pair(frames[0], frames[2])["confidence"] > 0.9)
"""


@pytest.mark.exhaustive
def test_the_lowest_declared_versions_read_a_film_and_a_pair(tmp_path: Path) -> None:
    """Install the wheel with the lowest versions into a fresh environment, and read there.

    What pyproject.toml lists for it as ``package>=version`` is installed as ``package==version``.
    It takes a minute or two and a package index; `.github/workflows/tests.yml` runs it.
    """
    found = run_process(sys.executable, "-m", "pip", "index", "versions", "numpy", status=None)
    if found.status:
        pytest.skip("no package index can be reached")
    groups = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["dependency-groups"]
    lowest = [re.sub(r">=([\d.]+)$", r"==\1.*", each) for each in groups["receive"]]
    assert all("==" in each for each in lowest)
    wheel, python = write_wheel(tmp_path), str(tmp_path / "venv" / "bin" / "python")
    without = {name: None for name in os.environ if name.startswith("PYTHON")}
    for words in (
        (sys.executable, "-m", "venv", "venv"),
        (python, "-m", "pip", "install", "-q", f"{wheel}[opencv]", *lowest),
    ):
        run_process(*words, cwd=tmp_path, **without)
    write_film(tmp_path / "film.avi", robust_film(36)[0], codec="FFV1")
    assert run_process(python, "-c", READ, cwd=tmp_path, **without).stdout == "no marks True\n"
