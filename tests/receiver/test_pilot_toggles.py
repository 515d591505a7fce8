"""Toggles of pilots over the parts of the display, from which its clock is found."""

from collections.abc import Iterable

import numpy as np
import pytest
from numpy.typing import NDArray

from link.layout import Layout, make_layout
from link.pilots import pilot_signs, pilot_values
from link.types import Array, Image
from receiver.timing.toggles import PARTS, PatchToggles, PilotToggles, make_toggles

LAYOUT = make_layout(16, 16, 128, 128, modulation="antipodal", pilots=128)
WAVE = np.resize([1.0, 1.0, -1.0, -1.0], 80)
"""State of the display in each frame: each is shown for two frames."""


def rectified(layout: Layout, level: float | Array, picture: float | Array = 120.0) -> Image:
    """A frame whose pilots stand out of the blocks of a picture by a level each."""
    blocks = np.zeros(layout.rows * layout.cols) + picture
    blocks[layout.pilot_blocks] += level * pilot_signs(layout)
    tall, wide = layout.height // layout.rows, layout.width // layout.cols
    grid = blocks.reshape(layout.rows, layout.cols)
    return np.kron(grid, np.ones((tall, wide))).round().astype(np.uint8)


def toggles_of(frames: Iterable[Image], layout: Layout = LAYOUT) -> Array:
    """Toggles (n, P) of rectified frames."""
    return PilotToggles(layout).over_time(
        np.array([pilot_values(frame, layout) for frame in frames])
    )


def parts_of(layout: Layout) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Row and column of the part in which each pilot lies, of `PARTS`."""
    row, col = np.divmod(layout.pilot_blocks, layout.cols)
    return row * PARTS[0] // layout.rows, col * PARTS[1] // layout.cols


@pytest.mark.parametrize("colour", [False, True], ids=["gray", "RGB"])
@pytest.mark.parametrize("kappa", [1.0, 4.0])
def test_a_square_wave_is_measured_in_every_part(kappa: float, colour: bool) -> None:
    toggles = PilotToggles(LAYOUT)
    assert toggles.places.shape == (16, 2)
    frames = [rectified(LAYOUT, kappa * sign) for sign in WAVE]
    if colour:
        frames = [np.repeat(frame[..., None], 3, 2) for frame in frames]
    seen = toggles_of(frames)
    high, low = seen[WAVE > 0], seen[WAVE < 0]
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
        seen = toggles_of([rectified(LAYOUT, sign * alone) for sign in WAVE])
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
    values = toggles_of([rectified(few, level) for level in (2.0, -2.0)], few)
    assert values.shape == (2, len(expected))
    assert np.isfinite(values).all()


def test_a_grid_coarser_than_the_parts_has_a_place_for_each_block() -> None:
    coarse = make_layout(2, 3, 96, 64, modulation="antipodal", pilots=4)
    toggles = PilotToggles(coarse)
    assert len(toggles.places) == 4
    assert np.isfinite(toggles_of([rectified(coarse, 2.0)], coarse)).all()


def test_restless_blocks_weigh_less() -> None:
    """Half of the pilots flicker at random, by far more than the others toggle.

    With equal weights the correlation with the wave is 0.85.
    """
    rng, kappa = np.random.default_rng(0), 2.0
    restless = np.arange(LAYOUT.pilots) % 2 == 0
    frames = [
        rectified(LAYOUT, kappa * sign + 20 * restless * rng.standard_normal(LAYOUT.pilots))
        for sign in WAVE
    ]
    seen = toggles_of(frames).mean(axis=1)
    assert np.corrcoef(seen, WAVE)[0, 1] > 0.95


def test_the_picture_does_not_come_through() -> None:
    """The picture stands out of its neighbourhood by far more than pilots toggle.

    Some pilots become restless half way, so that they weigh less; what they show of the picture
    must not look like a change of what toggles.
    """
    rng, kappa = np.random.default_rng(1), 1.0
    picture = rng.uniform(60, 200, LAYOUT.rows * LAYOUT.cols).round()
    restless = rng.random(LAYOUT.pilots) < 0.3
    late = np.arange(len(WAVE)) >= len(WAVE) // 2
    frames = []
    for sign, noisy in zip(WAVE, late, strict=True):
        level = kappa * sign + 6 * noisy * restless * rng.standard_normal(LAYOUT.pilots)
        frames.append(rectified(LAYOUT, level, picture))
    still = toggles_of([rectified(LAYOUT, 0.0, picture)] * 5)
    np.testing.assert_allclose(still, 0, atol=1e-9)
    seen = toggles_of(frames).mean(axis=1)
    assert np.corrcoef(seen, WAVE)[0, 1] > 0.98


def test_what_measures_follows_from_the_layout() -> None:
    assert isinstance(make_toggles(LAYOUT), PilotToggles)
    patches = make_toggles(make_layout())
    assert isinstance(patches, PatchToggles)
    assert patches.places.shape == (5, 2)
