"""Pictures that move: drawn scenes and video files, as carriers of messages in simulated films."""

from itertools import islice, pairwise
from pathlib import Path

import numpy as np
import pytest
from conftest import Refuses, slow

from data_gen.film.message import FilmSettings, Take, film_message
from data_gen.pictures.carriers import open_carrier
from data_gen.pictures.library import load_pictures
from data_gen.pictures.moving import PICTURE_HZ, SCENES, moving_carrier
from link.code.framing import encode
from link.images.video import write_video
from link.loop import Loop, MovingStates
from link.presets import PRESETS

SIZE = 96, 72
TEST = load_pictures("test", *SIZE)


@pytest.mark.parametrize("scene", SCENES)
def test_scenes_move_and_repeat_what_they_gave_for_a_time(scene: str) -> None:
    film, same = (moving_carrier(scene, TEST, np.random.default_rng(4)) for _ in range(2))
    assert film.rate in PICTURE_HZ
    times = np.arange(0, 6, 0.23)
    shown = [film(float(time)) for time in times]
    assert {picture.shape for picture in shown} == {(72, 96, 3)}
    assert {picture.dtype for picture in shown} == {np.dtype(np.uint8)}
    assert len({picture.tobytes() for picture in shown}) > 1
    for at in (20, 3, 11):
        assert np.array_equal(same(float(times[at])), shown[at])


def test_pictures_change_at_the_films_rate() -> None:
    film = moving_carrier("pan", TEST, np.random.default_rng(1), rate=25)
    times = np.arange(0, 2, 1 / 600)
    changes = sum(film(b) is not film(a) for a, b in pairwise(times))
    assert 49 <= changes <= 51


def test_scenes_of_one_split_show_no_picture_of_the_other() -> None:
    slides = moving_carrier("slides", TEST, np.random.default_rng(0))
    train = {picture.rgb.tobytes() for picture in load_pictures("train", *SIZE)}
    assert not train & {slides(time).tobytes() for time in np.arange(0, 30, 0.2)}


def test_a_video_file_is_played_at_its_own_rate_over_and_over(tmp_path: Path) -> None:
    levels = (40, 90, 140, 190, 240)
    images = [np.full((72, 96, 3), level, np.uint8) for level in levels]
    write_video(tmp_path / "film.mkv", images, 10)
    film = open_carrier(str(tmp_path / "film.mkv"), TEST, np.random.default_rng(0))
    times = (0.0, 0.05, 0.15, 0.45, 0.55, 1.25, 0.1)
    assert [film(time).max() for time in times] == [40, 40, 90, 240, 40, 140, 90]


def test_states_show_the_picture_of_their_time_and_the_loops_bits() -> None:
    preset = PRESETS["hidden"]
    layout = preset.layout
    grays = [np.full((384, 512, 3), level, np.uint8) for level in range(80, 200)]
    bits = encode(b"Hi", layout.n_bits)
    loop = Loop(layout, 2, bits, lambda: iter(grays[:1]))
    states = MovingStates(loop, lambda time: grays[int(25 * time + 1e-6)], 60.0)
    for number in (0, 1, 2, 3, 4, 5, 40, 41):
        pair, gray = number // 2, grays[int(25 * number / 60 + 1e-6)]
        shown = loop.carrier(pair, gray).displayed()
        embedded = layout.code.states_of(pair)[1] == number
        assert np.array_equal(states(number), shown.embedded if embedded else shown.original)
    in_step = MovingStates(loop, lambda time: grays[int(30 * time + 1e-6)], 60.0, in_step=True)
    assert np.array_equal(in_step(0).astype(int) + in_step(1), 2 * grays[0].astype(int))


@pytest.mark.parametrize("carriers", ["moving", slow("cuts")])
def test_films_with_moving_carriers_are_filmed_alike_each_time(carriers: str) -> None:
    settings = FilmSettings(
        kappa=1, preset="hidden", state_hz=60.0, carriers=carriers, size=(320, 240)
    )
    one, other = (film_message(Take(settings, "canon-lg", 0.0, 1, 0)) for _ in range(2))
    assert one.picture == other.picture and one.picture in SCENES
    for frame, same in zip(islice(one.frames, 3), islice(other.frames, 3), strict=True):
        assert np.array_equal(frame.rgb, same.rgb)


def test_what_is_no_carrier_is_refused_in_one_line(refuses: Refuses) -> None:
    refuses("data_gen.video", "--message Hi --out x --carriers nothing", "carriers", "ticker")
