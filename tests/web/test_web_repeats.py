"""The page skips repeats as Python does."""

import cv2
import numpy as np
from conftest import cases
from port import Port

from link.types import Array, Image
from receiver.repeats import Repeats


def smooth(height: int, width: int, seed: int, deviation: float = 25.0) -> Array:
    noise = np.random.default_rng(seed).normal(0, 1, (height, width))
    blurred = cv2.GaussianBlur(noise, (0, 0), 8)
    return np.asarray(130 + deviation * blurred / blurred.std())


def noisy(image: Array, seed: int, deviation: float = 2.0) -> Image:
    noise = np.random.default_rng(seed).normal(0, deviation, image.shape)
    return np.clip(image + noise + 0.5, 0, 255).astype(np.uint8)


@cases(((96, 128), 3.0), ((45, 250), 3.0), ((96, 128), 0.0))
def test_repeated_frames_are_recognised(
    shape: tuple[int, int], deviation: float, port: Port
) -> None:
    """In films with noise and without, of odd sizes."""
    base = smooth(*shape, 0)
    numbers = (0, 1, 2, 3, 4, 5, 6, 7, 7, 8, 9, 9, 10, 11, 11)
    film = [noisy(base + 3 * (number // 2 % 2), number, deviation) for number in numbers]
    corrected = np.clip(film[-1] + (np.arange(shape[1]) % 7 == 0), 0, 255).astype(np.uint8)
    repeats, ported = Repeats(), port("receiver/repeats.js").Repeats()
    repeated = []
    for image in [*film, corrected, film[0][::-1, : shape[1] // 2].copy(), film[0]]:
        repeated.append(repeats.is_repeat(image))
        assert ported.isRepeat(image) == repeated[-1]
    assert any(repeated) or (shape, deviation) != ((96, 128), 3.0)
