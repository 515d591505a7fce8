"""How strongly blocks change: as much as the eye allows, and never less than kappa."""

from dataclasses import replace

import numpy as np
import pytest
from tolerances import EVEN_CONTRAST, FLOAT64

from link.layout import make_layout
from link.presets import PRESETS
from link.strength import EVEN, FACTORS, block_steps, even_factor, light_of_level, masking
from link.types import Image
from sender.hiding import MESSAGE_SEED, SECONDS, Onlooker
from sender.visibility.flicker import contrast_over_threshold, high_end, random_message

LAYOUT = make_layout(12, 16, 160, 120, modulation="antipodal", pilots=8)


def plain(level: int) -> Image:
    return np.full((LAYOUT.height, LAYOUT.width, 3), level, np.uint8)


@pytest.mark.parametrize("level", range(0, 256, 15))
def test_plain_grays_have_the_factor_of_their_level(level: int) -> None:
    steps = block_steps(plain(level), LAYOUT)
    assert len(np.unique(steps)) == 1
    factor, wanted = FACTORS[steps[0, 0]], float(even_factor(light_of_level(level)))
    assert factor <= wanted < factor * FACTORS[1] * 1.0001
    np.testing.assert_array_equal(block_steps(plain(level)[..., 0], LAYOUT), steps)


def test_texture_masks_and_only_where_it_is() -> None:
    picture = plain(60)
    checks = np.indices((LAYOUT.rows, LAYOUT.cols)).sum(axis=0) % 2
    busy = np.kron(checks, np.ones((10, 10), int))
    picture[:, 80:] = 60 + 60 * busy[:, 80:, None]
    steps = block_steps(picture, LAYOUT)
    usual = block_steps(plain(60), LAYOUT)[0, 0]
    assert (steps[:, :2] == usual).all()
    assert (steps[:, 11:] > usual + 4).all()
    light = np.full((4, 4), 0.3)
    np.testing.assert_allclose(masking(light), 1, rtol=0, atol=FLOAT64)


def test_the_curve_makes_all_grays_alike_to_the_eye() -> None:
    """The table against elaTCSF, by which it was made: `hidden`, seen from 1 m."""
    hidden = PRESETS["hidden"]
    usual = Onlooker(distance=1.0).viewing(hidden.layout, hidden.state_hz)
    seen = {}
    for level, factor in EVEN.items():
        viewing = replace(usual, kappa=factor, picture_level=float(level))
        rng = np.random.default_rng(MESSAGE_SEED)
        shown = random_message(viewing, "antipodal", rng, SECONDS)
        seen[level] = high_end(contrast_over_threshold(shown, viewing, "block"))
    inside = np.array([seen[level] for level in EVEN if 0 < level < 255])  # others are clipped
    assert inside.max() / inside.min() < EVEN_CONTRAST
    assert 0.95 < inside.max() < 1
