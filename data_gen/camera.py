"""Camera: linear light at the sensor -> 8-bit pixels of a file (Eq. camerapixel, response f)."""

from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from data_gen.display import Light
from data_gen.optics import vignette
from data_gen.pairs import Camera, Curve

RESPONSE_STEPS = 4096


@lru_cache(maxsize=16)
def response_curve(tone_curve: Curve) -> NDArray[np.float32]:
    """The response f as a table: (RESPONSE_STEPS + 1,) float32 in [0, 255] over exposure [0, 1].

    The camera's tone curve (linear to linear), then the sRGB transfer function (IEC 61966-2-1).
    """
    nodes = np.array(tone_curve)
    exposure = np.linspace(0, 1, RESPONSE_STEPS + 1)
    linear = np.clip(PchipInterpolator(nodes[:, 0], nodes[:, 1])(exposure), 0, 1)
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    return np.asarray(255 * encoded, np.float32)


def expose(
    irradiance: Light,
    camera: Camera,
    crosstalk: tuple[tuple[float, ...], ...],
    gain: float,
    rng: np.random.Generator,
) -> NDArray[np.uint8]:
    """One captured frame.

    exposure = white_level gain vignette (M light); electrons = Normal(N, N + read_noise^2) with
    N = exposure full_well / gain; then the response f, rounding to 8 bits, and JPEG. Gain is the
    camera's ISO: it amplifies without collecting more electrons. Noise and JPEG are those of single
    sensor pixels: the capture stands for a crop or a skipped-pixel video mode, not for a big still
    that is averaged down, which would be quieter.

    Args:
        irradiance: (H, W, 3) float32 linear, display primaries; frontal white is 1.
        camera: parameters.
        crosstalk: (3, 3) M of Eq. redpixel, rows camera R, G, B.
        gain: exposure relative to the camera's ``white_level`` setting.
        rng: source of the noise.

    Returns:
        (H, W, 3) uint8, encoded RGB.
    """
    M = np.array(crosstalk, np.float32)
    exposure = cv2.transform(irradiance, M) * (
        np.float32(camera.white_level * gain) * vignette(camera.vignetting)[:, :, None]
    )
    well = camera.full_well_e / max(gain, 1.0)
    variance = exposure / np.float32(well) + np.float32((camera.read_noise_e / well) ** 2)
    exposure += np.sqrt(variance) * rng.standard_normal(exposure.shape, np.float32)
    table = response_curve(camera.tone_curve)
    index = np.clip(exposure * RESPONSE_STEPS, 0, RESPONSE_STEPS) + np.float32(0.5)
    pixels = (table + np.float32(0.5)).astype(np.uint8)[index.astype(np.intp)]
    return jpeg(pixels, camera.jpeg_quality)


def jpeg(pixels: NDArray[np.uint8], quality: int) -> NDArray[np.uint8]:
    """Store and reload an RGB frame as JPEG of this quality; same shape and dtype."""
    bgr = cv2.cvtColor(pixels, cv2.COLOR_RGB2BGR)
    _, data = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return np.asarray(
        cv2.cvtColor(cv2.imdecode(data, cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB), np.uint8
    )
