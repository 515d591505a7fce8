"""The camera-display transfer function: captured gray levels of displayed ones, without space."""

import numpy as np
from numpy.typing import NDArray

from data_gen.channel.camera import collect, response_curve
from data_gen.channel.display import emitted_light
from data_gen.parameters import Pair


def metered_gain(pair: Pair, view_deg: float) -> float:
    """Return how much longer the camera exposes, or amplifies, than at the frontal view.

    With `Setup.metering` 1 white stays as bright; it is measured in green, with the backlight's
    leak and the room's haze in it. With 0 the gain is 1 at every view.

    Args:
        pair: camera, display and metering.
        view_deg: nominal angle of observation, degrees.
    """
    theta, display = np.radians(view_deg), pair.display
    white = np.cos(theta) ** display.falloff[1] + display.leak * np.sin(theta) ** 2
    brightness = (white + display.haze) / (1 + display.haze)
    return float(brightness**-pair.setup.metering)


def cdtf(pair: Pair, view_deg: float) -> NDArray[np.float64]:
    """Return the camera-display transfer function at the picture's centre, in a dark room.

    >>> from data_gen.pairs import get_pair
    >>> curve = cdtf(get_pair("canon-lg"), view_deg=45.0)
    >>> curve.shape
    (256, 3)
    >>> bool((curve[255] > curve[0]).all())
    True

    Args:
        pair: camera and display.
        view_deg: angle of observation, degrees from the display's normal.

    Returns:
        (256, 3) float64: captured R, G, B in gray levels of [0, 255], unrounded, of the displayed
        grays 0 to 255.
    """
    grays = np.repeat(np.arange(256, dtype=np.uint8), 3).reshape(256, 1, 1, 3)
    theta = np.full((1, 1), np.radians(view_deg))
    light = emitted_light(grays, pair.display, theta)[:, 0]  # (256, 1, 1, 3) -> (256, 1, 3)
    exposure = collect(light, pair.camera, pair.crosstalk, metered_gain(pair, view_deg))
    exposure = np.asarray(np.minimum(exposure, 1.0), np.float32)
    raw = exposure[:, 0] @ np.array(pair.camera.color_matrix).T
    table = response_curve(pair.camera.tone_curve, pair.camera.encoding)
    curve = np.interp(np.clip(raw, 0, 1), np.linspace(0, 1, len(table)), table)
    return np.asarray(curve, np.float64)
