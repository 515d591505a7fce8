from dataclasses import replace

import cv2
import numpy as np
import pytest
from conftest import cases, slow
from numpy.typing import NDArray

from data_gen.channel.stills import capture
from data_gen.frame_pair import Cell, FramePair, Source, shuffled_pictures
from data_gen.pairs import get_pair
from link.embed import embed
from link.frames import Captured
from link.images import intensity
from link.layout import Layout, make_layout
from link.observation import Observation
from link.types import Image
from models import DECODERS, make_decoder
from models.blind.blind import SIGNAL_SPREAD, fit, log_odds
from models.blind.register import REACH_PX, align_frames, high_pass, whole_pixel_shift
from models.blind.tones import TONES, cut_into_tones

NO_PATCHES = make_layout(ratex=0)


@pytest.fixture(scope="module")
def filmed() -> Captured:
    """A frame pair without patches, canon-lg, 45 degrees, kappa 3."""
    return FramePair(Source(NO_PATCHES), Cell("canon-lg", 45.0, 3), 4, equalised=True).captured


@pytest.fixture(scope="module")
def scene() -> Image:
    """A textured picture, (384, 512, 3) uint8."""
    picture = shuffled_pictures(Source(NO_PATCHES))[0]
    return picture.rgb


def truth(captured: Captured) -> NDArray[np.intp]:
    assert captured.bits is not None
    return captured.bits


def errors(pair: Observation, bits: NDArray[np.intp], method: str = "blind") -> int:
    return int((make_decoder(method).decode(pair).bits != bits).sum())


def message(
    share: float, layout: Layout = NO_PATCHES, kappa: int = 3, picture: int = 2
) -> Captured:
    """A frame pair of sony-imac at 0 degrees with this share of ones; not equalised."""
    rng = np.random.default_rng(5)
    bits = (rng.permutation(layout.n_bits) < round(share * layout.n_bits)).astype(int)
    shown = shuffled_pictures(Source(layout))[picture].rgb
    return capture(embed(shown, bits, layout, kappa), get_pair("sony-imac"), 0.0, rng)


def test_blind_reads_every_bit_and_wants_neither_patches_nor_kappa(filmed: Captured) -> None:
    assert DECODERS["blind"].equalised
    pair = filmed.rectified()
    assert errors(pair, truth(filmed)) == 0
    known = make_decoder("blind").decode(pair).scores
    unknown = make_decoder("blind").decode(replace(pair, kappa=None)).scores
    np.testing.assert_array_equal(known, unknown)


@cases((8, 0), slow(16, 4))
@pytest.mark.parametrize("method", ["blind", "hidden_ratex"])
def test_antipodal_messages_are_read_without_patches(side: int, wrong: int, method: str) -> None:
    """The darkest of 16 x 16 blocks emit next to nothing, so that some of their bits are lost."""
    layout = make_layout(side, side, ratex=0, modulation="antipodal")
    for index in (1, 4):
        pair = FramePair(Source(layout), Cell("canon-lg", 45.0, 3), index, equalised=True)
        assert errors(pair.rectified, pair.displayed.bits, method) <= wrong


@pytest.mark.slow
def test_a_swapped_antipodal_pair_flips_the_bits() -> None:
    layout = make_layout(ratex=0, modulation="antipodal", pilots=16)
    pair = FramePair(Source(layout), Cell("nikon-samsung", 45.0, 3), 0, equalised=True)
    captured, bits = pair.captured, pair.displayed.bits
    assert errors(captured.rectified(), bits) == 0
    swapped = replace(captured, original=captured.embedded, embedded=captured.original)
    assert errors(swapped.rectified(), 1 - bits) == 0


def test_blind_reads_gray_frames(filmed: Captured) -> None:
    pair = filmed.rectified()
    frames = [(255 * intensity(f)).round().astype(np.uint8) for f in (pair.original, pair.embedded)]
    assert errors(replace(pair, frames=tuple(frames)), truth(filmed)) == 0


def test_a_swapped_pair_flips_the_bits_of_a_strong_message() -> None:
    """Kappa 40 darkens its ones by more than drift is expected to."""
    strong = message(0.5, kappa=40)
    swapped = replace(strong, original=strong.embedded, embedded=strong.original)
    assert errors(swapped.rectified(), 1 - truth(strong)) <= 1


@pytest.mark.parametrize("gain", [0.9, 1.08])
def test_exposure_drift_is_no_message(filmed: Captured, gain: float) -> None:
    pair = filmed.rectified()
    drifted = (gain * pair.embedded).round().clip(0, 255).astype(np.uint8)
    pair = replace(pair, frames=(pair.original, drifted))
    assert errors(pair, truth(filmed)) == 0
    assert errors(pair, truth(filmed), "hidden_ratex") > 3


@pytest.mark.parametrize("sigma", [2.0, 4.0])
def test_wrong_corners_are_registered_away(filmed: Captured, sigma: float) -> None:
    rng = np.random.default_rng(3)
    low, high = -0.5, np.array(filmed.original.shape[1::-1]) - 0.5
    first, second = (
        np.clip(corners + sigma * rng.standard_normal((4, 2)), low, high)
        for corners in (filmed.corners, filmed.corners_embedded)
    )
    pair = replace(filmed, corners=first, corners_embedded=second).rectified()
    assert errors(pair, truth(filmed)) == 0
    assert errors(pair, truth(filmed), "hidden_ratex") > 3


def test_what_covers_a_block_costs_that_block_alone() -> None:
    strong = message(0.5, kappa=20)
    pair = strong.rectified()
    covered = np.array(pair.embedded)
    covered[50:94, 70:120] = 255
    assert errors(replace(pair, frames=(pair.original, covered)), truth(strong)) <= 1


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.05, 0.95])
def test_any_balance_of_bits_is_read(share: float) -> None:
    captured = message(share)
    assert (
        errors(captured.rectified(), truth(captured)) <= 1
    )  # the rarer bit occurs 3 times or more


