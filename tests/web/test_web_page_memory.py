"""How much memory the page needs while it watches."""

import sys
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import Command
from web_fixtures import built_site

from reports.films.browser import find_browser
from reports.films.y4m import read_y4m
from reports.lab import page_memory
from reports.lab.page_memory import MemorySample, memory_table, watch_memory, write_room

BOUND_MIB, WASM_MIB = 900, 256
"""Memory of the page's process, and of WebAssembly in it, that a phone can spare."""


@pytest.fixture(scope="module")
def site(make_once) -> Path:
    return built_site(make_once)


@pytest.fixture
def room(tmp_path):
    write_room(tmp_path / "room.y4m", 0, (320, 240))
    return tmp_path / "room.y4m"


def test_a_room_is_filmed_without_a_seam(room) -> None:
    frames = [cv2.GaussianBlur(frame, (0, 0), 3).astype(float) for frame in read_y4m(room)]
    assert len(frames) == page_memory.ROOM_FRAMES
    steps = [np.abs(after - before).mean() for before, after in pairwise(frames)]
    assert np.abs(frames[-1] - frames[0]).mean() < 1.5 * max(steps)
    assert min(steps) > 0


def test_halves_are_compared() -> None:
    grows = [10.0 * k for k in range(10)] + [50.0 + k for k in range(10)]
    samples = [MemorySample(60.0 * k, grown, 100 + k, k, k) for k, grown in enumerate(grows)]
    row = memory_table({"a wall": samples}).markdown().splitlines()[-1]
    cells = [cell.strip() for cell in row.strip("|").split("|")]
    assert cells == ["a wall", "19.0", "19", "20", "90", "59", "59", "102", "119"]


@pytest.mark.parametrize("minutes", ["0", "-1", "2000"])
def test_a_wrong_time_is_refused(minutes: str, command: Command) -> None:
    done = command(page_memory.main, "--minutes", minutes)
    assert (done.status, done.stderr.count("\n")) == (2, 1)
    assert done.stderr.startswith("error: --minutes: need more than 0 and at most 1440")


@pytest.mark.slow
@pytest.mark.skipif(find_browser() is None or sys.platform != "linux", reason="needs Chromium")
def test_memory_is_bounded(site, room) -> None:
    *_, middle, last = watch_memory(site, room, 15.0, every_s=1.0)
    assert last.process_mib < BOUND_MIB
    assert 0 < middle.wasm_mib <= last.wasm_mib < WASM_MIB
