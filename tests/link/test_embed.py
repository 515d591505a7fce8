from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest
from conftest import cases
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray
from skimage.metrics import peak_signal_noise_ratio, structural_similarity
from tolerances import FLOAT32, FLOAT64

from link.embed import (
    BLACK,
    BOTTOM,
    MAX_KAPPA,
    TOP,
    WHITE,
    check_kappa,
    embed,
    levels_of_steps,
    split_change,
    with_head_room,
)
from link.errors import InputError
from link.images.quality import psnr, ssim
from link.layout import (
    Layout,
    block_index,
    make_layout,
)
from link.strength import block_steps
from link.types import Array, Image

SMALL = make_layout(4, 4, 160, 128, ratex=2)  # blocks of 40x32 pixels


def noise(layout: Layout, *channels: int, seed: int = 0) -> Image:
    rng = np.random.default_rng(seed)
    return rng.integers(0, 256, (layout.height, layout.width, *channels), np.uint8)


def random_bits(layout: Layout, seed: int = 1) -> NDArray[np.int64]:
    return np.random.default_rng(seed).integers(0, 2, layout.n_bits)


def message_pixels(layout: Layout) -> NDArray[np.bool_]:
    """(height, width), true where a pixel belongs to a message block."""
    of_y, of_x = (block_index(layout.height, layout.rows), block_index(layout.width, layout.cols))
    return layout.message_mask[of_y[:, None], of_x]


@pytest.mark.parametrize("channels", [(), (3,)], ids=["gray", "colour"])
def test_ratex_tiles_toggle_by_kappa_as_blocks_do(
    layout: Layout, channels: tuple[int, ...]
) -> None:
    displayed = embed(noise(layout, *channels), random_bits(layout), layout, 10)
    change = displayed.embedded.astype(int) - displayed.original
    assert set(change.ravel().tolist()) == {0, 10}
    assert np.mean(change[~message_pixels(layout)] == 10) == 0.5
    assert displayed.kappa == 10


def test_ratex_patches_reach_from_black_to_white(layout: Layout) -> None:
    displayed = embed(noise(layout), random_bits(layout), layout, 30)
    patches = displayed.embedded[~message_pixels(layout)]
    assert (patches.min(), patches.max()) == (0, 255)


# Antipodal blocks and pilots

PILOTS = make_layout(8, 8, 157, 131, modulation="antipodal", pilots=16)
channels_both = pytest.mark.parametrize("channels", [(), (3,)], ids=["gray", "colour"])


def blocks_of(layout: Layout, bits: NDArray[np.int64]) -> NDArray[np.int64]:
    """(height, width) bit of the block to which each pixel belongs, known bits of pilots too."""
    grid = np.full(layout.rows * layout.cols, -1)
    grid[layout.message_mask.ravel()] = bits
    grid[layout.pilot_blocks] = layout.pilot_bits
    rows, cols = block_index(layout.height, layout.rows), block_index(layout.width, layout.cols)
    return np.asarray(grid.reshape(layout.rows, layout.cols)[rows[:, None], cols])


def planes(frame: Image) -> NDArray[np.intp]:
    """(channels, height, width) levels of a gray or colour frame."""
    return np.atleast_3d(frame).transpose(2, 0, 1).astype(np.intp)


@channels_both
@pytest.mark.parametrize("kappa", [1, 4, 64])
def test_antipodal_blocks_and_pilots_change_by_exactly_kappa_up_or_down(
    kappa: int, channels: tuple[int, ...]
) -> None:
    bits = random_bits(PILOTS)
    displayed = embed(noise(PILOTS, *channels), bits, PILOTS, kappa)
    expected = kappa * (2 * blocks_of(PILOTS, bits) - 1)
    for change in planes(displayed.embedded) - planes(displayed.original):
        np.testing.assert_array_equal(change, expected)


