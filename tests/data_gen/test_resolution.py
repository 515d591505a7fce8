"""A stored image with fewer pixels: the same scene, reduced."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from tolerances import FLOAT64

from data_gen.channel.optics import CAPTURE_HEIGHT, CAPTURE_WIDTH
from data_gen.channel.stills import capture, draw_shots
from data_gen.effects import EFFECTS
from data_gen.frame_pair import Cell, FramePair, Source
from link.geometry import frame_corners, resized_homography, transform
from link.layout import Layout, make_layout
from link.types import Image

CELL = Cell("canon-lg", 45.0, 3)


def source(resolution: float) -> Source:
    return Source(make_layout(), parameters=(("resolution", resolution),))


def test_at_one_nothing_changes() -> None:
    usual, same = (
        FramePair(Source(make_layout()), CELL, 0).captured,
        FramePair(source(1.0), CELL, 0).captured,
    )
    assert np.array_equal(usual.original, same.original)
    assert np.array_equal(usual.embedded, same.embedded)
    assert np.array_equal(usual.corners, same.corners)


def test_corners_of_the_image_go_to_corners_of_the_image() -> None:
    reduced = resized_homography(269 / CAPTURE_WIDTH, 202 / CAPTURE_HEIGHT)
    moved = transform(reduced, frame_corners(CAPTURE_WIDTH, CAPTURE_HEIGHT))
    np.testing.assert_allclose(moved, frame_corners(269, 202), rtol=0, atol=1e6 * FLOAT64)


@pytest.mark.parametrize("resolution", [0.5, 0.35])
def test_the_picture_is_that_of_the_usual_capture_reduced(
    layout: Layout, resolution: float
) -> None:
    quiet = tuple(effect for effect in EFFECTS if effect not in ("perspective", "transfer"))
    without = replace(source(1.0), without=quiet)
    pair, smaller = (
        replace(without, parameters=(("resolution", r),)).pair(CELL.pair) for r in (1.0, resolution)
    )
    take = FramePair(without, CELL, 0)
    usual, small = (
        capture(take.displayed, p, 30.0, np.random.default_rng(3)) for p in (pair, smaller)
    )
    height, width = small.original.shape[:2]
    assert (width, height) == (round(768 * resolution), round(576 * resolution))
    area = cv2.resize(usual.original, (width, height), interpolation=cv2.INTER_AREA)
    shown = area.max(axis=2) > 30  # beside the picture the room is dark in both

    def apart(image: Image) -> float:
        return float(np.abs(image.astype(int) - small.original)[shown].mean())

    shifted = np.roll(area, 3, axis=1)
    assert apart(area) < 0.25 * apart(shifted)


def test_noise_and_motion_shrink_with_the_image(layout: Layout) -> None:
    shots = [
        draw_shots(layout, source(r).pair(CELL.pair), 0.0, np.random.default_rng(5))
        for r in (1.0, 0.5)
    ]
    assert shots[1][0].viewpoint.noise_scale == 0.5 * shots[0][0].viewpoint.noise_scale
    centre = [[255.5, 191.5]]
    moves = [
        transform(b.H_captured_from_display, centre) - transform(a.H_captured_from_display, centre)
        for a, b in shots
    ]
    np.testing.assert_allclose(moves[1], 0.5 * moves[0], rtol=0, atol=1e-3)
