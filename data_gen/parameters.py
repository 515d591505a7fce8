"""The parameters of a camera, a display and how they meet; each value is held to its range."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, NamedTuple, Self, get_args, get_origin, get_type_hints

from link.errors import InputError, choose
from link.outside import read_bounded

RGB = tuple[float, float, float]
"""One number for each of the channels R, G and B."""
Curve = tuple[tuple[float, float], ...]
"""Nodes (in, out) of a curve, in increasing order."""
Matrix = tuple[RGB, RGB, RGB]
"""Rows of a matrix that maps colours to colours."""
IDENTITY: Matrix = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
"""Matrix that leaves every colour as it is."""
MAX_CURVE_BYTES = 2**20
"""Largest size of a file with a curve, bytes."""
ENCODINGS = {"srgb": "IEC 61966-2-1", "linear": "none"}
"""Transfer functions of stored images by name, and the standard that defines each."""
PANELS = {
    "TN": "twisted nematic",
    "VA": "vertical alignment",
    "IPS": "in-plane switching",
    "OLED": "organic light-emitting diodes",
}
"""Kinds of panel by name, and what the name stands for."""
SCANS = {
    "down": "rows from the top one to the bottom one",
    "up": "rows from the bottom one to the top one",
    "right": "columns from the left one to the right one",
    "left": "columns from the right one to the left one",
    "none": "the whole picture at once",
}
"""Orders in which a panel may write the picture, by name, and what each means."""

PLAIN_KINDS = {str: "a text", bool: "true or false"}
"""Kinds of value that have no range, and what they are called in messages."""


class Limits(NamedTuple):
    """The range of a field, or of each number in it; both ends belong to it."""

    low: float
    """Smallest value allowed."""
    high: float
    """Largest value allowed."""


class Limited:
    """A dataclass whose texts, flags and fields annotated with `Limits` are checked.

    Raises:
        InputError: a value is of the wrong kind or out of its range; the message names the field.
    """

    name: str
    """Name of the camera, display or setup that the parameters describe, for messages."""

    def __post_init__(self) -> None:
        for field, hint in get_type_hints(type(self), include_extras=True).items():
            value = getattr(self, field)
            if hint in PLAIN_KINDS and not isinstance(value, hint):
                raise InputError(f"{self.name}: {field} must be {PLAIN_KINDS[hint]}, got {value!r}")
            if get_origin(hint) is not Annotated:
                continue
            kind, limits = get_args(hint)
            allowed = f"[{limits.low:g}, {limits.high:g}]"
            shape = (3, 3) if kind == Matrix else (3,) if kind == RGB else ()
            if _shape(value) != shape:
                wanted = " x ".join(map(str, shape)) + " numbers" if shape else "a number"
                problem = f"{field} must be {wanted} in {allowed}, got {value!r}"
                raise InputError(f"{self.name}: {problem}")
            if not all(limits.low <= v <= limits.high for v in _flat(value)):
                raise InputError(f"{self.name}: {field} must lie in {allowed}, got {value!r}")
            if kind is int and value != int(value):
                raise InputError(f"{self.name}: {field} must be a whole number, got {value!r}")


def check_curve(curve: Any, name: str) -> Curve:
    """Return a curve that runs from (0, 0) to (1, 1) and rises all the way.

    Args:
        curve: its nodes.
        name: what it is called in messages.

    Raises:
        InputError: it is no such curve.
    """
    if (_shape(curve) or ())[1:] != (2,):
        raise InputError(f"{name} must be a list of pairs of numbers")
    if len(curve) < 2 or tuple(curve[0]) != (0.0, 0.0) or tuple(curve[-1]) != (1.0, 1.0):
        raise InputError(f"{name} must run from (0, 0) to (1, 1)")
    if not all(a[0] < b[0] and a[1] < b[1] for a, b in pairwise(curve)):
        raise InputError(f"{name} must increase strictly in both coordinates")
    return tuple((float(a), float(b)) for a, b in curve)


def read_curve(file: Path) -> Curve:
    """Read a curve from a CSV file: two columns, input and output, from 0 to 1; heads may be above.

    Raises:
        InputError: the file is not there, or holds no curve.
    """
    nodes = []
    lines = read_bounded(file, MAX_CURVE_BYTES).decode("utf-8-sig", "replace").splitlines()
    for number, line in enumerate(lines, 1):
        try:
            nodes.append(tuple(float(text) for text in line.replace(";", ",").split(",")))
        except ValueError:
            if number > 1 and line.strip():  # the first line may be heads
                raise InputError(f"{file}: line {number} holds no two numbers") from None
    return check_curve(tuple(nodes), str(file))


def _shape(value: Any) -> tuple[int, ...] | None:
    """Return the shape of nested lists of numbers, () for one number, None for anything else."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        return ()
    if not isinstance(value, list | tuple) or not value:
        return None
    inner = _shape(value[0])
    if inner is None or any(_shape(part) != inner for part in value):
        return None
    return (len(value), *inner)


