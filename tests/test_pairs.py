"""The nine pairs and the integration of their spectra; nothing here needs measured files."""

import json
import math
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import scipy.io

from data_gen.pairs import CAMERAS, DISPLAYS, PAIRS, get_pair
from data_gen.spectra import (
    DISPLAY_FILES,
    SSF_FILES,
    SpectraConfig,
    crosstalk,
    fit_gamma,
    load_display,
    load_ssf,
    main,
)
from link.errors import InputError


def triangles(wavelength: np.ndarray, centres: tuple[int, ...] = (450, 550, 650)) -> np.ndarray:
    """Unit triangles 20 nm wide at the base, (L, 3)."""
    return np.clip(1.0 - np.abs(wavelength[:, None] - np.array(centres)) / 10.0, 0.0, None)


def test_there_are_nine_pairs_named_camera_display() -> None:
    assert set(PAIRS) == {f"{c}-{d}" for c in CAMERAS for d in DISPLAYS}
    assert len(PAIRS) == 9
    for name, pair in PAIRS.items():
        assert pair.name == name
        assert pair is get_pair(name)
        camera, display = name.split("-")
        assert (pair.camera, pair.display) == (CAMERAS[camera], DISPLAYS[display])


@pytest.mark.parametrize("name", PAIRS)
def test_crosstalk_keeps_white_and_its_diagonal_dominates(name: str) -> None:
    M = np.array(PAIRS[name].crosstalk)
    np.testing.assert_allclose(M.sum(axis=1), 1.0, atol=0.0015)  # three rounded entries
    assert np.all(np.diag(M) > 0.5)  # more than the rest of a row that sums to 1


def test_crosstalk_agrees_with_the_published_check_for_nikon_and_imac() -> None:
    expected = [[0.64, 0.33, 0.03], [0.04, 0.81, 0.15], [0.01, 0.18, 0.81]]
    np.testing.assert_allclose(PAIRS["nikon-imac"].crosstalk, expected, atol=0.006)


def test_oblique_light_and_gamma_fall_fastest_on_tn_and_least_on_the_imac() -> None:
    def white(name: str, degrees: float) -> float:
        exponents = DISPLAYS[name].falloff
        return max(math.cos(math.radians(degrees)) ** n for n in exponents)

    assert DISPLAYS["samsung"].panel == "TN"
    assert white("samsung", 45) < white("lg", 45) < white("imac", 45)
    assert white("samsung", 30) > 0.5  # phones and tablets, which lost over half, bound it
    assert DISPLAYS["samsung"].washout > DISPLAYS["lg"].washout > DISPLAYS["imac"].washout


@pytest.mark.parametrize("name", CAMERAS)
def test_tone_curves_increase_from_black_to_white(name: str) -> None:
    curve = CAMERAS[name].tone_curve
    assert curve[0] == (0.0, 0.0)
    assert curve[-1] == (1.0, 1.0)
    assert all(a[0] < b[0] and a[1] < b[1] for a, b in pairwise(curve))


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("panel", "CRT"),
        ("gamma", (2.2, 2.2, 0.0)),
        ("gamma", (2.2, 2.2)),
        ("black", -0.1),
        ("clip", 1.1),
        ("falloff", (-1.0, 2.0, 2.0)),
        ("washout", math.nan),
        ("washout_gamma", 0.0),
        ("leak", 1.0),
        ("width_m", 0.0),
    ],
)
def test_display_refuses_and_names_the_field(field: str, value: object) -> None:
    with pytest.raises(InputError, match=rf"iMac.*: {field} must"):
        replace(DISPLAYS["imac"], **{field: value})


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("full_well_e", 0.0),
        ("read_noise_e", -1.0),
        ("white_level", 1.5),
        ("tone_curve", ((0.0, 0.1), (1.0, 1.0))),
        ("tone_curve", ((0.0, 0.0), (0.5, 0.6), (0.7, 0.5), (1.0, 1.0))),
        ("blur_px", math.inf),
        ("vignetting", 1.0),
        ("jpeg_quality", 0),
    ],
)
def test_camera_refuses_and_names_the_field(field: str, value: object) -> None:
    with pytest.raises(InputError, match=rf"Sony.*: {field} must"):
        replace(CAMERAS["sony"], **{field: value})


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("crosstalk", ((1.0, 0.0, 0.0),)),
        ("crosstalk", ((0.5, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))),
        ("crosstalk", ((1.2, -0.2, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))),
        ("drift", -0.01),
        ("jitter_px", 9.0),
    ],
)
def test_pair_refuses_and_names_the_field(field: str, value: object) -> None:
    with pytest.raises(InputError, match=rf"canon-lg: .*{field} must"):
        replace(PAIRS["canon-lg"], **{field: value})


