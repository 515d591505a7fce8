"""Compute crosstalk, colour matrices and gamma from spectra: python -m reports.lab.spectra.

I_c = M rho_lin (Eq. redpixel, camerapixel): M[c, d] is the integral over wavelength of
s_c(lambda) e_d(lambda), rows camera channels, columns display primaries, each row divided by its
sum, so that display white gives equal camera R, G and B.

Units: the display spectra are energy (W sr^-1 m^-2 per nm or per band: with the CIE 1931 observer
LCD-Apple gives a plausible 118 cd/m^2), the sensitivities relative response per energy, as
rawtoaces uses them. So the integrand is the plain product; a photon factor lambda would move an
entry by at most 0.03. Scales cancel in the row sums.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
import scipy.io
import tyro

from link.cli import read_flags, run_cli
from link.errors import InputError
from link.outside import read_json

Array = npt.NDArray[np.float64]
"""Numbers of any shape."""
UNREADABLE = (OSError, EOFError, ValueError, KeyError, TypeError, AttributeError)
"""Exceptions that a damaged file of spectra may raise."""

SSF_FILES = {
    "canon": "Canon_Digital_Rebel_XTi_380_780_5.json",  # one model before the Rebel XSi (450D)
    "nikon": "Nikon_D70_380_780_5.json",  # exact
    "sony": "Sony_DSC-RX100M4_380_780_5.json",  # the RX100, three generations later
}
"""Files of measured sensitivities that stand for the cameras."""
DISPLAY_FILES = {
    # White LED (450 nm peak and broad phosphor), as the LED-backlit iMac of late 2009
    "imac": "LCD-Apple.mat",
    # The other two are lit by fluorescent lamps, whose lines (436, 488, 545, 612 nm) only the Dells
    # show: LCD-HP and HP_LP2480zx are wide-gamut RGB LED, LCD-Samsung-RGBW repeats LCD-Apple.
    # Which Dell stands for which display is arbitrary: their M differ by at most 0.02.
    "lg": "LCD-Dell.mat",
    "samsung": "vistadisp_DELL1905FP.mat",
}
"""Files of measured primaries that stand for the displays."""
GAMMA_FROM = 0.2
"""Lowest digital level, as a share of full, in the fit of gamma: below it the black level rules."""


@dataclass(frozen=True)
class SpectraConfig:
    """Where the measured spectra lie."""

    data: Path
    """Folder with ``camera_ssf/*.json`` (rawtoaces) and ``display/*.mat`` (isetbio, vistadisp)."""


@dataclass(frozen=True)
class DisplaySpectra:
    """A measured display: primaries (columns R, G, B) and tone response."""

    wavelength: Array
    """(L,) wavelengths, nm."""
    spd: Array
    """(L, 3) energy of the primaries at each wavelength, relative."""
    level: Array
    """(K,) digital values as shares of full, in [0, 1]."""
    light: Array
    """(K, 3) emitted light of the primaries as a share of that of full."""


def load_ssf(path: Path) -> tuple[Array, Array]:
    """Read a rawtoaces file: wavelengths (L,) in nm, sensitivities (L, 3) in columns R, G, B."""
    try:
        table = read_json(path)["spectral_data"]["data"]["main"]
        wavelength = np.array([float(key) for key in table], dtype=np.float64)
        ssf = np.array(list(table.values()), dtype=np.float64).reshape(len(wavelength), 3)
    except UNREADABLE as error:
        raise InputError(f"cannot read camera sensitivities from {path}: {error}") from error
    return wavelength, ssf


def load_display(path: Path) -> DisplaySpectra:
    """Read an isetbio (struct ``d``) or vistadisp (Psychtoolbox ``cals``) calibration."""
    try:
        with path.open("rb") as file:
            mat = scipy.io.loadmat(file, squeeze_me=True, struct_as_record=False)
        if "d" in mat:
            d = mat["d"]
            wavelength, spd, light = np.asarray(d.wave, np.float64), d.spd, d.gamma
            level = np.linspace(0.0, 1.0, len(light))
        else:
            cal = mat["cals"]
            start, step, count = (float(v) for v in cal.S_device)
            wavelength = start + step * np.arange(count)
            spd, light = cal.P_device, cal.rawdata.rawGammaTable
            level = np.asarray(cal.rawdata.rawGammaInput, np.float64)
        spd = np.asarray(spd, np.float64).reshape(len(wavelength), 3)
        light = np.asarray(light, np.float64).reshape(len(level), 3)
    except (*UNREADABLE, scipy.io.matlab.MatReadError) as error:
        raise InputError(f"cannot read three display primaries from {path}: {error}") from error
    return DisplaySpectra(wavelength, spd, level, light)


def crosstalk(s_wavelength: Array, s: Array, e_wavelength: Array, e: Array) -> Array:
    """Integrate sensitivities and primaries, both linear on their common grid of 1 nm.

    Args:
        s_wavelength: (L,) nm.
        s: (L, 3) sensitivities of R, G, B.
        e_wavelength: (K,) nm.
        e: (K, 3) energy of the primaries R, G, B.

    Returns:
        M (3, 3), whose rows sum to 1.

    Raises:
        InputError: a camera channel gets no light from display white.
    """
    high = min(s_wavelength[-1], e_wavelength[-1])
    grid = np.arange(np.ceil(max(s_wavelength[0], e_wavelength[0])), np.floor(high) + 0.5)
    s_grid = np.stack([np.interp(grid, s_wavelength, column) for column in s.T], axis=1)
    e_grid = np.stack([np.interp(grid, e_wavelength, column) for column in e.T], axis=1)
    M = s_grid.T @ e_grid
    white = M.sum(axis=1, keepdims=True)
    if not np.all(white > 0):
        raise InputError("a camera channel gets no light from display white: check the spectra")
    return np.asarray(M / white, dtype=np.float64)


XYZ_TO_SRGB = np.array(
    [[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]]
)
"""Matrix from CIE 1931 XYZ to linear sRGB (IEC 61966-2-1)."""


def color_matrix(s_wavelength: Array, s: Array, x_wavelength: Array, xyz: Array) -> Array:
    """Fit the matrix from white-balanced raw values to linear sRGB.

    Maximum ignorance: min || S C^T - X ||^2 over all spectra alike, subject to C 1 = 1, where the
    columns of S (sensitivities) and X (sRGB from the colour-matching functions) are scaled so that
    a flat spectrum gives equal R, G and B (Finlayson & Drew 1997, white-point preserving).

    Args:
        s_wavelength: (L,) nm.
        s: (L, 3) sensitivities of R, G, B.
        x_wavelength: (K,) nm, covering the others.
        xyz: (K, 3) CIE 1931 colour-matching functions.

    Returns:
        C (3, 3), whose rows sum to 1.
    """
    X = np.stack([np.interp(s_wavelength, x_wavelength, column) for column in xyz.T], axis=1)
    X = X @ XYZ_TO_SRGB.T
    S, X = s / s.sum(axis=0), X / X.sum(axis=0)
    inverse = np.linalg.inv(S.T @ S)
    free = (inverse @ S.T @ X).T
    ones = np.ones(3)
    step = inverse @ ones / (ones @ inverse @ ones)
    return np.asarray(free + np.outer(1 - free.sum(axis=1), step), np.float64)


def fit_gamma(level: Array, light: Array) -> Array:
    """Fit log light = gamma log level by least squares, through white, unweighted.

    Args:
        level: (K,) digital values as shares of full.
        light: (K, 3) emitted light as a share of that of full.

    Returns:
        (3,) exponents of R, G, B.
    """
    kept = (level >= GAMMA_FROM) & (level < 1.0)
    x = np.log(level[kept])[:, None]
    y = np.log(np.maximum(light[kept], 1e-6))
    return np.asarray((x * y).sum(axis=0) / (x * x).sum(axis=0), dtype=np.float64)


def main() -> None:
    """Print the tables that `data_gen.pairs` holds, as Python source."""
    config = read_flags(lambda: tyro.cli(SpectraConfig))
    displays = {k: load_display(config.data / "display" / f) for k, f in DISPLAY_FILES.items()}
    print("CROSSTALK = {")
    for camera, file in SSF_FILES.items():
        wavelength, s = load_ssf(config.data / "camera_ssf" / file)
        for name, e in displays.items():
            rows = crosstalk(wavelength, s, e.wavelength, e.spd).round(3).tolist()
            print(f'    "{camera}-{name}": ({", ".join(str(tuple(row)) for row in rows)}),')
    x_wavelength, xyz = load_ssf(config.data / "camera_ssf" / "cmf_1931.json")
    print("}")
    for camera, file in SSF_FILES.items():
        C = color_matrix(*load_ssf(config.data / "camera_ssf" / file), x_wavelength, xyz)
        print(f"{camera}: color_matrix={tuple(tuple(row) for row in C.round(3).tolist())}")
    gammas = {k: fit_gamma(e.level, e.light).round(2).tolist() for k, e in displays.items()}
    print(*(f"{name}: gamma={tuple(gamma)}" for name, gamma in gammas.items()), sep="\n")


if __name__ == "__main__":
    run_cli(main)
