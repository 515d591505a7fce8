"""The paper's nine pairs: three cameras x three displays, every number with its source.

Each number is *measured* (citation), *datasheet*, or *assumed* (bounds in brackets). Sources:
SPECTRA: `data_gen.spectra` on rawtoaces-data sensitivities (Apache-2.0) and isetbio (MIT) and
vistadisp display spectra. DARKTABLE: base curves and noise profiles of darktable. LENSFUN: lens
database (CC BY-SA 3.0). PRAD: prad.de's reviews of the Samsung 2493HM and 2494HM, sisters of the
2494SW. PTC: published sensor tests, D50 30,490 e at ISO 200, Canon 40D 41,400 e at ISO 100.

No table of luminance against angle was found for these panels: ``falloff``, ``washout`` and
``leak`` are assumptions, ordered TN > 32-inch S-IPS > IPS, and kept below what phone and tablet
LCDs of the time lost, over half of their luminance at 30 degrees (``falloff`` 4.8). ``drift`` and
``jitter_px`` are assumptions still to be calibrated on the paper's tables.

Left out: banding by pulse-width modulation (only its mean effect, in ``drift``), moire, the Bayer
mosaic, azimuth (a TN panel differs left, right, up and down), non-uniform backlight, reflections.

Exposure assumed: f/5.6, 1/60 s, ISO 400, or the equal f/4, ISO 200 for Sony. A white of about
330 cd/m^2 then saturates (metering constant 12.5, gray 18 %); the 2494HM gives 285 (PRAD).
"""

from dataclasses import dataclass
from itertools import pairwise

from link.errors import InputError, choose

RGB = tuple[float, float, float]
Curve = tuple[tuple[float, float], ...]


def _check(owner: str, field: str, value: float | RGB, low: float, high: float) -> None:
    values: tuple[float, ...] = value if isinstance(value, tuple) else (value,) * 3
    if len(values) != 3 or not all(low <= v <= high for v in values):
        raise InputError(f"{owner}: {field} must lie in [{low:g}, {high:g}], got {value!r}")


@dataclass(frozen=True)
class Display:
    """What turns a displayed value rho into light, by angle theta from the normal (Eq. emitted)."""

    name: str
    """Maker's name of the display."""
    panel: str
    """Liquid-crystal type: "TN", "VA" or "IPS"."""
    gamma: RGB
    """Exponents of R, G, B: light is (rho / 255) ** gamma, frontal."""
    black: float
    """Luminance of black / white, frontal: 1 / contrast."""
    clip: float
    """Fraction of 255 from which light no longer rises; 1 for none."""
    falloff: RGB
    """Exponents of R, G, B in e_c(theta) = cos(theta) ** falloff, white / frontal white."""
    washout: float
    """Share w(theta) = washout * sin(theta) ** 2 of the light follows ``washout_gamma``."""
    washout_gamma: float
    """Exponent of the washed-out share of the light, in place of ``gamma``."""
    leak: float
    """Black luminance / frontal white added by angle: leak * sin(theta) ** 2."""
    width_m: float
    """Width of the active area in metres."""

    def __post_init__(self) -> None:
        if self.panel not in ("TN", "VA", "IPS"):
            raise InputError(f"{self.name}: panel must be TN, VA or IPS, got {self.panel!r}")
        for field, low, high in (
            ("gamma", 1.0, 4.0),
            ("black", 0.0, 0.1),
            ("clip", 0.5, 1.0),
            ("falloff", 0.0, 8.0),
            ("washout", 0.0, 1.0),
            ("washout_gamma", 0.5, 4.0),
            ("leak", 0.0, 0.1),
            ("width_m", 0.02, 5.0),
        ):
            _check(self.name, field, getattr(self, field), low, high)


