"""A display without patches is found by its pilots, and nothing else is."""

import gc
from weakref import ref

import cv2
import numpy as np
import pytest
from conftest import cases
from pilot_films import (
    BENT_CORNERS,
    BENT_SIZE,
    FINE,
    OTHER,
    block_views,
    filmed,
    panned_to,
    pilots_alone,
)

from link.errors import InputError
from link.geometry import frame_corners, homography_from_corners, transform
from link.layout import Layout, make_layout
from link.pilots import pilot_signs
from link.presets import PRESETS
from link.steps import run_to_end
from link.types import Array, Floats, Image
from receiver.pilots.search.all_blocks import BlockFit, block_fit, block_maps
from receiver.pilots.search.parts import COARSE_SIZE, coarse_shift
from receiver.pilots.search.pilot_search import PilotSearch
from receiver.pilots.search.stills import Stills
from receiver.pilots.search.watch import LEAST_WINDOW
from receiver.pilots.signal import pilot_evidence
from receiver.pilots.stabilise import Tracks
from receiver.pilots.toggling import Wave
from receiver.pilots.waves import position, span_of, waves

CLOSE_PX = 1.0
"""A twelfth of a block as it is filmed."""


def search(images: list[Image], layouts: list[Layout], fps: float = 60.0):
    finder = PilotSearch(layouts, fps)
    for number, image in enumerate(images):
        found = finder.push(np.repeat(image[:, :, None], 3, axis=2), number / fps)
        if found is not None:
            return number, found
    return None


def find(images: list[Image], corners: Array, layouts: list[Layout], within: float = CLOSE_PX):
    """The frame in which a display is found, and the display, which must lie where it is."""
    number, display = search(images, layouts)
    assert np.abs(display.corners - corners[number]).max() < within
    return number, display


def test_finds_the_display_its_layout_and_its_corners() -> None:
    _, display = find(*filmed(FINE, 30, seed=0), [OTHER, FINE])
    assert display.layout == FINE
    assert not display.picture_moves


@pytest.mark.slow
def test_finds_a_display_before_a_wall_that_moves_otherwise() -> None:
    """Its own motion, by few points, places the corners less well than that of the room."""
    find(*filmed(FINE, 30, seed=2, parallax=1.0), [FINE], 2 * CLOSE_PX)


@pytest.mark.slow
def test_finds_a_display_to_which_the_camera_turns() -> None:
    """The search that began before a wall ends once the wall is out of view."""
    images, corners = filmed(FINE, 75, seed=0)
    find(panned_to(images, 45), corners, [FINE])


@pytest.mark.slow
def test_a_search_goes_on_while_the_hand_moves_the_frame_a_little() -> None:
    images, _ = filmed(FINE, 20, seed=0)
    finder = PilotSearch([OTHER], 60.0)
    for number, image in enumerate(images):
        grow = cv2.getRotationMatrix2D((320, 240), 0.1 * number, 1 + 0.002 * number)
        finder.push(cv2.warpAffine(image, grow, (640, 480)), number / 60)
    assert next(iter(finder._windows)).watch.first.time == 0.0


@pytest.mark.slow
def test_finds_a_display_that_begins_to_play_late() -> None:
    """In the window that follows the first one, while that one is still searched.

    Few frames have shown it by then, so corners are found less well.
    """
    still, _ = filmed(FINE, 40, seed=4, hold=10**6)
    images, corners = filmed(FINE, 40 + LEAST_WINDOW + 1, seed=4)
    number, _ = find([*still, *images[40:]], corners, [FINE], 2 * CLOSE_PX)
    assert number <= 40 + LEAST_WINDOW


@pytest.mark.slow
def test_a_display_whose_picture_moves_is_found_by_what_surrounds_it() -> None:
    _, display = find(*filmed(FINE, 40, seed=2, pan=8.0, hold=2), [FINE])
    assert display.picture_moves


def test_points_that_lie_close_together_do_not_say_how_a_display_moves() -> None:
    """They move otherwise than the room; spread over the display they count, in a corner not."""
    quad = np.array([[0.0, 0.0], [200.0, 0.0], [200.0, 100.0], [0.0, 100.0]])
    x, y = np.meshgrid(np.arange(4.0), np.arange(4.0))
    grid = np.stack([x, y], axis=-1).reshape(-1, 1, 2).astype(np.float32)
    for wide, tall, says in ((60, 30, True), (5, 5, False)):
        before = 5 + grid * np.float32([wide, tall])
        around = np.concatenate([before, before + np.float32([300, 0])])
        after = np.concatenate([before + 3, before + np.float32([300, 0])])
        own = Tracks(around, after, 0.7).motion_within(quad)
        assert (own is not None) == says
        if own is not None:
            np.testing.assert_allclose(transform(own, quad), quad + 3, atol=0.01)
    assert Tracks(around[:5], after[:5], 0.7).motion_within(quad) is None


