"""Effects of the channel, to be switched off by name, and parameters, to be set by name.

effects.json lists the effects, and the values of parameters with which each is absent.
"""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

from data_gen.parameters import PLACES, Pair, read_curve
from link.errors import InputError, ParameterError, choose
from link.outside import parse_json, read_json


def as_tuple(value: Any) -> Any:
    """Make tuples of the lists of a value of JSON, those within its objects, too."""
    if isinstance(value, dict):
        return {name: as_tuple(part) for name, part in value.items()}
    return tuple(as_tuple(part) for part in value) if isinstance(value, list) else value


_ABSENT = as_tuple(read_json(Path(__file__).with_suffix(".json")))
EFFECTS: dict[str, dict[str, Any]] = _ABSENT["channel"]
"""Effects of the channel by name, and the parameters' values with which each is absent.

With all of them absent the channel is the identity.
"""
FILM_EFFECTS: dict[str, dict[str, Any]] = _ABSENT["films"]
"""Effects that films have beside those of `EFFECTS`, and the values with which each is absent."""


def switch_off(pair: Pair, effects: Iterable[str]) -> Pair:
    """Return the pair without some effects.

    >>> from data_gen.pairs import get_pair
    >>> quiet = switch_off(get_pair("canon-lg"), ["noise", "moire"])
    >>> quiet.frontal.noise_scale, quiet.display.grid_contrast
    (0.0, 0.0)

    Args:
        pair: camera and display.
        effects: names of the effects, keys of `EFFECTS` or `FILM_EFFECTS`.

    Raises:
        InputError: an effect is unknown; the message lists all of them.
    """
    for effect in effects:
        for name, value in choose(EFFECTS | FILM_EFFECTS, effect, "effect").items():
            pair = with_parameter(pair, name, value)
    return pair


def with_parameter(pair: Pair, name: str, value: Any) -> Pair:
    """Return the pair with one parameter changed, in every part that has a field of that name.

    >>> from data_gen.pairs import get_pair
    >>> pair = with_parameter(get_pair("canon-lg"), "drift", 0.1)
    >>> pair.frontal.drift, pair.oblique.drift
    (0.1, 0.1)

    Args:
        pair: camera and display.
        name: name of the parameter, a key of `parameters.PLACES`.
        value: its new value.

    Raises:
        InputError: no part has such a field, or the value is out of its range.
    """
    for place in choose(PLACES, name, "parameter"):
        part, _, field = place.rpartition(".")
        changes = {field: value}
        pair = replace(pair, **{part: replace(getattr(pair, part), **changes)} if part else changes)
    return pair


def parse_settings(texts: Iterable[str]) -> tuple[tuple[str, Any], ...]:
    """Read parameters of the channel from texts of the form ``name=value``.

    A value that ends in .csv names a file with a curve.

    >>> parse_settings(["drift=0.1", "falloff=[3, 3, 3]"])
    (('drift', 0.1), ('falloff', (3, 3, 3)))

    Args:
        texts: the settings; each value is written in JSON.

    Returns:
        Names and values, lists as tuples.

    Raises:
        ParameterError: a text has no ``=``, or its value is not JSON within the bounds of
            `link.outside.parse_json`.
    """
    settings = []
    for text in texts:
        name, equals, value = text.partition("=")
        if value.endswith(".csv"):
            settings.append((name, read_curve(Path(value))))
            continue
        try:
            parsed = parse_json(value, name)
        except InputError as error:
            problem = f"need name=value, such as drift=0.1, got {text!r:.100}"
            if equals:
                problem += f" ({error})"
            raise ParameterError("--set", problem) from None
        settings.append((name, as_tuple(parsed)))
    return tuple(settings)