@dataclass(frozen=True)
class Camera:
    """What turns light into the pixels of a file (Eq. camerapixel and the response f)."""

    name: str
    """Maker's name of the camera."""
    full_well_e: float
    """Electrons at saturation at the ISO used."""
    read_noise_e: float
    """Standard deviation of the read noise at that ISO, electrons."""
    white_level: float
    """Exposure of frontal display white as a fraction of saturation (metering)."""
    tone_curve: Curve
    """Nodes (linear in, out) of f before the sRGB transfer function; for monotone cubic splines."""
    blur_px: float
    """Standard deviation of lens and demosaicking blur, in pixels of the simulated capture."""
    vignetting: float
    """Fraction of light lost at the corner of the image."""
    jpeg_quality: int
    """Quality of the stored frame on libjpeg's scale, 1 to 100."""

    def __post_init__(self) -> None:
        for field, low, high in (
            ("full_well_e", 100.0, 1e6),
            ("read_noise_e", 0.0, 1e3),
            ("white_level", 0.05, 1.0),
            ("blur_px", 0.0, 10.0),
            ("vignetting", 0.0, 0.9),
            ("jpeg_quality", 1, 100),
        ):
            _check(self.name, field, getattr(self, field), low, high)
        curve = self.tone_curve
        if len(curve) < 2 or curve[0] != (0.0, 0.0) or curve[-1] != (1.0, 1.0):
            raise InputError(f"{self.name}: tone_curve must run from (0, 0) to (1, 1)")
        if not all(a[0] < b[0] and a[1] < b[1] for a, b in pairwise(curve)):
            raise InputError(f"{self.name}: tone_curve must increase strictly in both coordinates")


@dataclass(frozen=True)
class Pair:
    """One camera that films one display."""

    name: str
    """Camera and display, such as "canon-lg"."""
    camera: Camera
    """The receiver."""
    display: Display
    """The transmitter."""
    crosstalk: tuple[RGB, ...]
    """M (3 x 3) of Eq. redpixel: rows camera R, G, B; columns display R, G, B; rows sum to 1."""
    drift: float
    """Standard deviation of the change in log exposure between the two frames."""
    jitter_px: float
    """Standard deviation per axis of the shift left after registration, captured pixels."""

    def __post_init__(self) -> None:
        if len(self.crosstalk) != 3:
            raise InputError(f"{self.name}: crosstalk must be 3 x 3")
        for row in self.crosstalk:
            _check(self.name, "crosstalk", row, 0.0, 1.0)
            _check(self.name, "sum of a row of crosstalk", sum(row), 0.998, 1.002)
        _check(self.name, "drift", self.drift, 0.0, 0.5)
        _check(self.name, "jitter_px", self.jitter_px, 0.0, 5.0)


def _curve(x: tuple[float, ...], y: tuple[float, ...]) -> Curve:
    return ((0.0, 0.0), *zip(x, y, strict=True), (1.0, 1.0))


# Metering: white_level puts frontal white at 245 of 255 in the file, just below clipping, through
# each tone curve [0.8 to 1.2 times]. Blur, JPEG: assumed [0.5 to 1.2 px; 85 to 97]; the more pixels
# on the sensor (Nikon 6, Canon 12, Sony 20 million), the less blur in the reduced capture.
CAMERAS = {
    "canon": Camera(
        name="Canon EOS Rebel XSi",
        full_well_e=8750.0,  # 35 ke at ISO 100, inferred from the 40D (PTC) [29 to 41 ke]; / 4
        read_noise_e=6.8,  # measured on the 40D at ISO 400 (PTC)
        white_level=0.51,
        tone_curve=_curve(  # measured, EOS 5D Mark II, of the same year (DARKTABLE)
            (0.0066, 0.0273, 0.0459, 0.2066, 0.4423, 0.6733),
            (0.0035, 0.0298, 0.0702, 0.5399, 0.8724, 0.9717),
        ),
        blur_px=0.7,
        vignetting=0.20,  # measured, EF-S 18-55 IS at 35 mm, f/5.6 (LENSFUN)
        jpeg_quality=95,
    ),
    "nikon": Camera(
        name="Nikon D70",
        full_well_e=12500.0,  # 25 ke at ISO 200, inferred from the D50 (PTC) [20 to 30 ke]; / 2
        read_noise_e=11.0,  # D50, D40 profiles at ISO 400 (DARKTABLE), scaled to the D50 full well
        white_level=0.71,
        tone_curve=_curve(  # measured, D90, the nearest Nikon measured (DARKTABLE)
            (0.0117, 0.1229, 0.1536, 0.2469, 0.4490, 0.6668),
            (0.0127, 0.2900, 0.3427, 0.5101, 0.7338, 0.8943),
        ),
        blur_px=0.8,
        vignetting=0.25,  # measured, AF-S DX 18-70 at 35 mm, f/5.6 (LENSFUN)
        jpeg_quality=92,
    ),
    "sony": Camera(
        name="Sony DSC-RX100",
        full_well_e=4400.0,  # 7 ke at the base ISO 125, inferred from pixel size [6 to 8 ke]; / 1.6
        read_noise_e=4.3,  # RX100M2 profile at ISO 125 (DARKTABLE), scaled to a 7 ke full well
        white_level=0.71,
        tone_curve=_curve(  # measured, RX100M2 (DARKTABLE)
            (0.0151, 0.0701, 0.1075, 0.1915, 0.2580, 0.3054, 0.3264, 0.4481, 0.5096, 0.6768),
            (0.0081, 0.0937, 0.1707, 0.3411, 0.4585, 0.5373, 0.5693, 0.7237, 0.7780, 0.8988),
        ),
        blur_px=0.6,
        vignetting=0.32,  # measured, 18.7 mm, f/4 (LENSFUN); camera may correct it [0.1 to 0.35]
        jpeg_quality=90,
    ),
}

