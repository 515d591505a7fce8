"""Streams: shares of states in exact toy cases, and what the truth of a stream promises."""

import json
from collections.abc import Sequence
from dataclasses import replace
from itertools import islice, pairwise
from pathlib import Path

import numpy as np
import pytest
from conftest import Command, Refuses
from filming import ROOM, SMALL, only, seen_centre, true_centre
from hypothesis import given
from hypothesis import strategies as st
from tolerances import FLOAT64

from data_gen.channel.timing import state_shares
from data_gen.film.shake import LIMIT, ExposureDrift, Hand, Wander
from data_gen.film.stream import VideoFrame, VideoSettings, film
from data_gen.pairs import get_pair
from data_gen.parameters import Pair
from data_gen.video import main
from link.geometry import frame_corners, transform
from link.images.files import read_image
from link.images.video import read_video
from link.types import Array, Image

STEADY = VideoSettings(scene=ROOM, seconds=1.0, clock_error=0.0, start_s=0.0, hand=0.0)
WHITE, BLACK = (np.full((96, 128, 3), level, np.uint8) for level in (255, 0))
QUIET = only("canon-lg", "perspective")
"""No noise, no flicker; the file holds 255 x light, rounded."""


def with_shutter(shutter_s: float, readout_s: float = 0.0, pair: Pair = QUIET) -> Pair:
    return replace(pair, camera=replace(pair.camera, shutter_s=shutter_s, readout_s=readout_s))


def stream(
    chosen: VideoSettings,
    states: Sequence[Image] = (WHITE, BLACK),
    pair: Pair = QUIET,
    seed: int = 0,
) -> list[VideoFrame]:
    return list(film(states, SMALL, pair, 0.0, chosen, np.random.default_rng(seed)))


def inside(frame: VideoFrame) -> Array:
    """Rows (h, w) of green well within the display."""
    corners = transform(frame.H_captured_from_display, frame_corners(128, 96))
    (left, top), (right, bottom) = (
        np.ceil(np.sort(corners, axis=0)[1] + 3).astype(int),
        np.floor(np.sort(corners, axis=0)[2] - 3).astype(int),
    )
    return np.asarray(frame.rgb[top:bottom, left:right, 1], np.float64)


@given(
    st.floats(-0.1, 5),
    st.floats(1e-3, 0.2),
    st.floats(1, 60),
    st.sampled_from([0.0, 0.002, 0.02]),
    st.floats(0, 0.03),
)
def test_shares_are_those_of_a_fine_sum(
    start: float, shutter_s: float, state_hz: float, response_s: float, readout_s: float
) -> None:
    opens = start + np.linspace(0, readout_s, 5)
    first, weights = state_shares(opens, shutter_s, state_hz, response_s)
    assert (weights >= 0).all()
    np.testing.assert_allclose(weights.sum(axis=0), 1.0, atol=FLOAT64)
    t = opens[-1] + (np.arange(20_000) + 0.5) / 20_000 * shutter_s
    since, until = (t - (first + k + np.arange(len(weights))[:, None]) / state_hz for k in (0, 1))

    def step(lag: Array) -> Array:
        on = np.maximum(lag, 0)
        return (lag > 0) * (-np.expm1(-on / response_s) if response_s else 1.0)

    expected = (step(since) - step(until)).mean(axis=1)
    np.testing.assert_allclose(weights[1:, -1], expected[1:], atol=2e-4)


def test_brightness_is_the_share_of_white() -> None:
    frames = stream(replace(STEADY, state_hz=11.0), pair=with_shutter(0.02))
    mixed = 0
    for frame in frames:
        white = sum(share for state, share in frame.states.items() if state % 2 == 0)
        assert sum(frame.states.values()) == pytest.approx(1)
        np.testing.assert_allclose(inside(frame), 255 * white, rtol=0, atol=2.0)
        mixed += 0.02 < white < 0.98
    assert mixed >= 5


