"""The nine camera-display pairs and what was fitted of them."""

import math
from dataclasses import replace

import numpy as np
import pytest
from conftest import ROOT

from data_gen.pairs import GROUPS, PAIRS, TODAY, get_pair, pair_names
from link.errors import InputError
from link.outside import read_json

CAMERAS, DISPLAYS = ("canon", "nikon", "sony"), ("imac", "lg", "samsung")


def test_there_are_nine_pairs_named_camera_display() -> None:
    assert set(PAIRS) == {f"{c}-{d}" for c in CAMERAS for d in DISPLAYS}
    assert len(PAIRS) == 9
    for name, pair in PAIRS.items():
        assert pair.name == name
        assert pair is get_pair(name)
        camera, display = name.split("-")
        assert pair.camera == PAIRS[f"{camera}-lg"].camera
        assert pair.display == PAIRS[f"nikon-{display}"].display


def test_each_number_of_the_paper_s_pairs_has_its_source() -> None:
    content = read_json(ROOT / "data_gen" / "paper.json")
    for name, description in (content["parts"] | content["pairs"]).items():
        for parameter, value in description["set"].items():
            if not parameter.endswith("name") and parameter != "perspective":
                assert value["source"], (name, parameter)


# What was fitted


def test_the_fall_off_of_the_tn_panel_exceeds_that_of_the_others_as_fitted() -> None:
    green = {display: PAIRS[f"canon-{display}"].display.falloff[1] for display in DISPLAYS}
    assert green["samsung"] > green["lg"] > green["imac"]


# Spectra


@pytest.mark.parametrize("name", PAIRS | TODAY)
def test_crosstalk_keeps_white_and_its_diagonal_dominates(name: str) -> None:
    M = np.array(get_pair(name).crosstalk)
    np.testing.assert_allclose(M.sum(axis=1), 1.0, atol=0.0015)  # three rounded entries
    assert np.all(np.diag(M) > 0.5)  # more than the rest of a row that sums to 1


def test_crosstalk_agrees_with_the_published_check_for_nikon_and_imac() -> None:
    expected = [[0.64, 0.33, 0.03], [0.04, 0.81, 0.15], [0.01, 0.18, 0.81]]
    np.testing.assert_allclose(PAIRS["nikon-imac"].crosstalk, expected, atol=0.006)


def test_white_at_30_degrees_keeps_what_the_worst_of_phones_lost() -> None:
    exponent = PAIRS["canon-samsung"].display.falloff[1]
    assert math.cos(math.radians(30)) ** exponent > 0.5
    washout = [PAIRS[f"canon-{display}"].display.washout for display in DISPLAYS]
    assert washout == sorted(washout)


# Pairs of today


def test_pairs_of_today_stand_beside_the_paper_s() -> None:
    assert pair_names(["today"]) == tuple(TODAY)
    assert pair_names(["paper", "phone-tv"]) == (*PAIRS, "phone-tv")
    assert not set(PAIRS) & set(TODAY)
    with pytest.raises(InputError, match=r"canon-dell.*today"):
        pair_names(["canon-dell"])
    for names in GROUPS.values():
        assert pair_names(names) == names


@pytest.mark.parametrize("name", TODAY)
def test_white_of_a_camera_of_today_is_that_of_iso_12232(name: str) -> None:
    """The white level is that of 300 cd/m^2 at the stated shutter, aperture and ISO."""
    camera = TODAY[name].camera
    white = 0.65 * 300 * camera.shutter_s / camera.f_number**2 * camera.iso / 78
    assert camera.white_level == pytest.approx(white, rel=0.02)


@pytest.mark.parametrize("name", TODAY)
def test_colours_of_a_camera_of_today_are_undone_by_its_matrix(name: str) -> None:
    """Before primaries of sRGB, crosstalk and colour matrix cancel."""
    M, C = np.array(TODAY[name].crosstalk), np.array(TODAY[name].camera.color_matrix)
    if TODAY[name].display.panel != "OLED":
        np.testing.assert_allclose(C @ M, np.eye(3), atol=0.005)
    np.testing.assert_allclose((C @ M).sum(axis=1), 1.0, atol=0.003)


def test_six_bits_are_all_that_tells_the_two_laptops_apart() -> None:
    laptop, six = (TODAY[f"phone-{name}"].display for name in ("laptop", "sixbit"))
    assert replace(six, name=laptop.name, frc_bits=0) == laptop
