"""Display: displayed values -> emitted light by viewing angle (Eq. emitted)."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from data_gen.pairs import Display

Light = NDArray[np.floating[Any]]


def emitted_light(frame: NDArray[np.uint8], display: Display, theta: Light) -> Light:
    """Light that leaves each display pixel towards the camera.

    Per channel c, with x = min(1, rho / (255 clip)) and s = sin(theta)^2,
        light_c = e_c(theta) ((1 - b) ((1 - w) x^gamma_c + w x^gamma_w) + b) + leak s,
        e_c(theta) = cos(theta)^falloff_c,  w = washout s,  b = black.

    Args:
        frame: (H, W, 3) uint8, encoded RGB.
        display: parameters.
        theta: (H, W) viewing angle at each pixel, radians from the normal.

    Returns:
        (H, W, 3) float32, linear; frontal white is 1 in every channel.
    """
    x = np.minimum(1.0, np.arange(256) / (255 * display.clip))
    sine2 = (np.sin(theta) ** 2).astype(np.float32)
    cosine = np.cos(theta).astype(np.float32)
    washed_curve = ((1 - display.black) * x**display.washout_gamma).astype(np.float32)
    light = np.empty(frame.shape, np.float32)
    for c in range(3):
        curve = ((1 - display.black) * x ** display.gamma[c]).astype(np.float32)
        rho = frame[:, :, c]
        transmitted = curve[rho]
        transmitted += display.washout * sine2 * (washed_curve - curve)[rho]
        transmitted += np.float32(display.black)
        light[:, :, c] = cosine ** display.falloff[c] * transmitted
    light += (display.leak * sine2)[:, :, None]
    return light
