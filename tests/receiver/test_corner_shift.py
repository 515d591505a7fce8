"""Decoded blocks say where the display lies in its rectified image."""

from collections.abc import Callable

import cv2
import numpy as np
import pytest
from conftest import cases, slow
from pilot_films import FINE, texture

import receiver.tracking.corners as corners_module
from link.geometry import frame_corners, transform
from link.layout import Layout, make_layout
from link.pilots import expected_changes, pilot_signs
from link.types import Array, Image
from receiver.tracking.corners import CornerShift
from receiver.tracking.follow import Follower

CLOSE_PX = 0.2


def moved(*, x: float = 0.0, y: float = 0.0, corner: float = 0.0) -> Array:
    """A translation, and a homography that moves the last corner but one by as much on each axis.

    The three numbers are pixels of the layout.
    """
    start = frame_corners(FINE.width, FINE.height)
    end = start + np.array([x, y])
    end[2] += corner
    return np.asarray(cv2.getPerspectiveTransform(start.astype("f4"), end.astype("f4")))


def largest_move(H: Array, layout: Layout = FINE) -> float:
    """Largest distance by which a homography moves a corner of the layout, pixels."""
    start = frame_corners(layout.width, layout.height)
    return float(np.linalg.norm(transform(H, start) - start, axis=1).max())


class Display:
    """Makes frame pairs of random bits over one picture, rectified wrongly, and their scores."""

    def __init__(self, layout: Layout = FINE, kappa: float = 5.0, colour: bool = False) -> None:
        self.layout, self.kappa, self.colour = layout, kappa, colour
        self.rng = np.random.default_rng(0)
        self.picture = 130 + 25 * texture((layout.height, layout.width), 1, 12.0)

    def pair(self, H_old_from_new: Array) -> tuple[list[Image], Array]:
        """Two frames, and by how much each shows each block changed."""
        layout = self.layout
        signs = self.rng.choice([-1.0, 1.0], layout.rows * layout.cols)
        signs[layout.pilot_blocks] = pilot_signs(layout)
        grid = signs.reshape(layout.rows, layout.cols)
        size = layout.width, layout.height
        change = cv2.resize(grid, size, interpolation=cv2.INTER_NEAREST)
        frames = []
        for sign in (-1, 1):
            shown = self.picture + sign * self.kappa * change
            seen = cv2.warpPerspective(shown, H_old_from_new, size, borderMode=cv2.BORDER_REPLICATE)
            noisy = seen + self.rng.normal(0, 2, seen.shape)
            gray = np.clip(noisy + 0.5, 0, 255).astype(np.uint8)
            frames.append(np.repeat(gray[:, :, None], 3, axis=2) if self.colour else gray)
        return frames, np.stack([-grid / 2, grid / 2])


def follow(display: Display, H: Array, pairs: int, known: Callable[[Array], Array]) -> Array:
    """Move the display by what each frame pair says; how it is misplaced in the end."""
    shifts, start = CornerShift(display.layout), H
    for _ in range(pairs):
        frames, changes = display.pair(H)
        shifts.take(frames, known(changes), 2 * [shifts.placement])
        H = left(shifts, start)
    return H


def left(shifts: CornerShift, misplaced: Array) -> Array:
    """How a display is misplaced still, once it is moved."""
    H = np.linalg.inv(shifts.placement.H_followed_from_shown) @ misplaced
    return np.asarray(H / H[2, 2])


@cases(
    (moved(), False),
    (moved(x=4.0, y=-3.0), False),
    slow(moved(corner=5.0), False),
    slow(moved(x=-3.0, y=1.5, corner=4.0), False),
    slow(moved(x=4.0, y=-3.0), True),
    ids=["nothing", "translation", "one corner", "both", "RGB"],
)
def test_the_display_is_moved_to_where_its_blocks_lie(misplaced: Array, colour: bool) -> None:
    display, H = Display(colour=colour), misplaced
    shifts, errors = CornerShift(FINE), []
    corners = frame_corners(FINE.width, FINE.height)
    for _ in range(14):
        shifts.take(*display.pair(H), 2 * [shifts.placement])
        H = left(shifts, misplaced)
        errors.append(transform(H, corners) - corners)
    settled = np.array(errors[6:])
    assert np.abs(settled.mean(axis=0)).max() < CLOSE_PX
    assert np.abs(settled).max() < 3 * CLOSE_PX


