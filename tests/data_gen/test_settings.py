"""Effects and parameters by name, in the code, on the command line, and in files."""

from pathlib import Path

import numpy as np
import pytest
from conftest import cases

from data_gen.channel.display import Emission
from data_gen.effects import EFFECTS, parse_settings
from data_gen.pairs import get_pair, pair_names
from data_gen.parameters import PLACES
from link.errors import InputError


def test_every_effect_sets_parameters_that_exist() -> None:
    assert {name for values in EFFECTS.values() for name in values} <= set(PLACES)


# name=value


def test_settings_are_read_as_json() -> None:
    texts = ["drift=0.1", "gamma=[2, 2.5, 2]", 'encoding="linear"', "bayer=false"]
    expected = (("drift", 0.1), ("gamma", (2, 2.5, 2)), ("encoding", "linear"), ("bayer", False))
    assert parse_settings(texts) == expected


# Curves and pairs of one's own


def test_a_pair_of_ones_own_has_the_curves_that_were_measured(tmp_path: Path) -> None:
    (tmp_path / "camera.csv").write_text("light,level\n0,0\n0.5,0.7\n1,1\n")
    (tmp_path / "display.csv").write_text("0;0\n0.5;0.3\n1;1\n")
    file = tmp_path / "mine.json"
    file.write_text(
        '{"base": "canon-lg", "set": {"tone_curve": "camera.csv", "light_curve": "display.csv",'
        ' "black": 0, "clip": 1, "crosstalk": [[1, 0, 0], [0, 1, 0], [0, 0, 1]]}}'
    )
    assert pair_names([str(file)]) == (str(file),)
    pair = get_pair(str(file))
    assert (pair.name, pair.camera.tone_curve[1]) == ("mine.json", (0.5, 0.7))
    assert pair.crosstalk[1] == (0, 1, 0)
    frame = np.array([[[0] * 3, [127] * 3, [255] * 3]], np.uint8)
    emission = Emission.of(pair.display, np.zeros((1, 3)))
    uniform = emission.light(frame)[0, :, 0] / emission.light(frame[:, [2, 2, 2]])[0, :, 0]
    np.testing.assert_allclose(uniform, [0, 0.3, 1], atol=0.01)
    (given,) = parse_settings([f"tone_curve={tmp_path / 'camera.csv'}"])
    assert given == ("tone_curve", pair.camera.tone_curve)


def test_a_pair_of_ones_own_joins_parts_and_says_where_numbers_are_from(tmp_path: Path) -> None:
    file = tmp_path / "mine.json"
    file.write_text(
        '{"base": ["canon-lg", "tv"], "set": {"camera.name": "mine", "oblique.drift": 0.2,'
        ' "iso": {"value": 200, "source": "as it was set"}}}'
    )
    pair, base = get_pair(str(file)), get_pair("canon-lg")
    assert (pair.camera.name, pair.camera.iso) == ("mine", 200)
    assert pair.display == get_pair("phone-tv").display
    assert (pair.frontal.drift, pair.oblique.drift) == (base.frontal.drift, 0.2)
    assert pair.crosstalk == base.crosstalk


@cases(
    ("0,0\n0.5,x\n1,1", "line 2 holds no two numbers"),
    ("0,0\n0.5,0.7", r"must run from \(0, 0\) to \(1, 1\)"),
    ("0,0\n0.5,0.7\n0.6,0.6\n1,1", "must increase strictly"),
    ("0,0,0\n1,1,1", "must be a list of pairs"),
)
def test_a_wrong_curve_is_refused(content: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "curve.csv").write_text(content)
    with pytest.raises(InputError, match=message):
        parse_settings([f"tone_curve={tmp_path / 'curve.csv'}"])


@cases(
    ("[]", "need"),
    ('{"base": "no"}', "pair"),
    ('{"base": "own.json"}', "unknown base pair in"),
    ('{"base": [["canon-lg"]]}', "unknown base pair in"),
    ('{"base": []}', "neither base nor set gives camera.name"),
    ('{"base": ["canon", "tv", "hand"]}', "neither base nor set gives crosstalk"),
    ('{"base": "canon-lg", "set": {"no": 1}}', "unknown parameter"),
    ('{"base": "canon-lg", "set": {"drift": "x"}}', "drift must be a number"),
    ('{"base": "canon-lg", "set": {"drift": {"value": 0.1}}}', "drift must be a number"),
    ('{"base": "canon-lg", "set": {"bayer": 1}}', "bayer must be true or false"),
    ('{"base": "canon-lg", "set": {"light_curve": 0}}', "light_curve must be a list of pairs"),
    ('{"base": "canon-lg", "set": {"display.name": 1}}', "name must be a text"),
)
def test_a_wrong_pair_is_refused(content: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "mine.json").write_text(content)
    with pytest.raises(InputError, match=message):
        get_pair(str(tmp_path / "mine.json"))
