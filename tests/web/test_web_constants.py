"""No constant that the page shares with Python is written again, by hand, in JavaScript.

JavaScript takes such numbers from generated/constants.js, which Python writes.
"""

import re
from typing import NamedTuple

from conftest import ROOT

from web.host.constants import SHARED, constants_of, plain

SOURCES = ROOT / "web" / "port"
NUMBER = re.compile(r"(?<![\w.$])\d[\d_]*(?:\.\d+)?(?:e-?\d+)?(?![\w.])")
CONSTANT = re.compile(r"^(?:export )?const (\[[^=\]]*\]|[A-Z][A-Z0-9_]*) = ([^;]*);$", re.MULTILINE)


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


class Place(NamedTuple):
    """A record with named fields."""

    x: float
    y: float


def test_a_record_becomes_a_tuple_of_its_fields() -> None:
    assert plain([Place(0.5, 2), Place(1, 3)]) == [(0.5, 2), (1, 3)]
