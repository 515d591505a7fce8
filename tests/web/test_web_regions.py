"""The page maps and outlines where displays toggle as Python does."""

import cv2
import numpy as np
import onnx
import pytest
from pilot_films import TEXT, filmed, robust_film
from port import Port, PortError, page_graphs, same
from tolerances import LOG_ODDS, OUTLINE_CELLS, SNAPPED_PX

from export.region_graph import shipped_region_graph
from link.code.framing import encode
from link.images import as_gray
from link.presets import PRESETS
from link.steps import run_to_end
from link.types import Array, Image
from models import REGION_GRAPH
from receiver.locate.quads import upright
from receiver.pilots.search.proposals import Proposer
from receiver.pilots.search.regions import (
    PANEL_SHAPES,
    PICTURE_SHARES,
    WITH_BARS,
    about_middle,
    leaning,
    leaving_regions,
    outline_regions,
    panels_of,
    pictures_in,
    portrait_beyond,
    portrait_parts,
    reaching_beyond,
    ways_up,
)
from receiver.pilots.search.watch import Watch

SIZE = 45, 80
"""Rows and columns of a map."""


def map_with(displays: list[list[list[float]]], seed: int) -> Array:
    """Log-odds, (45, 80) float32, of noise, which are larger within quadrilaterals."""
    rng = np.random.default_rng(seed)
    shown = np.zeros(SIZE, np.uint8)
    for display in displays:
        cv2.fillPoly(shown, [np.rint(display).astype(np.int32)], 1)
    noise = cv2.GaussianBlur(rng.normal(0, 6, SIZE), (0, 0), 1.5)
    return (4.0 * shown - 2 + noise).astype(np.float32)


def drawn_quads(count: int) -> Array:
    """Quadrilaterals, (count, 4, 2) in cells, clockwise; some reach beyond the map."""
    rng, corners = np.random.default_rng(1), np.array([[0, 0], [30, 0], [30, 20], [0, 20]])
    return corners + rng.uniform(-6, 40, (count, 1, 2)) + rng.uniform(-5, 5, (count, 4, 2))


MAPS = {
    "noise": [],
    "rectangles": [[[8, 5], [34, 5], [34, 20], [8, 20]], [[50, 18], [74, 18], [74, 40], [50, 40]]],
    "turned": [[[30, 8], [58, 20], [46, 42], [16, 30]]],
    "leaving": [[[-14, 6], [24, 2], [28, 30], [-10, 36]], [[60, 20], [95, 24], [92, 60], [58, 50]]],
}
"""Corners, in cells, of the displays of maps."""


@pytest.mark.parametrize("name", MAPS)
def test_displays_are_outlined_as_by_python(port: Port, name: str) -> None:
    outlined = port("receiver/pilots/search/regions.js").outlineRegions
    for seed in range(6):
        log_odds = map_with(MAPS[name], seed)
        found, known = outlined(log_odds.ravel(), SIZE[1]), outline_regions(log_odds)
        assert len(found) == len(known) >= len(MAPS[name])
        same(upright(np.reshape(found, (-1, 4, 2))), upright(np.array(known)), OUTLINE_CELLS)


@pytest.mark.parametrize("name", MAPS)
def test_portrait_parts_are_chosen_as_by_python(port: Port, name: str) -> None:
    chosen = port("receiver/pilots/search/regions.js").portraitParts
    quads = drawn_quads(5)
    maps = [map_with(MAPS[name], 0), leaning(map_with(MAPS[name], 1))]
    found = chosen(quads.tolist(), [log_odds.ravel() for log_odds in maps], SIZE[1])
    same(np.array(found), np.array(portrait_parts(quads, maps)), OUTLINE_CELLS)


@pytest.mark.parametrize("name", MAPS)
def test_leaving_displays_are_chosen_as_by_python(port: Port, name: str) -> None:
    chosen = port("receiver/pilots/search/regions.js").leavingRegions
    quads = drawn_quads(9)
    for seed in range(6):
        log_odds = map_with(MAPS[name], seed)
        found = chosen(quads.tolist(), log_odds.ravel(), SIZE[1])
        known = leaving_regions(quads, log_odds)
        assert len(found) == len(known)
        same(
            upright(np.reshape(found, (-1, 4, 2))),
            upright(np.reshape(known, (-1, 4, 2))),
            OUTLINE_CELLS,
        )


