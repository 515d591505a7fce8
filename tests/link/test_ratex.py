from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from link.layout import MODULATIONS, Layout, make_layout
from link.ratex import (
    LEVELS,
    SAMPLES,
    TILE_ORDERS,
    TILES,
    draw_patches,
    match_patches,
    patch_correlation,
    tile_labels,
    tile_levels,
    training_pixels,
)
from link.types import Array, Image

LAYOUTS = {
    "two patches": make_layout(ratex=2),
    "16x16 grid, small": make_layout(16, 16),
    "odd size": make_layout(8, 8, 515, 389),
    "non-square": make_layout(5, 9, 641, 367),
    "seven patches": Layout(8, 8, 512, 384, tuple((k, (3 * k) % 8) for k in range(7))),
}
every_layout = pytest.mark.parametrize("layout", LAYOUTS.values(), ids=list(LAYOUTS))
every_kappa = pytest.mark.parametrize("kappa", [1, 64])


def drawn(layout: Layout, kappa: int, *, embedded: bool) -> Image:
    frame = np.full((layout.height, layout.width), 99, np.uint8)
    draw_patches(frame, layout, kappa, embedded=embedded)
    return frame


def correlation(a: Array, b: Array) -> float:
    return float(np.corrcoef(a.ravel(), b.ravel())[0, 1])


@every_layout
@every_kappa
def test_both_labels_occur_once_at_every_intensity(layout: Layout, kappa: int) -> None:
    levels, labels = tile_levels(layout, kappa), tile_labels(layout)
    tiles = sorted(zip(levels.ravel().tolist(), labels.ravel().tolist(), strict=True))
    shown = sorted(set(levels.ravel().tolist()))
    assert tiles == sorted(product(shown, (0, 1)))
    assert len(shown) == LEVELS * len(layout.ratex)


@every_layout
@every_kappa
def test_intensities_of_all_patches_span_the_range_evenly(layout: Layout, kappa: int) -> None:
    shown = np.unique(tile_levels(layout, kappa))
    assert (shown[0], shown[-1]) == (0, 255 - kappa)
    assert np.ptp(np.diff(shown)) <= 1  # even, but for rounding


@every_layout
def test_each_patch_alone_spans_most_of_the_range(layout: Layout) -> None:
    patches = tile_levels(layout, 3).reshape(len(layout.ratex), -1)
    assert (np.ptp(patches, axis=1) >= 0.85 * 252).all()


@every_layout
@every_kappa
@pytest.mark.parametrize("modulation", MODULATIONS)
def test_training_pixels_tell_what_is_drawn_under_them(
    layout: Layout, kappa: int, modulation: str
) -> None:
    """Antipodal tiles have the levels and labels of on-off ones, and toggle up or down."""
    toggling = replace(layout, modulation=modulation)
    original, embedded = (
        drawn(toggling, kappa, embedded=late).astype(int) for late in (False, True)
    )
    pixels, usual = training_pixels(toggling, kappa), training_pixels(layout, kappa)
    np.testing.assert_array_equal(original[pixels.y, pixels.x], pixels.rho)
    np.testing.assert_array_equal(pixels.label, usual.label)
    np.testing.assert_array_equal(tile_levels(toggling, kappa), tile_levels(layout, kappa))
    change = embedded[pixels.y, pixels.x] - original[pixels.y, pixels.x]
    up = {"on_off": pixels.label, "antipodal": 2 * pixels.label - 1}
    np.testing.assert_array_equal(change, kappa * up[modulation])


@pytest.mark.parametrize("embedded", [False, True])
def test_antipodal_patches_match_what_was_displayed(embedded: bool) -> None:
    layout = replace(make_layout(), modulation="antipodal")
    match = match_patches(drawn(layout, 3, embedded=embedded), layout)
    assert match.correlation.min() > 0.999
    np.testing.assert_array_equal(match.label, tile_labels(layout).reshape(5, -1))


@given(st.integers(2, 9), st.integers(2, 9), st.integers(4, 40), st.integers(4, 40), st.data())
def test_training_pixels_match_the_drawing_at_every_size_a_layout_allows(
    rows: int, cols: int, block_height: int, block_width: int, data: st.DataObject
) -> None:
    height = rows * block_height + data.draw(st.integers(0, rows - 1))
    width = cols * block_width + data.draw(st.integers(0, cols - 1))
    layout = make_layout(rows, cols, width, height, ratex=2)
    pixels = training_pixels(layout, 5)
    original = drawn(layout, 5, embedded=False)
    np.testing.assert_array_equal(original[pixels.y, pixels.x], pixels.rho)


@every_layout
def test_drawing_leaves_the_message_blocks_alone(layout: Layout) -> None:
    frame = drawn(layout, 3, embedded=True)
    for row, col in np.argwhere(layout.message_mask).tolist():
        top, bottom, left, right = layout.cell_box(row, col)
        assert (frame[top:bottom, left:right] == 99).all()


