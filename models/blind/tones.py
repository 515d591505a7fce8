"""What blind mode sees of a frame pair: the mean change of each block's tones."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from link.images import intensity
from link.layout import block_grid
from link.observation import Observation
from link.types import Array
from models.blind.register import align_frames, centred

TONES = 12
"""Number of tones into which a frame is cut, with equally many pixels in each; fewer would do to
show the bend of a CDTF."""
RAMP = 0.25
"""Share of a block's width, at each side, over which pixels count less: corners are a bit off,
and light of the neighbours spills over."""
TEXTURE = 0.02
"""Gradient, in intensity per pixel, at which a pixel counts half: a tenth of a pixel of motion
then changes it by half a gray level."""


@dataclass(frozen=True)
class Tones:
    """Averages over the tones of each message block; arrays (blocks, TONES) but for ``row``."""

    change: Array
    """Mean of the embedded minus the original frame, captured gray levels."""
    i: Array
    """Mean intensity of both frames, in [0, 1], encoded."""
    x: Array
    """Mean horizontal position in the frame, from -1 at the left to 1 at the right."""
    y: Array
    """Mean vertical position in the frame, from -1 at the top to 1 at the bottom."""
    gradient_x: Array
    """Mean derivative of the intensity to the right, gray levels per pixel."""
    gradient_y: Array
    """Mean derivative of the intensity downwards, gray levels per pixel."""
    curvature: Array
    """Mean Laplacian of the intensity, gray levels per square pixel."""
    share: Array
    """Share that a tone has of its block's weight; a block's shares sum to 1, or to 0 where the
    embedded frame lacks it."""
    row: NDArray[np.intp]
    """(blocks,) row of the grid in which each block lies."""


def cut_into_tones(pair: Observation) -> Tones:
    """Register the frames and average over the tones of each message block.

    Args:
        pair: rectified frames.
    """
    layout = pair.layout
    i_o = intensity(pair.original)
    i_e, inside = align_frames(pair.original, pair.embedded)
    i = (i_o + i_e) / 2
    smooth = cv2.GaussianBlur(i, (0, 0), 1.0)
    dx = cv2.Sobel(smooth, cv2.CV_32F, 1, 0, scale=1 / 8)
    dy = cv2.Sobel(smooth, cv2.CV_32F, 0, 1, scale=1 / 8)
    weights = _ramp(layout.height, layout.rows)[:, None] * _ramp(layout.width, layout.cols)
    weights = weights * inside / (1 + (dx * dx + dy * dy) / TEXTURE**2)

    edges = np.quantile(i, np.arange(1, TONES) / TONES)
    rows, cols = block_grid(layout)
    block = rows * layout.cols + cols
    cell = (block * TONES + np.searchsorted(edges, i, side="right")).ravel()
    message = layout.message_mask.ravel()

    def total(values: NDArray[np.float64]) -> Array:
        sums = np.bincount(cell, values.ravel(), minlength=message.size * TONES)
        return np.asarray(sums.reshape(-1, TONES)[message], np.float64)

    count = total(weights)

    def mean(values: NDArray[np.float32] | Array) -> Array:
        return total(weights * values) / (count + 1e-9)

    y, x = np.meshgrid(centred(layout.height), centred(layout.width), indexing="ij")
    return Tones(
        change=255 * mean(i_e - i_o),
        i=mean(i),
        x=mean(x),
        y=mean(y),
        gradient_x=255 * mean(dx),
        gradient_y=255 * mean(dy),
        curvature=255 * mean(cv2.Laplacian(smooth, cv2.CV_32F)),
        share=count / (count.sum(axis=1, keepdims=True) + 1e-9),
        row=np.nonzero(layout.message_mask)[0],
    )


def _ramp(length: int, blocks: int) -> Array:
    """(length,) weights in (0, 1] that fall towards the edges of each block."""
    within = (np.arange(length) + 0.5) * blocks / length % 1
    return np.clip(np.minimum(within, 1 - within) / RAMP, 0.02, 1)
