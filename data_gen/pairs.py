"""The nine pairs of the paper: three cameras before three displays, each number with its source.

Each number is *measured* (citation), *datasheet*, *assumed* (bounds in brackets) or *fitted*
(`reports.lab.calibrate`, in nuisances.json). Sources:
SPECTRA: `reports.lab.spectra`, at the tag results-2026-11, on rawtoaces-data sensitivities
(Apache-2.0) and isetbio (MIT) and vistadisp display spectra. DARKTABLE: base curves and noise
profiles of darktable. LENSFUN: lens database (CC BY-SA 3.0). PRAD: prad.de's reviews of the Samsung
2493HM and 2494HM, sisters of the 2494SW. PTC: published sensor tests, D50 30,490 e at ISO 200,
Canon 40D 41,400 e at ISO 100.

No table of luminance against angle was found for these panels: ``falloff``, ``washout`` and
``leak`` are assumptions, ordered TN > 32-inch S-IPS > IPS, and kept below what phone and tablet
LCDs of the time lost, over half of their luminance at 30 degrees (``falloff`` 4.8).

Left out: azimuth (a TN panel differs left, right, up and down), lens distortion, the row grid's
moire, metering that changes within a pair other than as drift.

Exposure assumed: f/5.6, 1/60 s, ISO 400, or the equal f/4, ISO 200 for Sony. A white of about
330 cd/m^2 then saturates (metering constant 12.5, gray 18 %); the 2494HM gives 285 (PRAD).
"""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from data_gen.effects import as_tuple, with_parameter
from data_gen.parameters import (
    Camera,
    Curve,
    Display,
    Matrix,
    Nuisance,
    Pair,
    Setup,
    read_curve,
)
from data_gen.today import TODAY
from link.errors import InputError, choose
from link.outside import read_json


def _curve(x: tuple[float, ...], y: tuple[float, ...]) -> Curve:
    return ((0.0, 0.0), *zip(x, y, strict=True), (1.0, 1.0))


# white_level puts frontal white at 245 of 255 in the file, just below clipping, through each tone
# curve [0.8 to 1.2 times]. color_matrix: printed by reports.lab.spectra (SPECTRA). Assumed: blur_px
# [0.3 to 1; the more native pixels, the less], sharpening [0 to 0.6],
# breathing [0 to 5e-4], jpeg_quality [85 to 97], shutter 1/60 s on the dial (1/64 by whole stops).
CAMERAS = {
    "canon": Camera(
        name="Canon EOS Rebel XSi",
        full_well_e=8750.0,  # 35 ke at ISO 100, inferred from the 40D (PTC) [29 to 41 ke]; / 4
        read_noise_e=6.8,  # measured on the 40D at ISO 400 (PTC)
        white_level=0.51,
        color_matrix=((1.541, -0.615, 0.075), (-0.059, 1.51, -0.451), (0.018, -0.442, 1.424)),
        tone_curve=_curve(  # measured, EOS 5D Mark II, of the same year (DARKTABLE)
            (0.0066, 0.0273, 0.0459, 0.2066, 0.4423, 0.6733),
            (0.0035, 0.0298, 0.0702, 0.5399, 0.8724, 0.9717),
        ),
        blur_px=0.5,
        native_width=4272,  # maker
        sharpening=0.4,
        vignetting=0.20,  # measured, EF-S 18-55 IS at 35 mm, f/5.6 (LENSFUN)
        breathing=1e-4,
        shutter_s=1 / 64,
        readout_s=0.004,  # focal plane; flash sync at 1/200 s (maker), so the curtains take less
        jpeg_quality=95,
    ),
    "nikon": Camera(
        name="Nikon D70",
        full_well_e=12500.0,  # 25 ke at ISO 200, inferred from the D50 (PTC) [20 to 30 ke]; / 2
        read_noise_e=11.0,  # D50, D40 profiles at ISO 400 (DARKTABLE), scaled to the D50 full well
        white_level=0.71,
        color_matrix=((1.51, -0.535, 0.025), (-0.063, 1.41, -0.346), (-0.015, -0.347, 1.362)),
        tone_curve=_curve(  # measured, D90, the nearest Nikon measured (DARKTABLE)
            (0.0117, 0.1229, 0.1536, 0.2469, 0.4490, 0.6668),
            (0.0127, 0.2900, 0.3427, 0.5101, 0.7338, 0.8943),
        ),
        blur_px=0.6,
        native_width=3008,  # maker
        sharpening=0.3,
        vignetting=0.25,  # measured, AF-S DX 18-70 at 35 mm, f/5.6 (LENSFUN)
        breathing=1e-4,
        shutter_s=1 / 64,
        readout_s=0.0,  # the interline CCD starts and stops all rows at once
        jpeg_quality=92,
    ),
    "sony": Camera(
        name="Sony DSC-RX100",
        full_well_e=4400.0,  # 7 ke at the base ISO 125, inferred from pixel size [6 to 8 ke]; / 1.6
        read_noise_e=4.3,  # RX100M2 profile at ISO 125 (DARKTABLE), scaled to a 7 ke full well
        white_level=0.71,
        color_matrix=((1.67, -0.588, -0.082), (-0.195, 1.584, -0.389), (0.092, -0.715, 1.623)),
        tone_curve=_curve(  # measured, RX100M2 (DARKTABLE)
            (0.0151, 0.0701, 0.1075, 0.1915, 0.2580, 0.3054, 0.3264, 0.4481, 0.5096, 0.6768),
            (0.0081, 0.0937, 0.1707, 0.3411, 0.4585, 0.5373, 0.5693, 0.7237, 0.7780, 0.8988),
        ),
        blur_px=0.4,
        native_width=5472,  # maker
        sharpening=0.5,
        vignetting=0.32,  # measured, 18.7 mm, f/4 (LENSFUN); camera may correct it [0.1 to 0.35]
        breathing=5e-5,
        shutter_s=1 / 64,
        readout_s=0.015,  # assumed: video by a rolling CMOS readout [0.008 to 0.03]
        jpeg_quality=90,
    ),
}
"""The three cameras, by the first part of a pair's name."""

