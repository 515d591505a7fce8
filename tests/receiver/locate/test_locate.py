"""Finding the display: drawn scenes, small and few, none of them used to tune anything."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import Command, Refuses, slow
from drawn_scenes import CORNERS, HEIGHT, LAYOUT, PLAIN, WIDTH, content, room, scene
from hypothesis import given, settings
from hypothesis import strategies as st

from link.images import as_gray, write_image
from link.images.files import read_image
from link.layout import Layout
from link.overlay import outline_display
from link.types import Array, Image
from models import PRETRAINED
from receiver.locate.__main__ import main
from receiver.locate.candidates import display_candidates, leaving_quads
from receiver.locate.find import locate
from receiver.locate.patches import image_pyramid
from receiver.locate.quads import BEYOND
from receiver.locate.refine import corners_on_edges, corners_on_patches

CORNER_PX = 1.5
"""Of refined corners in these small drawn scenes (measured: 0.6 at most)."""


@pytest.fixture(scope="module")
def with_patches() -> Image:
    return scene(content(LAYOUT))


@pytest.fixture(scope="module")
def without_patches() -> Image:
    return scene(content(PLAIN))


def off(found: Array, corners: Array) -> float:
    return float(np.linalg.norm(found - corners, axis=1).max())


@pytest.mark.parametrize("turns", [slow(0), 1, slow(2), slow(3)])
def test_patches_tell_which_way_up_the_display_is(turns: int, with_patches: Image) -> None:
    turned = np.roll(CORNERS, turns, axis=0)  # the picture's top-left in another corner
    shape = content(LAYOUT)
    found = locate(scene(shape, turned), LAYOUT)
    assert off(found.corners, turned) < CORNER_PX
    assert found.score > 0.95


def test_without_patches_corners_are_upright(without_patches: Image) -> None:
    for layout in (None, PLAIN):
        found = locate(without_patches, layout)
        assert off(found.corners, CORNERS) < CORNER_PX
        assert 0 <= found.score <= 1
    upside_down = locate(np.ascontiguousarray(without_patches[::-1, ::-1]))
    there = np.roll([WIDTH - 1, HEIGHT - 1] - CORNERS, 2, axis=0)
    assert off(upside_down.corners, there) < CORNER_PX


def test_a_display_with_a_side_outside_is_proposed_by_the_others() -> None:
    """Its unseen side is taken to lie some way beyond the image's border."""
    image = np.full((360, 640, 3), 30, np.uint8)
    image[60:300, 400:] = 200
    first = leaving_quads(image, 1)[0]
    outside = (1 + BEYOND) * 640
    expected = [[399.5, 59.5], [outside, 59.5], [outside, 299.5], [399.5, 299.5]]
    np.testing.assert_allclose(first, expected, atol=2)


def test_a_display_with_two_facing_sides_outside_is_proposed_by_the_others() -> None:
    image = np.full((360, 640, 3), 60, np.uint8)
    image[:, 200:440] = 180
    before, beyond = -BEYOND * 640, 360 + BEYOND * 640
    expected = [[199.5, before], [439.5, before], [439.5, beyond], [199.5, beyond]]
    np.testing.assert_allclose(leaving_quads(image, 1)[0], expected, atol=2)
    turned = leaving_quads(image.transpose(1, 0, 2), 1)[0]
    np.testing.assert_allclose(turned, np.array(expected)[[0, 3, 2, 1], ::-1], atol=2)


def test_no_display() -> None:
    rng = np.random.default_rng(0)
    wall = np.clip(room(), 0, 255).astype(np.uint8)
    even = np.full((HEIGHT, WIDTH, 3), 90, np.uint8)
    noise = rng.integers(0, 256, (HEIGHT, WIDTH, 3), dtype=np.uint8)
    for image in (even, noise, wall):
        assert locate(image) is None
        assert locate(image, LAYOUT) is None
    assert display_candidates(even) == []


def test_a_display_without_the_patches_is_not_ours(without_patches: Image) -> None:
    assert locate(without_patches) is not None
    assert locate(without_patches, LAYOUT) is None


def test_gray_images_and_the_small_copy_of_a_large_one(with_patches: Image) -> None:
    found = locate(cv2.cvtColor(with_patches, cv2.COLOR_RGB2GRAY), LAYOUT)
    assert off(found.corners, CORNERS) < CORNER_PX
    large = cv2.resize(with_patches, None, fx=3, fy=3, interpolation=cv2.INTER_CUBIC)
    found = locate(large, LAYOUT)
    assert off((found.corners + 0.5) / 3 - 0.5, CORNERS) < CORNER_PX


