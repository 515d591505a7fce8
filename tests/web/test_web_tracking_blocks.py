"""The page fills unseen blocks, finds covered ones and skips repeats as Python does."""

import cv2
import numpy as np
import pytest
from conftest import cases
from port import Port, same

from link.layout import make_layout
from link.ratex import draw_patches
from link.types import Array, Image
from receiver.reading.occlusion import Occlusion
from receiver.reading.unseen import fill_unseen, unseen_blocks
from receiver.repeats import Repeats

PATCHES = make_layout(9, 11, 250, 190)
"""Blocks and tiles of unequal sizes."""
PILOTS = make_layout(24, 32, 256, 192, modulation="antipodal", pilots="auto")


def smooth(height: int, width: int, seed: int, deviation: float = 25.0) -> Array:
    noise = np.random.default_rng(seed).normal(0, 1, (height, width))
    blurred = cv2.GaussianBlur(noise, (0, 0), 8)
    return np.asarray(130 + deviation * blurred / blurred.std())


def noisy(image: Array, seed: int, deviation: float = 2.0) -> Image:
    noise = np.random.default_rng(seed).normal(0, deviation, image.shape)
    return np.clip(image + noise + 0.5, 0, 255).astype(np.uint8)


HIDING = {
    "partly out of view": (PATCHES, True, False),
    "behind a hand": (PATCHES, False, True),
    "pilots": (PILOTS, True, False),
    "all seen": (PATCHES, False, False),
}
"""A layout, whether some of the display is outside the image, and whether a hand is before it."""


@pytest.mark.parametrize("name", HIDING)
def test_unseen_blocks_are_filled(port: Port, name: str) -> None:
    layout, cut, hand = HIDING[name]
    images, module = [], port("receiver/reading/unseen.js")
    for embedded in (False, True):
        shown = smooth(layout.height, layout.width, 1).astype(np.uint8)
        draw_patches(shown, layout, 3, embedded=embedded)
        if hand:
            shown[:60, :70] = 120
        images.append(noisy(shown.astype(np.float64), 2 + embedded))
    purity = np.full((16, 16), 0.9)
    if cut:
        purity[:, 13:] = 0
        purity[7, 6] = 0
    hidden = unseen_blocks(images[0], images[1], purity, layout)
    assert hidden.any() == (name != "all seen")
    same(module.unseenBlocks(*images, purity, layout), hidden)
    filled = module.fillUnseen(images, hidden, layout)
    same(filled, fill_unseen(images, hidden, layout))


def test_covered_blocks_are_found(port: Port) -> None:
    """A hand passes by, the light changes, and then the picture."""
    occlusion, ported = Occlusion(PATCHES), port("receiver/reading/occlusion.js").Occlusion(PATCHES)
    is_covered = []
    for number in range(14):
        shown = smooth(PATCHES.height, PATCHES.width, int(number > 11)) * (1 + 0.03 * number)
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
