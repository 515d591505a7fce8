"""The receiver's work is spread over camera frames, and what makes it quick changes no result."""

import sys

import cv2
import numpy as np
import pytest
from conftest import run_process, slow
from pilot_films import FINE, BlockMeans, texture
from scores import noisy
from streams import seen_frame

from link.clock import DisplayClock
from link.code.collect import Collector, Message, make_collector
from link.code.framing import encode
from link.code.rateless import ITERATIONS, MAX_COLUMNS, make_rateless
from link.layout import make_layout
from link.steps import run_to_end
from link.types import Array
from receiver.pilots.motion import GridMaps, MotionEquations
from receiver.reading.occlusion import median_image
from receiver.reading.reader import WORK_A_FRAME
from receiver.reading.states import PURE, compose_state
from receiver.receiver import Receiver
from receiver.seen import MESH, PLACES

N_BITS = 730


# Decoding in steps


def came_at(collector: Collector, rows: Array, work: float, pushes: int) -> tuple[int, Message]:
    """The camera frame, of ``pushes`` for each frame pair, at which the message came."""
    for push in range(pushes * len(rows)):
        pair, left = divmod(push, pushes)
        message = collector.go_on(work) if left else collector.add(rows[pair], pair, work)
        if message is not None:
            return push, message
    raise AssertionError("no message came")


@pytest.mark.parametrize("ber", [0.02, slow(0.1)])
def test_a_message_decoded_in_steps_is_the_same_and_little_later(ber: float) -> None:
    rng = np.random.default_rng(1)
    data = rng.bytes(900)
    bits = encode(data, N_BITS)
    rows = noisy(np.tile(bits, (3, 1)), ber, rng)
    whole, message = came_at(make_collector(N_BITS), rows, np.inf, 4)
    in_steps, other = came_at(make_collector(N_BITS), rows, 1, 4)
    assert message.data == other.data == data
    assert whole <= in_steps <= whole + 4 * ITERATIONS
    usual, _ = came_at(make_collector(N_BITS), rows, WORK_A_FRAME, 4)
    assert usual == whole  # a short message is decoded at once


def test_decoding_goes_on_while_frames_come_and_ends_when_asked() -> None:
    rng = np.random.default_rng(2)
    data = rng.bytes(900)
    rows = noisy(encode(data, N_BITS), 0.02, rng)
    collector = make_collector(N_BITS)
    count = next(
        at for at, row in enumerate(rows) if not collector.add(row, at, 0) and began(collector)
    )
    attempts, progress = collector.attempts, collector.progress
    assert collector.add(rows[count + 1], count + 1, 0) is None
    assert (collector.attempts, collector.decoding) == (attempts, True)
    assert collector.progress > progress  # what comes meanwhile is kept
    message = collector.go_on()
    assert message.data == data
    assert not collector.decoding
    assert collector.go_on() is None


def began(collector: Collector) -> bool:
    """Whether decoding is under way that has enough information to succeed."""
    if collector.decoding and collector.progress < 1.1:
        collector.go_on()
    return collector.decoding


def test_a_message_that_changes_while_another_is_decoded_comes_after_it() -> None:
    rng = np.random.default_rng(3)
    first, second = rng.bytes(900), rng.bytes(900)
    loops = [encode(data, N_BITS) for data in (first, second)]
    collector, count, came = make_collector(N_BITS), 0, []
    for row in noisy(loops[0], 0.02, rng):
        assert collector.add(row, count, 0) is None
        count += 1
        if began(collector):
            break
    for row in noisy(np.tile(loops[1], (2, 1)), 0.02, rng):
        message = collector.add(row, count, 1)
        count += 1
        came += [] if message is None else [(message.data, message.changed)]
    for _ in range(2):
        message = collector.go_on()
        came += [] if message is None else [(message.data, message.changed)]
    assert came == [(first, False), (second, True)]
    assert collector.progress == 1


def test_coarse_grids_leave_nothing_to_go_on_with() -> None:
    collector = make_collector(59)
    loop = encode(b"Hello", 59)
    came = [collector.add(9.0 * row - 4.5, at, 0) for at, row in enumerate(np.tile(loop, (2, 1)))]
    assert [message.text for message in came if message] == ["Hello"]
    assert not collector.decoding
    assert collector.go_on() is None


def test_blocks_after_one_that_cannot_be_decoded_are_left_alone() -> None:
    rng = np.random.default_rng(4)
    code = make_rateless(512)
    information = rng.integers(0, 2, (512, 3 * MAX_COLUMNS), np.uint8)
    llr = 8.0 * code.encode(information, 900) - 4
    llr[300:, 1] = 0
    bits, done = run_to_end(code.decoding_steps(llr))
    assert done.tolist() == [True, False] + [True] * (MAX_COLUMNS - 2) + [False] * 2 * MAX_COLUMNS
    assert np.array_equal(bits[:, done], information[:, done])


def test_steps_of_decoding_tell_their_work() -> None:
    rng = np.random.default_rng(5)
    code = make_rateless(512)
    llr = noisy(code.encode(rng.integers(0, 2, (512, 2), np.uint8), 900), 0.02, rng)
    steps = code.decoding_steps(llr)
    works = [next(steps), next(steps)]
    assert works[1] > 2 * 900
    assert all(work < 40 * works[1] for work in works)
    assert run_to_end(steps)[1].all()


