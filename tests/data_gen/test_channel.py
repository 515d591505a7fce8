"""The whole channel: what one call of `capture` promises."""

import functools
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import cases
from filming import even_scene, film, levels, only, photograph, scene
from numpy.typing import NDArray
from tolerances import CDTF_LEVELS, FLOAT32, IDENTITY_LEVELS

from data_gen.channel import composition, panel
from data_gen.channel.camera import collect, response_curve
from data_gen.channel.composition import Shot
from data_gen.channel.display import Emission
from data_gen.channel.metering import metered_gain
from data_gen.channel.optics import CAPTURE_HEIGHT, CAPTURE_WIDTH
from data_gen.channel.stills import capture, draw_shots
from data_gen.effects import EFFECTS, switch_off, with_parameter
from data_gen.film import stream
from data_gen.film.scenes import SceneSettings, draw_scene
from data_gen.film.stream import VideoSettings
from data_gen.pairs import PAIRS, get_pair
from data_gen.parameters import Pair
from link.frames import Captured, Displayed
from link.layout import make_layout
from link.types import Array, Image

SCENE = scene()


@pytest.fixture(scope="module")
def displayed() -> Displayed:
    """Of the usual size."""
    return scene(make_layout())


def cdtf(pair: Pair, view_deg: float) -> Array:
    """Captured R, G, B (256, 3) of all displayed grays at the picture's centre, in a dark room."""
    grays = np.repeat(np.arange(256, dtype=np.uint8), 3).reshape(256, 1, 1, 3)
    light = Emission.of(pair.display, np.full((1, 1), np.radians(view_deg))).light(grays)[:, 0]
    exposure = collect(light, pair.camera, pair.crosstalk, metered_gain(pair, view_deg))
    raw = np.clip(np.minimum(exposure, 1.0)[:, 0] @ np.array(pair.camera.color_matrix).T, 0, 1)
    table = response_curve(pair.camera.tone_curve, pair.camera.encoding)
    return np.asarray(np.interp(raw, np.linspace(0, 1, len(table)), table), np.float64)


def inside(captured: Captured) -> bool:
    height, width = captured.original.shape[:2]
    high = [width - 0.5, height - 0.5]
    return bool((captured.corners >= -0.5).all() and (captured.corners <= high).all())


@pytest.mark.parametrize("view", [75.0])
@pytest.mark.parametrize("name", PAIRS)
def test_every_pair_films_the_picture_inside_the_image(
    name: str, view: float, displayed: Displayed
) -> None:
    captured = film(get_pair(name), displayed, view, seed=3)
    shape = (CAPTURE_HEIGHT, CAPTURE_WIDTH, 3)
    assert captured.original.shape == captured.embedded.shape == shape
    assert captured.original.dtype == captured.embedded.dtype == np.uint8
    assert inside(captured)
    picture = captured.rectified().original
    assert np.mean(picture == 255) < 0.5  # not burnt out
    assert picture.std() > 1  # nor black, not even a TN panel at 75 degrees
    assert captured.original[:, :10].mean() < picture.mean()  # the room beside it is darker


def test_a_capture_passes_on_what_the_receiver_and_the_reports_need() -> None:
    captured = film(get_pair("nikon-lg"), SCENE, 20.0)
    assert np.array_equal(captured.bits, SCENE.bits)
    assert (captured.layout, captured.kappa) == (SCENE.layout, 5)
    assert captured.meta == {"pair": "nikon-lg", "view_deg": 20.0}


def test_the_same_seed_gives_the_same_bytes_and_another_does_not() -> None:
    pair = get_pair("nikon-imac")
    first, again, other = (film(pair, SCENE, 20.0, seed) for seed in (7, 7, 8))
    for name in ("original", "embedded", "corners"):
        one, same, different = (getattr(c, name).tobytes() for c in (first, again, other))
        assert one == same
        assert one != different


