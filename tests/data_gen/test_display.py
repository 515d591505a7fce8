import math
from dataclasses import replace

import numpy as np
import pytest
from filming import DISPLAYS, even_scene, film, only, smooth_picture
from hypothesis import given
from hypothesis import strategies as st
from tolerances import FLOAT32

from data_gen.channel.display import Emission, fall_to_corners, room_light
from data_gen.effects import with_parameter
from data_gen.pairs import PAIRS
from data_gen.parameters import Display
from link.layout import make_layout
from link.types import Array

ANGLES = range(0, 80, 5)
RAMP = np.repeat(np.arange(256, dtype=np.uint8)[None, :, None], 3, axis=2)
displays = st.sampled_from([pair.display for pair in PAIRS.values()])


def emitted(level: int, display: Display, degrees: float) -> Array:
    """Light of an even picture's centre in R, G, B."""
    theta = np.full((3, 3), np.radians(degrees))
    light = Emission.of(display, theta).light(np.full((3, 3, 3), level, np.uint8))
    return np.asarray(light[1, 1], np.float64)


@given(displays)
def test_frontal_white_is_one_and_black_is_the_display_black(display: Display) -> None:
    np.testing.assert_allclose(emitted(255, display, 0.0), 1.0, atol=FLOAT32)
    np.testing.assert_allclose(emitted(0, display, 0.0), display.black, atol=FLOAT32)


@given(displays, st.integers(0, 255), st.floats(0, 75))
def test_light_is_that_of_the_equation(display: Display, level: int, degrees: float) -> None:
    x, sine2 = min(1.0, level / (255 * display.clip)), math.sin(math.radians(degrees)) ** 2
    for light, gamma, falloff in zip(
        emitted(level, display, degrees), display.gamma, display.falloff, strict=True
    ):
        w = display.washout * sine2
        curve = (1 - w) * x**gamma + w * x**display.washout_gamma
        white = math.cos(math.radians(degrees)) ** falloff
        expected = white * ((1 - display.black) * curve + display.black) + display.leak * sine2
        assert light == pytest.approx(expected, abs=FLOAT32)


@pytest.mark.parametrize("name", PAIRS)
def test_white_falls_with_the_angle_and_black_never_goes_dark(name: str) -> None:
    display = PAIRS[name].display
    white = np.array([emitted(255, display, degrees) for degrees in ANGLES])
    black = np.array([emitted(0, display, degrees) for degrees in ANGLES])
    assert np.all(np.diff(white, axis=0) < 0)
    assert np.all(np.diff(black / white, axis=0) > 0)  # and so contrast falls
    assert np.all(black > 0)


@pytest.mark.parametrize("camera", ["canon", "nikon", "sony"])
@pytest.mark.parametrize("ips", ["imac", "lg"])
def test_white_falls_faster_on_the_tn_than_on_the_ips_displays(camera: str, ips: str) -> None:
    tn = PAIRS[f"{camera}-samsung"].display
    slow = PAIRS[f"{camera}-{ips}"].display
    assert (tn.panel, slow.panel) == ("TN", "IPS")
    ratio = np.array([emitted(255, tn, a) / emitted(255, slow, a) for a in range(0, 65, 5)])
    assert np.all(np.diff(ratio, axis=0) < 0)


@pytest.mark.parametrize("degrees", [0.0, 30.0, 60.0, 75.0])
@pytest.mark.parametrize("name", DISPLAYS)
def test_light_rises_with_rho_up_to_the_clip_and_stays_there(name: str, degrees: float) -> None:
    display = replace(DISPLAYS[name], edge_loss=0.0)
    light = Emission.of(display, np.full(RAMP.shape[:2], np.radians(degrees))).light(RAMP)[0]
    last = int(255 * display.clip)
    assert np.all(np.diff(light[: last + 1], axis=0) > 0)
    assert np.abs(light[last + 1 :] - light[-1]).max(initial=0.0) < FLOAT32


def test_a_clip_makes_the_top_levels_white() -> None:
    display = replace(DISPLAYS["samsung"], clip=0.9)
    assert emitted(230, display, 0.0) == pytest.approx(emitted(255, display, 0.0))
    assert np.all(emitted(225, display, 0.0) < emitted(255, display, 0.0))


def test_washout_lifts_dark_tones_by_angle_and_leaves_white() -> None:
    plain, washed = (replace(DISPLAYS["samsung"], washout=share) for share in (0.0, 0.6))
    assert emitted(80, washed, 0.0) == pytest.approx(emitted(80, plain, 0.0))
    assert np.all(emitted(80, washed, 45.0) > 1.2 * emitted(80, plain, 45.0))
    assert emitted(255, washed, 45.0) == pytest.approx(emitted(255, plain, 45.0), abs=FLOAT32)


@pytest.mark.parametrize("shape", [(49, 65), (96, 128), (128, 96)])
@given(loss=st.floats(0, 0.9))
def test_edge_loss_is_nothing_in_the_centre_and_all_at_the_corners(
    shape: tuple[int, int], loss: float
) -> None:
    gain = fall_to_corners(loss, *shape)
    assert gain.shape == shape
    assert gain[shape[0] // 2, shape[1] // 2] == pytest.approx(1.0, abs=1 / min(shape) ** 2)
    np.testing.assert_allclose(gain[[0, 0, -1, -1], [0, -1, 0, -1]], 1 - loss, atol=FLOAT32)
    np.testing.assert_allclose(gain, gain[::-1, ::-1], atol=FLOAT32)
    assert np.all(np.diff(gain[shape[0] // 2 :], axis=0) <= 0)


def test_a_single_pixel_is_its_pictures_centre() -> None:
    assert fall_to_corners(0.5, 1, 1) == pytest.approx(1.0)


def test_edge_loss_dims_the_emitted_light_by_that_field() -> None:
    layout = make_layout()
    even, uneven = (replace(DISPLAYS["lg"], edge_loss=loss) for loss in (0.0, 0.3))
    theta = np.full((layout.height, layout.width), 0.5, np.float32)
    frame = smooth_picture(layout)
    ratio = Emission.of(uneven, theta).light(frame) / Emission.of(even, theta).light(frame)
    expected = fall_to_corners(0.3, layout.height, layout.width)[:, :, None]
    np.testing.assert_allclose(ratio, np.broadcast_to(expected, ratio.shape), atol=FLOAT32)


@given(displays, st.floats(0, 0.5), st.floats(0, 0.5), st.floats(0, 1), st.floats(0, 1))
def test_room_light_lies_between_the_haze_and_the_lamp(
    display: Display, haze: float, glare: float, x: float, y: float
) -> None:
    lit = replace(display, haze=haze, glare=glare)
    room = room_light(lit, 48, 64, np.array([x, y]))
    assert room.shape == (48, 64)
    assert room.min() >= haze - FLOAT32
    assert haze + 0.99 * glare - FLOAT32 <= room.max() <= haze + glare + FLOAT32


def test_the_lamp_is_mirrored_where_it_is_asked_for() -> None:
    room = room_light(DISPLAYS["imac"], 48, 64, np.array([0.25, 0.75]))
    assert np.unravel_index(int(room.argmax()), room.shape) == (36, 16)


def test_room_light_is_added_to_the_black_of_the_display() -> None:
    pair = with_parameter(only("canon-lg", "ambient"), "haze", 0.2)
    captured = film(with_parameter(pair, "glare", 0.0), even_scene(0))
    assert np.all(captured.original == round(0.2 * 255))