class SlowMessage:
    """Stands in for a collector whose message takes some camera frames to decode."""

    progress, attempts = 1.1, 1

    def __init__(self, frames: int) -> None:
        self.left = frames
        self.works: list[float] = []

    @property
    def decoding(self) -> bool:
        return self.left > 0

    def go_on(self, work: float = np.inf) -> Message | None:
        self.works.append(work)
        self.left -= 1
        return None if self.left else Message(b"slow", 9, 9, 1.0, False)


def test_a_message_is_decoded_on_while_the_display_is_out_of_view() -> None:
    receiver = Receiver(BlockMeans(FINE), 30.0)
    slow = SlowMessage(3)
    receiver._reader.collector = slow  # type: ignore[assignment]
    wall = np.full((120, 160), 90, np.uint8)
    came = [receiver.push(wall, number / 30).message for number in range(5)]
    assert [message and message.data for message in came] == [None, None, b"slow", None, None]
    assert slow.works == [WORK_A_FRAME] * 3


def test_what_is_left_of_decoding_is_done_when_the_film_ends() -> None:
    receiver = Receiver(BlockMeans(FINE), 30.0)
    slow = SlowMessage(1)
    receiver._reader.collector = slow  # type: ignore[assignment]
    message = receiver.finish().message
    assert message is not None
    assert slow.works == [np.inf]


# The same results with less work


def test_the_motion_of_a_grid_has_the_normal_equations_of_all_pixels() -> None:
    """Those of the eight numbers of a homography, and of a further motion."""
    rng, (width, height) = np.random.default_rng(6), (96, 64)
    maps = GridMaps(make_layout(16, 16, width, height), (width, height))
    expected, residual = rng.normal(0, 1, (2, height, width)).astype(np.float32)
    weight = rng.uniform(0.1, 1, (height, width)).astype(np.float32)
    further = rng.normal(0, 1, (2, height, width)).astype(np.float32)
    equations = MotionEquations(maps)
    equations.take(expected, residual, weight, 0.5)
    x, y = np.meshgrid(*maps.places())
    # the motion of a point by the eight numbers of a homography, to first order
    zero, one = np.zeros_like(x), np.ones_like(x)
    motion_x = np.stack([x, y, one, zero, zero, zero, -x * x, -x * y, further[0]])
    motion_y = np.stack([zero, zero, zero, x, y, one, -x * y, -y * y, further[1]])
    slope_x = 0.5 * width / 16 * cv2.Sobel(expected, -1, 1, 0)
    slope_y = 0.5 * height / 16 * cv2.Sobel(expected, -1, 0, 1)
    columns = (slope_x * motion_x + slope_y * motion_y).reshape(9, -1)
    weighed = columns * weight.reshape(-1)
    scale = float(np.diag(weighed @ columns.T).mean())
    for count, found in ((8, equations.normal()), (9, equations.normal(further))):
        matrix, right = (weighed @ columns.T)[:count, :count], weighed @ residual.reshape(-1)
        np.testing.assert_allclose(found[0], matrix, rtol=0, atol=1e-5 * scale)
        np.testing.assert_allclose(found[1], right[:count], rtol=0, atol=1e-5 * scale)


@pytest.mark.parametrize("colour", [False, True])
@pytest.mark.parametrize("delay_y", [0.02, -0.03, 0.0])
def test_states_put_together_by_rows_are_those_of_whole_images(
    colour: bool, delay_y: float
) -> None:
    rng = np.random.default_rng(7)
    shape = (48, 70, 3) if colour else (48, 70)
    frames = [
        seen_frame(number / 30, rng.integers(0, 256, shape).astype(np.uint8)) for number in range(8)
    ]
    clock = DisplayClock(1 / 14, 0.01, 0.004, delay_y, 0.02)
    for number in range(1, 4):
        state = compose_state(frames, clock, number)
        assert state is not None
        shares = [clock.shares(frame.time, PLACES, number).reshape(MESH, MESH) for frame in frames]
        if any(share.min() >= PURE for share in shares):
            continue
        limit = np.minimum(state.purity, PURE) - 1e-6
        total, weights = np.zeros(shape), np.zeros(shape[:2])
        for frame, share in zip(frames, shares, strict=True):
            chosen = ((share >= limit) & (share.max() > 0)).astype(np.float32)
            weight = cv2.resize(chosen, shape[1::-1], interpolation=cv2.INTER_LINEAR)
            total += frame.rectified * (weight[:, :, None] if colour else weight)
            weights += weight
        mean = total / np.maximum(weights[:, :, None] if colour else weights, 1e-3)
        assert np.abs(state.image - mean).max() < 0.51


@pytest.mark.parametrize("count", range(1, 10))
def test_the_median_of_images_is_that_of_numpy(count: int) -> None:
    images = [texture((20, 30), seed) for seed in range(count)]
    assert np.array_equal(median_image(images), np.median(np.stack(images), axis=0))


def test_the_commands_multiply_matrices_with_one_thread() -> None:
    """The variable must be set before numpy is loaded, and a user's own value stands."""
    shown = "os.environ['OPENBLAS_NUM_THREADS'], 'numpy' in sys.modules"
    code = f"import os, sys, receiver; print({shown})"
    for given, seen in ((None, "1 False"), ("3", "3 False")):
        done = run_process(sys.executable, "-c", code, OPENBLAS_NUM_THREADS=given)
        assert done.stdout.strip() == seen, done.stderr
