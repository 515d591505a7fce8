"""Pairs of today: phones, webcams and action cameras before laptops, phones and televisions.

Each number is *measured* (source), *code* (source), *derived* from such a number, or *assumed*,
with bounds in brackets. Sources, seen in stored copies unless marked with a star, which says:
known, but not read again.
IMX477: photon transfer of the Raspberry Pi HQ camera, 1.55 um stacked, 8180 e full well, 3 e read
noise (strollswithmydog.com/tag/optical-black). IMX708: the open tuning of the Raspberry Pi Camera
Module 3, a phone's sensor (libcamera, src/ipa/rpi/vc4/data/imx708.json). IPHONE11: ColorMatrix2 of
its raw files. SLASHCAM: sensor tests of iPhones (slashcam.de). KALIBR: table of rolling shutters
(kalibr, doc/rolling-shutter-table.md). GYROFLOW: lens profiles of GoPro cameras. OV5647: its sheet
(OmniVision, by Raspberry Pi). LAPTOPMEDIA: reviews of ThinkPad T14s G3 and ThinkBook 16p G4. PRAD:
prad.de on MSI MD272QXPDE and on ViewSonic VX3218 and VX3276. DISPLAYMATE: its shoot-outs, as others
report them. NOTEBOOKCHECK: PWM of laptops. SUNDIAL: sundiallabs.tech/pages/oled-flicker.

A lens is given by what its maker's processing leaves. Left out: lenses that see as wide as an
action camera's "Wide", whose distortion (-33 % at half width, GYROFLOW) one coefficient does not
describe; local dimming of televisions; the layout of an OLED's subpixels, which are taken for
stripes; and, for stills, distortion, sway, automatic exposure and all that a panel does in time.
"""

from dataclasses import replace

from data_gen.parameters import Camera, Curve, Display, Matrix, Nuisance, Pair, Setup

IMX708_CURVE: Curve = (
    (0.0, 0.0),
    (0.0156, 0.0068),
    (0.0625, 0.0447),
    (0.125, 0.128),
    (0.25, 0.3424),
    (0.5, 0.6685),
    (0.75, 0.8564),
    (1.0, 1.0),
)
"""Tone curve of phones (IMX708), before the transfer function of sRGB."""
IMX708_COLOURS: Matrix = (
    (1.5408, -0.3715, -0.1693),
    (-0.2802, 1.6490, -0.3689),
    (0.0040, -0.5252, 1.5212),
)
"""Matrix from raw to linear sRGB of small sensors (IMX708)."""

# white_level is derived: 0.65 L t / N^2 * S / 78 (`data_gen.film.exposure`) with L = 300 cd/m^2 and
# the shutter and ISO given here. Assumed: blur_px [0.3 to 1], sharpening
# [0.1 to 1], breathing [0 to 5e-4], jpeg_quality [85 to 97; MJPEG 60 to 92].
CAMERAS = {
    "phone": Camera(
        name="phone, main camera of 1/1.3 inch, f/1.8",
        full_well_e=13600.0,  # derived: IMX477's 3400 e/um^2 on binned pixels of 2 um [5 to 20 ke]
        read_noise_e=3.0,  # measured (IMX477) [1.5 to 5]
        white_level=0.64,
        color_matrix=((1.402, -0.361, -0.041), (-0.167, 1.392, -0.225), (0.020, -0.652, 1.632)),
        tone_curve=IMX708_CURVE,
        blur_px=0.45,
        native_width=4032,  # code (IPHONE11) [4000 to 4080]
        sharpening=0.4,
        vignetting=0.20,  # derived: IMX708 leaves 0.31 of its 0.62; assumed less [0.03 to 0.35]
        breathing=1e-4,
        shutter_s=1 / 60,
        readout_s=0.009,  # measured, iPhone 14 Pro (SLASHCAM) [2.4 ms, 16 Pro Max, to 24 ms]
        jpeg_quality=95,
        auto_exposure=True,
        f_number=1.8,  # maker* [1.5 to 1.9]
        iso=50.0,  # assumed [25 to 100]
        anti_banding_hz=100.0,  # lamps of 50 Hz; Android's test suite has the grid of 10 ms
        distortion=0.003,  # assumed: processing leaves little [-0.01 to 0.01]
    ),
    "webcam": Camera(
        name="webcam of a laptop, 1/4 inch, f/2.2",
        full_well_e=4300.0,  # datasheet (OV5647) [3 to 10 ke]
        read_noise_e=3.0,  # assumed [2 to 6]
        white_level=0.86,
        color_matrix=IMX708_COLOURS,
        tone_curve=IMX708_CURVE,
        blur_px=0.8,
        native_width=1920,  # maker*, Logitech C920
        sharpening=0.6,
        vignetting=0.25,  # assumed [0.05 to 0.45]
        breathing=0.0,  # fixed focus
        shutter_s=1 / 60,
        readout_s=0.030,  # measured on cameras like it (KALIBR) [20 to 33 ms]
        jpeg_quality=80,
        auto_exposure=True,
        f_number=2.2,  # assumed [2.0 to 2.9]
        iso=100.0,  # assumed [50 to 200]
        anti_banding_hz=100.0,
        distortion=-0.02,  # assumed [-0.06 to 0.01]
    ),
    "action": Camera(
        name="action camera, 1/2.3 inch, f/2.8, linear lens",
        full_well_e=8200.0,  # measured (IMX477) [3 to 10 ke]
        read_noise_e=3.0,  # measured (IMX477) [1.5 to 5]
        white_level=0.53,
        color_matrix=IMX708_COLOURS,
        tone_curve=IMX708_CURVE,
        blur_px=0.5,
        native_width=3840,  # maker*, video of 4K
        sharpening=0.7,
        vignetting=0.25,  # assumed [0.1 to 0.5]
        breathing=0.0,  # fixed focus
        shutter_s=1 / 60,
        readout_s=0.0148,  # measured, GoPro Hero3+ at 60 frames/s (KALIBR) [7 to 16 ms]
        jpeg_quality=95,
        auto_exposure=True,
        f_number=2.8,  # maker*, GoPro Hero5 to Hero8 [2.5 to 2.8]
        iso=100.0,  # documented (GoPro Labs, lowest by default)
        anti_banding_hz=100.0,
        distortion=-0.0025,  # derived, GoPro Hero11 "Linear" (GYROFLOW) [-0.01 to 0.01]
    ),
}
"""The cameras, by the first part of a pair's name."""

