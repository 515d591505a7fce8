"""The page's OpenCV is what its sources say, and has what the page calls."""

import hashlib
import re

from web.host.site import WEB

FOLDER = WEB / "host" / "opencv"
CALLED = re.compile(r'\b(?:call|filled)\(\s*"(\w+)"')
DEFINED = re.compile(r"^PAGE [\w ]+[ *](\w+)\(", re.MULTILINE)


def test_it_was_built_from_the_sources_beside_it() -> None:
    """Who changes one of them runs build.sh, which writes the sums of what it read and wrote."""
    sums = dict(line.split()[::-1] for line in (FOLDER / "SHA256SUMS").read_text().splitlines())
    sources = {"build.sh", "code.cpp", "opencv.cpp", "plane.h", "rounding.patch"}
    assert set(sums) == sources | {"opencv.wasm"}
    for name, known in sums.items():
        assert hashlib.sha256((FOLDER / name).read_bytes()).hexdigest() == known, name


def test_the_page_calls_all_of_its_functions_and_no_others() -> None:
    called = {
        name
        for path in (WEB / "port").rglob("*.js")
        for name in CALLED.findall(path.read_text("utf-8"))
    }
    sources = [path.read_text("utf-8") for path in FOLDER.glob("*.cpp")]
    defined = {name for source in sources for name in DEFINED.findall(source)}
    assert called == defined - {"room"}
