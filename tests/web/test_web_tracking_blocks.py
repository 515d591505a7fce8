"""The page fills unseen blocks, finds covered ones and skips repeats as Python does."""

from pathlib import Path

import cv2
import numpy as np
from web_fixtures import run_node_tests, write_fixture

from export.receive.occlusion import Occlusion
from export.receive.repeats import Repeats
from export.receive.unseen import fill_unseen, unseen_blocks
from export.web.tables import layout_table
from link.layout import Layout, make_layout
from link.ratex import draw_patches
from link.types import Array, Image

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


def hiding(layout: Layout, cut: bool, hand: bool) -> dict[str, object]:
    """A frame pair of which some is outside the image, or behind a hand, and the filled images."""
    images = []
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
    unseen = unseen_blocks(images[0], images[1], purity, layout)
    return {
        "layout": layout_table(layout),
        "images": images,
        "purity": purity,
        "unseen": unseen,
        "filled": fill_unseen(images, unseen, layout),
    }


def covering() -> dict[str, object]:
    """A hand passes by, the light changes, and then the picture."""
    occlusion, images, covered = Occlusion(PATCHES), [], []
    for number in range(14):
        shown = smooth(PATCHES.height, PATCHES.width, int(number > 11)) * (1 + 0.03 * number)
        if 4 < number < 9:
            shown[20:110, 20 * number : 20 * number + 70] = 30
        images.append(noisy(shown, number))
        covered.append(occlusion.covered(images[-1]))
    assert any(blocks.any() for blocks in covered)
    return {"layout": layout_table(PATCHES), "images": images, "covered": covered}


def repeating() -> list[dict[str, object]]:
    """Films with noise and without, of odd sizes, in which frames are repeated."""
    films = []
    for (height, width), deviation in (((96, 128), 3.0), ((45, 250), 3.0), ((96, 128), 0.0)):
        base = smooth(height, width, 0)
        numbers = (0, 1, 2, 3, 4, 5, 6, 7, 7, 8, 9, 9, 10, 11, 11)
        film = [noisy(base + 3 * (number // 2 % 2), number, deviation) for number in numbers]
        corrected = np.clip(film[-1] + (np.arange(width) % 7 == 0), 0, 255).astype(np.uint8)
        repeats = Repeats()
        images = [*film, corrected, film[0][::-1, : width // 2].copy(), film[0]]
        films.append({"images": images, "repeated": [repeats.is_repeat(i) for i in images]})
    assert any(films[0]["repeated"])
    return films


def test_blocks_and_repeats_are_handled_as_in_python(tmp_path: Path) -> None:
    cases = {
        "partly out of view": hiding(PATCHES, cut=True, hand=False),
        "behind a hand": hiding(PATCHES, cut=False, hand=True),
        "pilots": hiding(PILOTS, cut=True, hand=False),
        "all seen": hiding(PATCHES, cut=False, hand=False),
    }
    write_fixture(tmp_path, "hiding", cases)
    for part in (covering, repeating):
        write_fixture(tmp_path, part.__name__, part())
    run_node_tests("trackingBlocks", tmp_path)
