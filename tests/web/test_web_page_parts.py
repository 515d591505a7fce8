"""The page's parts that need no browser, and what its files promise."""

import io
import json
import os
import re
import subprocess
import tarfile

import cv2
import numpy as np
import pytest
from port import same
from tolerances import ROUNDED_LEVELS
from web_films import gray

from link.errors import InputError
from link.presets import PRESETS
from models import FILM_GRAPH, REGION_GRAPH
from web.host import site
from web.host.site import WEB

PAGE = WEB / "page"


def test_colours_become_luma_as_opencv_makes_it(port):
    rgba = np.random.default_rng(0).integers(0, 256, (110, 130, 4)).astype(np.uint8)
    found = port("../page/planes.js").planeOfRgba({"width": 130, "height": 110, "data": rgba})
    same(found, gray(rgba[:, :, :3].copy()))


def test_a_recording_is_an_archive_of_a_film_and_of_what_is_known_about_it(port, tmp_path):
    """It can be unpacked, and OpenCV plays it."""
    luma = np.random.default_rng(0).integers(0, 256, (3, 18, 21)).astype(np.uint8)
    times = [0.5, 0.75, 2.0]
    frames = [{"plane": plane, "time": time} for plane, time in zip(luma, times, strict=True)]
    about = {"versions": {"a": "1"}}
    file = port("../page/recording.js").recordingFile(frames, 29.97, about, 1_800_000_000)
    with tarfile.open(fileobj=io.BytesIO(file.arrayBuffer())) as archive:
        archive.extractall(tmp_path, filter="data")
    assert json.loads((tmp_path / "about.json").read_text()) == {**about, "times": times}
    film = cv2.VideoCapture(str(tmp_path / "film.y4m"))
    for plane in luma:
        ok, image = film.read()
        assert ok
        assert np.abs(image[:, :, 0].astype(int) - plane).max() <= ROUNDED_LEVELS
    assert not film.read()[0]


def test_what_needs_no_browser(node):
    """The tests of web/tests, which compare nothing with Python."""
    done = subprocess.run(["node", "tests/page.test.js"], cwd=WEB, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize("name", ["index.html", "send.html", "about.html"])
def test_the_page_has_no_script_or_style_in_its_text(name):
    html = (PAGE / "frame.html").read_text() + (PAGE / name).read_text()
    policy = re.search(r'Content-Security-Policy"\s+content="([^"]+)"', html)
    rules = dict(rule.strip().split(" ", 1) for rule in policy[1].split(";"))
    assert rules["default-src"] == "'none'"
    assert rules["script-src"] == rules["style-src"] == rules["connect-src"] == "'self'"
    assert "unsafe" not in policy[1]
    assert not re.search(r"<script(?![^>]*\bsrc=)|<style|\bstyle=|\bon\w+=", html)
    scripts = "\n".join(file.read_text() for file in PAGE.glob("*.js"))
    assert not re.search(r"innerHTML|outerHTML|insertAdjacentHTML|document\.write", scripts)


@pytest.mark.slow
def test_the_page_gets_the_graphs_and_every_layout_that_it_reads(tmp_path):
    site.write_inputs(tmp_path)
    tables = json.loads((tmp_path / site.MARK).read_text())
    assert {table["name"] for table in tables} == {"hidden", "fast", "robust"}
    for table in tables:
        pilots = PRESETS[table["name"]].layout.pilot_blocks
        assert table["layout"]["pilot_blocks"] == pilots.tolist()
    for name, graph in {"film": FILM_GRAPH, "region": REGION_GRAPH}.items():
        assert (tmp_path / f"models/{name}.onnx").read_bytes() == graph.read_bytes()


def test_the_icon_is_the_same_in_both_files():
    image = site.draw_icon(16)
    assert image.shape == (16, 16, 3)
    assert image[4, 4].tolist() == [94, 214, 166] and image[4, 6].tolist() == [30, 74, 66]
    assert image[0, 0].tolist() == [16, 33, 31]
    svg = (PAGE / "icon.svg").read_text()
    for x, y in np.argwhere(image[4:12:2, 4:12:2].transpose(1, 0, 2)[:, :, 0] == 94):
        assert f"M{4 + 2 * x} {4 + 2 * y}h2" in svg


def test_a_folder_with_something_else_is_not_replaced(tmp_path):
    (tmp_path / "thesis.txt").write_text("years")
    with pytest.raises(InputError, match=r"out: .* holds something else; name a new folder"):
        site.build_site(tmp_path)
    assert [file.name for file in tmp_path.iterdir()] == ["thesis.txt"]


def test_a_site_to_which_somebody_added_a_file_is_not_replaced(tmp_path, monkeypatch):
    for name in ("install_packages", "write_constants"):
        monkeypatch.setattr(site, name, lambda: None)
    monkeypatch.setattr(site, "write_inputs", lambda out: (out / site.MARK).touch())
    monkeypatch.setattr(site, "run_node", lambda words: "")
    out = tmp_path / "site"
    site.build_site(out)
    site.build_site(out)
    (out / "CNAME").write_text("example.org")
    with pytest.raises(InputError, match=r"out: .* has CNAME, which is not of a site"):
        site.build_site(out)
    assert (out / "CNAME").is_file() and os.listdir(tmp_path) == ["site"]


def test_without_node_one_line_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setattr(site, "write_inputs", lambda out: None)
    monkeypatch.setattr(site.shutil, "which", lambda _: None)
    with pytest.raises(InputError, match=r"not found; install Node\.js 20 or newer"):
        site.build_site(tmp_path / "site")
    assert list(tmp_path.iterdir()) == []


def test_what_node_complains_about_becomes_one_line(node, tmp_path, monkeypatch):
    monkeypatch.setattr(site, "WEB", tmp_path)
    (tmp_path / "fail.mjs").write_text("throw new Error('no such colour');")
    with pytest.raises(InputError, match=r"node fail.mjs failed in .*: .*Error: no such colour$"):
        site.run_node(["node", "fail.mjs"])