LAPTOP = Display(
    name="laptop with IPS panel, 60 Hz",
    panel="IPS",
    gamma=(2.2, 2.2, 2.2),  # assumed, sRGB [2.0 to 2.4]
    black=1 / 1300,  # measured, 1540 and 1700 to 1 (LAPTOPMEDIA) [1000 to 1700]
    falloff=(3.5, 3.5, 3.6),  # assumed: 0.6 at 30 degrees [1.6 to 5.6; 5.6 is DISPLAYMATE's LCD]
    washout=0.15,  # assumed [0 to 0.3]
    washout_gamma=1.4,  # assumed [1.2 to 1.8]
    leak=0.003,  # assumed [0.001 to 0.01]
    edge_loss=0.10,  # measured, 8 to 13 % (LAPTOPMEDIA)
    haze=0.004,  # assumed, matt [0.002 to 0.01]
    glare=0.006,  # assumed, matt [0 to 0.01]
    pwm_hz=1000.0,  # none or far above 1 kHz (NOTEBOOKCHECK has 117 kHz; few have 200 Hz)
    pwm_duty=1.0,
    pwm_depth=0.0,
    native_height=1080,
    white_cd=300.0,  # measured, 367 and 395 (LAPTOPMEDIA) [245 to 400]
    # derived from PRAD: from 10 to 90 % in 10.8 ms at best and 16.4 ms in the mean over levels, the
    # slowest 2.5 times the fastest, among dark grays; a time constant is 1 / 2.2 of it
    rise_s=(0.012, 0.0085, 0.006),
    fall_s=(0.009, 0.0065, 0.005),
)
"""A laptop of today, whose panel shows all eight bits."""
OLED = Display(
    name="OLED phone, 60 Hz, dimmed by 240 Hz, held sideways",
    panel="OLED",
    gamma=(2.2, 2.2, 2.2),  # assumed [2.0 to 2.4]
    black=0.0,
    falloff=(1.7, 1.7, 1.9),  # 0.78 at 30 degrees (DISPLAYMATE, iPhone X) [1.1 to 2.5]
    washout=0.0,
    washout_gamma=1.4,
    leak=0.0,
    edge_loss=0.03,  # assumed [0 to 0.08]
    haze=0.003,  # assumed, glossy [0.001 to 0.006]
    glare=0.04,  # reflects 4.4 to 4.7 % (DISPLAYMATE); a lamp as bright as white, about
    pwm_hz=240.0,  # measured, Galaxy S8+ (XDA forum) [240 to 480]
    pwm_duty=0.8,  # measured, iPhone 16e, most levels (ledstrain.org) [0.5 to 0.9; 0.1 when dark]
    pwm_depth=1.0,  # assumed [0.3 to 1]
    native_height=1080,
    white_cd=400.0,  # assumed, indoors [200 to 800]
    scan="right",  # a phone writes from its short upper edge; it lies on its side
    rise_s=(0.0005, 0.0003, 0.0003),  # assumed [0.1 to 2 ms from 10 to 90 %]
    fall_s=(0.0003, 0.0003, 0.0003),
    pwm_scans=True,  # row by row in step with the scan (SUNDIAL)
)
"""A phone of today."""
DISPLAYS = {
    "laptop": LAPTOP,
    "sixbit": replace(LAPTOP, name="the same laptop with six bits and rate control", frc_bits=2),
    "oled": OLED,
    "oled120": replace(
        OLED,
        name="OLED phone, 120 Hz, dimmed by 480 Hz, held sideways",
        refresh_hz=120.0,
        pwm_hz=480.0,  # measured, iPhone 16 Pro (a user's oscilloscope)
    ),
    "tv": Display(
        name="television of 55 inch with VA panel, 60 Hz",
        panel="VA",
        gamma=(2.3, 2.3, 2.3),  # assumed [2.0 to 2.5]
        black=1 / 4000,  # assumed [2500, measured on a VX3276 (PRAD), to 6500]
        falloff=(3.5, 3.5, 3.6),  # assumed: half at 35 degrees [2.0 to 5.6]
        washout=0.5,  # assumed: colours wash out from 22 degrees on [0.3 to 0.9]
        washout_gamma=1.3,  # assumed [1.0 to 1.8]
        leak=0.002,  # assumed [0.0005 to 0.01]
        edge_loss=0.10,  # assumed [0.05 to 0.2]
        haze=0.004,  # assumed [0.002 to 0.01]
        glare=0.01,  # total reflectance 0.7 to 1.9 % (rtings.com) [0 to 0.02]
        pwm_hz=240.0,  # assumed [100 to 960]
        pwm_duty=0.7,  # assumed: most sets pulse to darkness below full brightness [0.5 to 1]
        pwm_depth=1.0,
        native_height=2160,
        white_cd=350.0,  # assumed [200 to 600]
        # assumed, with overdrive, from 10 to 90 %: out of black 30 ms [15 to 60], among grays 20
        # [8 to 40; PRAD's VX3218 has 36.5 in the mean], to black 9 [4 to 15]
        rise_s=(0.0136, 0.0091, 0.0045),
        fall_s=(0.0041, 0.0041, 0.0041),
    ),
}
"""The displays, by the second part of a pair's name."""