def test_a_window_that_is_given_up_is_freed_at_once() -> None:
    """Its frames do not wait until Python looks for what holds itself."""
    images, _ = filmed(FINE, 3, seed=0)
    search = PilotSearch([FINE])
    for number, image in enumerate(images):
        search.push(image, number / 60)
    window = ref(next(iter(search._windows)))
    gc.disable()
    search.push(np.zeros_like(images[0]), 1.0)
    gc.enable()
    assert window() is None


@pytest.mark.slow
def test_finds_a_dark_picture() -> None:
    find(*filmed(FINE, 48, seed=9, kappa=12.0, night=True), [FINE])


@pytest.mark.slow
def test_all_blocks_place_the_corners_of_a_display_that_toggles_weakly() -> None:
    find(*filmed(FINE, 50, seed=1, kappa=0.24), [FINE], 2 * CLOSE_PX)  # the noise is 1


@pytest.mark.slow
def test_tells_which_way_up() -> None:
    images, corners = filmed(FINE, 30, seed=1)
    turned = [np.ascontiguousarray(image[::-1, ::-1]) for image in images]
    find(turned, [639, 479] - corners, [FINE])


@pytest.mark.slow
def test_does_not_find_what_is_not_there() -> None:
    """A display that stands still, and one of another layout."""
    for images, _ in (filmed(FINE, 30, seed=2, hold=10**6), filmed(OTHER, 30, seed=3)):
        assert search(images, [FINE]) is None


def dropped(frames: int, kept: int, seed: int) -> Array:
    """Positions of the frames that are left of some evenly spaced ones."""
    rng = np.random.default_rng(seed)
    return np.sort(rng.choice(frames, kept, replace=False)).astype(np.float64)


@pytest.mark.parametrize("missing", [0, 300])
@pytest.mark.parametrize("frames_a_period", [4, 2])
def test_evidence_is_no_surer_than_chance(frames_a_period: int, missing: int) -> None:
    """Whatever toggles, signs that it does not keep to are believed as rarely as evidence says."""
    rng = np.random.default_rng(5)
    at = dropped(24 + missing, 24, seed=8)
    wave = np.cos(2 * np.pi * at / frames_a_period) + 3 * np.sin(2 * np.pi * at / 500)
    runs = 1000 if missing == 0 else 300
    evidence = np.array(
        [
            pilot_evidence(wave[:, None] * rng.standard_normal(FINE.pilots) * 9, FINE, at)[0]
            for _ in range(runs)
        ]
    )
    paid = np.log(11)  # of the frequencies that are looked at, at least one holds anything
    for rare in (1.0, 2.0):
        usual = runs * np.exp(-rare - (paid if missing == 0 else 0))
        assert (evidence >= rare).sum() <= usual + 4 * np.sqrt(usual)
    assert evidence.max() < 6.0


@pytest.mark.parametrize("frequency", [0.5, 0.1875])
def test_evidence_is_found_where_frames_are_missing(frequency: float) -> None:
    """The frequency is right, and a display that drifts slowly is as sure as one that does not."""
    rng, signs = np.random.default_rng(3), pilot_signs(FINE)
    at = dropped(72, 24, seed=2)
    noise = rng.standard_normal((24, FINE.pilots))
    wave = np.sign(np.cos(2 * np.pi * frequency * (at + 0.3)))[:, None] * signs
    evidence, found = pilot_evidence(list(noise + wave), FINE, at + rng.uniform(-0.02, 0.02, 24))
    assert evidence > 20
    assert found == pytest.approx(frequency, abs=0.5 / 72)
    assert pilot_evidence(list(noise), FINE, at)[0] < 6
    assert pilot_evidence(list(noise + wave), FINE)[0] < evidence - 20  # as if none were missing
    drift = np.cos(2 * np.pi * at / 144)[:, None] * rng.standard_normal(FINE.pilots)
    drifting, _ = pilot_evidence(list(noise + wave + drift), FINE, at)
    assert drifting > 0.7 * evidence


