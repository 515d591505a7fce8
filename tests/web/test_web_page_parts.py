"""The page's parts that need no browser, and what its files promise."""

import json
import re
import tarfile

import cv2
import numpy as np
import pytest
from web_films import gray, limited, y4m_bytes
from web_fixtures import WEB, run_node_tests, write_fixture

from export.web import site
from link.code.collect import Message
from link.errors import InputError
from link.presets import PRESETS
from models import shipped_graphs

PAGE = WEB / "src" / "page"


HEADERS = [
    (words, {"fps": fps, "limited": limited, "bits": bits, "rest": rest})
    for words, fps, limited, bits, rest in (
        ("", 30, False, 8, 2 * 11 * 9),
        ("F30000:1001 Ip A0:0 C420mpeg2 XYSCSS=420MPEG2", 30000 / 1001, False, 8, 2 * 11 * 9),
        ("F25:1 It A1:1 C422 XCOLORRANGE=LIMITED", 25, True, 8, 2 * 11 * 18),
        ("F60:1 Ib C444 XCOLORRANGE=FULL", 60, False, 8, 2 * 21 * 18),
        ("F24000:1001 Im C411", 24000 / 1001, False, 8, 2 * 6 * 18),
        ("F0:0 Cmono", 30, False, 8, 0),
        ("F50:1 C440", 50, False, 8, 2 * 21 * 9),
        ("F50:1 C444alpha", 50, False, 8, 3 * 21 * 18),
        ("F50:1 C420paldv", 50, False, 8, 2 * 11 * 9),
        ("F50:1 Cmono10", 50, False, 10, 0),
        ("F50:1 C422p12", 50, False, 12, 4 * 11 * 18),
    )
]
"""First lines of films of 21 x 18 pixels, after the size, and what they mean."""


def as_array(data):
    return np.frombuffer(data, np.uint8)


def test_parts_of_the_page(tmp_path):
    rng = np.random.default_rng(0)
    luma = rng.integers(0, 256, (3, 18, 21)).astype(np.uint8)
    times = [0.5, 0.75, 2.0]
    even = [number / 25 for number in range(3)]
    films = [
        {"film": as_array(y4m_bytes(luma, 25, chroma)), "luma": luma, "times": even, "fps": 25}
        for chroma in ("mono", "420jpeg", "422", "444")
    ]
    films += [
        {
            "film": as_array(y4m_bytes(map(limited, luma), 60, tag="XCOLORRANGE=LIMITED")),
            "luma": np.rint((limited(luma) - 16.0) * 255 / 219).astype(np.uint8),
            "times": [number / 60 for number in range(3)],
            "fps": 60,
        },
        {
            "film": as_array(y4m_bytes(luma, 25, times=times)[:-5]),  # cut off in its last frame
            "luma": luma[:2],
            "times": times[:2],
            "fps": 25,
        },
    ]
    write_fixture(tmp_path, "y4m", films)
    write_fixture(tmp_path, "headers", HEADERS)
    rgba = rng.integers(0, 256, (11, 13, 4)).astype(np.uint8)
    write_fixture(tmp_path, "colours", {"rgba": rgba, "luma": gray(rgba[:, :, :3].copy())})
    texts = [b"plain", "grün 😀".encode(), b"\xff\x00a", b"\xf0\x9f\x98", b"a\xc3", b"\xed\xa0\x80"]
    write_fixture(
        tmp_path,
        "texts",
        [{"data": as_array(data), "text": Message(data, 1, 1, 1.0).text} for data in texts],
    )
    frames = [{"luma": plane, "time": time} for plane, time in zip(luma, times, strict=True)]
    write_fixture(tmp_path, "recording", frames)
    run_node_tests("page", tmp_path)
    check_recording(tmp_path, luma, times)


def check_recording(folder, luma, times):
    """What the page saves can be unpacked, and OpenCV plays it."""
    with tarfile.open(folder / "recording.tar") as archive:
        archive.extractall(folder, filter="data")
    about = json.loads((folder / "about.json").read_text())
    assert about == {"versions": {"a": "1"}, "times": times}
    film = cv2.VideoCapture(str(folder / "film.y4m"))
    for plane in luma:
        ok, image = film.read()
        assert ok
        assert np.abs(image[:, :, 0].astype(int) - plane).max() <= 1
    assert not film.read()[0]


def test_the_page_has_no_script_or_style_in_its_text():
    html = (PAGE / "index.html").read_text()
    policy = re.search(r'Content-Security-Policy"\s+content="([^"]+)"', html)
    assert policy is not None
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


def test_what_node_complains_about_becomes_one_line(tmp_path, monkeypatch):
    monkeypatch.setattr(site, "WEB", tmp_path)
    (tmp_path / "fail.mjs").write_text("throw new Error('no such colour');")
    with pytest.raises(InputError, match=r"node fail.mjs failed in .*: .*Error: no such colour$"):
        site.run_node(["node", "fail.mjs"])
