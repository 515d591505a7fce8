"""The nine pairs and the integration of their spectra; nothing here needs measured files."""

import ast
import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.io
from conftest import Command
from numpy.typing import NDArray
from tolerances import FLOAT64

from data_gen.pairs import CAMERAS, DISPLAYS, FALLOFF_BOUNDS, FITTED, PAIRS, get_pair
from link.errors import InputError
from reports.lab.spectra import (
    DISPLAY_FILES,
    SSF_FILES,
    XYZ_TO_SRGB,
    color_matrix,
    crosstalk,
    fit_gamma,
    load_display,
    load_ssf,
    main,
)

Array = NDArray[np.float64]


def triangles(wavelength: Array, centres: tuple[int, ...] = (450, 550, 650)) -> Array:
    """Unit triangles 20 nm wide at the base, (L, 3)."""
    return np.asarray(np.maximum(1 - np.abs(wavelength[:, None] - np.array(centres)) / 10, 0.0))


def test_there_are_nine_pairs_named_camera_display() -> None:
    assert set(PAIRS) == {f"{c}-{d}" for c in CAMERAS for d in DISPLAYS}
    assert len(PAIRS) == 9
    for name, pair in PAIRS.items():
        assert pair.name == name
        assert pair is get_pair(name)
        camera, display = name.split("-")
        assert pair.camera == CAMERAS[camera]
        assert replace(pair.display, falloff=DISPLAYS[display].falloff) == DISPLAYS[display]


# What was fitted


def test_a_pair_has_the_fitted_nuisances_and_fall_off() -> None:
    for name, pair in PAIRS.items():
        camera, display = name.split("-")
        assert pair.display.falloff == tuple(FITTED["falloff"][display])
        for nuisance, view in ((pair.frontal, "0"), (pair.oblique, "45")):
            for field, value in FITTED["fitted"][camera][view].items():
                assert getattr(nuisance, field) == value


def test_fitted_nuisances_lie_within_their_bounds() -> None:
    for camera in CAMERAS:
        for view in ("0", "45"):
            fitted = FITTED["fitted"][camera][view]
            assert set(fitted) == {"drift", "jitter_px", "noise_scale"}
            for field, value in fitted.items():
                low, high = FITTED["bounds"][field]
                assert low <= value <= high, (camera, view, field)


@pytest.mark.parametrize("display", DISPLAYS)
def test_fitted_fall_off_lies_within_its_bounds(display: str) -> None:
    low, high = FALLOFF_BOUNDS[display]
    assert low <= FITTED["falloff"][display][1] <= high
    assert low <= DISPLAYS[display].falloff[1] <= high


def test_the_fall_off_of_the_tn_panel_exceeds_that_of_the_others_as_fitted() -> None:
    green = {display: FITTED["falloff"][display][1] for display in DISPLAYS}
    assert green["samsung"] > green["lg"] > green["imac"]


# Spectra


@pytest.mark.parametrize("name", PAIRS)
def test_crosstalk_keeps_white_and_its_diagonal_dominates(name: str) -> None:
    M = np.array(PAIRS[name].crosstalk)
    np.testing.assert_allclose(M.sum(axis=1), 1.0, atol=0.0015)  # three rounded entries
    assert np.all(np.diag(M) > 0.5)  # more than the rest of a row that sums to 1


def test_crosstalk_agrees_with_the_published_check_for_nikon_and_imac() -> None:
    expected = [[0.64, 0.33, 0.03], [0.04, 0.81, 0.15], [0.01, 0.18, 0.81]]
    np.testing.assert_allclose(PAIRS["nikon-imac"].crosstalk, expected, atol=0.006)


def test_white_at_30_degrees_keeps_what_the_worst_of_phones_lost() -> None:
    exponent = PAIRS["canon-samsung"].display.falloff[1]
    assert math.cos(math.radians(30)) ** exponent > 0.5
    assert DISPLAYS["samsung"].washout > DISPLAYS["lg"].washout > DISPLAYS["imac"].washout


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


WAVELENGTH = np.arange(400.0, 701.0, 5.0)


def test_a_camera_with_the_sensitivities_of_srgb_needs_no_colour_matrix() -> None:
    s = triangles(WAVELENGTH) * [1.0, 2.0, 5.0]
    xyz = triangles(WAVELENGTH) @ np.linalg.inv(XYZ_TO_SRGB).T
    C = color_matrix(WAVELENGTH, s, WAVELENGTH, xyz)
    np.testing.assert_allclose(C, np.eye(3), atol=FLOAT64)


def test_the_colour_matrix_undoes_a_known_mixture_of_srgb() -> None:
    mix = np.array([[0.7, 0.2, 0.1], [0.1, 0.8, 0.1], [0.0, 0.3, 0.7]])
    xyz = triangles(WAVELENGTH) @ np.linalg.inv(XYZ_TO_SRGB).T
    C = color_matrix(WAVELENGTH, triangles(WAVELENGTH) @ mix.T, WAVELENGTH, xyz)
    np.testing.assert_allclose(C, np.linalg.inv(mix), atol=FLOAT64)


def test_no_colour_matrix_that_keeps_white_fits_better() -> None:
    rng = np.random.default_rng(0)
    s, xyz = rng.random((2, len(WAVELENGTH), 3))
    C = color_matrix(WAVELENGTH, s, WAVELENGTH, xyz)
    np.testing.assert_allclose(C.sum(axis=1), 1.0, atol=FLOAT64)
    srgb = xyz @ XYZ_TO_SRGB.T
    S, X = s / s.sum(axis=0), srgb / srgb.sum(axis=0)

    def misfit(matrix: Array) -> float:
        return float(np.square(S @ matrix.T - X).sum())

    for _ in range(50):
        step = rng.normal(0, 0.01, (3, 3))
        assert misfit(C + step - step.mean(axis=1, keepdims=True)) > misfit(C)


def test_gamma_of_a_power_law_is_its_exponent() -> None:
    level = np.linspace(0.0, 1.0, 30)
    light = level[:, None] ** np.array([1.8, 2.2, 2.4])
    np.testing.assert_allclose(fit_gamma(level, light), [1.8, 2.2, 2.4], rtol=1e-12)


def write_measurements(folder: Path) -> None:
    """Write three cameras and three displays with narrow primaries at 450, 550 and 650 nm."""
    wavelength = np.arange(380.0, 781.0, 5.0)
    rows = triangles(wavelength, (650, 550, 450))
    table = {str(w): row.tolist() for w, row in zip(wavelength, rows, strict=True)}
    (folder / "camera_ssf").mkdir()
    (folder / "display").mkdir()
    for name in (*SSF_FILES.values(), "cmf_1931.json"):
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


def test_printed_tables_are_python_that_holds_the_nine_pairs(
    tmp_path: Path, command: Command
) -> None:
    write_measurements(tmp_path)
    table, others = command(main, "--data", tmp_path).stdout.split("\n}\n")
    crosstalks = ast.literal_eval(table.split(" = ", 1)[1] + "}")
    assert set(crosstalks) == set(PAIRS)
    for M in crosstalks.values():
        np.testing.assert_array_equal(np.array(M), np.eye(3))
    matrices = [line.split("=", 1) for line in others.splitlines() if "color_matrix" in line]
    assert [name for name, _ in matrices] == [f"{camera}: color_matrix" for camera in CAMERAS]
    for _, rows in matrices:
        np.testing.assert_allclose(np.sum(ast.literal_eval(rows), axis=1), 1.0, atol=0.0015)
    assert others.count("(2.2, 2.2, 2.2)") == 3


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
