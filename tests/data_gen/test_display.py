import math
from dataclasses import replace

import numpy as np
import pytest
from filming import DISPLAYS, smooth_picture
from hypothesis import given
from hypothesis import strategies as st
from tolerances import FLOAT32

from data_gen.channel.display import Emission, fall_to_corners, room_light
from data_gen.pairs import PAIRS
from data_gen.parameters import Display
from link.layout import make_layout
from link.types import Array

ANGLES = range(0, 80, 5)
displays = st.sampled_from([pair.display for pair in PAIRS.values()])


def emitted(level: int, display: Display, degrees: float) -> Array:
    """Light of an even picture's centre in R, G, B."""
    theta = np.full((3, 3), np.radians(degrees))
    light = Emission.of(display, theta).light(np.full((3, 3, 3), level, np.uint8))
    return np.asarray(light[1, 1], np.float64)


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