@pytest.mark.slow
@pytest.mark.parametrize("layout", [make_layout(), Layout(3, 5, 400, 300, ())])
def test_any_grid_is_read_and_patches_are_ignored(layout: Layout) -> None:
    captured = message(0.5, layout, kappa=5)
    pair = captured.rectified()
    assert errors(pair, truth(captured)) == 0
    blank = np.array(pair.embedded)
    for row, col in layout.ratex:
        top, bottom, left, right = layout.cell_box(row, col)
        inner = np.s_[top + 8 : bottom - 8, left + 8 : right - 8]
        blank[inner] = pair.original[inner]
    assert errors(replace(pair, frames=(pair.original, blank)), truth(captured)) == 0


@pytest.mark.parametrize("level", [0, 128, 255])
@pytest.mark.parametrize("layout", [NO_PATCHES, Layout(1, 1, 16, 16, ()), Layout(1, 2, 64, 48, ())])
def test_frames_that_show_nothing_yield_finite_scores(layout: Layout, level: int) -> None:
    flat = np.full((layout.height, layout.width), level, np.uint8)
    scores = make_decoder("blind").decode(Observation.still(flat, flat, layout)).scores
    assert scores.shape == (layout.n_bits,)
    assert np.isfinite(scores).all()


def test_tones_split_each_block_by_intensity(filmed: Captured) -> None:
    tones = cut_into_tones(filmed.rectified())
    assert tones.share.shape == (NO_PATCHES.n_bits, TONES)
    np.testing.assert_allclose(tones.share.sum(axis=1), 1, atol=1e-6)
    seen = tones.share > 0.01
    lowest = np.where(seen, tones.i, np.inf).min(axis=0)
    highest = np.where(seen, tones.i, -np.inf).max(axis=0)
    assert (highest[:-1] <= lowest[1:] + 1e-6).all()


def test_the_true_bits_are_likelier_than_their_opposite(filmed: Captured) -> None:
    tones = cut_into_tones(filmed.rectified())
    start = 0.1 + 0.8 * truth(filmed)
    everything = np.ones_like(start)
    right = fit(tones, start, everything)
    np.testing.assert_array_equal(right.scores > 0, truth(filmed) == 1)
    assert right.likelihood > fit(tones, 1 - start, everything).likelihood - 1e-6


@pytest.mark.parametrize("variance", [1e-4, 0.01, 1.0])
def test_a_brighter_block_is_never_less_likely_a_one(variance: float) -> None:
    amplitude = np.linspace(-30, 30, 2001)
    odds = log_odds(amplitude, np.full_like(amplitude, variance))
    assert (np.diff(odds) >= 0).all()
    wide = variance + SIGNAL_SPREAD**2  # equal densities at the root of a quadratic, by numpy
    a = np.roots([1 / variance - 1 / wide, 2 / wide, -1 / wide - np.log(wide / variance)]).max()
    assert log_odds(np.array([a]), np.array([variance]))[0] == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize("shift", [(0, 0), (3, -5), (-7, 2), (1, 7)])
def test_whole_pixel_shift_is_found_through_blocks_and_drift(
    scene: Image, shift: tuple[int, int]
) -> None:
    bits = np.random.default_rng(1).integers(0, 2, NO_PATCHES.n_bits)
    shown = embed(scene, bits, NO_PATCHES, 20)
    dy, dx = shift
    moved = np.roll(0.85 * shown.embedded, shift, axis=(0, 1)).round().astype(np.uint8)
    assert whole_pixel_shift(shown.original, moved) == (dy, dx)


def test_whole_pixel_shift_is_zero_where_it_is_unsure(scene: Image) -> None:
    noise = np.random.default_rng(0).integers(0, 256, (2, 100, 120)).astype(np.uint8)
    assert whole_pixel_shift(noise[0], noise[1]) == (0, 0)
    flat = np.full((100, 120), 90, np.uint8)
    assert whole_pixel_shift(flat, flat) == (0, 0)
    far = np.roll(scene, (0, REACH_PX + 4), axis=(0, 1))
    assert whole_pixel_shift(scene[:40, :40], far[:40, :40]) == (0, 0)


def test_align_undoes_a_homography_and_an_exposure(scene: Image) -> None:
    height, width = scene.shape[:2]
    ends = np.array([[0, 0], [width, 0], [width, height], [0, height]], np.float32)
    moved = ends + np.array([[5, -3], [-4, 2], [3, 6], [-6, -2]], np.float32)
    H = cv2.getPerspectiveTransform(ends, moved)
    embedded = np.asarray(cv2.warpPerspective(scene, H, (width, height), flags=cv2.INTER_CUBIC))
    luma, inside = align_frames(scene, (0.9 * embedded).astype(np.uint8))
    inside[:12], inside[-12:], inside[:, :12], inside[:, -12:] = 0, 0, 0, 0  # the scene ends there
    target = high_pass(intensity(scene))[inside]
    before = np.corrcoef(target, high_pass(intensity(embedded))[inside])[0, 1]
    after = np.corrcoef(target, high_pass(luma)[inside])[0, 1]
    assert inside.mean() > 0.8
    assert before < 0.6
    assert after > 0.97


def test_align_leaves_frames_that_share_nothing_where_they_are() -> None:
    noise = np.random.default_rng(0).integers(0, 256, (2, 100, 120)).astype(np.uint8)
    flat = np.full((100, 120), 90, np.uint8)
    luma, inside = align_frames(flat, noise[0])
    np.testing.assert_array_equal(luma, intensity(noise[0]))
    assert inside.all()
