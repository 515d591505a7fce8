"""The camera: from linear light at the sensor to 8-bit pixels of a file (Eq. camerapixel)."""

from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from data_gen.channel.display import Light
from data_gen.parameters import IDENTITY, Camera, Curve, Matrix

RESPONSE_STEPS = 65535
"""Number of steps of exposure in [0, 1] at which the response is tabulated."""
PEDESTAL = 1 / 16
"""Raw level that stands for no light, relative to saturation; noise below zero is kept by it."""


@lru_cache(maxsize=16)
def response_curve(tone_curve: Curve, encoding: str = "srgb") -> NDArray[np.float32]:
    """Return the camera's response f as a table over exposures from 0 to 1.

    The tone curve maps linear to linear light; the transfer function follows.

    Args:
        tone_curve: nodes (in, out) from (0, 0) to (1, 1), joined by a monotone cubic spline.
        encoding: "srgb" for the transfer function of IEC 61966-2-1, "linear" for none.

    Returns:
        (RESPONSE_STEPS + 1,) float32 in [0, 255].
    """
    nodes = np.array(tone_curve)
    exposure = np.linspace(0, 1, RESPONSE_STEPS + 1)
    if len(nodes) > 2:
        linear = np.clip(PchipInterpolator(nodes[:, 0], nodes[:, 1])(exposure), 0, 1)
    else:
        linear = exposure
    if encoding == "srgb":
        linear = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    return np.asarray(255 * linear, np.float32)


def collect(
    irradiance: Light, camera: Camera, crosstalk: Matrix, gain: Light | float = 1.0
) -> Light:
    """Return what the sensor's colour channels collect, ``white_level * gain * M @ light``.

    Args:
        irradiance: (H, W, 3) float32 linear in the display's primaries; frontal white is 1.
        camera: parameters of the camera.
        crosstalk: matrix M of Eq. redpixel, whose rows are the camera's R, G and B.
        gain: factor on the light, broadcastable to (H, W, 3), such as vignetting.

    Returns:
        (H, W, 3) float32, linear, without noise and not yet clipped; 1 is saturation.
    """
    return _transform(irradiance, crosstalk) * (np.float32(camera.white_level) * gain)


def develop(
    exposure: Light,
    camera: Camera,
    rng: np.random.Generator | None,
    noise_scale: float,
    iso: float = 1.0,
) -> NDArray[np.uint8]:
    """Turn an exposure into the file's pixels, as sensor and image processor do.

    Mosaic; electrons = Normal(N, s^2 (N + read_noise^2)) with N = exposure full_well / iso and
    s = noise_scale; demosaicing (edge-aware); colour matrix; response f; unsharp mask; rounding;
    JPEG. Noise and mosaic are those of the reduced capture: its pixels pool native pixels of one
    colour.

    Args:
        exposure: (H, W, 3) float32 in [0, 1], linear.
        camera: parameters of the camera.
        rng: source of the noise; None for no noise.
        noise_scale: standard deviation of the noise relative to a native pixel's; 0 for no noise.
        iso: amplification relative to the ISO of ``full_well_e``, at least 1.

    Returns:
        (H, W, 3) uint8, encoded RGB.
    """
    raw = mosaic(exposure) if camera.bayer else exposure
    if rng is not None and noise_scale > 0:
        well = camera.full_well_e / iso
        read = (camera.read_noise_e * iso / camera.full_well_e) ** 2
        sigma = raw * np.float32(1 / well)
        sigma += np.float32(read)
        noise = np.float32(noise_scale) * np.sqrt(sigma, out=sigma)
        noise *= rng.standard_normal(raw.shape, np.float32)
        raw = np.add(noise, raw, out=noise)
    linear = demosaic(raw) if camera.bayer else raw.copy()
    linear = _transform(np.clip(linear, 0, 1, out=linear), camera.color_matrix)
    table = response_curve(camera.tone_curve, camera.encoding)
    np.clip(linear, 0, 1, out=linear)
    linear *= np.float32(RESPONSE_STEPS)
    linear += np.float32(0.5)
    index = linear.astype(np.uint16)
    if camera.sharpening > 0:
        pixels = unsharp_mask(table[index], camera.sharpening)
    else:
        pixels = (table + np.float32(0.5)).astype(np.uint8)[index]
    return jpeg(pixels, camera.jpeg_quality) if camera.jpeg_quality else pixels


def unsharp_mask(encoded: Light, amount: float) -> NDArray[np.uint8]:
    """Sharpen (H, W, 3) float32 in [0, 255] by a mask with a sigma of 1 pixel, and round it."""
    soft = cv2.GaussianBlur(encoded, (0, 0), 1.0)
    sharp = cv2.addWeighted(encoded, 1 + amount, soft, -amount, 0.5)
    return np.asarray(np.clip(sharp, 0, 255, out=sharp), np.uint8)


def _transform(image: Light, matrix: Matrix) -> Light:
    if matrix == IDENTITY:
        return image
    return np.asarray(cv2.transform(image, np.array(matrix, np.float32)))


def mosaic(exposure: Light) -> Light:
    """Keep one colour a pixel, in rows RGRG and GBGB: (H, W, 3) to (H, W)."""
    raw = exposure[:, :, 1].copy()
    raw[0::2, 0::2] = exposure[0::2, 0::2, 0]
    raw[1::2, 1::2] = exposure[1::2, 1::2, 2]
    return raw


def demosaic(raw: Light) -> Light:
    """Interpolate (H, W) float32 to (H, W, 3) float32, through the 16-bit integers of OpenCV."""
    full = np.float32(65535 / (1 + 2 * PEDESTAL))
    counts = np.clip(raw + PEDESTAL, 0, 1 + 2 * PEDESTAL)
    counts *= full
    counts += np.float32(0.5)
    colour = cv2.demosaicing(counts.astype(np.uint16), cv2.COLOR_BayerRGGB2RGB_EA)
    colour = colour.astype(np.float32)
    colour /= full
    colour -= np.float32(PEDESTAL)
    return np.asarray(colour)


def jpeg(pixels: NDArray[np.uint8], quality: int) -> NDArray[np.uint8]:
    """Store and reload an RGB frame as JPEG of this quality; same shape and dtype."""
    bgr = cv2.cvtColor(pixels, cv2.COLOR_RGB2BGR)
    _, data = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return np.asarray(
        cv2.cvtColor(cv2.imdecode(data, cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB), np.uint8
    )