def test_what_passes_once_does_not_hide_the_toggling() -> None:
    """A scene changes every other pilot twice by thirty times as much as the message does."""
    rng, frames = np.random.default_rng(4), np.arange(24)[:, None]
    wave = np.sign(np.cos(np.pi * (frames + 0.5) / 2)) * pilot_signs(FINE)
    noise = rng.standard_normal(wave.shape) / 2
    passes = np.sort(rng.integers(2, 22, (2, FINE.pilots)), axis=0)
    scene = 30 * ((frames >= passes[0]) & (frames < passes[1]))
    scene[:, ::2] = 0
    evidence, frequency = pilot_evidence(list(wave + noise + scene), FINE)
    assert evidence > 20
    assert frequency == 0.25
    assert pilot_evidence(list(noise + scene), FINE)[0] < 6


def test_waves_of_evenly_spaced_frames_are_those_of_fourier() -> None:
    series = np.random.default_rng(1).standard_normal((24, 3))
    numbers = np.arange(2, 13)
    lines = waves(np.arange(24.0), numbers / 24, np.arange(2) / 24) @ series
    np.testing.assert_allclose(lines, np.fft.rfft(series, axis=0)[2:], atol=1e-9)


def test_small_views_show_what_a_quadrilateral_bounds() -> None:
    still = np.random.default_rng(0).integers(0, 256, (90, 160), np.uint8)
    stills = Stills()
    stills.add(still)
    stills.add(255 - still)
    corners = np.array([[39.5, 29.5], [99.5, 29.5], [99.5, 59.5], [39.5, 59.5]])
    bounded = still[30:60, 40:100]
    np.testing.assert_array_equal(stills.views([corners], 60, 30), [bounded, 255 - bounded])
    turned = stills.views([corners, corners], 30, 60, turn=1, first=1)
    np.testing.assert_array_equal(turned, [np.rot90(255 - bounded)])


def test_waves_do_not_see_what_is_slow() -> None:
    at = dropped(100, 30, seed=1)
    slower = np.array([0.0, 0.01, 0.02])
    made = waves(at, np.array([0.1, 0.25, 0.5]), slower)
    slow = np.cos(2 * np.pi * np.outer(slower, at) + 1)
    assert np.abs(made @ slow.T).max() < 1e-9
    assert np.abs(made).max() < 2


@pytest.mark.slow
def test_finds_a_preset_where_most_frames_are_dropped() -> None:
    preset = PRESETS["hidden"]
    fps = 2 * preset.state_hz
    images, corners = filmed(preset.layout, 120, seed=0, kappa=5.0)
    finder = PilotSearch([p.layout for p in PRESETS.values() if p.layout.pilots], fps)
    rng = np.random.default_rng(0)
    for number, image in enumerate(images):
        if rng.random() < 0.6:
            continue
        found = finder.push(image, number / fps)
        if found is not None:
            assert found.layout == preset.layout
            assert np.abs(found.corners - corners[number]).max() < CLOSE_PX
            return
    pytest.fail("no display was found")


@pytest.mark.parametrize("shift", [(0.0, 0.0), (17.0, -12.0)])
def test_corner_shifts_are_recovered(shift: tuple[float, float]) -> None:
    rng = np.random.default_rng(6)
    blocks = pilots_alone(FINE, (FINE.cols, FINE.rows)).astype(np.float64)
    full = pilots_alone(FINE, (FINE.width, FINE.height))
    by_shift = np.array([[1, 0, shift[0]], [0, 1, shift[1]]], float)
    moved = cv2.warpAffine(full, by_shift, full.shape[::-1])
    seen = cv2.resize(moved, COARSE_SIZE, interpolation=cv2.INTER_AREA)
    seen = seen + rng.normal(0, 0.3, seen.shape)
    fit = coarse_shift((seen * np.exp(0.7j)).astype(np.complex64), blocks, FINE)
    found = transform(fit[0], frame_corners(FINE.width, FINE.height))
    expected = frame_corners(FINE.width, FINE.height) + shift
    assert np.abs(found - expected).max() < 4.0


OFF = np.array([[5.0, -3.0], [-4.0, 2.0], [3.0, 4.0], [-2.0, -5.0]])
"""Errors of corners that the pilots may leave, in layout pixels; a block of FINE has 16."""


def fit_of(views: Floats, frequency: float = 0.25) -> BlockFit:
    return run_to_end(block_fit(block_maps(FINE), views, range(len(views)), Wave(frequency)))


def fitted_by_blocks(views: Floats, frequency: float) -> Array:
    """Corners, in layout pixels, to which the fit by all blocks moves those of the views."""
    fit = fit_of(views, frequency)
    for _ in range(6):
        if fit.step():
            break
    return transform(fit.shift(), frame_corners(FINE.width, FINE.height))


