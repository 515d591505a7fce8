"""Displays are outlined where they toggle, and the network that maps them is what it says."""

from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from tolerances import LOG_ODDS, SNAPPED_PX

from data_gen.film.message import FilmSettings, Take, film_message
from export.parity import compare_regions
from export.region_graph import RegionGraph, shipped_region_graph
from link.errors import InputError
from link.geometry import frame_corners, homography_from_corners, transform
from link.presets import PRESETS
from link.types import Array
from models import FILM_GRAPH, REGION_GRAPH
from models.region.region import DisplayRegion
from receiver.pilots.search import proposals
from receiver.pilots.search.pilot_search import PilotSearch
from receiver.pilots.search.proposals import Proposer
from receiver.pilots.search.regions import (
    PANEL_SHAPES,
    _within,
    leaving_regions,
    outline_regions,
    portrait_beyond,
    portrait_parts,
    reaching_beyond,
)
from receiver.pilots.search.watch import Watch

SIZE = 45, 80
"""Rows and columns of the maps."""


def map_of(corners: Array, inside: float = 3.0, outside: float = -3.0):
    """A map in which a quadrilateral, (4, 2) in cells, is a display; edges by the share covered."""
    fine = 8
    mask = np.zeros((fine * SIZE[0], fine * SIZE[1]), np.uint8)
    cv2.fillConvexPoly(mask, np.int32(np.round(corners * fine - 0.5)), 1)
    share = cv2.resize(np.float32(mask), SIZE[::-1], interpolation=cv2.INTER_AREA)
    return np.float32(outside + (inside - outside) * share)


def off(outline: Array, corners: Array) -> float:
    return min(np.abs(np.roll(outline, turn, axis=0) - corners).max() for turn in range(4))


def test_outlines_are_those_of_the_display() -> None:
    rng = np.random.default_rng(0)
    offs = []
    for _ in range(60):
        half = np.array([[-14, -9], [14, -9], [14, 9], [-14, 9]]) + rng.uniform(-4, 4, (4, 2))
        turn = rng.uniform(0, 2 * np.pi)
        axes = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
        corners = half @ axes + np.array([40, 22])
        noise = rng.normal(0, 1, SIZE)
        (outline,) = outline_regions(np.float32(map_of(corners) + noise))
        offs.append(off(outline, corners))
    assert np.median(offs) < 0.5
    assert np.mean(np.array(offs) < 1.5) > 0.95  # the climb may end on a lower hill


def test_an_outline_goes_on_beyond_the_image() -> None:
    corners = np.array([[50.0, 8], [84, 12], [80, 36], [48, 38]])  # two corners lie outside
    (outline,) = outline_regions(map_of(corners))
    left = outline[np.argsort(outline[:, 0])]
    assert off(left[:2], corners[[0, 3]]) < 1
    assert (left[2:, 0] > 78).all()
    assert (left[2:] <= [90, 55]).all()


@pytest.mark.parametrize("side", range(4))
def test_a_portrait_picture_is_found_where_one_of_its_sides_is_not_seen(side: int) -> None:
    H = homography_from_corners(np.array([[8.0, 4], [70, 10], [66, 38], [10, 42]]), 160, 90)
    width = 90 * 9 / 16
    left, right = 80 - width / 2, 80 + width / 2  # of the picture, in the middle of the display
    picture, to_bezel = (
        transform(H, np.array([[first, 0], [last, 0], [last, 90], [first, 90]]) - 0.5)
        for first, last in ((left, right), (left, 160.0) if side % 2 else (0.0, right))
    )
    other = picture + np.array([10, 0])
    quads = np.roll(np.array([other, to_bezel]), side, axis=1)
    first, *_ = portrait_parts(quads, [map_of(picture)])
    assert off(first, picture) < 0.01


def in_space(width: float, height: float, middle: list[float]) -> Array:
    """The picture of a rectangle, (4, 2), in an image of 1280 x 720 of a usual focal length."""
    turn = cv2.Rodrigues(np.array([0.1, 0.6, 0.05]))[0]
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) / 2
    places = corners * [width, height, 1] @ turn.T + middle
    return 1280 * places[:, :2] / places[:, 2:] + [639.5, 359.5]


def guessed(picture: Array, side: int) -> Array:
    """The same quadrilateral with a side that is elsewhere, between the same sides."""
    guess = np.roll(picture, -side, axis=0)
    guess[:2] = guess[[3, 2]] + 0.95 * (guess[:2] - guess[[3, 2]])
    return np.roll(guess, side, axis=0)


@pytest.mark.parametrize("end", [0, 2])
def test_a_portrait_picture_longer_than_the_image_is_completed_by_its_shape(end: int) -> None:
    picture = in_space(18, 32, [1, 2, 35])
    found = portrait_beyond(guessed(picture, end), 1280, 720)
    assert min(off(each, picture) for each in found) < 0.01
    assert portrait_beyond(0.5 * picture + [0, 150], 1280, 720) == []  # all in view


@pytest.mark.parametrize("side", range(4))
def test_a_panel_that_leaves_the_image_is_completed_by_its_shape(side: int) -> None:
    middle = [[0, -7, 40], [16, 0, 40], [0, 7, 40], [-16, 0, 40]][side]
    panel = in_space(24, 18, middle)
    found = reaching_beyond(guessed(panel, side), PANEL_SHAPES, 1280, 720)
    assert min(off(each, panel) for each in found) < 0.01
    assert off(guessed(panel, side), panel) > 1


