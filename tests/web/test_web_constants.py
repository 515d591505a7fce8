"""No number stands both in Python and, by hand, in the JavaScript that was ported from it.

JavaScript takes such numbers from src/generated/constants.js, which Python writes. A module of
JavaScript has the place and the name of the Python module it was ported from, its twin. What both
may write by hand are numbers that say nothing by themselves: those of one digit but for zeros, such
as 2, 10 or 0.5, and those of `COMMON`.
"""

import ast
import re
from pathlib import Path

import pytest
from conftest import ROOT

from export.web.constants import SHARED, constants_of

SOURCES = ROOT / "export" / "web" / "src"
COMMON = {1.5, 0.25, 0.75, 12.0, 16.0, 64.0, 180.0, 255.0, 256.0}
"""Numbers of more digits that are words of the language: parts, powers of two, degrees, gray
levels."""
OTHER_TWINS = {
    "locate/bank.js": "export/locate/spots.py",
    "locate/segments.js": "export/locate/quads.py",
    "receive/timing/series.js": "export/receive/timing/fit.py",
}
"""Modules of JavaScript that hold a part of a Python module of another name."""
COMMENTS = re.compile(r"/\*.*?\*/|//[^\n]*", re.DOTALL)
NUMBER = re.compile(r"(?<![\w.$])\d[\d_]*(?:\.\d+)?(?:e-?\d+)?(?![\w.])")
CONSTANT = re.compile(r"^(?:export )?const (\[[^=\]]*\]|[A-Z][A-Z0-9_]*) = ([^;]*);$", re.MULTILINE)


def twin_of(source: Path) -> Path | None:
    """The Python module that a module of JavaScript was ported from; None where there is none."""
    name = source.relative_to(SOURCES).as_posix()
    snake = re.sub(r"(?<=[a-z0-9])[A-Z]", lambda m: "_" + m[0].lower(), name)[: -len(".js")]
    package = "" if snake.startswith("link/") else "export/"
    twin = ROOT / OTHER_TWINS.get(name, f"{package}{snake}.py")
    return twin if twin.is_file() else None


def says_something(number: float) -> bool:
    """Whether a number has two digits or more, and is none of `COMMON`."""
    digits = re.sub(r"e.*", "", f"{number:.12e}").replace(".", "").strip("0")
    return len(digits) > 1 and number not in COMMON


PORTED = {
    source.relative_to(SOURCES).as_posix(): (source, twin)
    for source in sorted(SOURCES.rglob("*.js"))
    if (twin := twin_of(source)) is not None
}


def test_most_modules_have_a_twin() -> None:
    assert len(PORTED) >= 45


@pytest.mark.parametrize("name", PORTED)
def test_no_number_of_a_twin_is_written_by_hand(name: str) -> None:
    source, twin = PORTED[name]
    code = COMMENTS.sub("", source.read_text("utf-8"))
    written = {float(number.replace("_", "")) for number in NUMBER.findall(code)}
    nodes = ast.walk(ast.parse(twin.read_text("utf-8")))
    values = [node.value for node in nodes if isinstance(node, ast.Constant)]
    pythons = {float(value) for value in values if isinstance(value, int | float)}
    both = sorted(number for number in written & pythons if says_something(number))
    assert not both, f"{name} and {twin.relative_to(ROOT)} both write {both}"


def test_no_shared_constant_is_defined_again() -> None:
    shared: dict[str, set[float]] = {}
    for module in SHARED:
        for name, value, _ in constants_of(module):
            if isinstance(value, int | float) and not isinstance(value, bool):
                shared.setdefault(name, set()).add(float(value))
    again = []
    for source in sorted(SOURCES.rglob("*.js")):
        if source.parent.name == "generated":
            continue
        for target, value in CONSTANT.findall(source.read_text("utf-8")):
            names = re.findall(r"\w+", target)
            numbers = [float(n.replace("_", "")) for n in NUMBER.findall(value)]
            if len(numbers) != len(names):
                continue
            again += [
                f"{source.relative_to(SOURCES)}: {name}"
                for name, number in zip(names, numbers, strict=True)
                if number in shared.get(name, ())
            ]
    assert not again, again