@pytest.mark.parametrize("layout", [PLAIN, LAYOUT], ids=["edges", "patches"])
def test_glare_and_a_hand(layout: Layout) -> None:
    image = scene(content(layout)).astype(np.float32)
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    image += 200 * np.exp(-((x - 440) ** 2 + (y - 125) ** 2) / (2 * 30.0**2))[..., None]
    cv2.ellipse(image, (300, 400), (30, 55), 10, 0, 360, (190, 140, 120), -1)  # over the bottom
    found = locate(np.clip(image, 0, 255).astype(np.uint8), layout)
    assert off(found.corners, CORNERS) < 2 * CORNER_PX


@pytest.mark.slow
@settings(max_examples=5)
@given(st.integers(0, 2**32 - 1), st.sampled_from([LAYOUT, PLAIN]))
def test_refining_undoes_a_few_per_cent(seed: int, layout: Layout) -> None:
    image = scene(content(layout))
    reach = 12.0 if layout.ratex else 5.0
    moved = CORNERS + np.random.default_rng(seed).uniform(-reach, reach, (4, 2)) / np.sqrt(2)
    gray = as_gray(image)
    if layout.ratex:
        found, _ = corners_on_patches(image, image_pyramid(gray), moved, layout)
    else:
        found = corners_on_edges(gray, moved, 7.0)
    assert off(found, CORNERS) < CORNER_PX


def test_edges_keep_the_order_of_corners(with_patches: Image) -> None:
    turned = np.roll(CORNERS, 1, axis=0)
    assert off(corners_on_edges(as_gray(with_patches), turned, 7.0), turned) < CORNER_PX
    even = np.full((HEIGHT, WIDTH), 90, np.uint8)
    np.testing.assert_allclose(corners_on_edges(even, CORNERS, 7.0), CORNERS, atol=1e-6)


@pytest.mark.slow
@settings(max_examples=3)
@given(st.floats(-8, 8), st.floats(-0.12, 0.12), st.floats(0.75, 1.05))
def test_a_turned_image_has_turned_corners(degrees: float, shear: float, size: float) -> None:
    centre = np.array([WIDTH, HEIGHT]) / 2
    turn = cv2.getRotationMatrix2D((0, 0), degrees, size)[:, :2] @ np.array([[1, shear], [0, 1]])
    corners = (CORNERS - CORNERS.mean(axis=0)) @ turn.T + centre
    found = locate(scene(content(LAYOUT), corners), LAYOUT)
    assert off(found.corners, corners) < CORNER_PX
    quarter = locate(np.ascontiguousarray(np.rot90(scene(content(LAYOUT), corners))), LAYOUT)
    there = np.column_stack([corners[:, 1], WIDTH - 1 - corners[:, 0]])
    assert off(quarter.corners, there) < CORNER_PX


def test_command(tmp_path: Path, with_patches: Image, command: Command) -> None:
    write_image(tmp_path / "a.png", with_patches)
    write_image(tmp_path / "empty.png", np.full((64, 64, 3), 90, np.uint8))
    (tmp_path / "layout.json").write_text(json.dumps(LAYOUT.to_dict()))
    images = [tmp_path / name for name in ("a.png", "missing.png", "empty.png")]
    flags = ("--layout", tmp_path / "layout.json", "--show", tmp_path / "shown")
    done = command(main, *images, *flags, status=2)
    assert done.stderr.count("\n") == 1
    assert "missing.png" in done.stderr
    first, second = (json.loads(line) for line in done.stdout.splitlines())
    assert set(first) == set(second) == {"image", "corners", "score"}
    assert first["image"] == str(tmp_path / "a.png")
    assert off(np.array(first["corners"]), CORNERS) < CORNER_PX
    assert second["corners"] is None
    shown = read_image(tmp_path / "shown" / "a.png")
    assert (shown != with_patches).any()
    assert (read_image(tmp_path / "shown" / "empty.png") == 90).all()
    found = locate(with_patches, LAYOUT)
    np.testing.assert_array_equal(shown, outline_display(with_patches, found.corners))


def test_command_takes_a_model(tmp_path: Path, with_patches: Image, command: Command) -> None:
    write_image(tmp_path / "a.png", with_patches)
    done = command(main, tmp_path / "a.png", "--model", PRETRAINED / "decoder.onnx")
    assert off(np.array(json.loads(done.stdout)["corners"]), CORNERS) < CORNER_PX


@pytest.mark.parametrize("text", ["", "{", "[]", '{"rows": 8}', "\xff"])
def test_wrong_layout(text: str, tmp_path: Path, refuses: Refuses) -> None:
    (tmp_path / "layout.json").write_bytes(text.encode("latin-1"))
    refuses("receiver.locate.__main__", "a.png --layout layout.json")
