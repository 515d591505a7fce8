"""Each effect alone does what it is named for; without any, the channel is the identity."""

from dataclasses import replace

import numpy as np
import pytest
from filming import SMALL, even_scene, film, levels, only, scene
from hypothesis import given, settings
from hypothesis import strategies as st
from tolerances import FLOAT64, IDENTITY_LEVELS

from data_gen.channel.optics import CAPTURE_HEIGHT, CAPTURE_WIDTH
from data_gen.effects import EFFECTS, with_parameter
from data_gen.pairs import PAIRS
from link.frames import Captured, Displayed
from link.geometry import frame_corners
from link.layout import make_layout

SCENE = scene()
CORNERS = frame_corners(SMALL.width, SMALL.height)
COMMON = {"angle", "uniformity", "ambient", "transfer", "crosstalk", "vignetting", "blur"}
COMMON |= {"mosaic", "sharpening", "jpeg"}
"""Effects that alone change the frames, in place, both in the same way."""


def alone(effect: str, displayed: Displayed = SCENE, view: float = 30.0, seed: int = 0) -> Captured:
    return film(only("canon-samsung", effect), displayed, view, seed)


# The identity


@settings(max_examples=30)
@given(
    st.sampled_from(sorted(PAIRS)), st.floats(-75, 75), st.integers(0, 999), st.sampled_from([3, 1])
)
def test_without_effects_the_capture_is_what_was_displayed(
    name: str, view: float, seed: int, channels: int
) -> None:
    rng = np.random.default_rng(seed)
    shape = (SMALL.height, SMALL.width, 3) if channels == 3 else (SMALL.height, SMALL.width)
    frames = [rng.integers(0, 256, shape, np.uint8) for _ in range(2)]
    shown = Displayed(frames[0], frames[1], np.zeros(SMALL.n_bits, np.intp), SMALL, 5)
    captured = film(only(name), shown, view, seed)
    for frame, displayed in zip((captured.original, captured.embedded), frames, strict=True):
        rgb = displayed if channels == 3 else np.repeat(displayed[:, :, None], 3, axis=2)
        assert np.array_equal(frame, rgb)
    np.testing.assert_allclose(captured.corners, CORNERS, atol=FLOAT64)


# One effect at a time


@pytest.mark.parametrize("effect", sorted(COMMON))
def test_common_effects_change_both_frames_alike_and_move_nothing(effect: str) -> None:
    captured = alone(effect, replace(SCENE, embedded=SCENE.original))
    assert not np.array_equal(captured.original, SCENE.original)
    assert np.array_equal(captured.original, captured.embedded)
    np.testing.assert_allclose(captured.corners, CORNERS, atol=FLOAT64)


@pytest.mark.parametrize("effect", ["drift", "jitter", "breathing"])
def test_what_happens_between_the_frames_leaves_the_original(effect: str) -> None:
    pair = only("canon-lg", effect)
    if effect == "breathing":
        pair = with_parameter(pair, "breathing", 0.01)
    captured = film(pair, SCENE)
    assert np.array_equal(captured.original, SCENE.original)
    assert not np.array_equal(captured.embedded, SCENE.embedded)


def test_all_effects_are_tried_alone() -> None:
    others = {"perspective", "corners", "drift", "flicker", "jitter", "breathing", "moire", "noise"}
    assert set(EFFECTS) == COMMON | others


def test_perspective_alone_films_at_the_captured_size() -> None:
    captured = alone("perspective")
    assert captured.original.shape == (CAPTURE_HEIGHT, CAPTURE_WIDTH, 3)
    rectified = captured.rectified()
    inner = np.s_[4:-4, 4:-4]
    error = levels(rectified.original)[inner] - SCENE.original[inner]
    assert np.median(np.abs(error)) <= 2 * IDENTITY_LEVELS  # resampled twice


def test_corners_alone_moves_the_reported_corners_only() -> None:
    captured = alone("corners")
    assert np.array_equal(captured.original, SCENE.original)
    assert np.array_equal(captured.embedded, SCENE.embedded)
    assert 0 < np.abs(captured.corners - CORNERS).max() < 4 * 0.5
    assert np.array_equal(captured.corners, captured.corners_embedded)