# gamma: SPECTRA, log-log fit over the upper 80 % of levels of the stand-in [+-0.15]. Assumed:
# edge_loss [0.05 to 0.2]; haze: 150 lux on a surface that scatters 1 to 3 % of it back, 0.5 to 1.5
# cd/m^2 beside a white of 250 [0.002 to 0.01]; pwm_duty: near full brightness, as sold [0.5 to 1].
# falloff is replaced by the fitted.
DISPLAYS = {
    "imac": Display(
        name="iMac 21.5-inch 2009",
        panel="IPS",  # maker, with white-LED backlight (everymac.com)
        gamma=(2.12, 2.09, 2.09),
        black=1 / 1000,  # assumed, usual for IPS of the time [1/1200 to 1/700]
        falloff=(2.2, 2.2, 2.3),  # assumed: half of white at 43 degrees [1.5 to 3.0]
        washout=0.12,  # assumed: IPS keeps its gamma best [0 to 0.25]
        washout_gamma=1.4,  # assumed [1.2 to 1.8]
        leak=0.003,  # assumed: glow of black, contrast about 240 at 45 degrees [0.001 to 0.01]
        edge_loss=0.08,
        haze=0.004,
        glare=0.02,  # assumed: glass front [0 to 0.06]
        pwm_hz=400.0,  # assumed [200 to 1000]
        pwm_duty=0.95,
        pwm_depth=1.0,  # white LED (everymac.com)
        native_height=1080,  # maker
    ),
    "lg": Display(
        name="LG M3204CCBA",
        panel="IPS",  # assumed: LG Display's 32-inch 1366 x 768 panels of 2008 were S-IPS; maybe VA
        gamma=(2.31, 2.35, 2.38),
        black=1 / 800,  # assumed; LG's 32LG40 had 0.52 cd/m^2 (reviewed.com) [1/1200 to 1/500]
        falloff=(2.7, 2.7, 2.8),  # assumed: between iMac and Samsung, half at 39 deg [2.0 to 3.6]
        washout=0.25,  # assumed: between the two [0.1 to 0.5]
        washout_gamma=1.3,  # assumed [1.1 to 1.8]
        leak=0.004,  # assumed [0.001 to 0.01]
        edge_loss=0.10,
        haze=0.006,
        glare=0.004,  # assumed: matt front [0 to 0.01]
        pwm_hz=150.0,  # assumed [100 to 250]
        pwm_duty=0.95,
        pwm_depth=0.3,  # assumed: fluorescent lamps glow on [0.1 to 0.6]
        native_height=768,  # datasheet of LG Display's LC320WXN
    ),
    "samsung": Display(
        name="Samsung SyncMaster 2494SW",
        panel="TN",  # 2494 family (PRAD)
        gamma=(2.17, 2.09, 2.16),  # PRAD gives about 2.2
        black=1 / 750,  # measured, 693 to 830:1 on the 2493HM (PRAD)
        clip=0.96,  # nearly 4 % of grays turn white at contrast 100, none at 75 (PRAD) [0.96 to 1]
        falloff=(3.6, 3.7, 4.1),  # assumed: half at 35 deg, blue first (yellow cast) [2.8 to 4.8]
        washout=0.6,  # assumed: gamma 1.8 at mid-gray and 45 degrees [0.3 to 0.9]
        washout_gamma=1.2,  # assumed [1.0 to 1.6]
        leak=0.006,  # assumed: contrast about 80 at 45 degrees [0.002 to 0.02]
        edge_loss=0.12,  # reported of a 24-inch Samsung TN: 6 % mean, 22 % worst; source not kept
        haze=0.006,
        glare=0.004,  # assumed: matt front [0 to 0.01]
        pwm_hz=180.0,  # reported of a 24-inch Samsung TN; the source was not kept
        pwm_duty=0.95,
        pwm_depth=0.3,  # assumed: fluorescent lamps glow on [0.1 to 0.6]
        native_height=1080,  # maker: 1920 x 1080
    ),
}
"""The three displays, by the second part of a pair's name."""

