"""The page finds the display in photographs where Python finds it, and nothing where none is."""

import cv2
import numpy as np
import pytest
import tolerances as within
from conftest import cases
from drawn_scenes import (
    CORNERS,
    HEIGHT,
    LAYOUT,
    PLAIN,
    WIDTH,
    content,
    room,
    scene,
    with_corner_out,
)
from filming import photograph
from numpy.typing import NDArray
from port import Port, same

from data_gen.film.scenes import SceneSettings, draw_scene
from data_gen.pairs import get_pair
from link.images import as_gray, as_rgb
from link.layout import Layout
from link.types import Array, Gray, Image
from receiver.locate.align import align_corners
from receiver.locate.edges import side_features, snap_to_edges
from receiver.locate.find import locate
from receiver.locate.patches import (
    corners_from_patches,
    image_pyramid,
    patches_in_view,
    search_patches,
    seen_correlation,
)
from receiver.locate.quads import distinct, is_sound, upright
from receiver.locate.refine import corners_on_patches

STEP_WORK, SEARCH_WORK = 20, 450
"""Largest number of units of work of a step, and of a search in vain."""


def film_gray(image: NDArray[np.floating] | Image) -> Gray:
    return as_gray(np.clip(image, 0, 255).astype(np.uint8))


@pytest.fixture(scope="module")
def gray() -> Gray:
    return film_gray(scene(content(LAYOUT)))


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(1)


def test_quadrilaterals(port: Port, rng: np.random.Generator) -> None:
    """Some of them are mirrored or out of the image."""
    module = port("receiver/locate/quads.js")
    quads = CORNERS + rng.uniform(-30, 30, (40, 4, 2))
    quads[:10] = quads[:10, [0, 3, 2, 1]]
    quads[10:16] -= [150, 0]
    for outside in (0.01, 0.25):
        found = [module.isSound(quad.tolist(), WIDTH, HEIGHT, outside) for quad in quads]
        same(found, is_sound(quads, WIDTH, HEIGHT, outside))
    rank = rng.uniform(size=len(quads))
    same(module.distinct(quads.tolist(), rank, 8, 15.0), distinct(quads, rank, 8, 15.0))
    turned = np.roll(quads[16:], 2, axis=1)
    same([module.upright(quad.tolist()) for quad in turned], upright(turned))


def test_what_the_sides_show_and_snap_to(port: Port, gray: Gray, rng: np.random.Generator) -> None:
    quads, edges = CORNERS + rng.uniform(-4, 4, (20, 4, 2)), port("receiver/locate/edges.js")
    levels = edges.edgeLevels(gray)
    found = [edges.sideFeatures(gray, quad.tolist(), levels) for quad in quads]
    same(np.reshape(found, (20, -1)), side_features(as_rgb(gray), quads), within.SIDE_FEATURES)

    smooth = cv2.GaussianBlur(gray, (0, 0), 0.7).astype(np.float32)
    blurred = port("image/blur.js").blurred(gray, 0.7)
    snapped = [edges.snapToEdges(blurred, quad.tolist(), 5) for quad in quads]
    off = np.abs(snapped - snap_to_edges(smooth, quads, 5.0)).max(axis=(1, 2))
    # steps of a pixel are tried, and two of them may be as good
    assert (off < within.SAME_PX).mean() >= 0.8, off
    assert off.max() < within.SNAPPED_PX, off


def test_patches_are_found(port: Port, gray: Gray, rng: np.random.Generator) -> None:
    """From corners a little off, and for a display that is partly out of view."""
    module, pyramid = port("receiver/locate/patches.js"), image_pyramid(gray)
    near, cut = CORNERS + rng.uniform(-12, 12, (4, 2)), CORNERS - [170, 0]
    ported = module.imagePyramid(gray)
    for corners in (near, cut):
        promise, places = search_patches(pyramid, corners, LAYOUT)
        found = module.searchPatches(ported, corners.tolist(), LAYOUT)
        same(found.promise, promise, within.SEARCH_SCORE)
        same(found.found, places, within.SAME_PX)
        moved = module.cornersFromPatches(corners.tolist(), found.found, LAYOUT)
        same(moved, corners_from_patches(corners, places, LAYOUT), within.CORNERS_PX)
    in_view = module.patchesInView(cut.tolist(), LAYOUT, WIDTH, HEIGHT)
    same(in_view, patches_in_view(cut, LAYOUT, gray.shape))


