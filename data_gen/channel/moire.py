"""Moire: the display's stripes sampled by the sensor's mosaic.

The stripes of display primary d vary as 1 + a cos(2 pi (X - d / 3)) over the panel column X. A
sensor channel that samples at spacing p sees the frequency f of X, in cycles per native sensor
pixel, at the alias f - n / p with whole n: p is two pixels for R and B, one for G (quincunx, along
rows). The amplitude falls by the pixel's aperture, the lens and anti-alias blur (at f), and by the
reduction to the captured size (at the alias).
"""

import cv2
import numpy as np

from data_gen.channel.display import Light
from data_gen.parameters import Pair
from link.layout import Layout
from link.types import Homography

SPACING = (2, 1, 2)
"""Number of native pixels between samples of R, G and B along a row."""
OFFSET = (0, 0, 1)
"""Native column of the first sample of R, G and B in the mosaic RGGB."""
REDUCTION_BLUR = 0.5
"""Standard deviation, in captured pixels, of the area average that reduces the image."""
COARSE_PX = 16
"""Number of captured pixels between the points at which the slow amplitudes are computed."""
INVISIBLE = 1e-3
"""Amplitude below which a channel's moire is left out."""


def moire_gain(
    pair: Pair,
    layout: Layout,
    H_captured_from_display: Homography,
    size: tuple[int, int],
    origin: tuple[int, int] = (0, 0),
    capture_width: int | None = None,
) -> Light:
    """Return the modulation of the light that each of the sensor's channels collects.

    Args:
        pair: panel, sensor, and crosstalk, by which a channel sees all three stripes.
        layout: layout of the picture, which fills the panel's rows.
        H_captured_from_display: homography.
        size: (width, height) of the capture, or of a part of it, pixels.
        origin: (x, y) of that part in the capture.
        capture_width: width of the whole capture, where ``size`` is that of a part.

    Returns:
        (height, width, 3) float32 factors, whose mean is about 1.
    """
    width, height = size
    columns = pair.display.native_height / layout.height  # of the panel, per display pixel
    native = pair.camera.native_width / (capture_width or width)  # sensor pixels per captured pixel
    h = np.linalg.inv(H_captured_from_display).astype(np.float32)
    x, y = (np.arange(o, o + n, dtype=np.float32) for o, n in zip(origin, size, strict=True))
    X, _ = _display_column(h, x, y)
    coarse_x, coarse_y = (
        np.arange(o + COARSE_PX // 2, o + n + COARSE_PX // 2, COARSE_PX).astype(np.float32)
        for o, n in zip(origin, size, strict=True)
    )
    coarse_X, w = _display_column(h, coarse_x, coarse_y)
    fx = columns * (h[0, 0] - coarse_X * h[2, 0]) / w  # cycles per captured pixel: d(columns X)/dx
    fy = columns * (h[0, 1] - coarse_X * h[2, 1]) / w
    f = np.hypot(fx, fy) / native
    transfer = np.sinc(f) * _gauss(f, pair.camera.native_blur_px)
    stripes = np.array(pair.crosstalk) @ np.exp(-2j * np.pi * np.arange(3) / 3)
    gain = np.ones((height, width, 3), np.float32)
    for c, spacing in enumerate(SPACING):
        n = np.round(fx[len(fx) // 2, fx.shape[1] // 2] / native * spacing)
        alias = np.hypot(fx - n * native / spacing, fy)
        amplitude = pair.display.grid_contrast * abs(stripes[c]) * transfer
        amplitude = (amplitude * _gauss(alias, REDUCTION_BLUR)).astype(np.float32)
        if amplitude.max() < INVISIBLE:
            continue
        phase = np.float32(columns) * X - np.float32(n * native / spacing) * x
        start = np.angle(stripes[c]) - np.pi * n * OFFSET[c]
        wave = np.cos(np.float32(2 * np.pi) * phase + np.float32(start))
        fine = cv2.resize(amplitude, None, fx=COARSE_PX, fy=COARSE_PX)
        gain[:, :, c] += fine[:height, :width] * wave
    return gain


def _display_column(h: Light, x: Light, y: Light) -> tuple[Light, Light]:
    """Return the display column at each captured pixel and its divisor, (len(y), len(x)) each."""
    w = h[2, 0] * x + (h[2, 1] * y + h[2, 2])[:, None]
    return (h[0, 0] * x + (h[0, 1] * y + h[0, 2])[:, None]) / w, w


def _gauss(frequency: Light, sigma: float) -> Light:
    """Return the transfer of a Gaussian blur of sigma pixels at cycles per pixel."""
    return np.asarray(np.exp(-2 * (np.pi * sigma * frequency) ** 2))