@pytest.mark.slow
def test_corners_are_off_by_their_sigma() -> None:
    pair = with_parameter(only("canon-lg", "perspective", "corners"), "corner_px", 0.0)
    off = with_parameter(pair, "corner_px", 2.0)
    errors = [film(off, SCENE, 0, s).corners - film(pair, SCENE, 0, s).corners for s in range(25)]
    assert np.std(errors) == pytest.approx(2.0, rel=0.15)  # 200 numbers: 5 % standard error


def test_angle_alone_darkens_with_the_view() -> None:
    means = [float(alone("angle", view=view).original.mean()) for view in (0.0, 30.0, 60.0)]
    assert SCENE.original.mean() > means[0] > means[1] > means[2]


@pytest.mark.parametrize("effect", ["uniformity", "vignetting"])
def test_uneven_light_spares_the_centre_and_dims_the_corners(effect: str) -> None:
    frame = levels(alone(effect, even_scene(200)).original)
    assert np.abs(frame[48, 64] - 200).max() <= IDENTITY_LEVELS
    assert np.all(frame[[0, 0, -1, -1], [0, -1, 0, -1]] < 200 * 0.9)
    assert np.all(np.diff(frame[48:, 64], axis=0) <= 0)


def test_ambient_alone_adds_the_same_light_to_every_level() -> None:
    dark, bright = (levels(alone("ambient", even_scene(level)).original) for level in (0, 128))
    assert dark.min() >= 1  # haze 0.006 of 255
    assert np.abs(bright - dark - 128).max() <= IDENTITY_LEVELS


def test_transfer_alone_maps_each_level_to_one_level() -> None:
    captured = alone("transfer").original
    for channel in range(3):
        shown, filmed = SCENE.original[:, :, channel].ravel(), captured[:, :, channel].ravel()
        assert len(np.unique(np.stack([shown, filmed]), axis=1).T) == len(np.unique(shown))
        order = np.argsort(shown, kind="stable")
        assert np.all(np.diff(levels(filmed)[order]) >= 0)


def test_drift_alone_scales_the_embedded_frame_by_one_factor() -> None:
    pair = with_parameter(only("canon-lg", "drift"), "drift", 0.1)
    factors = []
    for seed in range(5):
        captured = film(pair, SCENE, seed=seed)
        whole = captured.embedded < 255
        factors.append(levels(captured.embedded)[whole].sum() / SCENE.embedded[whole].sum())
        expected = np.minimum(255, factors[-1] * SCENE.embedded)
        assert np.abs(captured.embedded - expected).max() <= IDENTITY_LEVELS
    assert 0.02 < np.std(np.log(factors)) < 0.3


def test_flicker_alone_scales_rows_and_differs_between_the_frames() -> None:
    pair = with_parameter(only("sony-imac", "flicker"), "pwm_duty", 0.5)
    captured = film(with_parameter(pair, "pwm_hz", 90.0), even_scene(100))
    rows = [levels(frame).mean(axis=(1, 2)) for frame in (captured.original, captured.embedded)]
    for frame, row in zip((captured.original, captured.embedded), rows, strict=True):
        assert np.all(frame == row[:, None, None])
        assert np.ptp(row) > 10
    assert np.abs(rows[0] - rows[1]).max() > 5


def test_moire_needs_perspective_to_be_seen() -> None:
    flat = even_scene(128, make_layout())
    assert np.all(film(only("canon-imac", "moire"), flat).original == 128)
    plain, beating = (
        levels(film(only("canon-imac", "perspective", *more), flat).original)
        for more in ((), ("moire",))
    )
    inside = np.s_[200:380, 250:500]
    assert np.ptp(plain[inside]) == 0
    assert np.ptp(beating[inside]) > 3


def test_noise_alone_is_fresh_in_each_frame_and_grows_with_the_light() -> None:
    pair = with_parameter(only("canon-lg", "noise"), "noise_scale", 4.0)
    dark, bright = (film(pair, even_scene(level)) for level in (50, 200))
    assert levels(bright.original).var() > 2 * levels(dark.original).var()
    noise = [levels(frame) - 200 for frame in (bright.original, bright.embedded)]
    assert abs(np.corrcoef(noise[0].ravel(), noise[1].ravel())[0, 1]) < 0.03  # 36,864: 0.005
    assert abs(noise[0].mean()) < 0.2
