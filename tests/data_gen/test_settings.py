"""Effects and parameters by name, in the code and on the command line."""

import pytest

from data_gen.effects import (
    EFFECTS,
    parameter_names,
    parse_settings,
    switch_off,
    with_parameter,
)
from data_gen.pairs import get_pair
from link.errors import InputError


def test_an_unknown_effect_lists_the_valid_ones() -> None:
    with pytest.raises(InputError, match="unknown effect 'fog'") as error:
        switch_off(get_pair("canon-lg"), ["noise", "fog"])
    assert all(effect in str(error.value) for effect in EFFECTS)


def test_an_unknown_parameter_lists_the_valid_ones() -> None:
    with pytest.raises(InputError, match="unknown parameter 'fog'") as error:
        with_parameter(get_pair("canon-lg"), "fog", 1.0)
    names = str(error.value).split("choose from ")[1].split(", ")
    assert set(names) == parameter_names(get_pair("canon-lg"))
    assert {"drift", "gamma", "blur_px", "corner_px", "crosstalk"} <= set(names)
    assert not {"name", "camera", "frontal"} & set(names)


@pytest.mark.parametrize("name", ["name", "camera", "frontal"])
def test_a_part_is_no_parameter(name: str) -> None:
    with pytest.raises(InputError, match=f"unknown parameter '{name}'"):
        with_parameter(get_pair("canon-lg"), name, "x")


def test_every_effect_sets_parameters_that_exist() -> None:
    names = parameter_names(get_pair("canon-lg"))
    assert {name for values in EFFECTS.values() for name in values} <= names


def test_a_parameter_of_both_views_is_set_in_both() -> None:
    pair = with_parameter(get_pair("canon-lg"), "drift", 0.3)
    assert (pair.frontal.drift, pair.oblique.drift) == (0.3, 0.3)
    assert get_pair("canon-lg").frontal.drift < 0.3  # the pair itself is as it was


def test_a_value_out_of_range_is_refused_by_name() -> None:
    with pytest.raises(InputError, match=r"drift must lie in \[0, 0.5\], got 0.6"):
        with_parameter(get_pair("canon-lg"), "drift", 0.6)


# name=value


def test_settings_are_read_as_json() -> None:
    texts = ["drift=0.1", "gamma=[2, 2.5, 2]", 'encoding="linear"', "bayer=false"]
    expected = (("drift", 0.1), ("gamma", (2, 2.5, 2)), ("encoding", "linear"), ("bayer", False))
    assert parse_settings(texts) == expected


@pytest.mark.parametrize("text", ["drift", "drift=", "panel=VA", "drift=0.1.2"])
def test_a_setting_that_is_none_is_refused_with_its_flag(text: str) -> None:
    with pytest.raises(InputError, match=f"--set: need name=value.*got '{text}'"):
        parse_settings([text])


@pytest.mark.parametrize(
    "text",
    [
        'drift="low"',
        "gamma=2",
        'gamma=[2, 2, "a"]',
        "gamma=[[2, 2, 2]]",
        "gamma=[2, 2, [2]]",
        "crosstalk=[1, 0, 0, 0, 1, 0, 0, 0, 1]",
        "tone_curve=[[0, 0], [0.5], [1, 1]]",
        'tone_curve=[[0, 0], ["a", 0.5], [1, 1]]',
        "jpeg_quality=50.5",
        "encoding={}",
        "panel=null",
    ],
)
def test_a_value_of_the_wrong_kind_is_refused_by_name(text: str) -> None:
    ((name, value),) = parse_settings([text])
    with pytest.raises(InputError, match=name):
        with_parameter(get_pair("canon-lg"), name, value)
