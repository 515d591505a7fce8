"""A display, a viewer and a picture: from gray levels to light, and from metres to degrees."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from link.presets import USUAL_DISTANCE_M
from link.strength import light_of_level
from link.types import Array

PICTURE_LEVELS = (32.0, 128.0, 230.0)
"""Gray levels of a picture that stand for dark, middle and bright."""
METRES_PER_INCH = 0.0254
"""Length of an inch in metres."""
Where = Literal["block", "screen"]
"""Area that flickers: one block alone, or all blocks of the display in phase."""


@dataclass(frozen=True)
class Viewing:
    """A message on a display, and who looks at it.

    The defaults are the display "standard_fhd" of ColorVideoVDP (Mantiuk et al., SIGGRAPH 2024,
    https://doi.org/10.1145/3658144): 24 inches, 200 cd/m², contrast 1000, an office of 250 lux of
    which a surface with 0.5 % reflectance sends back 0.4 cd/m², seen from 0.6 m.
    """

    rows: int = 8
    """Number of blocks from top to bottom."""
    cols: int = 8
    """Number of blocks from left to right."""
    kappa: float = 3.0
    """Number of gray levels between the two states of a toggle."""
    states_hz: float = 60.0
    """Number of states that are shown a second; a frame pair is two states."""
    refresh_hz: float = 60.0
    """Number of times a second that the display shows a new frame, and holds it until the next: a
    whole multiple of the states."""
    picture_level: float = 128.0
    """Gray level of the picture below the message, in [0, 255]."""
    diagonal_inch: float = 24.0
    """Diagonal of the display, in inches."""
    aspect: float = 16 / 9
    """Width of the display over its height."""
    distance_m: float = USUAL_DISTANCE_M
    """Distance of the eye from the display, in metres."""
    white_cd_m2: float = 200.0
    """Luminance of the display's white, in cd/m²."""
    black_cd_m2: float = 0.2
    """Luminance of the display's black in a dark room, in cd/m²."""
    ambient_cd_m2: float = 0.4
    """Luminance of the room's light that the surface sends back, in cd/m²."""
    gazes_deg: tuple[float, ...] = (0.0, 2.0, 4.0, 7.0, 10.0, 15.0)
    """Angles, in degrees, between the line of sight and the centre of a block that are tried, and
    of which the most visible counts; beside the line of sight the eye sees fast flicker better."""

    @property
    def refreshes(self) -> int:
        """Number of refreshes for which each state is shown."""
        return round(self.refresh_hz / self.states_hz)

    def degrees(self, where: Where) -> tuple[float, float]:
        """Find the width and height of a block or of the display, in degrees, seen head-on."""
        height = self.diagonal_inch * METRES_PER_INCH / math.hypot(1, self.aspect)
        cols, rows = (self.cols, self.rows) if where == "block" else (1, 1)
        sides = (height * self.aspect / cols, height / rows)
        width_deg, height_deg = (
            math.degrees(2 * math.atan(side / 2 / self.distance_m)) for side in sides
        )
        return width_deg, height_deg

    def gray_levels(self, amplitudes: ArrayLike) -> Array:
        """Add a message to the picture.

        Args:
            amplitudes: (T,) what is added to the picture, in units of kappa.

        Returns:
            (T,) gray levels, clipped to [0, 255].

        >>> Viewing(kappa=3).gray_levels([-0.5, 0.5])
        array([126.5, 129.5])
        """
        levels = self.picture_level + self.kappa * np.asarray(amplitudes, np.float64)
        return np.asarray(np.clip(levels, 0, 255))

    def light(self, levels: ArrayLike) -> Array:
        """Turn gray levels into the light of the display and of the room.

        Args:
            levels: (...) gray levels in [0, 255].

        Returns:
            (...) luminance, cd/m².
        """
        span = self.white_cd_m2 - self.black_cd_m2
        return np.asarray(self.black_cd_m2 + self.ambient_cd_m2 + span * light_of_level(levels))
