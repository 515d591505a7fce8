"""The page's parts that need no browser, and what its files promise."""

import io
import json
import re
import subprocess
import tarfile

import cv2
import numpy as np
import pytest
from port import same
from tolerances import FLOAT64, ROUNDED_LEVELS, Y4M_SECONDS
from web_films import gray, limited, y4m_bytes

from export.web import site
from export.web.site import WEB
from link.errors import InputError
from link.presets import PRESETS
from models import shipped_graphs

PAGE = WEB / "src" / "page"


HEADERS = [
    ("", (30, False, 8, 2 * 11 * 9)),
    ("F30000:1001 Ip A0:0 C420mpeg2 XYSCSS=420MPEG2", (30000 / 1001, False, 8, 2 * 11 * 9)),
    ("F25:1 It A1:1 C422 XCOLORRANGE=LIMITED", (25, True, 8, 2 * 11 * 18)),
    ("F60:1 Ib C444 XCOLORRANGE=FULL", (60, False, 8, 2 * 21 * 18)),
    ("F24000:1001 Im C411", (24000 / 1001, False, 8, 2 * 6 * 18)),
    ("F0:0 Cmono", (30, False, 8, 0)),
    ("F50:1 C440", (50, False, 8, 2 * 21 * 9)),
    ("F50:1 C444alpha", (50, False, 8, 3 * 21 * 18)),
    ("F50:1 C420paldv", (50, False, 8, 2 * 11 * 9)),
    ("F50:1 Cmono10", (50, False, 10, 0)),
    ("F50:1 C422p12", (50, False, 12, 4 * 11 * 18)),
]
"""First lines of films of 21 x 18 pixels, after the size, and what they mean: frames a second,
whether the range is limited, bits of a sample, and bytes of a frame after its luma."""


@pytest.mark.parametrize(("words", "expected"), HEADERS)
def test_headers_of_all_kinds_are_understood(port, words, expected):
    found = port("page/y4m.js").parseHeader(f"YUV4MPEG2 W21 H18 {words}".strip())
    fps, *parts = expected
    same(found.fps, fps, FLOAT64)
    assert [found.limited, found.bits, found.restBytes] == parts


LUMA = np.random.default_rng(0).integers(0, 256, (3, 18, 21)).astype(np.uint8)
TIMES = [0.5, 0.75, 2.0]
EVEN = [0.0, 0.04, 0.08]
LIMITED = y4m_bytes(map(limited, LUMA), 25, tag="XCOLORRANGE=LIMITED")
CUT = y4m_bytes(LUMA, 25, times=TIMES)[:-5]
FILMS = {
    **{name: (y4m_bytes(LUMA, 25, name), LUMA, EVEN) for name in ("mono", "420jpeg", "422", "444")},
    "limited": (LIMITED, np.rint((limited(LUMA) - 16.0) * 255 / 219), EVEN),
    "cut off in its last frame": (CUT, LUMA[:2], TIMES),
}
"""Bytes of a film of 25 frames a second, and the luma and the times of its frames."""


@pytest.mark.parametrize("name", FILMS)
def test_films_without_compression_are_read_bit_for_bit_however_their_bytes_come(port, name):
    film, luma, times = FILMS[name]
    for size in (7, 1000, len(film)):
        frames = port("../tests/streams.js").framesOf(film, size)
        same([frame.plane for frame in frames], luma)
        same([frame.time for frame in frames], times[: len(luma)], Y4M_SECONDS)
        same([frame.fps for frame in frames], [25] * len(luma), FLOAT64)


def test_colours_become_luma_as_opencv_makes_it(port):
    rgba = np.random.default_rng(0).integers(0, 256, (110, 130, 4)).astype(np.uint8)
    found = port("page/planes.js").planeOfRgba({"width": 130, "height": 110, "data": rgba})
    same(found, gray(rgba[:, :, :3].copy()))


def test_a_recording_is_an_archive_of_a_film_and_of_what_is_known_about_it(port, tmp_path):
    """It can be unpacked, and OpenCV plays it."""
    frames = [{"plane": plane, "time": time} for plane, time in zip(LUMA, TIMES, strict=True)]
    about = {"versions": {"a": "1"}}
    file = port("page/recording.js").recordingFile(frames, 29.97, about, 1_800_000_000)
    with tarfile.open(fileobj=io.BytesIO(file.arrayBuffer())) as archive:
        archive.extractall(tmp_path, filter="data")
    assert json.loads((tmp_path / "about.json").read_text()) == {**about, "times": TIMES}
    film = cv2.VideoCapture(str(tmp_path / "film.y4m"))
    for plane in LUMA:
        ok, image = film.read()
        assert ok
        assert np.abs(image[:, :, 0].astype(int) - plane).max() <= ROUNDED_LEVELS
    assert not film.read()[0]


def test_what_needs_no_browser(node):
    """The tests of export/web/tests, which compare nothing with Python."""
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


def test_the_page_gets_the_graph_of_every_preset(tmp_path):
    site.write_inputs(tmp_path)
    tables = json.loads((tmp_path / site.MARK).read_text())
    assert {table["name"] for table in tables} == set(PRESETS)
    for table in tables:
        preset = PRESETS[table["name"]]
        graph = shipped_graphs()[preset.layout]
        assert (tmp_path / table["model"]).read_bytes() == graph.read_bytes()
        assert table["layout"]["pilot_blocks"] == preset.layout.pilot_blocks.tolist()


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


def test_without_node_one_line_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setattr(site.shutil, "which", lambda _: None)
    with pytest.raises(InputError, match=r"not found; install Node\.js 20 or newer"):
        site.build_site(tmp_path / "site")
    assert list(tmp_path.iterdir()) == []


def test_what_node_complains_about_becomes_one_line(node, tmp_path, monkeypatch):
    monkeypatch.setattr(site, "WEB", tmp_path)
    (tmp_path / "fail.mjs").write_text("throw new Error('no such colour');")
    with pytest.raises(InputError, match=r"node fail.mjs failed in .*: .*Error: no such colour$"):
        site.run_node(["node", "fail.mjs"])