def _flat(value: Any) -> list[float]:
    return [v for part in value for v in _flat(part)] if isinstance(value, Sequence) else [value]


@dataclass(frozen=True, kw_only=True)
class Display(Limited):
    """How a display turns a value rho into light, by angle theta from its normal (Eq. emitted)."""

    name: str
    """Maker's name of the display."""
    panel: str
    """Kind of panel, a key of `PANELS`."""
    gamma: Annotated[RGB, Limits(1.0, 4.0)]
    """Exponents of R, G and B; frontal light is (rho / 255) ** gamma."""
    black: Annotated[float, Limits(0.0, 0.1)]
    """Luminance of black relative to white, seen frontally: 1 / contrast."""
    clip: Annotated[float, Limits(0.5, 1.0)] = 1.0
    """Fraction of 255 from which light no longer rises; 1 for a display that does not clip."""
    falloff: Annotated[RGB, Limits(0.0, 8.0)]
    """Exponents of R, G and B by which white darkens with the angle, as cos(theta) ** falloff."""
    washout: Annotated[float, Limits(0.0, 1.0)]
    """Share of the light that follows ``washout_gamma``, over sin(theta) ** 2."""
    washout_gamma: Annotated[float, Limits(0.5, 4.0)]
    """Exponent of the washed-out share of the light, in place of ``gamma``."""
    leak: Annotated[float, Limits(0.0, 0.1)]
    """Luminance of black that the angle adds, relative to frontal white, over sin(theta) ** 2."""
    edge_loss: Annotated[float, Limits(0.0, 0.9)]
    """Fraction of light that the backlight lacks at the corners of the picture."""
    haze: Annotated[float, Limits(0.0, 0.5)]
    """Room light that the surface scatters back evenly, relative to frontal white."""
    glare: Annotated[float, Limits(0.0, 0.5)]
    """Brightest spot of a mirrored lamp or window, relative to frontal white."""
    pwm_hz: Annotated[float, Limits(30.0, 1e5)]
    """Rate, in Hz, at which the backlight is dimmed by pulse-width modulation."""
    pwm_duty: Annotated[float, Limits(0.01, 1.0)]
    """Share of each period that the backlight is on."""
    pwm_depth: Annotated[float, Limits(0.0, 1.0)]
    """Modulation of the light: 1 for an LED that goes dark, less for a lamp that glows on."""
    grid_contrast: Annotated[float, Limits(0.0, 2.0)] = 1.65
    """Amplitude over mean of the stripes' fundamental. RGB stripes of a third of a pixel each,
    which are assumed of every display, have 2 sinc(1/3)."""
    native_height: Annotated[int, Limits(100, 10_000)]
    """Number of rows of the panel; the picture is shown over all of them."""
    white_cd: Annotated[float, Limits(1.0, 1e4)] = 250.0
    """Luminance of frontal white, cd/m^2, for cameras that choose their exposure."""
    refresh_hz: Annotated[float, Limits(1.0, 1000.0)] = 60.0
    """Number of times a second that the panel writes the picture, in a film."""
    light_curve: Curve = ()
    """Nodes (in, out) of the light by displayed value, both from 0 to 1, in place of ``gamma``; a
    monotone cubic spline joins them. Empty where ``gamma`` holds."""
    scan: str = "down"
    """Order in which the panel writes the picture, a key of `SCANS`."""
    rise_s: Annotated[RGB, Limits(0.0, 1.0)] = (0.004, 0.004, 0.004)
    """Time constants, in seconds, with which pixels near black, near level 128 and near white
    become brighter; 2.2 of them pass from 10 to 90 per cent."""
    fall_s: Annotated[RGB, Limits(0.0, 1.0)] = (0.004, 0.004, 0.004)
    """Time constants, in seconds, with which these pixels become darker."""
    frc_bits: Annotated[int, Limits(0, 2)] = 0
    """Number of a level's eight bits that frame-rate control shows by turns of two neighbouring
    levels: 2 for a six-bit panel, 0 for a panel that shows all bits."""
    pwm_scans: bool = False
    """Whether pulses of the light run over the panel as its scan does, as an OLED's do, and do not
    come everywhere at once, as a backlight's do."""

    def __post_init__(self) -> None:
        super().__post_init__()
        choose(PANELS, self.panel, f"panel of {self.name}")
        choose(SCANS, self.scan, f"scan of {self.name}")
        if self.light_curve != ():
            check_curve(self.light_curve, f"{self.name}: light_curve")


