import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import cases
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from tolerances import FLOAT64

from link.errors import InputError, ParameterError
from link.layout import (
    MAX_SIDE_PX,
    MIN_BLOCK_PX,
    MODULATIONS,
    Layout,
    block_index,
    block_mean,
    count_pilots,
    make_layout,
    read_layout,
)
from link.presets import PRESETS


@st.composite
def layouts(draw: st.DrawFn) -> Layout:
    rows, cols = draw(st.integers(1, 12)), draw(st.integers(1, 12))
    width = draw(st.integers(cols * MIN_BLOCK_PX, 300))
    height = draw(st.integers(rows * MIN_BLOCK_PX, 300))
    cell = st.tuples(st.integers(0, rows - 1), st.integers(0, cols - 1))
    modulation = draw(st.sampled_from(list(MODULATIONS)))
    if rows * cols > 2 and draw(st.booleans()):
        pilots = draw(st.integers(2, rows * cols - 1))
        return Layout(rows, cols, width, height, (), modulation, pilots)
    cells = draw(st.lists(cell, unique=True, max_size=min(7, rows * cols - 1)))
    return Layout(rows, cols, width, height, tuple(cells), modulation)


def as_dict(**changes: Any) -> dict[str, Any]:
    return {**make_layout().to_dict(), **changes}


def test_the_default_layout_carries_59_bits_and_5_patches() -> None:
    layout = make_layout()
    assert (layout.rows, layout.cols, layout.width, layout.height) == (8, 8, 512, 384)
    assert layout.n_bits == 59
    assert set(layout.ratex) == {(0, 0), (0, 7), (7, 0), (7, 7), (4, 4)}


def test_one_patch_is_a_corner_and_two_lie_on_a_diagonal() -> None:
    assert make_layout(6, 10, ratex=1).ratex == ((0, 0),)
    assert make_layout(6, 10, ratex=2).ratex == ((0, 0), (5, 9))
    assert len(make_layout(6, 10, ratex=3).ratex) == 3


@given(layouts())
def test_json_round_trip(layout: Layout) -> None:
    assert Layout.from_dict(json.loads(json.dumps(layout.to_dict()))) == layout


@given(layouts())
def test_json_holds_the_later_keys_only_where_they_say_something(layout: Layout) -> None:
    described = layout.to_dict()
    first = ["rows", "cols", "width", "height", "ratex"]
    assert list(described)[:5] == first
    assert ("modulation" in described) == (layout.modulation != "on_off")
    assert ("pilots" in described) == (layout.pilots > 0)
    assert Layout.from_dict({key: described[key] for key in first}) == replace(
        layout, modulation="on_off", pilots=0
    )


def test_the_usual_layout_writes_the_bytes_that_it_has_always_written() -> None:
    """Golden: manifests, models and stored runs hold this text."""
    written = json.dumps(make_layout().to_dict())
    assert written == (
        '{"rows": 8, "cols": 8, "width": 512, "height": 384, '
        '"ratex": [[0, 0], [7, 7], [0, 7], [7, 0], [4, 4]]}'
    )
    layout = Layout.from_dict(json.loads(written))
    assert (layout.modulation, layout.pilots, layout) == ("on_off", 0, make_layout())


@given(layouts())
def test_every_block_is_message_patch_or_pilot(layout: Layout) -> None:
    assert layout.message_mask.sum() == layout.n_bits >= 1
    mask = layout.message_mask.copy()
    for cell in layout.ratex:
        assert not mask[cell]
        mask[cell] = True
    blocks = layout.pilot_blocks
    assert len(set(blocks.tolist())) == len(blocks) == len(layout.pilot_bits) == layout.pilots
    assert not mask.reshape(-1)[blocks].any()
    mask.reshape(-1)[blocks] = True
    assert mask.all()
    assert abs(2 * int(layout.pilot_bits.sum()) - layout.pilots) <= 1  # as many ones as zeros


@given(layouts(), st.data())
def test_more_pilots_keep_the_fewer(layout: Layout, data: st.DataObject) -> None:
    if layout.pilots:
        fewer = replace(layout, pilots=data.draw(st.integers(2, layout.pilots)))
        kept = slice(0, fewer.pilots)
        np.testing.assert_array_equal(layout.pilot_blocks[kept], fewer.pilot_blocks)


@cases(
    (8, 8, [53, 33, 2, 42, 32, 43, 41, 4, 52, 49, 6, 56, 18, 31, 37, 62]),
    (24, 32, [410, 366, 503, 254, 566, 203, 543, 735, 319, 53, 572, 514, 33, 709, 94, 249]),
)
def test_the_first_pilots_are_where_every_receiver_expects_them(
    rows: int, cols: int, blocks: list[int]
) -> None:
    """Golden: a display and a receiver of different versions must agree on it."""
    layout = make_layout(rows, cols, pilots=16)
    assert layout.pilot_blocks.tolist() == blocks
    in_reading_order = np.argsort(layout.pilot_blocks)
    assert layout.pilot_bits[in_reading_order].tolist() == [0, 1] * 8