def test_frame_pairs_that_waited_move_the_display_once() -> None:
    """All were rectified before the first move, and show the same error, which is put right once.

    To first order, that is: pairs that are rectified afterwards put the rest right.
    """
    display, misplaced = Display(), moved(x=4.0, corner=3.0)
    shifts = CornerShift(FINE)
    before = shifts.placement
    for _ in range(20):
        shifts.take(*display.pair(misplaced), 2 * [before])
        assert largest_move(left(shifts, misplaced)) < 1.1 * largest_move(misplaced)
    assert largest_move(left(shifts, misplaced)) < 0.5 * largest_move(misplaced)


def test_frames_of_a_display_that_was_found_at_another_time_move_nothing() -> None:
    display, now, before = Display(), CornerShift(FINE), CornerShift(FINE)
    now.take(*display.pair(moved(x=4.0)), [before.placement, now.placement])
    np.testing.assert_array_equal(now.placement.H_followed_from_shown, np.eye(3))
    now.take(*display.pair(moved(x=4.0)), [now.placement, now.placement])
    assert largest_move(now.placement.H_followed_from_shown) > 1.0


@pytest.mark.slow
def test_pilots_alone_move_the_display() -> None:
    """Without a decoded block, the message is noise beside the signs of the pilots."""
    pilots = np.abs(expected_changes(FINE))
    start = moved(x=5.0, y=5.0)
    assert largest_move(follow(Display(), start, 20, lambda changes: changes * pilots)) < 3.0


def test_without_evidence_nothing_moves() -> None:
    still = Display(kappa=0.0)
    assert largest_move(follow(still, np.eye(3), 8, np.zeros_like)) < 0.1
    even = np.full((FINE.height, FINE.width), 90, np.uint8)
    shifts = CornerShift(FINE)
    pilots = expected_changes(FINE) / 2
    shifts.take([even, even], np.stack([-pilots, pilots]), 2 * [shifts.placement])
    assert largest_move(shifts.placement.H_followed_from_shown) < 1e-6


def test_a_picture_that_moves_costs_what_it_covers() -> None:
    """A third of the display shows another picture in each frame."""
    display, shifts, misplaced = Display(), CornerShift(FINE), moved(x=3.0, y=-2.0)
    for number in range(12):
        frames, changes = display.pair(left(shifts, misplaced))
        for side, frame in enumerate(frames):
            other = 130 + 60 * texture((FINE.height, FINE.width), 2 * number + side + 5, 12.0)
            frame[:, : FINE.width // 3] = other[:, : FINE.width // 3].clip(0, 255)
        shifts.take(frames, changes, 2 * [shifts.placement])
    assert largest_move(left(shifts, misplaced)) < 5 * CLOSE_PX


def test_a_far_move_is_not_believed(monkeypatch: pytest.MonkeyPatch) -> None:
    display, misplaced = Display(), moved(x=5.0)
    assert largest_move(follow(display, misplaced, 1, np.asarray)) < 4.0
    monkeypatch.setattr(corners_module, "FAR_BLOCKS", 0.02)
    np.testing.assert_array_equal(follow(display, misplaced, 1, np.asarray), misplaced)


def test_no_frames_move_a_corner_by_more_than_a_block() -> None:
    display, shifts = Display(kappa=20.0), CornerShift(FINE)
    for far in np.linspace(-40, 40, 17):
        before = shifts.placement.H_followed_from_shown
        shifts.take(*display.pair(moved(x=far, y=-far)), 2 * [shifts.placement])
        step = np.linalg.inv(before) @ shifts.placement.H_followed_from_shown
        assert largest_move(step) < np.sqrt(2) * FINE.width / FINE.cols


def test_a_display_with_patches_is_never_moved() -> None:
    layout = make_layout()
    image = np.full((layout.height, layout.width), 90, np.uint8)
    seen = Follower(layout).see(image, 0.0, frame_corners(layout.width, layout.height))
    assert seen is not None and seen.placement is None
