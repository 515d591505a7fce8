"""Effects and parameters by name, in the code and on the command line."""

from data_gen.effects import EFFECTS, parameter_names, parse_settings, with_parameter
from data_gen.pairs import get_pair


def test_every_effect_sets_parameters_that_exist() -> None:
    names = parameter_names(get_pair("canon-lg"))
    assert {name for values in EFFECTS.values() for name in values} <= names


def test_a_parameter_of_both_views_is_set_in_both() -> None:
    pair = with_parameter(get_pair("canon-lg"), "drift", 0.3)
    assert (pair.frontal.drift, pair.oblique.drift) == (0.3, 0.3)
    assert get_pair("canon-lg").frontal.drift < 0.3  # the pair itself is as it was


# name=value


def test_settings_are_read_as_json() -> None:
    texts = ["drift=0.1", "gamma=[2, 2.5, 2]", 'encoding="linear"', "bayer=false"]
    expected = (("drift", 0.1), ("gamma", (2, 2.5, 2)), ("encoding", "linear"), ("bayer", False))
    assert parse_settings(texts) == expected