@cases((4, 0.0), (4, 2.5), (2, 0.0))
def test_all_blocks_lead_to_parts_of_a_pixel(frames_a_period: int, slope: float) -> None:
    """Bits need not be known, the phase may slope, and noise is as strong as the toggling."""
    views = block_views(FINE, OFF, 6 * frames_a_period, frames_a_period, slope=slope)
    found = fitted_by_blocks(views, 1 / frames_a_period)
    truth = frame_corners(FINE.width, FINE.height) + OFF
    assert np.abs(found - truth).max() < 0.5


@pytest.mark.parametrize("k", [-0.1, 0.06])
@pytest.mark.parametrize("off", [0 * OFF, OFF], ids=["right", "off"])
def test_all_blocks_tell_how_a_lens_bends_the_display(k: float, off: Array) -> None:
    """Corners were found as if the lens bent nothing."""
    fit = fit_of(block_views(FINE, off, 24, 4, k=k))
    H_captured_from_view = homography_from_corners(BENT_CORNERS, 512, 384) @ np.linalg.inv(
        homography_from_corners(frame_corners(512, 384) + off, 512, 384)
    )
    seen = transform(H_captured_from_view, frame_corners(512, 384))
    fit.step()
    fit.free_lens(seen, BENT_SIZE)
    while not fit.step():
        assert fit.bends()
    assert fit.k == pytest.approx(k, abs=0.005)
    found = transform(fit.shift(), frame_corners(512, 384))
    assert np.abs(found - frame_corners(512, 384) - off).max() < 0.7


@pytest.mark.parametrize("toggling", [3.0, 0.0])
def test_no_lens_is_seen_where_none_bends_and_where_nothing_toggles(toggling: float) -> None:
    fit = fit_of(block_views(FINE, 0 * OFF, 24, 4, toggling=toggling))
    fit.free_lens(BENT_CORNERS, BENT_SIZE)
    fit.step()
    assert not fit.bends()


def test_a_display_in_a_corner_of_the_image_tells_of_no_lens() -> None:
    """A small display is hardly bent, and noise does not make it look so."""
    fit = fit_of(block_views(FINE, 0 * OFF, 24, 4))
    fit.free_lens(100 + 0.2 * BENT_CORNERS, BENT_SIZE)
    fit.step()
    assert not fit.bends()


def test_noise_leads_corners_a_quarter_of_a_block_at_most() -> None:
    views = block_views(FINE, OFF, 24, 4, toggling=0.0)
    corners = frame_corners(FINE.width, FINE.height)
    assert np.abs(fitted_by_blocks(views, 0.25) - corners).max() < 4.0
    assert (fitted_by_blocks(views[:3], 0.25) == corners).all()  # a single period tells nothing


def test_changes_of_frame_pairs_are_kept_apart() -> None:
    """Pilots change alike in all periods, and other blocks by the bits of each frame pair."""
    views = block_views(FINE, 0 * OFF, 24, 4, noise=0.0)
    maps = block_maps(FINE)
    blocks = np.array(
        [
            cv2.resize(maps.within(change).copy(), (32, 24), interpolation=cv2.INTER_AREA)
            for change in Wave(0.25).period_changes(maps, views, range(24))
        ]
    ).reshape(-1, 24 * 32)
    signs = np.sign(blocks[:, FINE.pilot_blocks])
    assert (signs == pilot_signs(FINE)).all()
    strength = np.abs(blocks)
    assert len(blocks) == 6
    assert strength.min() > 0.7 * strength.max()
    others = np.delete(np.sign(blocks), FINE.pilot_blocks, axis=1)
    assert abs((others[1:] == others[:-1]).mean() - 0.5) < 0.1


def test_layouts_need_pilots() -> None:
    with pytest.raises(InputError, match="pilots"):
        PilotSearch([make_layout()])


@pytest.mark.parametrize("fps", [24.0, 30.0, 59.94, 120.0, 240.0])
def test_times_in_whole_milliseconds_leave_even_frames_even(fps: float) -> None:
    times = np.round(np.arange(40) / fps, 3)
    at = [position(time - times[0], fps) for time in times]
    assert at == list(range(40))
    assert span_of(at) == (40.0, 20)


def test_the_fastest_wave_is_real() -> None:
    """At two frames a period, times that are a little off must not make an imaginary part."""
    at = np.arange(24) + np.where(np.arange(24) % 3 == 0, 0.05, -0.02)
    fast, slower = waves(at, np.array([0.5, 0.25]), np.zeros(1))
    assert not fast.imag.any()
    assert np.abs(fast.real).min() > 0.9
    assert (slower.imag**2).sum() == pytest.approx((slower.real**2).sum(), rel=0.1)
