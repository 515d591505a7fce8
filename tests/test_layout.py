import json
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from tolerances import FLOAT64

from link.errors import InputError
from link.layout import MAX_SIDE_PX, MIN_BLOCK_PX, Layout, block_index, block_mean, make_layout


@st.composite
def layouts(draw: st.DrawFn) -> Layout:
    rows, cols = draw(st.integers(1, 12)), draw(st.integers(1, 12))
    width = draw(st.integers(cols * MIN_BLOCK_PX, 300))
    height = draw(st.integers(rows * MIN_BLOCK_PX, 300))
    cell = st.tuples(st.integers(0, rows - 1), st.integers(0, cols - 1))
    cells = draw(st.lists(cell, unique=True, max_size=min(7, rows * cols - 1)))
    return Layout(rows, cols, width, height, tuple(cells))


def as_dict(**changes: Any) -> dict[str, Any]:
    return {**make_layout().to_dict(), **changes}


def test_the_default_layout_carries_59_bits_and_5_patches() -> None:
    layout = make_layout()
    assert (layout.rows, layout.cols, layout.width, layout.height) == (8, 8, 512, 384)
    assert layout.n_bits == 59
    assert set(layout.ratex) == {(0, 0), (0, 7), (7, 0), (7, 7), (4, 4)}


@pytest.mark.parametrize(("rows", "cols"), [(8, 8), (16, 16), (6, 10), (1, 9)])
def test_without_patches_every_block_carries_a_bit(rows: int, cols: int) -> None:
    layout = make_layout(rows, cols, ratex=0)
    assert layout.n_bits == rows * cols
    assert layout.message_mask.shape == (rows, cols)
    assert layout.message_mask.all()


@pytest.mark.parametrize(("rows", "cols"), [(16, 16), (6, 10), (5, 3)])
@pytest.mark.parametrize("ratex", [1, 2, 3, 5])
def test_each_patch_takes_one_message_block(rows: int, cols: int, ratex: int) -> None:
    layout = make_layout(rows, cols, ratex=ratex)
    assert len(layout.ratex) == ratex
    assert layout.n_bits == rows * cols - ratex
    assert layout.message_mask.sum() == layout.n_bits
    assert not any(layout.message_mask[cell] for cell in layout.ratex)


def test_one_patch_is_a_corner_and_two_lie_on_a_diagonal() -> None:
    assert make_layout(6, 10, ratex=1).ratex == ((0, 0),)
    assert make_layout(6, 10, ratex=2).ratex == ((0, 0), (5, 9))


@given(layouts())
def test_json_round_trip(layout: Layout) -> None:
    assert Layout.from_dict(json.loads(json.dumps(layout.to_dict()))) == layout


@given(layouts())
def test_cell_boxes_hold_the_pixels_that_block_index_gives_them(layout: Layout) -> None:
    of_y, of_x = block_index(layout.height, layout.rows), block_index(layout.width, layout.cols)
    for row, col in np.ndindex(layout.rows, layout.cols):
        top, bottom, left, right = layout.cell_box(row, col)
        assert np.flatnonzero(of_y == row).tolist() == list(range(top, bottom))
        assert np.flatnonzero(of_x == col).tolist() == list(range(left, right))
        assert min(bottom - top, right - left) >= MIN_BLOCK_PX


@pytest.mark.slow
@given(st.data())
def test_block_mean_is_the_mean_over_each_block(data: st.DataObject) -> None:
    height, width = data.draw(st.integers(1, 60)), data.draw(st.integers(1, 60))
    rows, cols = data.draw(st.integers(1, height)), data.draw(st.integers(1, width))
    maps = data.draw(arrays(np.float64, (2, height, width), elements=st.floats(-1, 1)))
    of_y, of_x = block_index(height, rows), block_index(width, cols)
    expected = np.empty((2, rows, cols))
    for channel, row, col in np.ndindex(expected.shape):
        expected[channel, row, col] = maps[channel, of_y == row][:, of_x == col].mean()
    np.testing.assert_allclose(block_mean(maps, rows, cols), expected, rtol=0, atol=FLOAT64)