def test_the_displayed_frames_are_not_changed() -> None:
    before = SCENE.original.copy(), SCENE.embedded.copy()
    film(get_pair("canon-lg"), SCENE)
    assert np.array_equal(SCENE.original, before[0])
    assert np.array_equal(SCENE.embedded, before[1])


@pytest.mark.parametrize("room", [False, True])
def test_an_exposure_ends_at_saturation(room: bool) -> None:
    layout, rng = SCENE.layout, np.random.default_rng(0)
    white = np.full((layout.height, layout.width, 3), 255, np.uint8)
    shot = draw_shots(layout, get_pair("canon-lg"), 0.0, rng)[0]
    if room:
        made = draw_scene(layout, get_pair("canon-lg"), 0.0, rng, SceneSettings(size=(160, 96)))
        shot = Shot(made.viewpoint(rng), made.H_captured_from_display)
    once, longer = (replace(shot, exposure=gain).expose(white) for gain in (0.5, 4.0))
    assert once.max() < 1
    assert longer.max() == 1
    np.testing.assert_allclose(longer, np.minimum(8 * once, 1), rtol=20 * FLOAT32)


def test_stray_light_adds_a_spot_wherever_the_camera_looks() -> None:
    layout, rng = SCENE.layout, np.random.default_rng(0)
    settings = SceneSettings(size=(160, 96), room="dark", coverage=0.2, stray=0.3)
    made = draw_scene(layout, get_pair("canon-lg"), 0.0, rng, settings)
    black = np.zeros((layout.height, layout.width, 3), np.uint8)
    lit = made.viewpoint(np.random.default_rng(1))
    H = made.H_captured_from_display
    for motion in (np.eye(3), np.array([[1, 0, 20], [0, 1, 5], [0, 0, 1.0]])):
        shot = Shot(lit, motion @ H, motions=(motion,) * len(lit.surroundings))
        unlit = replace(shot, viewpoint=replace(lit, stray=None))
        added = shot.expose(black) - unlit.expose(black)
        spot = added[..., 1] / lit.lens[..., 0]
        assert spot.min() >= -FLOAT32
        assert 0.25 < spot.max() <= 0.3 + FLOAT32
        np.testing.assert_allclose(spot, lit.stray[..., 0], atol=20 * FLOAT32)


def still(pair: Pair) -> Image:
    return film(pair, SCENE).original


def still_in_a_room(pair: Pair) -> Image:
    rng = np.random.default_rng(0)
    settings = SceneSettings(size=(160, 96), room="dark", coverage=0.4, second_display=False)
    made = draw_scene(SCENE.layout, pair, 0.0, rng, settings)
    return photograph(SCENE.original, made, rng)


def frame_of_a_film(pair: Pair) -> Image:
    scene_settings = SceneSettings(size=(160, 96), room="dark", coverage=0.4, second_display=False)
    settings = VideoSettings(scene_settings, seconds=0.01)
    rng = np.random.default_rng(0)
    return next(stream.film([SCENE.original], SCENE.layout, pair, 0.0, settings, rng)).rgb


@functools.cache
def exposed_as_usual(expose: Callable[[Pair], Image]) -> Image:
    return expose(get_pair("canon-lg"))


@pytest.mark.parametrize("expose", [still, still_in_a_room, frame_of_a_film])
@cases(
    (composition.Emission, "light"),
    *((composition, n) for n in ("image_of", "collect", "pwm_gain", "moire_gain", "develop")),
)
def test_stills_scenes_and_films_pass_through_the_same_stages(
    holder: Any, name: str, expose: Callable[[Pair], Image], monkeypatch: pytest.MonkeyPatch
) -> None:
    """An effect that is added to a stage of the composition reaches all of them."""
    if name == "pwm_gain" and expose is frame_of_a_film:
        holder, name = panel, "pulsed_gain"  # films have the pulses in the display's light
    usual, stage = exposed_as_usual(expose), getattr(holder, name)

    def weaker(*args: Any) -> NDArray[Any]:
        made = stage(*args)
        return np.asarray((0.5 * made).astype(made.dtype))

    monkeypatch.setattr(holder, name, weaker)
    changed = expose(get_pair("canon-lg"))
    assert np.abs(levels(changed) - usual).mean() > 5