def test_states_come_at_the_display_rate_by_the_camera_s_clock() -> None:
    for error in (-0.01, 0.0, 0.01):
        chosen = replace(STEADY, clock_error=error, seconds=20.0, fps=2.0, state_hz=15.0)
        last = stream(chosen)[-1]
        assert last.time_s == pytest.approx(19.5)
        assert last.display_s == pytest.approx(19.5 * (1 + error))
        assert max(last.states) == int((19.5 * (1 + error) + 1 / 64) * 15)


def test_no_frame_is_exposed_for_longer_than_it_lasts() -> None:
    slow = with_shutter(1 / 64, readout_s=0.015)
    quick = replace(STEADY, fps=128.0, state_hz=64.0, seconds=0.25)
    shown = [frame.states for frame in stream(quick, pair=with_shutter(1 / 64))]
    assert [max(states.values()) for states in shown] == pytest.approx([1.0] * len(shown))
    camera = slow.camera.filming(128.0)
    assert (camera.shutter_s, camera.readout_s) == (1 / 128, 1 / 128)
    assert slow.camera.filming(60.0) == slow.camera


def test_a_shorter_exposure_is_as_bright_and_noisier() -> None:
    noisy = only("canon-lg", "perspective", "noise")
    gray = [np.full((96, 128, 3), 128, np.uint8)]
    mean, deviation = {}, {}
    for fps in (60.0, 256.0):
        frames = stream(replace(STEADY, fps=fps, seconds=8 / fps), gray, noisy)
        levels = np.array([inside(frame) for frame in frames])
        mean[fps], deviation[fps] = levels.mean(), levels.std(axis=0, ddof=1).mean()
    assert mean[256.0] == pytest.approx(mean[60.0], abs=0.2)
    assert deviation[256.0] > 1.5 * deviation[60.0]


def test_the_loop_starts_again() -> None:
    gray = [np.full((96, 128, 3), level, np.uint8) for level in (40, 120, 200)]
    frames = stream(
        replace(STEADY, state_hz=10.0, fps=10.0, start_s=0.03), gray, with_shutter(0.02)
    )
    seen = [round(float(inside(frame).mean())) for frame in frames]
    assert seen[:3] == seen[3:6] == seen[6:9]
    assert len(set(seen[:3])) == 3
    assert [list(frame.states) for frame in frames] == [[k] for k in range(10)]


def test_the_panel_writes_its_rows_from_top_to_bottom() -> None:
    chosen = replace(STEADY, state_hz=10.0, fps=10.0, start_s=0.1, seconds=0.05)
    pair = with_shutter(1 / 60, pair=only("canon-lg", "perspective", "scan"))
    rows = inside(stream(chosen, (WHITE, BLACK, WHITE), pair)[0]).mean(axis=1)
    assert rows[0] < 30  # written first, and black since
    assert rows[-1] > 220  # white until the end of the scan
    assert (np.diff(rows) > -1).all()


def test_a_hand_moves_smoothly_and_not_far() -> None:
    for seed in range(5):
        hand = Hand((1280, 720), 1.0, np.random.default_rng(seed))
        points = np.array([transform(hand.step(1 / 30), [[639.5, 359.5]])[0] for _ in range(900)])
        assert np.abs(points - [639.5, 359.5]).max() < LIMIT * 4 + 2
        assert points.std(axis=0).min() > 0.7  # it does move
        speeds = np.linalg.norm(np.diff(points, axis=0), axis=1) * 30
        assert 2 < np.median(speeds) < 40  # px/s


def test_wandering_has_deviation_one_at_the_start_and_later() -> None:
    walks = [Wander(500, np.random.default_rng(seed)) for seed in range(4)]
    early = np.concatenate([walk.step(1e-3) for walk in walks])
    later = np.concatenate([[walk.step(1 / 30) for _ in range(60)][-1] for walk in walks])
    for values in (early, later):  # tanh takes some off; 2000 draws: 1.6 % standard error
        assert 0.8 < values.std() < 1.02