@dataclass(frozen=True, kw_only=True)
class Camera(Limited):
    """How a camera turns light into the pixels of a file (Eq. camerapixel and the response f)."""

    name: str
    """Maker's name of the camera."""
    full_well_e: Annotated[float, Limits(100.0, 1e9)]
    """Number of electrons of one native pixel at saturation, at the ISO used."""
    read_noise_e: Annotated[float, Limits(0.0, 1e3)]
    """Standard deviation of the read noise at the ISO used, electrons."""
    white_level: Annotated[float, Limits(0.05, 1.0)]
    """Exposure of frontal display white as a fraction of saturation."""
    color_matrix: Annotated[Matrix, Limits(-3.0, 4.0)]
    """Matrix from white-balanced raw to linear sRGB; its rows sum to 1."""
    tone_curve: Curve
    """Nodes (in, out) of the response before its transfer function, linear light to linear light;
    a monotone cubic spline joins them."""
    encoding: str = "srgb"
    """Transfer function after the tone curve: "srgb" or "linear"."""
    bayer: bool = True
    """Whether a mosaic (RGGB) samples one colour a pixel."""
    blur_px: Annotated[float, Limits(0.0, 10.0)]
    """Standard deviation of the blur of lens and anti-alias filter, captured pixels."""
    native_blur_px: Annotated[float, Limits(0.0, 10.0)] = 0.7
    """Standard deviation of the blur of lens and anti-alias filter, native pixels of the sensor;
    moire arises there. The usual one is assumed [0.5 to 1]."""
    native_width: Annotated[int, Limits(100, 100_000)]
    """Number of columns of the sensor; the simulated capture is its image reduced."""
    sharpening: Annotated[float, Limits(0.0, 3.0)]
    """Amount of the camera's unsharp mask, whose sigma is 1 captured pixel."""
    vignetting: Annotated[float, Limits(0.0, 0.9)]
    """Fraction of light lost at the corner of the image."""
    breathing: Annotated[float, Limits(0.0, 0.01)]
    """Standard deviation of the relative change of scale between frames, by focusing anew."""
    shutter_s: Annotated[float, Limits(1e-5, 1.0)]
    """Exposure time, seconds."""
    readout_s: Annotated[float, Limits(0.0, 0.1)]
    """Delay from the first row to the last, seconds; 0 for a global shutter."""
    jpeg_quality: Annotated[int, Limits(0, 100)]
    """Quality of the stored frame on libjpeg's scale, 1 to 100; 0 stores it without loss."""
    auto_exposure: bool = False
    """Whether the camera of a film chooses shutter and ISO itself (`data_gen.film.exposure`)."""
    f_number: Annotated[float, Limits(0.5, 64.0)] = 5.6
    """Focal length over the aperture's diameter, which stays as it is."""
    iso: Annotated[float, Limits(1.0, 1e6)] = 400.0
    """ISO at which ``full_well_e`` is stated; automatic exposure chooses none below."""
    anti_banding_hz: Annotated[float, Limits(0.0, 1000.0)] = 0.0
    """Rate, in Hz, of the light of lamps, of whose periods automatic exposure takes whole numbers:
    100 or 120; 0 for any shutter."""
    distortion: Annotated[float, Limits(-0.12, 0.12)] = 0.0
    """Coefficient k of the lens in a film, as `link.geometry.Lens` takes it."""

    def __post_init__(self) -> None:
        super().__post_init__()
        choose(ENCODINGS, self.encoding, f"encoding of {self.name}")
        if not all(0.998 <= sum(row) <= 1.002 for row in self.color_matrix):
            raise InputError(f"{self.name}: rows of color_matrix must sum to 1")
        check_curve(self.tone_curve, f"{self.name}: tone_curve")

    def filming(self, fps: float, shutter: float | None = None) -> Self:
        """Return this camera as it is set to film.

        The shutter is open, and the rows are read, for no longer than a frame lasts. A higher ISO
        makes up for a shorter exposure, so that fewer electrons fill the scale and noise is
        stronger. A lower ISO makes up for a longer one. Automatic exposure chooses shutter and ISO
        frame by frame, so a camera that has it keeps both here.

        >>> from data_gen.pairs import get_pair
        >>> camera = get_pair("canon-lg").camera
        >>> quick = camera.filming(128)
        >>> quick.shutter_s / camera.shutter_s, quick.full_well_e / camera.full_well_e
        (0.5, 0.5)
        >>> camera.filming(30) == camera
        True

        Args:
            fps: number of frames a second, above 0.
            shutter: exposure time, seconds; None for the camera's own.
        """
        readout_s = min(self.readout_s, 1 / fps)
        if self.auto_exposure:
            return replace(self, readout_s=readout_s)
        shutter_s = min(shutter or self.shutter_s, 1 / fps)
        return replace(
            self,
            shutter_s=shutter_s,
            readout_s=readout_s,
            full_well_e=self.full_well_e * shutter_s / self.shutter_s,
        )


