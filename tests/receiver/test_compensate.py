"""What has only moved is taken off frames, and what toggles is left."""

import cv2
import numpy as np
import pytest
from pilot_films import texture

from link.pilots import pilot_signs
from link.presets import PRESETS
from link.types import Array, Image
from receiver.pilots.compensate import NOTHING, STEPS, Compensator, MovingPicture
from receiver.seen import SeenFrame, SeenFrames
from receiver.tracking.judge import WATCHED, Judge

BLOCKS = 12, 16
"""Rows and columns of blocks of 16 x 16 pixels."""
SIGNS = np.random.default_rng(0).choice([-1.0, 1.0], BLOCKS)


def panned(states: list[int], px: int, seed: int = 1) -> list[Image]:
    """Frames of a picture that moves by pixels a frame, under blocks that toggle by 2 levels."""
    height, width = 16 * BLOCKS[0], 16 * BLOCKS[1]
    wide = 120 + 35 * texture((height, width + px * len(states)), seed)
    toggled = np.kron(SIGNS, np.ones((16, 16)))
    return [
        np.uint8(np.clip(wide[:, px * n : px * n + width] + 2 * state * toggled, 0, 255).round())
        for n, state in enumerate(states)
    ]


def along_signs(change: Array) -> float:
    """Correlation of the blocks' means, but for those at the border, with their signs."""
    means = change.reshape(BLOCKS[0], 16, BLOCKS[1], 16).mean(axis=(1, 3))
    inner = np.s_[1:-1, 1:-1]
    return float(np.corrcoef(means[inner].ravel(), SIGNS[inner].ravel())[0, 1])


@pytest.mark.parametrize("px", [7, 12])
def test_what_toggles_is_left_of_a_picture_that_moves(px: int) -> None:
    states = [1, -1, 1, 1, -1, 1]
    frames = panned(states, px)
    compensator = Compensator(30.0)
    changes = [compensator.take(frame).astype(float) - NOTHING for frame in frames]
    for number in (1, 2, 4, 5):  # with states that differ from those before
        bare = frames[number].astype(float) - frames[number - 1]
        assert states[number] * along_signs(changes[number]) > 0.7
        assert abs(along_signs(bare)) < 0.5
        assert np.abs(changes[number]).mean() / STEPS < 0.3 * np.abs(bare).mean()


def test_nothing_is_left_of_what_stands_still() -> None:
    still = panned([0], 0)[0]
    compensator = Compensator(30.0)
    for _ in range(3):
        assert (compensator.take(still) == NOTHING).all()


@pytest.mark.parametrize("shape", [(1, 1), (5, 640), (16, 16), (640, 11)], ids=str)
def test_flashes_are_cut_to_8_bits_in_frames_of_any_size(shape: tuple[int, int]) -> None:
    """No point can be followed where a frame is black or white."""
    compensator, levels = Compensator(30.0), [0, 255, 255, 0]
    changes = [compensator.take(np.full(shape, level, np.uint8)) for level in levels]
    for change, expected in zip(changes, [NOTHING, 255, NOTHING, 0], strict=True):
        assert change.shape == shape and (change == expected).all()


def test_frames_of_quick_cameras_are_compared_over_the_same_time() -> None:
    """At 60 frames a second, a frame is compared with the one before the last."""
    compensator = Compensator(60.0)
    changes = [compensator.take(frame) for frame in panned([1, -1, 1, -1, 1], 0)]
    assert [bool((change == NOTHING).all()) for change in changes] == [
        True,
        False,
        True,
        True,
        True,
    ]


@pytest.mark.parametrize("px", [3, 7])
def test_motion_is_told_with_little_of_the_message(px: int) -> None:
    """The message of the frame before, moved with all that it shows, would be the whole of it."""
    states, inner = [1, -1, 1, 1, -1, 1, -1, -1, 1], np.s_[16:-16, 16:-16]
    frames = [frame.astype(np.float32) for frame in panned(states, px)]
    bare = [frame.astype(np.float32) for frame in panned([0] * len(states), px)]
    picture = MovingPicture()
    motions = [picture.take(frame) for frame in frames]
    assert not motions[0].any()
    for number in range(3, len(states)):
        true = (bare[number] - bare[number - 1])[inner]
        error = motions[number][inner] - true
        assert np.square(error).mean() < 0.02 * np.square(true).mean()
        message = 2 * states[number - 1] * np.kron(SIGNS, np.ones((16, 16)))
        moved = (np.roll(message, -px, axis=1) - message)[inner]
        assert abs((error * moved).sum()) < 0.7 * np.square(moved).sum()


def test_what_stands_still_does_not_move() -> None:
    picture, still = MovingPicture(), panned([0], 0)[0].astype(np.float32)
    rng = np.random.default_rng(0)
    for _ in range(4):
        noisy = (still + rng.normal(0, 2, still.shape)).clip(0, 255)
        assert np.abs(picture.take(noisy.astype(np.float32))).mean() < 0.2


@pytest.mark.parametrize("levels", [1.0, 0.0])
def test_a_display_whose_picture_moves_is_judged_by_what_is_left(levels: float) -> None:
    """It toggles in every frame, or not at all; its picture alone says nothing of either."""
    layout = PRESETS["robust"].layout
    blocks = np.zeros(layout.rows * layout.cols)
    blocks[layout.pilot_blocks] = levels * pilot_signs(layout)
    size, grid = (layout.width, layout.height), blocks.reshape(layout.rows, layout.cols)
    signs = cv2.resize(grid, size, interpolation=cv2.INTER_NEAREST)
    wide = 120 + 40 * texture((layout.height, layout.width + 16 * WATCHED), 3, sigma=8)
    before, corners = SeenFrames(), layout.corners
    for number in range(WATCHED):
        shown = wide[:, 16 * number : 16 * number + layout.width] + (-1) ** number * signs
        rectified = np.uint8(np.clip(shown, 0, 255).round())
        frame = SeenFrame(layout, number / 30, corners, rectified, followed=number + 1)
        if number < WATCHED - 1:
            before.add(frame)
    judge = Judge(layout, 30.0, 0.0, 0, 0)
    assert judge.has_stopped(frame, before) == (levels == 0)
