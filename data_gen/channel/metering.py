"""How a camera meters a display."""

import numpy as np

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
