"""The page fills unseen blocks, finds covered ones and skips repeats as Python does."""

import cv2
import numpy as np
import pytest
from conftest import cases
from port import Port, same

from link.layout import make_layout
from link.types import Array, Image
from receiver.reading.occlusion import Occlusion
from receiver.reading.unseen import fill_unseen, unseen_blocks
from receiver.repeats import Repeats

LAYOUT = make_layout(17, 23, 250, 190, modulation="antipodal", pilots="auto")
"""Blocks of unequal sizes."""


def smooth(height: int, width: int, seed: int, deviation: float = 25.0) -> Array:
    noise = np.random.default_rng(seed).normal(0, 1, (height, width))
    blurred = cv2.GaussianBlur(noise, (0, 0), 8)
    return np.asarray(130 + deviation * blurred / blurred.std())


def noisy(image: Array, seed: int, deviation: float = 2.0) -> Image:
    noise = np.random.default_rng(seed).normal(0, deviation, image.shape)
    return np.clip(image + noise + 0.5, 0, 255).astype(np.uint8)


@pytest.mark.parametrize("is_cut", [True, False])
def test_unseen_blocks_are_filled(port: Port, is_cut: bool) -> None:
    """Of a display that is partly out of view, or wholly in view."""
    module, shown = port("receiver/reading/unseen.js"), smooth(LAYOUT.height, LAYOUT.width, 1)
    images = [noisy(shown, seed) for seed in (2, 3)]
    purity = np.full((16, 16), 0.9)
    if is_cut:
        purity[:, 13:] = 0
        purity[7, 6] = 0
    hidden = unseen_blocks(images[0], images[1], purity, LAYOUT)
    assert hidden.any() == is_cut
    same(module.unseenBlocks(purity, LAYOUT), hidden)
    filled = module.fillUnseen(images, hidden, LAYOUT)
    same(filled, fill_unseen(images, hidden, LAYOUT))


def test_covered_blocks_are_found(port: Port) -> None:
    """A hand passes by, the light changes, and then the picture."""
    occlusion, ported = Occlusion(LAYOUT), port("receiver/reading/occlusion.js").Occlusion(LAYOUT)
    is_covered = []
    for number in range(14):
        shown = smooth(LAYOUT.height, LAYOUT.width, int(number > 11)) * (1 + 0.03 * number)
        if 4 < number < 9:
            shown[20:110, 20 * number : 20 * number + 70] = 30
        image = noisy(shown, number)
        covered = occlusion.covered(image)
        same(ported.covered(image), covered)
        is_covered.append(covered.any())
    assert any(is_covered)


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
