"""What blind mode sees of a frame pair: the mean change of each block's tones."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from link.frames import Rectified
from link.images import intensity
from link.layout import block_index
from models.classical.register import align

Array = NDArray[np.float64]

TONES = 12
"""Tones of a frame, equally many pixels in each; a CDTF's bend shows in less."""
RAMP = 0.25
"""Part of a block at each side over which pixels count less: corners are a few pixels off, a
message at a coarse pyramid level fades there, and s of the neighbours spills over."""
TEXTURE = 0.02
"""Gradient, in intensity per pixel, at which a pixel counts half: a tenth of a pixel of motion
then changes it by half a gray level."""


@dataclass(frozen=True)
class Tones:
    """What is seen of each block's tones; arrays (blocks, TONES) but for ``row``."""

    change: Array
    """Mean change, embedded minus original, captured gray levels."""
    i: Array
    """Mean intensity of both frames, [0, 1]."""
    x: Array
    """Mean position in the frame, [-1, 1]; likewise ``y``."""
    y: Array
    gradient_x: Array
    """Mean d/dx of the intensity, gray levels per pixel; likewise ``gradient_y``."""
    gradient_y: Array
    curvature: Array
    """Mean Laplacian of the intensity, gray levels per square pixel."""
    share: Array
    """Of the block's weight; each block's sum is 1, or 0 where the embedded frame lacks it."""
    row: NDArray[np.intp]
    """(blocks,) row of the grid."""


def cut_into_tones(pair: Rectified) -> Tones:
    """Register the frames and average over the tones of each message block."""
    layout = pair.layout
    i_o = intensity(pair.original)
    i_e, inside = align(pair.original, pair.embedded)
    i = (i_o + i_e) / 2
    smooth = cv2.GaussianBlur(i, (0, 0), 1.0)
    dx = cv2.Sobel(smooth, cv2.CV_32F, 1, 0, scale=1 / 8)
    dy = cv2.Sobel(smooth, cv2.CV_32F, 0, 1, scale=1 / 8)
    weights = _ramp(layout.height, layout.rows)[:, None] * _ramp(layout.width, layout.cols)
    weights = weights * inside / (1 + (dx * dx + dy * dy) / TEXTURE**2)

    edges = np.quantile(i, np.arange(1, TONES) / TONES)
    block = block_index(layout.height, layout.rows)[:, None] * layout.cols
    block = block + block_index(layout.width, layout.cols)
    cell = (block * TONES + np.searchsorted(edges, i, side="right")).ravel()
    message = layout.message_mask.ravel()

    def total(values: NDArray[np.float64]) -> Array:
        sums = np.bincount(cell, values.ravel(), minlength=message.size * TONES)
        return np.asarray(sums.reshape(-1, TONES)[message], np.float64)

    count = total(weights)

    def mean(values: NDArray[np.float32] | Array) -> Array:
        return total(weights * values) / (count + 1e-9)

    y, x = np.meshgrid(
        (2 * np.arange(layout.height) + 1) / layout.height - 1,
        (2 * np.arange(layout.width) + 1) / layout.width - 1,
        indexing="ij",
    )
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
