"""Toggles of pilots over the parts of the display, from which its clock is found."""

import numpy as np
import pytest
from numpy.typing import NDArray

from export.locate.pilots.evidence import pilot_signs
from export.receive.timing.toggles import (
    PARTS,
    PatchToggles,
    PilotToggles,
    make_toggles,
)
from link.layout import Layout, make_layout

LAYOUT = make_layout(16, 16, 128, 128, modulation="antipodal", pilots=128)
WAVE = np.resize([1.0, 1.0, -1.0, -1.0], 80)
"""State of the display in each frame: each is shown for two frames."""


def rectified(
    layout: Layout, level: float | NDArray[np.float64], picture: float = 120.0
) -> NDArray[np.uint8]:
    """A frame whose pilots stand out by a level each, and whose other blocks do not."""
    blocks = np.full(layout.rows * layout.cols, picture)
    blocks[layout.pilot_blocks] += level * pilot_signs(layout)
    tall, wide = layout.height // layout.rows, layout.width // layout.cols
    grid = blocks.reshape(layout.rows, layout.cols)
    return np.kron(grid, np.ones((tall, wide))).round().astype(np.uint8)


def parts_of(layout: Layout) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Row and column of the part in which each pilot lies, of `PARTS`."""
    row, col = np.divmod(layout.pilot_blocks, layout.cols)
    return row * PARTS[0] // layout.rows, col * PARTS[1] // layout.cols


@pytest.mark.parametrize("colour", [False, True], ids=["gray", "RGB"])
@pytest.mark.parametrize("kappa", [1.0, 4.0])
def test_a_square_wave_is_measured_in_every_part(kappa: float, colour: bool) -> None:
    toggles = PilotToggles(LAYOUT)
    assert toggles.places.shape == (16, 2)
    seen = []
    for sign in WAVE:
        frame = rectified(LAYOUT, kappa * sign)
        seen.append(toggles.measure(np.repeat(frame[..., None], 3, 2) if colour else frame))
    high, low = np.array(seen)[WAVE > 0], np.array(seen)[WAVE < 0]
    # a block stands out of its neighbourhood by its own level, less a share of its neighbours'
    np.testing.assert_allclose((high - low).mean(axis=0), 4 * kappa, rtol=0.35)
    np.testing.assert_allclose((high - low).mean(), 4 * kappa, rtol=0.1)
    np.testing.assert_allclose(high, -low[: len(high)], rtol=0.1)


def test_places_lie_in_the_middle_of_their_parts() -> None:
    """Parts are told apart: one that toggles alone is the one that is measured there."""
    rows, cols = parts_of(LAYOUT)
    for row, col in ((0, 0), (1, 3), (3, 2)):
        toggles = PilotToggles(LAYOUT)
        alone = 3.0 * ((rows == row) & (cols == col))
        seen = np.array([toggles.measure(rectified(LAYOUT, sign * alone)) for sign in WAVE])
        part = int(seen.std(axis=0).argmax())
        np.testing.assert_allclose(toggles.places[part], [(col + 0.5) / 4, (row + 0.5) / 4])
        others = np.delete(seen.std(axis=0), part)
        assert others.max() < 0.25 * seen.std(axis=0)[part]


def test_a_part_without_pilots_is_left_out() -> None:
    few = make_layout(16, 16, 128, 128, modulation="antipodal", pilots=6)
    rows, cols = parts_of(few)
    expected = {((col + 0.5) / 4, (row + 0.5) / 4) for row, col in zip(rows, cols, strict=True)}
    toggles = PilotToggles(few)
    assert {(x, y) for x, y in toggles.places} == expected
    assert len(toggles.places) < 16
    values = toggles.measure(rectified(few, 2.0))
    assert values.shape == (len(expected),)
    assert np.isfinite(values).all()


def test_a_grid_coarser_than_the_parts_has_a_place_for_each_block() -> None:
    coarse = make_layout(2, 3, 96, 64, modulation="antipodal", pilots=4)
    toggles = PilotToggles(coarse)
    assert len(toggles.places) == 4
    assert np.isfinite(toggles.measure(rectified(coarse, 2.0))).all()


def test_restless_blocks_weigh_less() -> None:
    """Half of the pilots flicker at random, by far more than the others toggle."""
    rng, kappa = np.random.default_rng(0), 2.0
    restless = np.arange(LAYOUT.pilots) % 2 == 0
    toggles, seen = PilotToggles(LAYOUT), []
    for sign in WAVE:
        level = kappa * sign + 20 * restless * rng.standard_normal(LAYOUT.pilots)
        seen.append(toggles.measure(rectified(LAYOUT, level)).mean())
    weights = 1 / toggles._variance
    assert weights[~restless].min() > 3 * np.median(weights[restless])
    late, wave = np.array(seen)[30:], WAVE[30:]
    assert np.corrcoef(late, wave)[0, 1] > 0.7


def test_a_still_picture_adds_nothing_that_changes() -> None:
    rng = np.random.default_rng(1)
    picture = rng.integers(60, 200, (LAYOUT.height, LAYOUT.width))
    seen = np.array([PilotToggles(LAYOUT).measure(picture.astype(np.uint8)) for _ in range(3)])
    np.testing.assert_array_equal(seen, np.repeat(seen[:1], 3, axis=0))
    toggles = PilotToggles(LAYOUT)
    still = np.array([toggles.measure(picture.astype(np.uint8)) for _ in range(40)])
    assert np.abs(np.diff(still[20:], axis=0)).max() < 0.5


def test_what_measures_follows_from_the_layout() -> None:
    assert isinstance(make_toggles(LAYOUT), PilotToggles)
    patches = make_toggles(make_layout())
    assert isinstance(patches, PatchToggles)
    assert patches.places.shape == (5, 2)
