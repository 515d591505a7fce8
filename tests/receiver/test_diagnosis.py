"""Why no message came: each reason names what was seen and what to try, in one line."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import cases

from export.runtime import Decoder
from link.geometry import frame_corners
from link.presets import PRESETS
from models import PRETRAINED
from receiver.diagnosis import Observations, explain_silence
from receiver.receiver import Receiver
from receiver.seen import MESH, points_in_view
from receiver.timing.synchronise import Toggling

STILL = Toggling(strength=0.0, amplitude=0.0, state_hz=0.0, deviation=0.04)
NOISE = Toggling(strength=0.4, amplitude=0.2, state_hz=7.7, deviation=0.5)
WEAK = Toggling(strength=0.8, amplitude=0.6, state_hz=14.94, deviation=0.9)
FOUND = Observations(fps=30, frames=210, found=180, seconds=6.1, level=90.0)


@cases(
    (replace(FOUND, refused=3), ["every message was refused (3)", "sender's key"]),
    (
        Observations(30, frames=90, level=100.0),
        ["no display that is looked for in any of 90 frames", "focus"],
    ),
    (Observations(30, frames=90, level=9.0), ["in any of 90 frames", "dark (mean level 9 of"]),
    (Observations(30, frames=9, level=200.0, clipped=0.6), ["60% of whose pixels", "shorter"]),
    (replace(FOUND, seconds=0.6), ["in 180 of 210 frames", "for 0.6 s", "film longer"]),
    (replace(FOUND, toggling=STILL), ["180 of 210", "patches or pilots do not change", "playing"]),
    (
        replace(FOUND, toggling=NOISE),
        ["than noise (40% of the", "take 30 frames a second"],
    ),
    (
        replace(FOUND, toggling=WEAK),
        ["toggle weakly (by 0.6 gray levels at 14.9 states a second, 80% of", "larger kappa"],
    ),
    (replace(FOUND, toggling=WEAK, level=12.0), ["dark there (mean level 12 of 255", "80% of"]),
    (replace(FOUND, toggling=WEAK, clipped=0.5), ["50% of it at the camera's limit", "80% of"]),
    (replace(FOUND, toggling=WEAK, cut=90), ["only in part in 90 of them", "move back"]),
    (replace(FOUND, state_hz=15.0), ["its clock was found (15.0 states a second)", "longer"]),
    (
        replace(FOUND, state_hz=29.9, decoded=80, mixed=0.8, progress=0.3),
        ["80 frame pairs gave 30%", "29.9 states a second", "takes 30 frames", "send at 15"],
    ),
    (replace(FOUND, state_hz=15.0, decoded=9, progress=2.1), ["gave 210% of the", "is wrong"]),
    (
        replace(FOUND, state_hz=15.0, decoded=40, mixed=0.1, progress=0.72),
        ["40 frame pairs gave 72%", "film longer or closer"],
    ),
)
def test_each_reason_names_what_was_seen(seen: Observations, says: list[str]) -> None:
    line = explain_silence(seen)
    assert len(line.splitlines()) == 1
    for words in says:
        assert words in line


SLOW = "20 frames a second, and a display with preset fast (30 states a second) needs at least 30"


@pytest.mark.parametrize("found", [0, 40])
def test_a_camera_that_is_too_slow_for_a_preset_is_named(found: int) -> None:
    seen = Observations(20, 90, found, level=9.0, presets=("fast",))
    assert f"{SLOW}, better 60: film at a higher rate" in explain_silence(seen)
    assert "exposure" not in explain_silence(seen)
    among = replace(seen, found=0, presets=tuple(PRESETS))
    assert SLOW in explain_silence(among)
    for fitting in (replace(seen, fps=30), replace(seen, fps=30, presets=("robust", "hidden"))):
        assert "needs at least" not in explain_silence(fitting)


def test_an_exposure_over_more_than_a_state_is_named() -> None:
    seen = replace(FOUND, fps=30, state_hz=60.0, exposed=1.9, decoded=91, presets=("hidden",))
    assert "lasts for 1.9 of the display's states" in explain_silence(seen)
    assert "one of 1/60 s or less reads faster" in explain_silence(seen)
    assert "reads faster" not in explain_silence(replace(seen, exposed=1.0))


def test_a_rate_that_only_just_fits_is_named() -> None:
    seen = replace(FOUND, fps=30, state_hz=29.5, decoded=91, presets=("fast",))
    line = explain_silence(seen)
    assert "91 frame pairs gave 0%" in line
    assert "shows 29.5 states a second, and the camera takes 30 frames" in line


def test_a_display_with_a_code_may_show_more_states_than_the_camera_takes_frames() -> None:
    seen = replace(FOUND, fps=30, state_hz=60.0, decoded=91, mixed=1.0, presets=("hidden",))
    line = explain_silence(seen)
    assert "91 frame pairs gave 0%" in line and "film longer or closer" in line


@cases(
    replace(FOUND, seconds=0.6, level=12.0),
    replace(FOUND, fps=20, level=12.0, presets=("fast",)),
    replace(FOUND, level=12.0, state_hz=60.0, exposed=1.9, decoded=91, presets=("hidden",)),
    replace(FOUND, level=12.0, state_hz=29.9, decoded=80, mixed=0.8),
)
def test_darkness_is_not_blamed_where_another_cause_is_known(seen: Observations) -> None:
    assert "dark" not in explain_silence(seen)


def test_a_good_view_is_not_called_dark_bright_or_cut() -> None:
    line = explain_silence(replace(FOUND, toggling=WEAK, cut=2, clipped=0.05))
    for word in ("dark", "limit", "part"):
        assert word not in line


def test_the_receiver_observes_the_light_of_frames_without_display() -> None:
    receiver = Receiver(Decoder(PRETRAINED / "decoder.onnx"), fps=24)
    for number in range(3):
        receiver.push(np.full((120, 160, 3), 7 + number, np.uint8), number / 24)
    seen = receiver.observations
    assert (seen.fps, seen.frames, seen.found, seen.level) == (24, 3, 0, 8.0)
    assert "dark (mean level 8 of 255)" in explain_silence(seen)


def test_points_outside_the_image_are_known() -> None:
    corners = frame_corners(160, 120)
    assert points_in_view(corners, (120, 160)) is None
    seen = points_in_view(corners - [80, 0], (120, 160, 3))
    assert not seen[:, : MESH // 2].any()
    assert seen[:, MESH // 2 :].all()
