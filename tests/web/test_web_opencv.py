"""The page's OpenCV is what its sources say, and has what the page calls."""

import hashlib
import re

from export.web.site import WEB

FOLDER = WEB / "opencv"
CALLED = re.compile(r'\bcall\(\s*"(\w+)"')
DEFINED = re.compile(r"^PAGE [\w ]+[ *](\w+)\(", re.MULTILINE)


def test_it_was_built_from_the_sources_beside_it() -> None:
    """Who changes one of them runs build.sh, which writes the sums of what it read and wrote."""
    sums = dict(line.split()[::-1] for line in (FOLDER / "SHA256SUMS").read_text().splitlines())
    assert set(sums) == {"build.sh", "opencv.cpp", "opencv.wasm", "rounding.patch"}
    for name, known in sums.items():
        assert hashlib.sha256((FOLDER / name).read_bytes()).hexdigest() == known, name


def test_the_page_calls_all_of_its_functions_and_no_others() -> None:
    called = {
        name
        for path in (WEB / "src").rglob("*.js")
        for name in CALLED.findall(path.read_text("utf-8"))
    }
    defined = set(DEFINED.findall((FOLDER / "opencv.cpp").read_text("utf-8")))
    assert called == defined - {"room"}
