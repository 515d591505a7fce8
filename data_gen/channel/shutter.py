"""The shutter against a pulsed backlight: flicker of frames and bands across rows."""

import numpy as np
from numpy.typing import NDArray

from data_gen.parameters import Camera, Display


def pwm_gain(
    display: Display, camera: Camera, rows: int, phase: float = 0.0
) -> NDArray[np.float32]:
    """Return the light that each row of the sensor collects, relative to the mean over time.

    The backlight is on during the first ``pwm_duty`` of each period. Row r collects from
    t_r = phase / f + r readout / rows during shutter_s; G is the integral of the square wave:
        gain_r = 1 - depth + depth (G(t_r + shutter) - G(t_r)) / (duty shutter).

    Args:
        display: rate, duty and depth of the backlight's pulses.
        camera: exposure time and readout of the shutter.
        rows: number of rows of the sensor's image.
        phase: phase of the backlight, in periods, when the first row opens.

    Returns:
        (rows,) float32; 1 where the shutter spans whole periods.
    """
    start = phase + display.pwm_hz * camera.readout_s * np.arange(rows) / rows
    return pulsed_gain(display, camera.shutter_s, start)


def pulsed_gain(
    display: Display, shutter_s: float, start: NDArray[np.float64]
) -> NDArray[np.float32]:
    """Return the light that exposures collect, relative to the mean over time.

    Args:
        display: rate, duty and depth of the pulses.
        shutter_s: exposure time, seconds.
        start: phase of the pulses, in periods, when each exposure begins; of any shape.

    Returns:
        float32 of the same shape, as `pwm_gain` explains it.
    """
    span = display.pwm_hz * shutter_s
    collected = _on_time(start + span, display.pwm_duty) - _on_time(start, display.pwm_duty)
    gain = 1 + display.pwm_depth * (collected / (display.pwm_duty * span) - 1)
    return np.asarray(gain, np.float32)


def _on_time(t: NDArray[np.float64], duty: float) -> NDArray[np.float64]:
    """Integrate from 0 to t, in periods, a wave that is 1 during the first ``duty`` of each."""
    whole = np.floor(t)
    return np.asarray(whole * duty + np.minimum(t - whole, duty))