def test_colour_frames_show_the_same_gray_in_every_channel(layout: Layout) -> None:
    colour = np.full((layout.height, layout.width, 3), 99, np.uint8)
    draw_patches(colour, layout, 3, embedded=True)
    gray = drawn(layout, 3, embedded=True)
    np.testing.assert_array_equal(colour, np.repeat(gray[:, :, None], 3, axis=2))


@every_layout
def test_there_are_36_training_pixels_in_each_tile(layout: Layout) -> None:
    pixels = training_pixels(layout, 3)
    tile_y = pixels.y * layout.rows * TILES // layout.height
    tile_x = pixels.x * layout.cols * TILES // layout.width
    _, counts = np.unique(np.stack([tile_y, tile_x]), axis=1, return_counts=True)
    assert counts.tolist() == [SAMPLES**2] * (TILES**2 * len(layout.ratex))


def test_training_pixels_lie_in_the_inner_half_of_their_tile() -> None:
    layout = make_layout()  # tiles of 16x12 pixels
    pixels = training_pixels(layout)
    assert set((pixels.x % 16).tolist()) <= set(range(4, 12))
    assert set((pixels.y % 12).tolist()) == set(range(3, 9))


@every_layout
def test_training_pixels_touch_the_inner_half_at_any_size(layout: Layout) -> None:
    pixels = training_pixels(layout)
    for position, length, count in (
        (pixels.y, layout.height, layout.rows),
        (pixels.x, layout.width, layout.cols),
    ):
        tile = length / (count * TILES)  # pixels
        from_middle = np.abs((position + 0.5) / tile % 1 - 0.5)
        assert (from_middle <= 0.25 + 0.5 / tile).all()


def test_no_patches_give_no_training_pixels() -> None:
    pixels = training_pixels(make_layout(ratex=0), 3)
    assert [len(v) for v in (pixels.y, pixels.x, pixels.rho, pixels.label)] == [0, 0, 0, 0]


def test_the_first_patch_is_what_every_receiver_expects() -> None:
    """Golden: a display and a receiver of different versions must agree on it."""
    layout = make_layout(ratex=1)
    assert tile_labels(layout)[0, :2].tolist() == [[0, 0, 1, 1], [0, 1, 0, 1]]
    assert tile_levels(layout, 3)[0, :2].tolist() == [[36, 216, 0, 216], [72, 108, 108, 180]]


@pytest.mark.parametrize("patch", range(len(TILE_ORDERS)))
def test_labels_are_balanced_over_rows_and_columns(patch: int) -> None:
    labels = (TILE_ORDERS[patch] % 2).reshape(TILES, TILES)
    assert (labels.sum(axis=0) == TILES // 2).all()
    assert (labels.sum(axis=1) == TILES // 2).all()


def test_tile_orders_differ_from_one_another_under_every_rotation() -> None:
    ranks = [(order // 2).reshape(TILES, TILES) for order in TILE_ORDERS]
    for a, b in product(range(len(ranks)), repeat=2):
        for turns in range(4):
            if a != b or turns != 0:
                assert correlation(ranks[a], np.rot90(ranks[b], turns)) < 0.24


@pytest.mark.parametrize("turns", range(4))
def test_the_corner_patches_tell_which_way_up_the_display_is(turns: int) -> None:
    layout = make_layout(8, 8, 256, 256)
    corners = [k for k, (row, col) in enumerate(layout.ratex) if {row, col} <= {0, 7}]
    frame = drawn(layout, 3, embedded=False)
    seen = np.rot90(255 * (frame / 255) ** 2.2, turns)  # through a camera held that way

    matches = []
    for back in range(4):
        upright = np.rot90(seen, -back)
        tiles = upright.reshape(32, 8, 32, 8).mean(axis=(1, 3))
        patches = [tiles[4 * r : 4 * r + 4, 4 * c : 4 * c + 4] for r, c in layout.ratex]
        shown = np.stack(patches)[corners]
        matches.append(correlation(shown, tile_levels(layout, 3)[corners]))

    assert len(corners) == 4
    assert np.argmax(matches) == turns
    assert sorted(matches)[-2] < 0.5 < 0.9 < matches[turns]


def test_patches_are_visible_through_a_curve_and_nowhere_else() -> None:
    rng = np.random.default_rng(0)
    layout = make_layout()
    frame = np.full((layout.height, layout.width), 90, np.uint8)
    assert abs(patch_correlation(frame, layout)) < 0.1
    draw_patches(frame, layout, 5, embedded=False)
    curved = (255 * (frame / 255.0) ** 0.6 * 0.7 + 20 + rng.normal(0, 3, frame.shape)).astype(
        np.uint8
    )
    assert patch_correlation(curved, layout) > 0.95
    assert patch_correlation(np.repeat(curved[::2, ::2, None], 3, axis=2), layout) > 0.95
    for turned in (curved[::-1, ::-1], curved[:, ::-1]):
        assert patch_correlation(turned, layout) < 0.5