def test_edges_of_a_display_that_leaves_the_image_are_told_from_others_by_what_toggles() -> None:
    display = np.array([[-6.0, 5], [30, 4], [31, 30], [-6, 32]])
    bezel = display + np.array([[0, -4], [4, -4], [4, 4], [0, 4]])
    half = display * np.array([1, 0.5])
    log_odds = map_of(display, inside=-2.0, outside=-9.0)  # as another camera may show it
    assert outline_regions(log_odds) == []
    first, outline = leaving_regions(np.array([bezel, half, display]), log_odds)
    assert (first == display).all()
    right = outline[np.argsort(outline[:, 0])][2:]
    assert np.abs(np.sort(right, axis=0) - display[1:3]).max() < 1.5
    within = map_of(display + np.array([20, 5]))
    assert leaving_regions(np.array([bezel]), within) == []
    (alone,) = leaving_regions(np.zeros((0, 4, 2)), log_odds)
    assert (alone == outline).all()


def test_the_likeliest_of_two_displays_comes_first() -> None:
    small = np.array([[5.0, 5], [15, 5], [15, 12], [5, 12]])
    large = np.array([[40.0, 10], [70, 10], [70, 35], [40, 35]])
    outlines = outline_regions(np.maximum(map_of(small), map_of(large)))
    assert [off(*each) < 1 for each in zip(outlines, (large, small), strict=True)] == [True] * 2
    assert outline_regions(np.full(SIZE, -1, np.float32)) == []


def test_sums_within_quadrilaterals_are_areas_where_every_cell_counts_one() -> None:
    quads = np.random.default_rng(0).uniform(-2, 2, (50, 4, 2))
    quads += [[20, 10], [60, 12], [58, 35], [22, 33]]
    sums = np.pad(np.cumsum(np.ones(SIZE, np.float32), axis=1), ((0, 0), (1, 0)))
    areas = [cv2.contourArea(quad.astype(np.float32)) for quad in quads]
    np.testing.assert_allclose(_within(quads, sums), areas, rtol=0.02)  # rows count whole


def test_blocks_that_toggle_have_more_power_than_noise_of_the_same_pixels() -> None:
    rng = np.random.default_rng(0)
    frames = 100 + rng.normal(0, 2, (13, 1, 64, 96))
    signs = np.kron(rng.choice([-1, 1], (12, 1, 8, 8)), np.ones((8, 4)))
    frames[1:, :, :, :32] += signs.cumsum(axis=0)  # each change from frame to frame is 1 level
    pixels, blocks, *_ = DisplayRegion.features(torch.from_numpy(frames).float())[0]
    toggles, noise = np.s_[:, :8], np.s_[:, 9:]
    assert float(pixels[toggles].mean() - pixels[noise].mean()) < 0.2
    assert float(blocks[toggles].mean() - blocks[noise].mean()) > 0.5


def test_the_shipped_map_is_that_of_its_checkpoint() -> None:
    module = DisplayRegion()
    state = torch.load(REGION_GRAPH.with_name("decoder.pt"), weights_only=True)
    module.load_state_dict(state, strict=True)
    parity = compare_regions(module, shipped_region_graph())
    assert parity.holds and parity.tolerance == LOG_ODDS


@pytest.mark.parametrize("is_seen", [True, False])
def test_regions_snap_to_edges_that_are_seen_and_to_those_of_what_changes(is_seen: bool) -> None:
    """A bright picture, and one as dark as what is around it which changes."""
    rng, frames = np.random.default_rng(0), []
    corners = np.array([[100.0, 80], [420, 90], [410, 300], [110, 290]])
    for _ in range(6):
        frame = rng.integers(28, 32, (360, 640), np.uint8)
        mask = cv2.fillConvexPoly(np.zeros_like(frame), np.int32(corners), 1) > 0
        frame[mask] = 150 if is_seen else rng.integers(10, 50, int(mask.sum()))
        frames.append(frame)
    watch = Watch(frames[0], 0.0, 30.0, picture_moves=False)
    for frame in frames:
        watch.stills.add(frame)
    rough = corners + rng.uniform(-9, 9, (4, 2))
    by_sight, by_change = Proposer(watch, [PRESETS["robust"].layout]).snapped(rough)
    assert off(by_sight if is_seen else by_change, corners) < SNAPPED_PX < off(rough, corners)


def test_other_graphs_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no map of displays of this version"):
        RegionGraph(FILM_GRAPH)
    with pytest.raises(InputError):
        RegionGraph(tmp_path / "none.onnx")


@pytest.mark.slow
def test_a_display_without_any_edge_is_found_by_what_toggles(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(proposals, "display_candidates", lambda *_: [])
    monkeypatch.setattr(proposals, "leaving_quads", lambda *_: [])
    settings = FilmSettings.of_preset("hidden", fps=30, size=(640, 360), coverage=(0.4, 0.4))
    layout = settings.layout
    search = PilotSearch([layout], settings.fps)
    for frame in film_message(Take(settings, "canon-lg", 20.0, 0, 3)).frames:
        found = search.push(frame.rgb, frame.time_s)
        if found is not None:
            break
        assert frame.time_s < 2
    display = frame_corners(layout.width, layout.height)
    corners = transform(frame.H_captured_from_display, display)
    assert np.abs(found.corners - corners).max() < 1