def test_the_channel_knows_nothing_of_films() -> None:
    files = list(Path(composition.__file__).parent.glob("*.py"))
    assert len(files) > 5
    assert not [file for file in files if "data_gen.film" in file.read_text()]


# Metering and the transfer function


def test_metering_makes_up_for_its_share_of_the_fall_off() -> None:
    pair = with_parameter(get_pair("canon-samsung"), "leak", 0.0)
    pair = with_parameter(pair, "haze", 0.0)
    fall = np.cos(np.radians(40.0)) ** pair.display.falloff[1]
    for share in (0.0, 0.5, 1.0):
        metered = with_parameter(pair, "metering", share)
        assert metered_gain(metered, 40.0) == pytest.approx(fall**-share)
        assert metered_gain(metered, -40.0) == pytest.approx(fall**-share)
        assert metered_gain(metered, 0.0) == 1


def test_full_metering_keeps_an_oblique_capture_bright() -> None:
    pair = only("canon-samsung", "angle")
    held, metered = (
        film(with_parameter(pair, "metering", share), even_scene(150), 45.0).original.mean()
        for share in (0.0, 1.0)
    )
    assert held < 60
    assert metered == pytest.approx(150, rel=0.15)  # by the nominal view


def test_metering_amplifies_the_noise_of_the_light_it_makes_up_for() -> None:
    pair = with_parameter(only("canon-samsung", "angle", "noise"), "noise_scale", 5.0)
    relative = []
    for share in (0.0, 1.0):
        captured = film(with_parameter(pair, "metering", share), even_scene(150), 45.0)
        noise = levels(captured.original) - levels(captured.embedded)
        relative.append(noise.std() / captured.original.mean())
    assert relative[1] == pytest.approx(relative[0], rel=0.1)  # no more electrons than before


LOCAL = ["ambient", "flicker", "noise", "vignetting", "perspective", "uniformity", "jpeg"]
"""What makes a capture's centre differ from the transfer function, or is none of it."""


@pytest.mark.parametrize("view", [0.0, 45.0])
@pytest.mark.parametrize("name", PAIRS)
def test_cdtf_rises_and_predicts_even_captures_at_the_centre(name: str, view: float) -> None:
    pair = switch_off(get_pair(name), LOCAL)
    curve = cdtf(pair, view)
    assert curve.shape == (256, 3)
    assert np.all(np.diff(curve, axis=0) > -255 * FLOAT32)  # even, where the display clips
    assert np.ptp(curve, axis=0).min() > 100
    for level in (40, 128, 220):
        captured = levels(film(pair, even_scene(level), view).original)[48, 64]
        assert np.abs(captured - curve[level]).max() <= CDTF_LEVELS


@pytest.mark.parametrize("name", PAIRS)
def test_frontal_white_is_stored_just_below_clipping(name: str) -> None:
    white = cdtf(switch_off(get_pair(name), ["uniformity"]), 0.0)[255]
    assert np.abs(white - 245).max() < IDENTITY_LEVELS


# The draws


def test_switching_an_effect_off_leaves_the_draws_of_the_others() -> None:
    def drawn(pair: Pair) -> tuple[Any, Captured]:
        rng = np.random.default_rng(5)
        captured = capture(SCENE, pair, 20.0, rng)
        return (rng.bit_generator.state, rng.random(), rng.spawn(1)[0].random()), captured

    state, full = drawn(get_pair("sony-lg"))
    for effect in EFFECTS:
        state_without, without = drawn(switch_off(get_pair("sony-lg"), [effect]))
        assert state == state_without, effect
        if effect not in ("perspective", "corners"):
            assert np.array_equal(full.corners, without.corners), effect
