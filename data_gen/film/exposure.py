"""Automatic exposure of a camera that films: a program that chooses shutter and ISO by the light.

A white of luminance L, seen for t seconds through an aperture N at ISO S, fills the share
    0.65 L t / N^2 * S / 78
of the sensor's range, by ISO 12232: 0.65 L t / N^2 is the light on the sensor in lux seconds, and
78 / S is the light that saturates it. The aperture stays as it is. The program keeps the ISO at its
floor and shortens the shutter while there is light enough; else the shutter stays open for as long
as a frame lasts, and the ISO rises. Beside lamps that flicker the shutter is a whole number of
their periods, if it is as long as one.

The frame is metered as a whole, its middle more than its edges, towards a mean level, but no
brighter than leaves its brightest parts below saturation. The mean level and the speed are those of
the open tuning of the Raspberry Pi Camera Module 3 (libcamera, imx708.json).
"""

from dataclasses import dataclass

import numpy as np

from data_gen.channel.display import Light
from data_gen.parameters import Camera

MEAN_LEVEL = 0.16
"""Mean exposure, relative to saturation, that the program aims at (imx708.json, y_target)."""
BRIGHTEST_LEVEL = 0.9
"""Exposure, relative to saturation, that the brightest parts must not exceed (assumed)."""
BRIGHTEST_SHARE = 0.02
"""Share of the frame that counts as its brightest parts (assumed)."""
MIDDLE = 0.35
"""Standard deviation of the weight of the frame's middle, in sides of the image (assumed)."""
METER_PX = 16
"""Number of pixels between those that are metered."""
SETTLING_S = 0.2
"""Time constant, in seconds, with which the exposure follows the light: a share of 0.15 in each of
30 frames a second (imx708.json, speed; phones may have 0.1 to 0.5 s)."""
SHORTEST_S = 1e-5
"""Shortest exposure time, seconds."""
MOST_ISO = 64.0
"""Largest ISO, relative to the camera's lowest."""


@dataclass(frozen=True)
class Exposure:
    """Gain, shutter and noise of one frame."""

    gain: float
    """Exposure relative to that for which the camera's white level is stated."""
    shutter_s: float
    """Time for which each row is open, seconds."""
    iso: float
    """Amplification relative to the ISO of `Camera.full_well_e`; it sets the noise."""


class ExposureProgram:
    """The program of one camera before one display.

    >>> from data_gen.pairs import get_pair
    >>> camera = get_pair("canon-lg").camera
    >>> program = ExposureProgram(camera, white_cd=250.0, fps=30.0, shutter=None)
    >>> bright = np.full((64, 96, 3), 0.5, np.float32)
    >>> program.meter(bright, program.exposure().gain)
    >>> program.step(10.0)  # long enough to settle
    >>> round(program.exposure().gain, 2)  # from 0.5 to 0.16 of saturation
    0.32

    Args:
        camera: aperture, ISO, and whether lamps flicker.
        white_cd: luminance of the display's frontal white, cd/m^2.
        fps: number of frames a second.
        shutter: exposure time that somebody chose, seconds; None for the program's.
    """

    def __init__(self, camera: Camera, white_cd: float, fps: float, shutter: float | None) -> None:
        self._camera, self._fps = camera, fps
        self._shutter = shutter and min(shutter, 1 / fps)
        share_of_second = 0.65 * white_cd / camera.f_number**2 * camera.iso / 78
        self._seconds = camera.white_level / share_of_second  # at the lowest ISO, for a gain of 1
        self._gain = self._wanted = 1.0

    def meter(self, exposure: Light, gain: float) -> None:
        """Take note of a frame, by which later ones are exposed.

        Args:
            exposure: (H, W, 3) float32 in [0, 1]; 1 is saturation.
            gain: gain with which the frame was exposed.
        """
        green = exposure[METER_PX // 2 :: METER_PX, METER_PX // 2 :: METER_PX, 1] / gain
        y, x = (np.linspace(-0.5, 0.5, side) / MIDDLE for side in green.shape)
        weight = np.exp(-0.5 * (x**2 + (y**2)[:, None]))
        mean = float((green * weight).sum() / weight.sum())
        brightest = float(np.quantile(green, 1 - BRIGHTEST_SHARE))
        wanted = min(MEAN_LEVEL / max(mean, 1e-6), BRIGHTEST_LEVEL / max(brightest, 1e-6))
        most = self.gain_of(self._shutter or 1 / self._fps, MOST_ISO)
        self._wanted = float(np.clip(wanted, self.gain_of(SHORTEST_S, 1.0), most))

    def step(self, seconds: float) -> None:
        """Let the exposure follow the light for some seconds."""
        share = -np.expm1(-seconds / SETTLING_S)
        self._gain *= float((self._wanted / self._gain) ** share)

    def exposure(self) -> Exposure:
        """Return how a frame is exposed now."""
        needed = self._gain * self._seconds
        shutter_s = self._shutter or min(needed, 1 / self._fps)
        hz = self._camera.anti_banding_hz
        if self._shutter is None and hz and shutter_s * hz >= 1:
            shutter_s = np.floor(shutter_s * hz + 1e-6) / hz
        iso = float(np.clip(needed / shutter_s, 1.0, MOST_ISO))
        return Exposure(self.gain_of(shutter_s, iso), float(shutter_s), iso)

    def gain_of(self, shutter_s: float, iso: float) -> float:
        """Return the gain of an exposure time, seconds, and an amplification."""
        return shutter_s * iso / self._seconds