def test_exposure_breathes_and_jumps_where_asked_to() -> None:
    rng = np.random.default_rng(0)
    still = ExposureDrift(0.0, 0.0, rng)
    assert {still.step(1 / 30) for _ in range(50)} == {1.0}
    breathing = ExposureDrift(0.02, 0.0, rng)
    gains = np.log([breathing.step(1 / 30) for _ in range(3000)])
    assert 0.012 < gains.std() < 0.025
    assert np.abs(np.diff(gains)).max() < 0.02
    jumping = ExposureDrift(0.0, 1.0, rng)
    assert np.log([jumping.step(1 / 30) for _ in range(3000)]).std() > 0.05


def test_the_picture_follows_the_truth_of_a_moving_camera() -> None:
    chosen = replace(STEADY, hand=3.0, seconds=3.0, fps=2.0)
    frames = stream(chosen, (WHITE,))
    centres = []
    for frame in frames:
        np.testing.assert_allclose(seen_centre(frame), true_centre(frame), atol=0.3)
        centres.append(true_centre(frame))
    assert np.ptp(centres, axis=0).max() > 0.3
    assert all(frame.visible for frame in frames)


def test_lost_frames_are_counted_and_repeated_ones_flagged() -> None:
    chosen = replace(STEADY, drop=0.3, duplicate=0.3, seconds=4.0)
    frames = stream(chosen, pair=get_pair("canon-lg"))
    numbers = [frame.number for frame in frames]
    assert numbers == sorted(set(numbers))
    assert 0.15 < 1 - len(numbers) / 120 < 0.45
    for before, frame in pairwise(frames):
        assert np.array_equal(before.rgb, frame.rgb) == frame.duplicate
        assert frame.time_s == pytest.approx(frame.number / 30)
    assert 0.15 < np.mean([frame.duplicate for frame in frames]) < 0.45


def test_a_stream_without_length_does_not_end_and_asks_for_states() -> None:
    asked = []

    def states(number: int) -> Image:
        asked.append(number)
        return WHITE if number % 2 else BLACK

    endless = film(
        states,
        SMALL,
        QUIET,
        0.0,
        replace(STEADY, seconds=None, state_hz=30.0),
        np.random.default_rng(0),
    )
    frames = list(islice(endless, 40))
    assert frames[-1].number == 39
    assert asked == sorted(set(asked))
    assert max(asked) >= 39


SHORT = ("--message", "hi", "--seconds", "0.2", "--size", "160", "96", "--width", "128")
SHORT += ("--height", "96", "--rows", "4", "--cols", "6", "--ratex", "2", "--drop", "0.3")


def test_the_command_writes_frames_and_truth(
    tmp_path: Path, command: Command, refuses: Refuses
) -> None:
    out = tmp_path / "stream"
    done = command(main, *SHORT, "--out", out)
    report = json.loads(done.stdout)
    lines = [json.loads(line) for line in (out / "truth.jsonl").read_text().splitlines()]
    assert report["camera_frames"] == len(lines) == len(list(out.glob("*.png")))
    assert report["simulated"] is True
    for line in lines:
        assert line["file"] == f"{line['number']:06d}.png"
        assert read_image(out / line["file"]).shape == (96, 160, 3)
        assert np.array(line["H_captured_from_display"]).shape == (3, 3)
    refuses("data_gen.video", [*SHORT, "--out", out], "is there already")


def test_a_video_file_holds_the_same_frames(tmp_path: Path, command: Command) -> None:
    command(main, *SHORT, "--out", tmp_path / "a")
    command(main, *SHORT, "--out", tmp_path / "a.mkv")
    stored = [read_image(file) for file in sorted((tmp_path / "a").glob("*.png"))]
    for image, frame in zip(stored, read_video(tmp_path / "a.mkv"), strict=True):
        assert np.array_equal(image, frame)
    truths = [
        [json.loads(line) | {"file": None} for line in path.read_text().splitlines()]
        for path in (tmp_path / "a" / "truth.jsonl", tmp_path / "a.jsonl")
    ]
    assert truths[0] == truths[1]