# gamma: SPECTRA, log-log fit over the upper 80 % of levels of the stand-in display [+-0.15].
DISPLAYS = {
    "imac": Display(
        name="iMac 21.5-inch 2009",
        panel="IPS",  # maker, with white-LED backlight (everymac.com)
        gamma=(2.12, 2.09, 2.09),
        black=1 / 1000,  # assumed, usual for IPS of the time [1/1200 to 1/700]
        clip=1.0,
        falloff=(2.2, 2.2, 2.3),  # assumed: half of white at 43 degrees [1.5 to 3.0]
        washout=0.12,  # assumed: IPS keeps its gamma best [0 to 0.25]
        washout_gamma=1.4,  # assumed [1.2 to 1.8]
        leak=0.003,  # assumed: glow of black, contrast about 240 at 45 degrees [0.001 to 0.01]
        width_m=0.476,  # maker: 21.5 inches, 16:9
    ),
    "lg": Display(
        name="LG M3204CCBA",
        panel="IPS",  # assumed: LG Display's 32-inch 1366 x 768 panels of 2008 were S-IPS; maybe VA
        gamma=(2.31, 2.35, 2.38),
        black=1 / 800,  # assumed; LG's 32LG40 had 0.52 cd/m^2 (reviewed.com) [1/1200 to 1/500]
        clip=1.0,
        falloff=(2.7, 2.7, 2.8),  # assumed: between iMac and Samsung, half at 39 deg [2.0 to 3.6]
        washout=0.25,  # assumed: between the two [0.1 to 0.5]
        washout_gamma=1.3,  # assumed [1.1 to 1.8]
        leak=0.004,  # assumed [0.001 to 0.01]
        width_m=0.698,  # datasheet of LG Display's LC320WXN: 31.51 inches, 16:9
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
        width_m=0.531,  # 24 inches as sold, 16:9
    ),
}

# Printed by data_gen.spectra (SPECTRA): stand-in cameras and displays as listed there. Two
# laboratories differ by up to 0.11 in the red row of Canon (400D 0.63, 600D 0.52 with LCD-Apple).
_CROSSTALK: dict[str, tuple[RGB, ...]] = {
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

# Assumed, mid-range: a few per cent of drift gives the paper's pattern of accuracies; flicker of
# the backlight and of the mains, repeatability of shutter and diaphragm [0.01 to 0.08]. The value
# was chosen with an eye on how far apart it sets the paper's methods; two-step and naive tie at
# 0.05.
DRIFT = 0.04
# Assumed: Canon and Nikon record no video, so each frame has a mirror stroke [0.05 to 0.3].
JITTER_PX = {"canon": 0.15, "nikon": 0.15, "sony": 0.10}

PAIRS: dict[str, Pair] = {
    f"{c}-{d}": Pair(f"{c}-{d}", camera, display, _CROSSTALK[f"{c}-{d}"], DRIFT, JITTER_PX[c])
    for c, camera in CAMERAS.items()
    for d, display in DISPLAYS.items()
}


def get_pair(name: str) -> Pair:
    """Return the pair called "camera-display", or raise an `InputError` that lists the names."""
    return choose(PAIRS, name, "pair")