def test_block_mean_keeps_the_dtype() -> None:
    assert block_mean(np.ones((9, 9), np.float32), 2, 2).dtype == np.float32


@pytest.mark.parametrize("cell", [(8, 0), (0, 8), (-1, 3), (3, -1)])
def test_a_patch_outside_the_grid_is_named(cell: tuple[int, int]) -> None:
    with pytest.raises(InputError, match=rf"\({cell[0]}, {cell[1]}\) lies outside the grid"):
        replace(make_layout(), ratex=(cell,))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"ratex": ((1, 2), (3, 3), (1, 2))}, "listed twice"),
        ({"rows": 0}, "rows and cols must be positive, got 0x8"),
        ({"cols": -1}, "rows and cols must be positive, got 8x-1"),
        ({"width": 31}, "at least 32x32 pixels, got 31x384"),
        ({"height": 31}, "at least 32x32 pixels, got 512x31"),
        ({"width": MAX_SIDE_PX + 1}, f"larger than {MAX_SIDE_PX}"),
        ({"height": MAX_SIDE_PX + 1}, f"larger than {MAX_SIDE_PX}"),
        ({"width": 5000, "height": 5000}, "5000x5000 frame has more than 20000000 pixels"),
        ({"rows": 129, "cols": 128, "width": 600, "height": 600}, "128x129 blocks are more than"),
        ({"rows": 1, "cols": 1, "ratex": ((0, 0),)}, "no block is left"),
    ],
)
def test_a_grid_that_does_not_fit_says_why(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        replace(make_layout(), **changes)


@pytest.mark.parametrize("ratex", [4, 6, -1])
def test_the_number_of_patches_is_one_of_five(ratex: int) -> None:
    with pytest.raises(InputError, match=f"0, 1, 2, 3 or 5 patches, got {ratex}"):
        make_layout(ratex=ratex)


def test_patches_that_coincide_in_a_small_grid_are_refused() -> None:
    with pytest.raises(InputError, match="no room for 5 patches"):
        make_layout(2, 2, ratex=5)


@pytest.mark.parametrize("key", ["rows", "cols", "width", "height", "ratex"])
def test_every_key_is_needed(key: str) -> None:
    data = as_dict()
    del data[key]
    with pytest.raises(InputError, match="need the keys rows, cols, width, height, ratex, and"):
        Layout.from_dict(data)


@pytest.mark.parametrize("data", [None, [], "layout", 5, as_dict(depth=3)])
def test_anything_but_the_five_keys_is_refused(data: Any) -> None:
    with pytest.raises(InputError, match="need the keys"):
        Layout.from_dict(data)


@pytest.mark.parametrize("key", ["rows", "cols", "width", "height"])
@pytest.mark.parametrize("value", ["8", 8.0, None, True, [8]])
def test_sizes_must_be_whole_numbers(key: str, value: Any) -> None:
    with pytest.raises(InputError, match=f"layout: {key} must be a whole number"):
        Layout.from_dict(as_dict(**{key: value}))


@pytest.mark.parametrize(
    "ratex",
    [None, 5, [5], [[0]], [[0, 1, 2]], [[0, None]], [["a", "b"]], [[math.nan, 0]]],
)
def test_patches_must_be_pairs(ratex: Any) -> None:
    with pytest.raises(InputError, match="ratex must be a list of"):
        Layout.from_dict(as_dict(ratex=ratex))


@pytest.mark.parametrize("ratex", [[[0.5, 1]], ["12"], [[0, "1"]], [[math.inf, 0]]])
def test_patches_must_be_whole_numbers(ratex: Any) -> None:
    with pytest.raises(InputError, match="ratex must be a list of"):
        Layout.from_dict(as_dict(ratex=ratex))
