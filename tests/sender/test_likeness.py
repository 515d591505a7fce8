"""How much a picture changes: CIEDE2000 of its mean over time."""

import numpy as np
import pytest
from skimage.color import lab2rgb

from sender.likeness import colour_difference


def test_a_step_in_lightness_is_what_the_formula_says() -> None:
    """Over the middle gray of L* = 50 the formula's S_L is 1, so that a step in L* is one unit."""
    gray, lighter = (
        np.full((16, 16, 3), 255 * lab2rgb([[[level, 0.0, 0.0]]])[0, 0]) for level in (49.5, 50.5)
    )
    mean, high = colour_difference(lighter, np.asarray(gray.round(), np.uint8))
    exact = colour_difference(gray.round(), np.asarray(gray.round(), np.uint8))
    assert exact == (0.0, 0.0)
    assert mean == pytest.approx(1.0, abs=0.2)  # a gray level is about 0.4 units
    assert high == pytest.approx(mean)


@pytest.mark.slow
def test_large_pictures_are_sampled_over_all_places_of_the_dither() -> None:
    """A chessboard of pixels that are one level off differs by half of what all pixels would."""
    picture = np.full((2002, 2002, 3), 100, np.uint8)
    board = np.indices((2002, 2002)).sum(axis=0) % 2
    mean, high = colour_difference(picture + board[:, :, None], picture)
    assert mean == pytest.approx(high / 2, rel=0.01)
