"""The studies of visibility: their tables, and the page that flickers."""

import json
import re
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from conftest import ROOT, OpenWindow

from lab.study import read_results, run_study
from lab.visibility import flicker, presets

if TYPE_CHECKING:
    from playwright.sync_api import Page


@pytest.mark.slow
def test_what_docs_store_is_what_the_command_computes(tmp_path: Path) -> None:
    run_study(presets.STUDY, ["--out", str(tmp_path)])
    stored = read_results(presets.STUDY, ROOT / "docs" / "visibility.json")
    assert read_results(presets.STUDY, tmp_path / "visibility.json").content == stored.content


@pytest.fixture(scope="module")
def flickering(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("page")
    flags = ["--width", "256", "--height", "192", "--seconds", "2", "--out", str(out)]
    run_study(flicker.STUDY, flags)
    return out / "flicker.html"


def test_the_flicker_page_loads_nothing_and_states_what_is_computed(flickering: Path) -> None:
    text = flickering.read_text()
    assert "default-src 'none'" in text
    assert not re.search(r"(?:src|href)=|@import|url\(", text)
    match = re.search(r"const page = (\{.*\});", text)
    assert match
    today, hidden = json.loads(match[1])["settings"]
    assert today["seen"]["15"]["block"] > 5
    assert hidden["seen"]["60"]["high"] < 1
    assert "elaTCSF" in json.loads(match[1])["viewing"]


def wait_until(page: "Page", condition: str) -> None:
    """The page's policy forbids what Playwright's own wait does."""
    for _ in range(100):
        if page.evaluate(condition):
            return
        page.wait_for_timeout(100)
    raise AssertionError(f"never: {condition}")


@pytest.mark.slow
@pytest.mark.parametrize("width", [390, 1280])
def test_the_flicker_page_fits_and_shows_its_states(
    width: int, open_window: OpenWindow, flickering: Path
) -> None:
    page = open_window(width, 900)
    problems: list[str] = []
    page.on("pageerror", lambda error: problems.append(str(error)))
    page.goto(flickering.as_uri())
    wait_until(page, "image.complete")
    assert page.evaluate("document.documentElement.scrollWidth") == width
    shown = page.evaluate(
        """[0, 1].map(state => sides.map(side => {
            draw(side, state);
            const { width, height } = side.canvas;
            const data = side.canvas.getContext("2d").getImageData(0, 0, width, height).data;
            return [data[0], side.bits[0]];
        }))"""
    )
    (off, hidden_off), (on, hidden_on) = shown
    assert on[0] - off[0] == 3 * on[1]
    assert hidden_on[0] - hidden_off[0] == 2 * hidden_on[1] - 1
    page.select_option("select >> nth=1", "30")
    assert "×" in page.inner_text("section >> nth=1")
    page.click("#start")
    wait_until(page, "sides.every(side => side.shown > 3)")
    assert problems == []
