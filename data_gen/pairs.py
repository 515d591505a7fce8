"""Pairs of a camera and a display, as JSON files describe them: those that ship, and one's own.

A description is ``{"base": NAME, "set": {PARAMETER: VALUE, ...}}``. Its base is what it differs
from: a pair, or several pairs and parts of pairs, of which later ones win. A value is one of JSON,
or the name of a CSV file with a curve; ``{"value": VALUE, "source": TEXT}`` says where it is from.
paper.json and today.json hold the descriptions that ship, with the source of each number.
"""

from collections.abc import Mapping, Sequence
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any

from data_gen.effects import as_tuple
from data_gen.parameters import PARTS, PLACES, Pair, read_curve
from link.errors import InputError, choose
from link.outside import read_json

Settings = dict[str, Any]
"""Values of parameters by their places, such as "camera.iso" (`parameters.PLACES`)."""


def _settings(content: Any, file: Path, known: Mapping[str, Settings]) -> Settings:
    """Read a description: what its bases set, and what it sets itself."""
    if not isinstance(content, dict) or not {"base"} <= set(content) <= {"base", "set"}:
        raise InputError(f'{file}: need {{"base": PAIR, "set": {{PARAMETER: VALUE, ...}}}}')
    bases, changes = content["base"], content.get("set", {})
    if not isinstance(changes, dict):
        raise InputError(f"{file}: set must name parameters and their values")
    settings: Settings = {}
    for base in bases if isinstance(bases, list) else [bases]:
        settings |= choose(known, base, f"base pair in {file}")
    for name, value in changes.items():
        if isinstance(value, dict) and set(value) == {"value", "source"}:
            value = value["value"]
        if isinstance(value, str) and value.endswith(".csv"):
            value = read_curve(file.parent / value)
        settings |= dict.fromkeys(choose(PLACES, name, "parameter"), as_tuple(value))
    return settings


def _pair(name: str, settings: Settings) -> Pair:
    """Make the pair that has these settings, which have to name all that has no usual value."""
    values: dict[str, Settings] = {part: {} for part in PARTS}
    values[""] = {"name": name, **dict.fromkeys(PARTS)}
    for place, value in settings.items():
        part, _, field = place.rpartition(".")
        values[part][field] = value
    missing = [
        f"{part}.{entry.name}".strip(".")
        for part, kind in {**PARTS, "": Pair}.items()
        for entry in fields(kind)
        if entry.default is MISSING and entry.name not in values[part]
    ]
    if missing:
        raise InputError(f"{name}: neither base nor set gives {', '.join(missing)}")
    values[""] |= {part: kind(**values[part]) for part, kind in PARTS.items()}
    return Pair(**values[""])


def _shipped() -> tuple[dict[str, Settings], dict[str, tuple[str, ...]]]:
    """Read the descriptions that ship: what each sets, and the names of pairs by group."""
    described: dict[str, Settings] = {}
    groups = {}
    for group in ("paper", "today"):
        file = Path(__file__).with_name(f"{group}.json")
        content = read_json(file)
        for name, description in (content["parts"] | content["pairs"]).items():
            described[name] = _settings(description, file, described)
        groups[group] = tuple(content["pairs"])
    return described, groups


DESCRIBED, GROUPS = _shipped()
"""What each description sets, by its name, those of parts that pairs share among them; and names of
groups of pairs, which stand for the names of all their pairs."""
PAIRS = {name: _pair(name, DESCRIBED[name]) for name in GROUPS["paper"]}
"""The nine camera-display pairs of the paper by name, such as "canon-lg"."""
TODAY = {name: _pair(name, DESCRIBED[name]) for name in GROUPS["today"]}
"""The pairs of today by name."""


def get_pair(name: str) -> Pair:
    """Return a camera-display pair by its name, or one of one's own by its file, NAME.json.

    >>> get_pair("canon-lg").camera.name
    'Canon EOS Rebel XSi'

    Raises:
        InputError: no pair has this name; the message lists those that there are. Or the file is
            not there, or wrong.
    """
    if name.endswith(".json"):
        file = Path(name)
        return _pair(file.name, _settings(read_json(file), file, DESCRIBED))
    return choose(PAIRS | TODAY, name, "pair")


def pair_names(names: Sequence[str]) -> tuple[str, ...]:
    """Return the names of pairs, with those of its pairs in place of a group's.

    >>> pair_names(["canon-lg", "today"])[:3]
    ('canon-lg', 'phone-laptop', 'phone-sixbit')

    Args:
        names: names of pairs and of `GROUPS`, and files of pairs of one's own.

    Raises:
        InputError: a name is neither a pair's nor a group's; the message lists all of them.
    """
    single = {name: (name,) for name in PAIRS | TODAY}
    single |= {name: (name,) for name in names if name.endswith(".json")}
    found = [choose(GROUPS | single, name, "name in --pairs") for name in names]
    return tuple(name for group in found for name in group)