PHONE_COLOURS: Matrix = ((0.738, 0.214, 0.048), (0.093, 0.795, 0.112), (0.028, 0.315, 0.657))
"""Crosstalk of a phone before primaries of sRGB, derived (IPHONE11)."""
SMALL_COLOURS: Matrix = ((0.684, 0.193, 0.123), (0.125, 0.693, 0.182), (0.042, 0.239, 0.719))
"""Crosstalk of small sensors before primaries of sRGB, derived: the inverse of `IMX708_COLOURS`."""
CROSSTALK: dict[tuple[str, bool], Matrix] = {
    ("phone", False): PHONE_COLOURS,
    ("webcam", False): SMALL_COLOURS,
    ("action", False): SMALL_COLOURS,
    ("phone", True): ((0.894, 0.053, 0.053), (0.078, 0.799, 0.123), (0.008, 0.270, 0.722)),
    ("webcam", True): ((0.827, 0.038, 0.135), (0.121, 0.679, 0.200), (0.027, 0.183, 0.790)),
    ("action", True): ((0.827, 0.038, 0.135), (0.121, 0.679, 0.200), (0.027, 0.183, 0.790)),
}
"""Crosstalk by camera, and by whether the display has the wide primaries of an OLED: those before
sRGB times the matrix from Display P3 to sRGB (derived)."""

SETUP = Setup(name="setup", perspective=True, metering=0.0, corner_px=0.5, sway=0.02)
"""How a hand holds a camera today. ``sway`` is assumed: 1 cm before a display of 24 inches
[0.005 to 0.05]."""
NUISANCES = {
    "phone": Nuisance(name="phone", drift=0.01, jitter_px=0.15, noise_scale=0.25),
    "webcam": Nuisance(name="webcam", drift=0.02, jitter_px=0.15, noise_scale=0.6),
    "action": Nuisance(name="action", drift=0.01, jitter_px=0.15, noise_scale=0.3),
}
"""Disturbances by camera, assumed: drift [0.005 to 0.03], jitter [0.1 to 0.3], and noise between
that of all native pixels pooled (0.19, 0.4, 0.2) and of half as many [to 0.5, 0.8, 0.4]."""

NAMES = (
    "phone-laptop", "phone-sixbit", "phone-oled", "phone-oled120", "phone-tv",
    "webcam-laptop", "webcam-oled", "action-tv",
)  # fmt: skip
"""Pairs that meet: a webcam looks at what is held before it."""


def _pair(name: str) -> Pair:
    camera, display = name.split("-")
    nuisance = NUISANCES[camera]
    return Pair(
        name=name,
        camera=CAMERAS[camera],
        display=DISPLAYS[display],
        setup=SETUP,
        frontal=nuisance,
        oblique=nuisance,
        crosstalk=CROSSTALK[camera, DISPLAYS[display].panel == "OLED"],
    )


TODAY = {name: _pair(name) for name in NAMES}
"""The pairs of today by name."""