@channels_both
@pytest.mark.parametrize("kappa", [1, 4])
def test_the_mean_over_time_of_antipodal_frames_is_the_picture(
    kappa: int, channels: tuple[int, ...]
) -> None:
    picture = noise(PILOTS, *channels)
    shown = planes(with_head_room(picture, kappa, "antipodal"))
    displayed = embed(picture, random_bits(PILOTS), PILOTS, kappa)
    surplus = planes(displayed.original) + planes(displayed.embedded) - 2 * shown
    inside = blocks_of(PILOTS, random_bits(PILOTS))
    even = (inside[:-1, :-1] == inside[1:, 1:]) & (inside[:-1, 1:] == inside[1:, :-1])
    even &= inside[:-1, :-1] == inside[:-1, 1:]
    assert even.mean() > 0.7
    for plane in surplus:
        assert set(np.unique(plane).tolist()) == ({0} if kappa % 2 == 0 else {-1, 1})
        four = plane[:-1, :-1] + plane[1:, :-1] + plane[:-1, 1:] + plane[1:, 1:]
        assert (four[even] == 0).all()  # every 2 x 2 pixels within blocks of one bit
        assert abs(plane.mean()) < 0.02


@pytest.mark.parametrize("kappa", [1, 3, 10, 64])
def test_a_knee_bends_the_ends_of_the_tones_alone(kappa: int) -> None:
    levels = np.arange(256, dtype=np.uint8)[None]
    shown = with_head_room(levels, kappa, "antipodal")[0].astype(int)
    room = -(-kappa // 2)
    low = max(room, min(BOTTOM, BLACK * kappa))
    high = max(room, min(255 - TOP, WHITE * (kappa - 1)))
    assert (shown[0], shown[-1]) == (low, 255 - high)
    inside = slice(2 * low, 256 - 2 * high)
    np.testing.assert_array_equal(shown[inside], levels[0, inside])
    assert (np.diff(shown) >= 0).all()
    assert np.abs(shown - levels[0]).max() <= max(low, high)


@channels_both
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("kappa", [1, 2, 3])
def test_the_mean_of_two_pairs_is_the_picture_in_every_pixel(
    kappa: int, seed: int, channels: tuple[int, ...]
) -> None:
    """Where a block has the same bit twice, and between blocks where it has not."""
    picture = noise(PILOTS, *channels)
    steps = block_steps(picture, PILOTS) if seed else None
    levels = levels_of_steps(kappa, steps, PILOTS)
    shown = planes(with_head_room(picture, kappa, "antipodal", levels))
    first, second = random_bits(PILOTS, seed), random_bits(PILOTS, seed + 1)
    total = np.zeros(shown.shape, int)
    for bits in (first, second):
        for turned in (False, True):
            pair = embed(picture, bits, PILOTS, kappa, steps=steps, turned=turned)
            total += planes(pair.original) + planes(pair.embedded)
    np.testing.assert_array_equal(total, 8 * shown)


def test_pilots_of_on_off_blocks_change_as_bits_do() -> None:
    layout = replace(PILOTS, modulation="on_off")
    bits = random_bits(layout)
    displayed = embed(noise(layout, 3), bits, layout, 3)
    for change in planes(displayed.embedded) - planes(displayed.original):
        np.testing.assert_array_equal(change, 3 * blocks_of(layout, bits))


@channels_both
@pytest.mark.parametrize("kappa", [1, 5, 64])
def test_on_off_frames_are_those_of_the_papers_formula(
    kappa: int, channels: tuple[int, ...]
) -> None:
    picture, bits = noise(SMALL, *channels), random_bits(SMALL)
    displayed = embed(picture, bits, SMALL, kappa)
    levels = np.linspace(BOTTOM, TOP - kappa, 256).round().astype(np.uint8)
    added = (kappa * blocks_of(SMALL, bits)).astype(np.uint8)
    inside = message_pixels(SMALL)
    original = levels[picture]
    embedded = original + (added[:, :, None] if channels else added)
    np.testing.assert_array_equal(displayed.original[inside], original[inside])
    np.testing.assert_array_equal(displayed.embedded[inside], embedded[inside])


@given(arrays(np.intp, (6, 8), elements=st.integers(-MAX_KAPPA, MAX_KAPPA)))
def test_changes_are_split_into_halves_a_level_apart_at_most(change: NDArray[np.intp]) -> None:
    below, above = split_change(change.astype(np.float64), 0.5)
    np.testing.assert_array_equal(below + above, change)
    assert (np.abs(above - below) == change % 2).all()
    y, x = np.indices(change.shape)
    np.testing.assert_array_equal(below, (change + (y + x) % 2) // 2)  # a chessboard
    assert (split_change(change + 1.0, 0.5)[0] >= below).all()
    whole = split_change(change.astype(np.float64), 0.0)
    np.testing.assert_array_equal(whole, [np.zeros_like(change), change])


@given(st.floats(-64, 64), st.sampled_from([0.0, 0.5]), st.integers(0, 3), st.integers(0, 3))
def test_any_change_is_dithered_right_over_each_4_x_4_pixels(
    change: float, before: float, top: int, left: int
) -> None:
    below, above = split_change(np.full((7, 7), change), before)
    window = np.s_[top : top + 4, left : left + 4]
    assert below[window].mean() == pytest.approx(before * change, abs=1 / 32 + FLOAT64)
    assert above[window].mean() == pytest.approx((1 - before) * change, abs=1 / 32 + FLOAT64)
    for part, exact in ((below, before * change), (above, (1 - before) * change)):
        assert np.abs(part - exact).max() <= 1
    if before == 0.5 and 0.01 < 32 * change % 1 < 0.99:  # no pixel is at its threshold
        assert below[window].mean() == above[window].mean()
        turned = split_change(np.full((7, 7), -change), before)
        np.testing.assert_array_equal(turned, [-above, -below])


def test_the_picture_passed_in_is_not_changed(layout: Layout) -> None:
    picture = noise(layout, 3)
    before = picture.copy()
    embed(picture, random_bits(layout), layout, 5)
    np.testing.assert_array_equal(picture, before)


@pytest.mark.parametrize("channels", [(), (3,)], ids=["gray", "colour"])
def test_psnr_agrees_with_scikit_image(layout: Layout, channels: tuple[int, ...]) -> None:
    pair = embed(noise(layout, *channels), random_bits(layout), layout, 5)
    expected = peak_signal_noise_ratio(pair.original, pair.embedded, data_range=255)
    assert psnr(pair.original, pair.embedded) == pytest.approx(expected, abs=FLOAT64)
    assert psnr(pair.original, pair.original) == float("inf")


@pytest.mark.parametrize("channels", [(), (3,)], ids=["gray", "colour"])
def test_ssim_agrees_with_scikit_image(channels: tuple[int, ...]) -> None:
    smooth = cv2.GaussianBlur(noise(SMALL, *channels), (0, 0), 3)
    pair = embed(smooth, random_bits(SMALL), SMALL, 10)
    expected = structural_similarity(
        pair.original,
        pair.embedded,
        gaussian_weights=True,
        sigma=1.5,
        use_sample_covariance=False,
        data_range=255,
        channel_axis=2 if channels else None,
    )
    assert expected < 0.99
    assert ssim(pair.original, pair.embedded) == pytest.approx(expected, abs=FLOAT32)
    assert ssim(pair.original, pair.original) == pytest.approx(1, abs=FLOAT32)


@pytest.mark.parametrize("kappa", [0, -3, MAX_KAPPA + 1, 2.5, float("nan")])
def test_kappa_must_be_a_whole_number_in_range(layout: Layout, kappa: Any) -> None:
    with pytest.raises(InputError, match=f"^kappa: need 1 to 64 whole gray levels, got {kappa}"):
        embed(noise(layout), random_bits(layout), layout, kappa)


def test_a_whole_kappa_of_any_type_becomes_an_int() -> None:
    kappas: list[Any] = [3, 3.0, np.int64(3)]
    assert [type(check_kappa(kappa)) for kappa in kappas] == [int, int, int]


@cases(np.zeros(58), np.zeros((1, 59)), np.full(59, 2), np.full(59, 0.5), np.full(59, np.nan))
def test_bits_must_fit_the_layout(bits: Array, layout: Layout) -> None:
    with pytest.raises(InputError, match="need 59 bits of 0 or 1"):
        embed(noise(layout), bits, layout, 3)


def test_the_picture_must_have_the_layouts_size(layout: Layout) -> None:
    with pytest.raises(InputError, match="picture is 384x512, the layout needs 512x384"):
        embed(noise(layout).T, random_bits(layout), layout, 3)
