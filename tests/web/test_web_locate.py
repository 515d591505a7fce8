"""The page proposes where displays may be in photographs as Python does."""

from collections.abc import Iterable

import cv2
import numpy as np
import pytest
import tolerances as within
from conftest import cases
from drawn_scenes import CORNERS, HEIGHT, LAYOUT, WIDTH, content, room, scene, with_corner_out
from filming import photograph
from numpy.typing import NDArray
from port import Port, same

from data_gen.film.scenes import SceneSettings, draw_scene
from data_gen.pairs import get_pair
from link.images import as_gray, as_rgb
from link.types import Array, Gray, Image
from receiver.locate.candidates import display_candidates, leaving_quads
from receiver.locate.edges import side_features, snap_to_edges
from receiver.locate.quads import distinct, is_sound, upright

STEP_WORK = 20
"""Largest number of units of work of a step of a search."""
PROPOSED = 6
"""Number of quadrilaterals that are proposed."""


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


def nearest(quads: Iterable[Array], truth: Array) -> float:
    """Distance in pixels of the nearest quadrilateral's farthest corner from the display's."""
    turns = [np.roll(truth, turn, axis=0) for turn in range(4)]
    return min(
        float(np.linalg.norm(np.asarray(quad) - turned, axis=1).max())
        for quad in quads
        for turned in turns
    )


def proposed(port: Port, name: str, gray: Gray) -> list[Array]:
    """What the page proposes for an image, by the name of the search."""
    steps = getattr(port("receiver/locate/candidates.js"), name)(gray, PROPOSED)
    works = []
    while not (step := steps.next()).done:
        works.append(step.value)
    assert max(works) <= STEP_WORK
    return [np.array(quad) for quad in step.value]


def compare(port: Port, gray: Gray, truth: Array) -> None:
    """Propose where the display is, in both languages."""
    known = [each.corners for each in display_candidates(gray, PROPOSED)]
    found = proposed(port, "candidateSteps", gray)
    assert len(found) == len(known)
    for quads in (known, found):
        assert nearest(quads, truth) < within.PROPOSED_PX


def test_a_turned_display_is_proposed(port: Port) -> None:
    turned = np.roll(CORNERS, 1, axis=0)
    compare(port, film_gray(scene(content(LAYOUT), turned)), turned)


def test_where_there_are_no_edges_nothing_is_proposed(port: Port) -> None:
    even = np.full((HEIGHT, WIDTH), 90, np.uint8)
    for name in ("candidateSteps", "leavingSteps"):
        assert proposed(port, name, even) == []
    assert len(proposed(port, "candidateSteps", film_gray(room()))) <= PROPOSED


@pytest.mark.parametrize("corner", [0, 3])
def test_a_display_of_which_a_corner_is_out_of_view_is_proposed(port: Port, corner: int) -> None:
    """By the outline of its bezel, which Python proposes, too."""
    gray = film_gray(scene(content(LAYOUT), with_corner_out(corner)))
    known, found = leaving_quads(gray, PROPOSED), proposed(port, "leavingSteps", gray)
    assert nearest(found, known[0]) < within.PROPOSED_PX
    assert nearest(known, found[0]) < within.PROPOSED_PX


def test_a_display_with_two_facing_sides_outside_is_proposed(port: Port) -> None:
    gray = np.full((360, 640), 60, np.uint8)
    gray[:, 200:440] = 180
    known, found = leaving_quads(gray, PROPOSED), proposed(port, "leavingSteps", gray)
    assert nearest(found, known[0]) < within.PROPOSED_PX
    assert nearest(known, found[0]) < within.PROPOSED_PX


@pytest.mark.slow
@cases((0.0, 0), (30.0, 1), (45.0, 2))
def test_simulated_displays_are_proposed(view_deg: float, seed: int, port: Port) -> None:
    """In photographs of 1280 x 720 by the simulated camera."""
    rng = np.random.default_rng(seed)
    drawn = draw_scene(LAYOUT, get_pair("canon-lg"), view_deg, rng, SceneSettings((1280, 720)))
    gray = film_gray(photograph(content(LAYOUT), drawn, rng))
    compare(port, gray, drawn.corners)
