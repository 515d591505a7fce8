"""The page finds the display in photographs where Python finds it, and nothing where none is."""

from pathlib import Path

import cv2
import numpy as np
import pytest
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
from numpy.typing import NDArray
from web_fixtures import run_node_tests, write_fixture

from data_gen.film.scenes import SceneSettings, draw_scene, photograph
from data_gen.pairs import get_pair
from export.locate.align import align_corners
from export.locate.edges import side_features, snap_to_edges
from export.locate.find import locate
from export.locate.patches import (
    corners_from_patches,
    image_pyramid,
    patches_in_view,
    search_patches,
    seen_correlation,
)
from export.locate.quads import distinct, is_sound, upright
from export.locate.refine import corners_on_edges, corners_on_patches
from export.web.tables import layout_table
from link.images import as_gray, as_rgb
from link.layout import Layout
from link.types import Gray


def film_gray(image: NDArray[np.floating] | NDArray[np.uint8]) -> Gray:
    return as_gray(np.clip(image, 0, 255).astype(np.uint8))


def shapes(rng: np.random.Generator) -> dict[str, object]:
    """Quadrilaterals, some of them mirrored or out of the image, and what is said of them."""
    quads = CORNERS + rng.uniform(-30, 30, (40, 4, 2))
    quads[:10] = quads[:10, [0, 3, 2, 1]]
    quads[10:16] -= [150, 0]
    rank = rng.uniform(size=len(quads))
    turned = np.roll(quads[16:], 2, axis=1)
    return {
        "quads": quads,
        "sound": [is_sound(quads, WIDTH, HEIGHT, outside) for outside in (0.01, 0.25)],
        "rank": rank,
        "distinct": distinct(quads, rank, 8, 15.0),
        "turned": turned,
        "upright": upright(turned),
    }


def sides(gray: Gray, rng: np.random.Generator) -> dict[str, object]:
    """What the sides of quadrilaterals show, and where they snap to."""
    quads = CORNERS + rng.uniform(-4, 4, (20, 4, 2))
    smooth = cv2.GaussianBlur(gray, (0, 0), 0.7).astype(np.float32)
    return {
        "quads": quads,
        "features": side_features(as_rgb(gray), quads),
        "snapped": snap_to_edges(smooth, quads, 5.0),
        "onEdges": np.array([corners_on_edges(gray, quad, 6.0) for quad in quads]),
    }


def patches(gray: Gray, rng: np.random.Generator) -> dict[str, object]:
    """Where patches are found from corners a little off, and how corners move there."""
    pyramid = image_pyramid(gray)
    near, close = (CORNERS + rng.uniform(-off, off, (4, 2)) for off in (12, 2))
    cut = CORNERS - [170, 0]
    promise, found = search_patches(pyramid, near, LAYOUT)
    cut_promise, cut_found = search_patches(pyramid, cut, LAYOUT)
    on_patches, seen = corners_on_patches(gray, pyramid, near, LAYOUT)
    match, in_view = rng.uniform(0.5, 1, (30, 5)), rng.random((30, 5)) < 0.8
    return {
        "near": near,
        "promise": promise,
        "found": found,
        "moved": corners_from_patches(near, found, LAYOUT),
        "cut": cut,
        "cutPromise": cut_promise,
        "cutFound": cut_found,
        "cutInView": patches_in_view(cut, LAYOUT, gray.shape),
        "close": close,
        "aligned": align_corners(pyramid, close, LAYOUT),
        "onPatches": on_patches,
        "seen": seen,
        "match": match,
        "inView": in_view,
        "correlation": [seen_correlation(*case) for case in zip(match, in_view, strict=True)],
    }


def test_parts_of_the_search(tmp_path: Path) -> None:
    rng, gray = np.random.default_rng(1), film_gray(scene(content(LAYOUT)))
    fixture = {
        "layout": layout_table(LAYOUT),
        "image": gray,
        "shapes": shapes(rng),
        "sides": sides(gray, rng),
        "patches": patches(gray, rng),
    }
    write_fixture(tmp_path, "locate", fixture)
    run_node_tests("locate", tmp_path)


def covered(layout: Layout) -> NDArray[np.uint8]:
    """A picture one of whose corner patches something covers."""
    shown = content(layout)
    top, bottom, left, right = layout.cell_box(0, 7)
    shown[top:bottom, left:right] = (150, 110, 90)
    return shown


def dark(layout: Layout) -> NDArray[np.uint8]:
    """A picture that is black but for its patches, so that its border in a bezel has no edges."""
    shown = np.full((layout.height, layout.width, 3), 12, np.uint8)
    bright = content(layout)
    for row, col in layout.ratex:
        top, bottom, left, right = layout.cell_box(row, col)
        shown[top:bottom, left:right] = bright[top:bottom, left:right]
    return shown


def simulated(view_deg: float, seed: int) -> tuple[Gray, NDArray[np.float64]]:
    """A photograph of 1280 x 720 by the simulated camera, and the display's corners."""
    rng = np.random.default_rng(seed)
    drawn = draw_scene(LAYOUT, get_pair("canon-lg"), view_deg, rng, SceneSettings((1280, 720)))
    return film_gray(photograph(content(LAYOUT), drawn, rng)), drawn.corners


def searched(gray: Gray, layout: Layout, truth: NDArray[np.float64] | None) -> dict[str, object]:
    """A photograph, what Python finds in it, and where the display is."""
    found = locate(gray, layout)
    return {
        "image": gray,
        "patches": bool(layout.ratex),
        "corners": None if found is None else found.corners,
        "score": None if found is None else found.score,
        "truth": truth,
    }


def run_searches(folder: Path, searches: dict[str, dict[str, object]]) -> None:
    layouts = {"layout": layout_table(LAYOUT), "plain": layout_table(PLAIN)}
    write_fixture(folder, "locate_find", {**layouts, "searches": searches})
    run_node_tests("locateFind", folder)


def test_a_display_is_found_where_it_is(tmp_path: Path) -> None:
    turned = np.roll(CORNERS, 1, axis=0)
    searches = {
        "turned": searched(film_gray(scene(content(LAYOUT), turned)), LAYOUT, turned),
        "no patches": searched(film_gray(scene(content(PLAIN))), PLAIN, CORNERS),
    }
    run_searches(tmp_path, searches)


@pytest.mark.slow
def test_difficult_displays_are_found_and_no_others(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    noise = rng.integers(0, 256, (HEIGHT, WIDTH), np.uint8)
    searches = {
        "wall": searched(film_gray(room()), LAYOUT, None),
        "wall, no patches": searched(film_gray(room()), PLAIN, None),
        "noise": searched(noise, LAYOUT, None),
        "a picture without patches": searched(film_gray(scene(content(PLAIN))), LAYOUT, None),
        "even": searched(np.full((HEIGHT, WIDTH), 90, np.uint8), LAYOUT, None),
        "covered": searched(film_gray(scene(covered(LAYOUT))), LAYOUT, CORNERS),
        "dark": searched(film_gray(scene(dark(LAYOUT), bezel=0.1)), LAYOUT, CORNERS),
    }
    for corner in range(4):
        out = with_corner_out(corner)
        image = film_gray(scene(content(LAYOUT), out))
        searches[f"corner {corner} out"] = searched(image, LAYOUT, out)
    for seed, view_deg in enumerate((0.0, 30.0, 45.0)):
        image, corners = simulated(view_deg, seed)
        searches[f"simulated, {view_deg:g} degrees"] = searched(image, LAYOUT, corners)
    run_searches(tmp_path, searches)
