"""The display: from displayed values to emitted light, by viewing angle (Eq. emitted)."""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from data_gen.parameters import Display

Light = NDArray[np.floating[Any]]
"""Array of linear light, in which the display's frontal white is 1 in every channel."""


@dataclass(frozen=True, eq=False)
class Emission:
    """How the levels of a display become light that leaves it towards a camera.

    Per channel c, with x = min(1, rho / (255 clip)) and s = sin(theta)^2,
        light_c = u (e_c(theta) ((1 - b) ((1 - w) x^gamma_c + w x^gamma_w) + b) + leak s),
        e_c(theta) = cos(theta)^falloff_c,  w = washout s,  b = black,
    and u falls from 1 in the centre by ``edge_loss`` to the corners. Where the display has a
    ``light_curve``, it takes the place of x^gamma_c. All but x depends on the place
    alone, so it is worked out once for all frames.
    """

    curves: Light
    """(256, 3) light of each level seen head-on, without black."""
    washed: Light
    """(256, 3) by how much the light differs where it is wholly washed out."""
    washed_share: Light | None
    """w at each pixel, (H, W, 1); None where it is 0 everywhere."""
    black: np.float32
    """Light of black, relative to white's."""
    gain: Light
    """u e_c at each pixel, (H, W, 3)."""
    leaked: Light
    """u leak s at each pixel, (H, W, 1)."""

    @classmethod
    def of(cls, display: Display, theta: Light) -> "Emission":
        """Work out the emission of a display.

        Args:
            display: parameters of the display.
            theta: (H, W) viewing angle at each pixel, radians from the normal.
        """
        x = np.minimum(1.0, np.arange(256) / (255 * display.clip))[:, None]
        bright = x ** np.array(display.gamma)
        if display.light_curve:
            nodes = np.array(display.light_curve)
            bright = np.repeat(PchipInterpolator(*nodes.T)(x), 3, axis=1)
        curves = ((1 - display.black) * bright).astype(np.float32)
        washed = ((1 - display.black) * x**display.washout_gamma - curves).astype(np.float32)
        sine2 = np.square(np.sin(theta, dtype=np.float32))[:, :, None]
        uniformity = fall_to_corners(display.edge_loss, *theta.shape)[:, :, None]
        log_cosine = np.log(np.cos(theta, dtype=np.float32))[:, :, None]
        gain = uniformity * np.exp(log_cosine * np.array(display.falloff, np.float32))
        washes = display.washout > 0 and sine2.max() > 0
        share = np.float32(display.washout) * sine2 if washes else None
        leaked = np.float32(display.leak) * uniformity * sine2
        return cls(curves, washed, share, np.float32(display.black), gain, leaked)

    def light(self, frames: NDArray[np.uint8]) -> Light:
        """Return the light that leaves each pixel towards the camera, without room light.

        Args:
            frames: (..., H, W, 3) uint8, encoded RGB.

        Returns:
            (..., H, W, 3) float32, linear; frontal white at the centre is 1 in every channel.
        """
        light = _look_up(frames, self.curves)
        if self.washed_share is not None:
            light += self.washed_share * _look_up(frames, self.washed)
        light += self.black
        light *= self.gain
        light += self.leaked
        return light


def _look_up(frames: NDArray[np.uint8], table: Light) -> Light:
    flat = cv2.LUT(np.ascontiguousarray(frames).reshape(1, -1, 3), table[None])
    return np.asarray(flat, np.float32).reshape(frames.shape)  # (1, N, 3) -> frames


def fall_to_corners(loss: float, height: int, width: int) -> Light:
    """Return the smooth gain 1 - loss r^2, in which r is 1 at the corner pixels.

    Args:
        loss: share of the light that the corners lack.
        height: number of rows.
        width: number of columns.

    Returns:
        (height, width) float32.
    """
    x = np.arange(width, dtype=np.float32) - (width - 1) / 2
    y = np.arange(height, dtype=np.float32) - (height - 1) / 2
    r2 = (x**2 + (y**2)[:, None]) / max(1.0, x[0] ** 2 + y[0] ** 2)
    return np.asarray(1 - loss * r2, np.float32)


GLARE_SIZE = 0.25
"""Standard deviation of the spot of a mirrored lamp, in widths of the picture."""


def room_light(display: Display, height: int, width: int, lamp: NDArray[np.float64]) -> Light:
    """Return the room light that the display's surface sends to the camera.

    Args:
        display: haze, which is even, and the glare of a mirrored lamp.
        height: height of the picture, pixels.
        width: width of the picture, pixels.
        lamp: (2,) x and y at which the lamp is mirrored, in widths and heights of the picture.

    Returns:
        (height, width) float32; frontal white is 1.
    """
    spot = light_spot(height, width, lamp, GLARE_SIZE)
    return np.asarray(display.haze + display.glare * spot, np.float32)


def light_spot(
    height: int, width: int, middle: NDArray[np.float64], size: float
) -> NDArray[np.float64]:
    """Make a round spot of light, (height, width), which is 1 in its middle and fades (Gaussian).

    Args:
        height: height of the image, pixels.
        width: width of the image, pixels.
        middle: (2,) x and y of the spot, in widths and heights of the image.
        size: standard deviation of the spot, in widths of the image.
    """
    x = (np.arange(width) / width - middle[0]) / size
    y = (np.arange(height) / height - middle[1]) * height / width / size
    return np.asarray(np.exp(-0.5 * x**2) * np.exp(-0.5 * y**2)[:, None])