def test_corners_move_onto_patches(port: Port, gray: Gray, rng: np.random.Generator) -> None:
    near, close = (CORNERS + rng.uniform(-off, off, (4, 2)) for off in (12, 2))
    pyramid, ported = image_pyramid(gray), port("receiver/locate/patches.js").imagePyramid(gray)
    steps = port("receiver/locate/align.js").alignSteps(ported, close.tolist(), LAYOUT)
    aligned = port("link/steps.js").runToEnd(steps)
    same(aligned, align_corners(pyramid, close, LAYOUT), within.ALIGNED_PX)
    corners, seen = corners_on_patches(gray, pyramid, near, LAYOUT)
    found = port("receiver/locate/refine.js").cornersOnPatches(gray, ported, near.tolist(), LAYOUT)
    same(found.corners, corners, within.ALIGNED_PX)
    same(found.seen, seen, within.VISIBILITY)


def test_correlation_of_patches_some_of_them_out_of_view(
    port: Port, rng: np.random.Generator
) -> None:
    correlation = port("receiver/locate/patches.js").seenCorrelation
    match, in_view = rng.uniform(0.5, 1, (30, 5)), rng.random((30, 5)) < 0.8
    for seen in zip(match, in_view, strict=True):
        same(correlation(*seen), seen_correlation(*seen), within.FLOAT64)


def covered(layout: Layout) -> Image:
    """A picture one of whose corner patches something covers."""
    shown = content(layout)
    top, bottom, left, right = layout.cell_box(0, 7)
    shown[top:bottom, left:right] = (150, 110, 90)
    return shown


def dark(layout: Layout) -> Image:
    """A picture that is black but for its patches, so that its border in a bezel has no edges."""
    shown = np.full((layout.height, layout.width, 3), 12, np.uint8)
    bright = content(layout)
    for row, col in layout.ratex:
        top, bottom, left, right = layout.cell_box(row, col)
        shown[top:bottom, left:right] = bright[top:bottom, left:right]
    return shown


def compare(port: Port, gray: Gray, truth: Array | None = None) -> None:
    """Search a photograph in both languages.

    Args:
        port: what calls the page's search.
        gray: photograph.
        truth: (4, 2) corners of the display, or None where there is none.
    """
    steps = port("receiver/locate/find.js").searchSteps(gray, LAYOUT)
    works = []
    while not (step := steps.next()).done:
        works.append(step.value)
    assert max(works) <= STEP_WORK
    found, known = step.value, locate(gray, LAYOUT)
    assert (found is None) == (known is None) == (truth is None)
    if known is None:
        assert sum(works) <= SEARCH_WORK
        return
    for corners, most in ((known.corners, within.FOUND_PX), (truth, within.TRUE_PX)):
        assert np.linalg.norm(found.corners - corners, axis=1).max() < most
    same(found.score, known.score, within.SEARCH_SCORE)


def test_a_turned_display_is_found(port: Port) -> None:
    turned = np.roll(CORNERS, 1, axis=0)
    compare(port, film_gray(scene(content(LAYOUT), turned)), turned)


@pytest.mark.slow
def test_nothing_is_found_where_there_are_no_patches(port: Port) -> None:
    """In noise, on a wall, in a picture, and where nothing is seen."""
    noise = np.random.default_rng(0).integers(0, 256, (HEIGHT, WIDTH), np.uint8)
    even = np.full((HEIGHT, WIDTH), 90, np.uint8)
    for gray in (noise, film_gray(room()), film_gray(scene(content(PLAIN))), even):
        compare(port, gray)


@pytest.mark.slow
def test_covered_and_dark_displays_are_found(port: Port) -> None:
    compare(port, film_gray(scene(covered(LAYOUT))), CORNERS)
    compare(port, film_gray(scene(dark(LAYOUT), bezel=0.1)), CORNERS)


@pytest.mark.slow
@pytest.mark.parametrize("corner", [0, 3])
def test_a_display_is_found_of_which_a_corner_is_out_of_view(port: Port, corner: int) -> None:
    out = with_corner_out(corner)
    compare(port, film_gray(scene(content(LAYOUT), out)), out)


@pytest.mark.slow
@cases((0.0, 0), (30.0, 1), (45.0, 2))
def test_simulated_displays_are_found(view_deg: float, seed: int, port: Port) -> None:
    """In photographs of 1280 x 720 by the simulated camera."""
    rng = np.random.default_rng(seed)
    drawn = draw_scene(LAYOUT, get_pair("canon-lg"), view_deg, rng, SceneSettings((1280, 720)))
    gray = film_gray(photograph(content(LAYOUT), drawn, rng))
    compare(port, gray, drawn.corners)