def test_unknown_pair_lists_the_valid_names() -> None:
    with pytest.raises(InputError) as error:
        get_pair("canon-sony")
    assert all(name in str(error.value) for name in ("canon-sony", *PAIRS))


def test_narrow_primaries_seen_by_their_own_channels_give_the_identity() -> None:
    camera, display = np.arange(400.0, 701.0, 5.0), np.arange(380.0, 781.0, 2.0)
    M = crosstalk(camera, triangles(camera), display, 3.0 * triangles(display))
    np.testing.assert_allclose(M, np.eye(3), atol=1e-12)


def test_flat_sensitivities_give_the_primaries_shares_of_white() -> None:
    wavelength = np.arange(400.0, 701.0)
    s = np.ones((len(wavelength), 3)) * [1.0, 2.0, 5.0]
    e = triangles(wavelength) * [1.0, 2.0, 5.0]
    M = crosstalk(wavelength, s, wavelength, e)
    np.testing.assert_allclose(M, np.tile([1 / 8, 2 / 8, 5 / 8], (3, 1)), atol=1e-12)


def test_a_channel_without_light_is_refused() -> None:
    wavelength = np.arange(400.0, 701.0)
    s = triangles(wavelength) * [1.0, 1.0, 0.0]
    with pytest.raises(InputError, match="no light"):
        crosstalk(wavelength, s, wavelength, triangles(wavelength))


def test_gamma_of_a_power_law_is_its_exponent() -> None:
    level = np.linspace(0.0, 1.0, 30)
    light = level[:, None] ** np.array([1.8, 2.2, 2.4])
    np.testing.assert_allclose(fit_gamma(level, light), [1.8, 2.2, 2.4], rtol=1e-12)


def write_measurements(folder: Path) -> None:
    """Write three cameras and three displays with narrow primaries at 450, 550 and 650 nm."""
    wavelength = np.arange(380, 781, 5)
    rows = triangles(wavelength, (650, 550, 450))
    table = {str(w): row.tolist() for w, row in zip(wavelength, rows, strict=True)}
    (folder / "camera_ssf").mkdir()
    (folder / "display").mkdir()
    for name in SSF_FILES.values():
        text = json.dumps({"spectral_data": {"data": {"main": table}}})
        (folder / "camera_ssf" / name).write_text(text)
    level = np.linspace(0.0, 1.0, 30)
    light = np.tile(level[:, None] ** 2.2, (1, 3))
    isetbio = {"d": {"wave": wavelength, "spd": rows, "gamma": light}}
    raw = {"rawGammaInput": level[1:], "rawGammaTable": light[1:]}
    cal = {"S_device": [380, 5, len(wavelength)], "P_device": rows, "rawdata": raw}
    for name in DISPLAY_FILES.values():
        mat = {"cals": cal} if name.startswith("vistadisp") else isetbio
        scipy.io.savemat(folder / "display" / name, mat)


def test_printed_table_is_python_that_holds_the_nine_pairs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_measurements(tmp_path)
    main(SpectraConfig(data=tmp_path))
    table, gammas = capsys.readouterr().out.split("\n}\n")
    scope: dict[str, dict[str, object]] = {}
    exec(table + "}", scope)
    assert set(scope["_CROSSTALK"]) == set(PAIRS)
    for M in scope["_CROSSTALK"].values():
        np.testing.assert_array_equal(np.array(M), np.eye(3))
    assert gammas.count("(2.2, 2.2, 2.2)") == 3


def test_missing_or_unreadable_measurements_are_refused_by_name(tmp_path: Path) -> None:
    for load, name in ((load_ssf, "camera.json"), (load_display, "display.mat")):
        path = tmp_path / name
        with pytest.raises(InputError, match=name):
            load(path)
        for content in (b"", b"{}", b"[]", b"not a measurement at all" * 20):
            path.write_bytes(content)
            with pytest.raises(InputError, match=name):
                load(path)


def test_a_display_with_four_primaries_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "rgbw.mat"
    d = {"wave": np.arange(380, 781, 4), "spd": np.ones((101, 4)), "gamma": np.ones((9, 4))}
    scipy.io.savemat(path, {"d": d})
    with pytest.raises(InputError, match="three display primaries"):
        load_display(path)