# Printed by reports.lab.spectra (SPECTRA): stand-in cameras and displays as listed there. Two
# laboratories differ by up to 0.11 in the red row of Canon (400D 0.63, 600D 0.52 with LCD-Apple).
CROSSTALK: dict[str, Matrix] = {
    "canon-imac": ((0.632, 0.336, 0.032), (0.052, 0.762, 0.186), (0.016, 0.197, 0.788)),
    "canon-lg": ((0.697, 0.268, 0.035), (0.057, 0.712, 0.231), (0.02, 0.233, 0.747)),
    "canon-samsung": ((0.705, 0.262, 0.032), (0.05, 0.718, 0.232), (0.013, 0.223, 0.764)),
    "nikon-imac": ((0.642, 0.331, 0.027), (0.042, 0.805, 0.153), (0.013, 0.181, 0.806)),
    "nikon-lg": ((0.683, 0.287, 0.03), (0.047, 0.762, 0.191), (0.019, 0.228, 0.753)),
    "nikon-samsung": ((0.688, 0.283, 0.029), (0.04, 0.767, 0.192), (0.011, 0.216, 0.773)),
    "sony-imac": ((0.616, 0.313, 0.07), (0.09, 0.781, 0.128), (0.03, 0.283, 0.687)),
    "sony-lg": ((0.634, 0.288, 0.079), (0.099, 0.714, 0.187), (0.034, 0.301, 0.665)),
    "sony-samsung": ((0.637, 0.286, 0.076), (0.091, 0.715, 0.194), (0.029, 0.297, 0.675)),
}
"""Share of the display's red, green and blue that each channel of the camera takes in, by pair.
Rows are the channels of the camera, and sum to 1 but for rounding."""

# The paper holds the exposure while the angle changes (Figure "Influence of observation angles").
# corner_px: assumed; a good detector on a lit display [0.2 to 1].
SETUP = Setup(name="setup", perspective=True, metering=0.0, corner_px=0.5)
"""How the paper sets up camera and display."""

FITTED_FILE = Path(__file__).with_name("nuisances.json")
"""File that `reports.lab.calibrate` writes and that ships with the code."""
FITTED = json.loads(FITTED_FILE.read_text("utf-8"))
"""Fitted values: those of `Nuisance` by camera and view, and ``falloff`` by display."""


def _pair(camera: str, display: str) -> Pair:
    fitted = FITTED["fitted"][camera]
    return Pair(
        name=f"{camera}-{display}",
        camera=CAMERAS[camera],
        display=replace(DISPLAYS[display], falloff=tuple(FITTED["falloff"][display])),
        setup=SETUP,
        frontal=Nuisance(name=f"{camera} at 0 degrees", **fitted["0"]),
        oblique=Nuisance(name=f"{camera} at 45 degrees", **fitted["45"]),
        crosstalk=CROSSTALK[f"{camera}-{display}"],
    )


PAIRS = {f"{c}-{d}": _pair(c, d) for c in CAMERAS for d in DISPLAYS}
"""The nine camera-display pairs of the paper by name, such as "canon-lg"."""
GROUPS = {"paper": tuple(PAIRS), "today": tuple(TODAY)}
"""Names of groups of pairs, which stand for the names of all their pairs."""


def get_pair(name: str) -> Pair:
    """Return a camera-display pair by its name, or one of one's own by its file, NAME.json.

    >>> get_pair("canon-lg").camera.name
    'Canon EOS Rebel XSi'

    Raises:
        InputError: no pair has this name; the message lists those that there are. Or the file is
            not there, or wrong.
    """
    return _own_pair(Path(name)) if name.endswith(".json") else choose(PAIRS | TODAY, name, "pair")


def _own_pair(file: Path) -> Pair:
    """Read a pair: "base" names the one from which it differs by the parameters of "set"."""
    content = read_json(file)
    if not isinstance(content, dict) or not {"base"} <= set(content) <= {"base", "set"}:
        raise InputError(f'{file}: need {{"base": PAIR, "set": {{PARAMETER: VALUE, ...}}}}')
    pair = choose(PAIRS | TODAY, content["base"], f"base pair in {file}")
    changes = content.get("set", {})
    if not isinstance(changes, dict):
        raise InputError(f"{file}: set must name parameters and their values")
    for name, value in changes.items():
        if isinstance(value, str) and value.endswith(".csv"):
            changed: Any = read_curve(file.parent / value)
        else:
            changed = as_tuple(value)
        pair = with_parameter(pair, name, changed)
    return replace(pair, name=file.name)


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
