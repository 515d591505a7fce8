"""Someone who walks between camera and display: a blurred figure, dark or in coloured cloth."""

import cv2
import numpy as np
from numpy.typing import NDArray

from data_gen.channel.composition import Foreground


def draw_passer(
    width: int, height: int, level: float, rng: np.random.Generator, blur_px: float = 3.0
) -> Foreground:
    """Draw a head, shoulders and cloth with folds or stripes, in linear light.

    Args:
        width: width at the shoulders, pixels.
        height: distance from the crown down to where the figure leaves the image, pixels.
        level: light of a white sheet in the room; white of the display is 1.
        rng: every random draw comes from here.
        blur_px: standard deviation of the figure's edge: out of focus and in motion.
    """
    mask = np.zeros((height, width), np.uint8)
    head = int(0.23 * width)
    middle, neck = width // 2, int(2.3 * head)
    skin = np.zeros_like(mask)
    cv2.ellipse(skin, (middle, int(1.3 * head)), (head, int(1.25 * head)), 0, 0, 360, 255, -1)
    cv2.rectangle(skin, (middle - head // 2, 2 * head), (middle + head // 2, neck + head), 255, -1)
    edge = int(0.06 * width)
    body = np.array(
        [
            (middle - head // 2, neck),
            (middle + head // 2, neck),
            (width - edge, neck + head),
            (width - edge // 2, height),
            (edge // 2, height),
            (edge, neck + head),
        ]
    )
    cv2.fillPoly(mask, [body], 255)
    tone = rng.uniform(0.08, 0.6) * np.array([1.0, 0.72, 0.55])
    cloth = rng.uniform(0.02, 0.5) * (1 + 0.6 * rng.uniform(-1, 1, 3))
    texture = rng.normal(1, 0.25, (max(2, height // 24), max(2, width // 24))).astype(np.float32)
    folds = cv2.resize(texture, (width, height), interpolation=cv2.INTER_CUBIC)[:, :, None]
    if rng.random() < 0.4:
        stripes = np.sin(np.arange(height) * 2 * np.pi / rng.uniform(8, 40))[:, None, None]
        folds = folds * (1 + 0.5 * np.sign(stripes))
    hair = np.arange(height)[:, None, None] < head
    face = np.where(hair, 0.08 * tone, tone) * np.ones((height, width, 1))
    colour = np.where(skin[:, :, None] > 0, face, np.clip(cloth * folds, 0.005, 0.9))
    cover = cv2.GaussianBlur(
        np.maximum(mask, skin).astype(np.float32) / 255, (0, 0), blur_px, borderType=0
    )
    cover[-1:] = cover[-2:-1]
    soft: NDArray[np.float32] = cv2.GaussianBlur((level * colour).astype(np.float32), (0, 0), 1.5)
    return Foreground(np.asarray(soft * cover[:, :, None], np.float32), cover[:, :, None])
