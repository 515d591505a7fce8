"""What the simulation cannot be asked for is refused in one line that says what it needs."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from conftest import cases, refusal
from filming import ROOM, SMALL, only, scene

from data_gen.channel.optics import check_view
from data_gen.channel.stills import capture
from data_gen.effects import parse_settings, with_parameter
from data_gen.film.codec import CodecSettings
from data_gen.film.phone import PhoneSettings
from data_gen.film.scenes import SceneSettings, draw_scene
from data_gen.film.stream import VideoSettings, film
from data_gen.frame_pair import Cell, FramePair, Source
from data_gen.pairs import get_pair
from data_gen.pictures.drawings import draw_picture
from data_gen.pictures.library import load_pictures

NAN, INF = math.nan, math.inf
PAIR = get_pair("canon-lg")
FRONTAL = Cell("canon-lg", 0.0, 5)


def phone(**settings: float) -> VideoSettings:
    return VideoSettings(phone=PhoneSettings(**settings))  # type: ignore[arg-type]


def h264(**settings: object) -> CodecSettings:
    return replace(CodecSettings("h264"), **settings)  # type: ignore[arg-type]


@cases(
    (VideoSettings(fps=0.0), "fps: need 0.1 to 1000"),
    (VideoSettings(hand=NAN), "hand: need 0 to 100"),
    (VideoSettings(jumps_hz=-1.0), "jumps_hz: need 0 to 1000 a second"),
    (VideoSettings(shutter=NAN), "shutter: need 1e-05 to 1 seconds"),
    (VideoSettings(drop=1.0), "drop: need a probability"),
    (VideoSettings(jitter_s=-0.1), "jitter_s: need 0 to 1 seconds"),
    (SceneSettings(size=(20, 400)), "size: need at least 64x64"),
    (SceneSettings(room="cellar"), "room 'cellar'; choose one of: dark, office, bright"),
    (SceneSettings(free=0.4), "free: need 0 to 0.2 of the image"),
    (phone(noise_reduction=1.0), "noise_reduction: need 0 to 0.95, got 1"),
    (phone(local_tone=-1.0), "local_tone: need 0 to 100"),
    (phone(stabilise_s=11.0), "stabilise_s: need 0 to 10 seconds"),
    (phone(sharpen=6.0), "sharpen: need 0 to 5"),
    (phone(distortion=-0.3), "distortion: need -0.12 to 0.12"),
    (h264(name="vp9"), "codec.name: need none, h264, hevc, got 'vp9'"),
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_settings_of_films_out_of_range(settings: Any, says: str) -> None:
    assert says in refusal(settings.check)


def filmed(cell: Cell = FRONTAL, **source: Any) -> Callable[[], object]:
    return lambda: FramePair(Source(SMALL, **source), cell, 0).captured


def seen_at(view_deg: float) -> Callable[[], object]:
    return lambda: capture(scene(), PAIR, view_deg, np.random.default_rng(0))


def drawn(view_deg: float, *effects: str) -> Callable[[], object]:
    pair = only("canon-lg", *effects)
    return lambda: draw_scene(SMALL, pair, view_deg, np.random.default_rng(0), ROOM)


@cases(
    (filmed(replace(FRONTAL, kappa=0)), ("kappa",)),
    (filmed(parameters=(("drift", 9.0),)), ("drift must lie in",)),
    (filmed(parameters=(("metering", 1.5),)), ("setup: metering must lie in [0, 1]",)),
    (seen_at(75.5), ("view_deg: need an angle within ±75 degrees, got 75.5",)),
    (seen_at(NAN), ("view_deg: need an angle within ±75 degrees, got nan",)),
    (lambda: check_view(75.001, "--views"), ("--views: need an angle within", "got 75.001")),
    (drawn(80.0, "perspective"), ("view_deg",)),
    (
        lambda: next(film([], SMALL, PAIR, 0.0, VideoSettings(), np.random.default_rng(0))),
        ("states: a display needs at least one state",),
    ),
    (lambda: load_pictures("valid", 320, 240), ("'valid'", "train, test")),
    (lambda: load_pictures("test", 10, 240), ("10x240",)),
    (lambda: draw_picture("chart", 0, 320, 240), ("'chart'", "slide, map, poster")),
)
def test_captures_and_pictures_that_cannot_be(
    call: Callable[[], object], says: tuple[str, ...]
) -> None:
    said = refusal(call)
    for part in says:
        assert part in said


ROWS = ((0.8, 0.1, 0.1), (0.1, 0.8, 0.1))
NO_MATRIX: list[Any] = [
    (),
    ((1.0, 0.0), (0.0, 1.0), (0.0, 1.0)),
    (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0),
]
NO_CURVE: list[Any] = [
    (),
    ((0.0, 0.0), (1.0, 0.9)),
    ((0.1, 0.0), (1.0, 1.0)),
    ((0.0, 0.0), (0.5, 0.6), (0.7, 0.5), (1.0, 1.0)),
    ((0.0, 0.0), (0.5, NAN), (1.0, 1.0)),
]
OTHER_KINDS = [
    'drift="low"',
    'gamma=[2, 2, "a"]',
    "gamma=[2, 2, [2]]",
    "crosstalk=[1, 0, 0, 0, 1, 0, 0, 0, 1]",
    "tone_curve=[[0, 0], [0.5], [1, 1]]",
    "jpeg_quality=50.5",
    "panel=null",
]


@cases(
    ("name", "x", "unknown parameter 'name'"),
    ("frontal", "x", "unknown parameter 'frontal'"),
    ("drift", 0.6, "drift must lie in [0, 0.5], got 0.6"),
    ("panel", "CRT", f"panel of {PAIR.display.name} 'CRT'"),
    ("encoding", "raw", f"encoding of {PAIR.camera.name} 'raw'"),
    *((*parse_settings([text])[0], text.split("=")[0]) for text in OTHER_KINDS),
    *((name, rows, name) for name in ("crosstalk", "color_matrix") for rows in NO_MATRIX),
    *(
        (name, (*ROWS[:row], (total - 0.2, 0.1, 0.1), *ROWS[row:]), "must sum to 1")
        for name in ("crosstalk", "color_matrix")
        for total in (0.997, 1.003)
        for row in (0, 2)
    ),
    *(("tone_curve", curve, f"{PAIR.camera.name}: tone_curve must") for curve in NO_CURVE),
)
def test_values_that_a_parameter_cannot_have(name: str, value: Any, says: str) -> None:
    said = refusal(lambda: with_parameter(PAIR, name, value))
    assert says in said and name in said


def test_choices_are_listed() -> None:
    assert "TN, VA, IPS" in refusal(lambda: with_parameter(PAIR, "panel", "CRT"))
    assert "srgb, linear" in refusal(lambda: with_parameter(PAIR, "encoding", "raw"))