@dataclass(frozen=True)
class Setup(Limited):
    """How the camera is placed and set."""

    name: str
    """Name of the setup, for messages."""
    perspective: bool
    """Whether the camera sees the display in perspective; else display pixels are copied to
    captured pixels one to one, whatever the view."""
    metering: Annotated[float, Limits(0.0, 1.0)]
    """Share, in log light, of the fall-off by angle that the exposure makes up for: 0 keeps the
    frontal settings, 1 keeps white equally bright."""
    corner_px: Annotated[float, Limits(0.0, 20.0)]
    """Standard deviation of the error of each reported corner coordinate, captured pixels."""
    sway: Annotated[float, Limits(0.0, 1.0)] = 0.0
    """Standard deviation, in a film, of the camera's way sideways, up and down, in longer sides of
    the picture. The camera stays aimed, and what lies behind the display moves by parallax."""


@dataclass(frozen=True)
class Nuisance(Limited):
    """Disturbances that no data sheet tells."""

    name: str
    """Camera and view, for messages."""
    drift: Annotated[float, Limits(0.0, 0.5)]
    """Standard deviation of the change in log exposure between the two frames."""
    jitter_px: Annotated[float, Limits(0.0, 5.0)]
    """Standard deviation of the shift left after registration, along each axis, captured pixels."""
    noise_scale: Annotated[float, Limits(0.0, 10.0)]
    """Standard deviation of the noise relative to a single native pixel's; below 1 where native
    pixels are pooled."""


@dataclass(frozen=True)
class Pair(Limited):
    """One camera that films one display."""

    name: str
    """Names of camera and display, such as "canon-lg"."""
    camera: Camera
    """Camera, the receiver."""
    display: Display
    """Display, the transmitter."""
    setup: Setup
    """Placement and exposure of the camera."""
    frontal: Nuisance
    """Disturbances at 0 degrees."""
    oblique: Nuisance
    """Disturbances at `OBLIQUE_DEG` and beyond; in between they are linear in the angle."""
    crosstalk: Annotated[Matrix, Limits(0.0, 1.0)]
    """Matrix M of Eq. redpixel: its rows, which sum to 1, are the camera's R, G and B, and its
    columns the display's."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not all(0.998 <= sum(row) <= 1.002 for row in self.crosstalk):
            raise InputError(f"{self.name}: rows of crosstalk must sum to 1")

    def nuisance(self, view_deg: float) -> Nuisance:
        """Return the disturbances at a view in degrees."""
        share = min(1.0, abs(view_deg) / OBLIQUE_DEG)
        mixed = {
            entry.name: getattr(self.frontal, entry.name)
            + share * (getattr(self.oblique, entry.name) - getattr(self.frontal, entry.name))
            for entry in fields(Nuisance)
            if entry.name != "name"
        }
        return Nuisance(name=self.name, **mixed)


OBLIQUE_DEG = 45.0
"""Angle, in degrees, for which the disturbances `Pair.oblique` are fitted."""

PARTS = {
    "camera": Camera,
    "display": Display,
    "setup": Setup,
    "frontal": Nuisance,
    "oblique": Nuisance,
}
"""Classes of the parts of a pair, by the field of `Pair` that holds each."""


def _places() -> dict[str, list[str]]:
    places = {"crosstalk": ["crosstalk"]}
    for part, kind in PARTS.items():
        for entry in fields(kind):
            places.setdefault(entry.name, []).append(f"{part}.{entry.name}")
    of_one = {place: [place] for several in places.values() if several[1:] for place in several}
    del places["name"]  # each part has another one
    return places | of_one


PLACES = _places()
"""Where a parameter belongs, by its name: "iso" in "camera.iso", "drift" in "frontal.drift" and
"oblique.drift". What several parts have is found by the latter names, too: it may be set in one."""