def test_pictures_are_sought_within_panels_and_in_every_way_up_as_by_python(port: Port) -> None:
    lying = np.array([[10.0, 5], [70, 8], [71, 40], [9, 36]])
    standing = lying[:, ::-1][[0, 3, 2, 1]]
    square = np.array([[0.0, 0], [40, 0], [40, 40], [0, 40]])
    within = square.mean(axis=0) + 0.9 * (square - square.mean(axis=0))
    ported = port("receiver/pilots/search/regions.js")
    for outline in (lying, standing):
        for share in PICTURE_SHARES:
            known = about_middle(outline, share, WITH_BARS)
            same(ported.aboutMiddle(outline.tolist(), share, WITH_BARS), known, 1e-5)
    for portrait in (standing, 4 * standing - [0, 40], 9 * lying - [90, 0]):
        for known, found in (
            (portrait_beyond(portrait, 80, 45), ported.portraitBeyond(portrait.tolist(), 80, 45)),
            (
                reaching_beyond(portrait, PANEL_SHAPES, 80, 45),
                ported.reachingBeyond(portrait.tolist(), PANEL_SHAPES, 80, 45),
            ),
        ):
            same(np.reshape(found, (-1, 4, 2)), np.reshape(known, (-1, 4, 2)), 1e-5)
    panels = [lying, standing]
    found = ported.picturesIn([panel.tolist() for panel in panels])
    same(np.array(found), np.array(pictures_in(panels)), 1e-5)
    quads = [square, lying, within]
    same(ported.panelsOf([quad.tolist() for quad in quads]), [square, within], 0)
    assert len(panels_of(quads)) == len(panels_of([square, within])) == 2
    quads.append(standing)
    ways = [np.array(list(ways_up(quads, likely=likely))) for likely in (True, False)]
    for likely, known in zip((True, False), ways, strict=True):
        same(list(ported.waysUp([quad.tolist() for quad in quads], likely)), known, 0)
    assert {way.tobytes() for way in np.concatenate(ways)} == {
        np.roll(quad, turn, axis=0).tobytes() for quad in quads for turn in range(4)
    }
    assert (ways[0][:3] == [square, lying, within]).all()  # each upright, before any is turned


def test_regions_snap_to_edges_as_by_python(port: Port) -> None:
    images, corners = filmed(PRESETS["robust"].layout, 14, seed=5, hold=10**6)
    layout = PRESETS["robust"].layout
    ported = port("receiver/pilots/search/watch.js").Watch(as_gray(images[0]), 0, 30, False)
    watch = Watch(images[0], 0.0, 30.0, picture_moves=False)
    for number, image in enumerate(images[1:], 1):
        assert watch.take(as_gray(image), number / 30) and ported.take(as_gray(image), number / 30)
    proposer = port("receiver/pilots/search/proposals.js").Proposer(ported, [layout], None)
    for seed in range(4):
        rough = corners[0] + np.random.default_rng(seed).uniform(-8, 8, (4, 2))
        known = Proposer(watch, [layout]).snapped(rough)
        found = run_to_end(iter(proposer.snapped(rough.tolist())))
        assert np.median(np.abs(np.array(found) - known)) < SNAPPED_PX


def test_nothing_is_outlined_where_nothing_is_likely(port: Port) -> None:
    outlined = port("receiver/pilots/search/regions.js").outlineRegions
    assert outlined(np.full(45 * 80, -1, np.float32), 80) == []


@pytest.mark.parametrize("size", [(3, 96, 128), (13, 360, 640), (9, 357, 203)])
def test_frames_are_mapped_as_by_python(port: Port, size: tuple[int, int, int]) -> None:
    stills = np.random.default_rng(0).integers(0, 256, size, np.uint8)
    graph = port("export/regionGraph.js").RegionGraph(REGION_GRAPH.read_bytes())
    same(graph.logOdds(list(stills)), shipped_region_graph().log_odds(stills), LOG_ODDS)


def test_a_map_that_is_not_finite_is_refused(port: Port) -> None:
    """Weights that are not finite stand for a graph that is damaged on its way."""
    model = onnx.load(REGION_GRAPH)
    for weights in model.graph.initializer:
        if weights.data_type == onnx.TensorProto.FLOAT:
            infinite = np.full(tuple(weights.dims), np.nan, np.float32)
            weights.CopyFrom(onnx.numpy_helper.from_array(infinite, weights.name))
    graph = port("export/regionGraph.js").RegionGraph(model.SerializeToString())
    with pytest.raises(PortError, match="the model returned no valid log_odds"):
        graph.logOdds(list(np.zeros((3, 96, 128), np.uint8)))


def behind_a_lattice(images: list[Image]) -> list[Image]:
    """Frames through a pane with sixty bright rectangles, whose edges are the clearest."""
    rng, lattice = np.random.default_rng(0), np.zeros(images[0].shape, np.uint8)
    for left, top, width, height in rng.integers((0, 0, 30, 30), (560, 420, 290, 230), (60, 4)):
        cv2.rectangle(lattice, (left, top), (left + width, top + height), 255, 2)
    return [np.maximum(image, lattice) for image in images]


@pytest.mark.slow
def test_a_display_is_read_whose_edges_are_lost_among_others(port: Port) -> None:
    layout = PRESETS["robust"].layout
    images, _ = filmed(layout, 60, seed=2, message=encode(TEXT, layout.n_bits))
    receiver = port("receiver/receiver.js").Receiver([layout], page_graphs(port), 30)
    frames = enumerate(behind_a_lattice(images))
    found = (receiver.push(image, number / 30).message for number, image in frames)
    assert next(message for message in found if message is not None).text == TEXT.decode()


@pytest.mark.slow
def test_a_map_that_fails_is_told_once_and_the_search_goes_on(port: Port) -> None:
    layout = PRESETS["robust"].layout
    damaged = port("export/regionGraph.js").RegionGraph(b"none")
    graphs = {**page_graphs(port), "region": damaged}
    receiver = port("receiver/receiver.js").Receiver([layout], graphs, 30)
    still, failures = filmed(layout, 16, seed=3, hold=10**6)[0], []
    for number, image in enumerate([*still, *robust_film(30)[0]]):
        try:
            step = receiver.push(image, number / 30)
        except PortError as error:
            failures.append(str(error))
        else:
            if step.tracked is not None:
                break
    assert step.tracked is not None
    assert len(failures) == 1 and "protobuf" in failures[0]