@cases((16, 16), (24, 32), (48, 64), (96, 128))
def test_pilots_of_either_bit_are_spread_over_the_frame(rows: int, cols: int) -> None:
    layout = make_layout(rows, cols, pilots=count_pilots("auto", rows, cols))
    row, col = np.divmod(layout.pilot_blocks, cols)
    share = 1 / np.sqrt(layout.pilots)
    for bit in (0, 1):
        mine = layout.pilot_bits == bit
        for place, count in ((row[mine], rows), (col[mine], cols)):
            assert abs(place.mean() / (count - 1) - 0.5) < 3 * np.sqrt(2 / 12) * share
            assert np.ptp(place) >= (0.8 if layout.pilots > 20 else 0.6) * (count - 1)
    quarter = (row * 2 // rows) * 2 + col * 2 // cols
    assert np.bincount(quarter, minlength=4).min() >= 1


@cases(
    ("0", 8, 8, 0),
    ("auto", 8, 8, 16),
    ("auto", 24, 32, 38),
    ("auto", 96, 128, 614),
    ("auto", 3, 3, 2),
    ("0.25", 8, 8, 16),
    ("1e-1", 24, 32, 77),
)
def test_shares_of_pilots_become_numbers(pilots: str, rows: int, cols: int, count: int) -> None:
    assert count_pilots(pilots, rows, cols) == count


def test_a_coded_display_has_more_pilots() -> None:
    """Finding it takes more evidence: more clocks may explain it by chance."""
    coded = PRESETS["hidden"].layout
    assert coded.pilots == 307 > count_pilots("auto", coded.rows, coded.cols)


@pytest.mark.parametrize("pilots", ["", "-0.1", "1", "nan", "AUTO", "5%"])
def test_what_is_no_share_of_pilots_is_refused(pilots: str) -> None:
    with pytest.raises(ParameterError, match=r"^pilots: need auto, or a share from 0 to below 1"):
        count_pilots(pilots, 8, 8)


@pytest.mark.parametrize("pilots", ["0.001", "0.02", "1e-300"])
def test_a_share_of_less_than_two_pilots_is_no_wish_for_patches(pilots: str) -> None:
    with pytest.raises(ParameterError, match="of 8x8 blocks is less than 2 pilots; give a larger"):
        count_pilots(pilots, 8, 8)


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


@pytest.mark.parametrize("cell", [(8, 0), (3, -1)])
def test_a_patch_outside_the_grid_is_named(cell: tuple[int, int]) -> None:
    with pytest.raises(InputError, match=rf"\({cell[0]}, {cell[1]}\) lies outside the grid"):
        replace(make_layout(), ratex=(cell,))


@cases(
    ({"ratex": ((1, 2), (3, 3), (1, 2))}, "listed twice"),
    ({"rows": 0}, "rows and cols must be positive, got 0x8"),
    ({"width": 31}, "at least 32x32 pixels, got 31x384"),
    ({"width": MAX_SIDE_PX + 1}, f"larger than {MAX_SIDE_PX}"),
    ({"width": 5000, "height": 5000}, "5000x5000 frame has more than 20000000 pixels"),
    ({"rows": 129, "cols": 128, "width": 600, "height": 600}, "128x129 blocks are more than"),
    ({"rows": 1, "cols": 1, "ratex": ((0, 0),)}, "no block is left"),
    ({"ratex": (), "pilots": 64}, "no block is left"),
    ({"ratex": (), "pilots": 1}, "need 2 pilots, so that both bits occur, got 1"),
    ({"pilots": 2}, "pilots beside ratex patches"),
    ({"modulation": "onoff"}, "unknown modulation 'onoff'; choose one of: on_off, antipodal"),
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


FIVE = ("rows", "cols", "width", "height", "ratex")
LACKING = [{key: as_dict()[key] for key in FIVE if key != lacks} for lacks in FIVE]


@pytest.mark.parametrize("data", [None, [], "layout", 5, as_dict(depth=3), *LACKING])
def test_anything_but_the_five_keys_is_refused(data: Any) -> None:
    with pytest.raises(InputError, match=f"need the keys {', '.join(FIVE)}, and"):
        Layout.from_dict(data)


@cases(
    ({"rows": "8"}, "rows must be a whole number"),
    ({"cols": 8.0}, "cols must be a whole number"),
    ({"width": True}, "width must be a whole number"),
    ({"height": None}, "height must be a whole number"),
    ({"ratex": [], "pilots": True}, "pilots must be a whole number"),
    ({"modulation": ["antipodal"]}, "modulation must be text"),
    *(({"ratex": r}, "ratex must be a list of") for r in (None, [5], [[0, 1, 2]], [["a", "b"]])),
    *(({"ratex": r}, "ratex must be a list of") for r in ([[math.nan, 0]], [[0.5, 1]])),
)
def test_what_is_of_another_type_is_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=f"layout: {message}"):
        Layout.from_dict(as_dict(**changes))


def test_what_was_sent_is_a_layout_too(tmp_path: Path) -> None:
    layout = PRESETS["robust"].layout
    sent = {"frame_pairs": 3, "layout": layout.to_dict()}
    (tmp_path / "sent.json").write_text(json.dumps(sent))
    assert read_layout(tmp_path / "sent.json") == layout
