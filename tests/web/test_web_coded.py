"""The page finds a coded display's rate, moment and clock as Python does."""

from dataclasses import astuple, replace

import cv2
import numpy as np
import pytest
from conftest import cases
from pilot_films import filmed
from port import Port, page_graphs, same
from test_web_clock import numbers_of
from tolerances import (
    CLOCKS_APART,
    FLOAT32_SUM,
    FLOAT64,
    PILOT_CHANGE,
    SAME_STEPS,
)

from export.film_graph import FilmGraph
from export.runtime import Decoder
from link.clock import DisplayClock, embedded_share
from link.pilot_code import PilotCode
from link.pilots import expected_changes, pilot_centres, pilot_signs
from link.presets import PRESETS
from link.steps import run_to_end
from link.types import Array
from models import FILM_GRAPH, PRETRAINED_PILOTS
from receiver.pilots.code import CodeSearch, clocks_tried
from receiver.pilots.search.all_blocks import block_maps
from receiver.pilots.search.parts import COARSE_SIZE, rough_series, shifted_togglings
from receiver.pilots.toggling import CodedToggling, find_toggling, over_deviation
from receiver.receiver import Receiver

CODE = PilotCode()
LAYOUT = replace(PRESETS["robust"].layout, code=CODE)
"""A grid that small films show well and a shipped graph reads, with the code of `hidden`."""
GRAPH = PRETRAINED_PILOTS / "24x32.onnx"
FPS = 30.0
BITS_ALIKE = 0.97
"""Share of bits in which frame pairs must be like those that Python has decoded."""


def coded_values(times: Array, clock: DisplayClock, strength: float) -> Array:
    """(T, P) values of pilots that follow the code in noise, and drift."""
    rng = np.random.default_rng(3)
    shares = embedded_share(np.array([astuple(clock)]), times, pilot_centres(LAYOUT), CODE)[0].T
    noise = rng.standard_normal(shares.shape)
    drift = times[:, None] * rng.standard_normal(LAYOUT.pilots)
    return strength * (2 * shares - 1) * pilot_signs(LAYOUT) + noise + drift


def test_codes_order_states_and_share_exposures(port: Port) -> None:
    page, module = port("link/pilotCode.js"), port("link/clock.js")
    code = page.PilotCode(CODE.signs.tolist())
    pairs = [-130, -1, 0, 1, 2, 62, 63, 1000]
    assert [code.sign(pair) for pair in pairs] == [CODE.sign(pair) for pair in pairs]
    assert [tuple(code.statesOf(pair)) for pair in pairs] == [CODE.states_of(p) for p in pairs]
    assert (code.period, code.isPlain, page.PLAIN.isPlain) == (CODE.period, False, True)
    assert port("receiver/pilots/code.js").clocksTried(code) == clocks_tried(CODE)
    numbers, times = np.array([1 / 60, 0.3, 0.004, 0.012, 0.01]), np.arange(-40, 90) / 29.9
    places = np.random.default_rng(0).random((9, 2))
    found = module.embeddedShare(numbers, times, places, code)
    same(found, embedded_share(numbers[None], times, places, CODE)[0], 10 * SAME_STEPS)


@cases(
    (60.0, 0.016, 24),
    (59.7, 0.0, 40),
    (120.0, -0.024, 30),
    (24.0, 0.008, 26),
    ids=["half", "slow", "fast", "long"],
)
def test_clocks_of_a_code_are_those_of_python(hz: float, delay: float, frames: int, port: Port):
    """At rates below, at and above that of the camera; a frame is missing."""
    times = np.delete(np.arange(frames + 1), 7) / FPS
    clock = DisplayClock(1 / hz, 0.21, 0.0, delay, 0.4 / hz)
    values = coded_values(times, clock, 1.5)
    signs, places = pilot_signs(LAYOUT), pilot_centres(LAYOUT)
    search = CodeSearch(CODE, signs, places, times, FPS)
    code = port("link/pilotCode.js").PilotCode(CODE.signs.tolist())
    ported = port("receiver/pilots/code.js").CodeSearch(code, signs, places, times.tolist(), FPS)
    same(np.array(ported.waves).T, search.waves, FLOAT32_SUM)
    known = search.strongest(values, 4)
    found = ported.strongest(list(values), 4)
    for lock, ported_lock in zip(known, found, strict=True):
        same(numbers_of(ported_lock.clock), astuple(lock.clock), FLOAT64)
        same([ported_lock.evidence, ported_lock.rival], [lock.evidence, lock.rival], FLOAT32_SUM)
    assert known[0].evidence > 5
    assert abs(1 / known[0].clock.period / hz - 1) < CLOCKS_APART
    matches = [signs * values + shift for shift in (0, 1)]
    matches = [np.concatenate([each, values[:, :9]], axis=1) for each in matches]
    highest = search.highest(matches)
    ported_highest = ported.highest([list(np.asarray(each, np.float32)) for each in matches])
    assert ported_highest.period == highest.period
    moments = [each.number(0.3) for each in (ported_highest, highest)]
    assert moments[0] == pytest.approx(moments[1], abs=0.51)  # two of a state show the same


@pytest.mark.parametrize("delays", [(0.0, 0.3), (-0.25, 0.0)], ids=["down", "across"])
def test_what_a_code_changes_is_measured_as_by_python(
    delays: tuple[float, float], port: Port
) -> None:
    """In maps, and in frame pairs; positions count nominal frames."""
    clock, at = DisplayClock(0.5, 3.1, *delays, 0.3), np.delete(np.arange(20), 5).tolist()
    toggling, module = CodedToggling(clock, CODE), port("receiver/pilots/toggling.js")
    code = port("link/pilotCode.js").PilotCode(CODE.signs.tolist())
    ported_clock = port("link/clock.js").DisplayClock(*astuple(clock))
    ported = module.CodedToggling(ported_clock, code)
    maps = block_maps(LAYOUT)
    rng = np.random.default_rng(1)
    views = rng.normal(90, 9, (len(at), *maps.size[::-1])).astype(np.float32)
    planes = port("receiver/pilots/search/allBlocks.js").blockMaps(LAYOUT)
    changes = run_to_end(iter(ported.changeSteps(planes, list(views), at)))
    same(np.array(changes), list(toggling.period_changes(maps, views, at)), PILOT_CHANGE)
    series = port("receiver/pilots/signal.js").overDeviation([view.reshape(-1) for view in views])
    line = ported.amplitudes(series, at, maps.size)
    expected = toggling.amplitudes(over_deviation(views), at).real.reshape(-1)  # -> (pixels,)
    same(np.asarray(line.real), expected, PILOT_CHANGE)
    seconds = ported.clockInSeconds(FPS, 7.5)
    same(numbers_of(seconds), astuple(toggling.clock_in_seconds(FPS, 7.5)), SAME_STEPS)


def test_pilots_tell_how_they_toggle(port: Port) -> None:
    """More frames than are looked at."""
    at = np.arange(70.0)
    values = coded_values(at / FPS, DisplayClock(1 / 60, 0.1, 0.0, 0.016, 0.008), 1.0)
    values = values.astype(np.float32)
    evidence, toggling = find_toggling(list(values), LAYOUT, at.tolist(), FPS)
    found = port("receiver/pilots/toggling.js").findToggling(list(values), LAYOUT, at.tolist(), FPS)
    same(found.evidence, evidence, 10 * FLOAT32_SUM)
    assert found.toggling.clear == toggling.clear
    same(numbers_of(found.toggling.clock), astuple(toggling.clock), FLOAT64)
    assert evidence > 20


def test_clocks_are_tried_at_shifts_of_a_display(port: Port) -> None:
    """Of one that lies two blocks to the right and one further down than thought."""
    clock, at = DisplayClock(0.5, 0.2, 0.0, 0.0, 0.3), np.arange(24.0)
    shares = embedded_share(np.array([astuple(clock)]), at, np.full((1, 2), 0.5), CODE)[0, 0]
    blocks = expected_changes(LAYOUT)
    drawn = cv2.resize(blocks, COARSE_SIZE, interpolation=cv2.INTER_NEAREST)
    side = [COARSE_SIZE[0] // LAYOUT.cols, COARSE_SIZE[1] // LAYOUT.rows]
    shown = np.roll(drawn, (side[1], 2 * side[0]), axis=(0, 1))
    noise = np.random.default_rng(2).normal(90, 3, (24, *shown.shape))
    views = (noise + 4 * np.multiply.outer(2 * shares - 1, shown)).astype(np.float32)
    found = shifted_togglings(rough_series(views, LAYOUT), blocks, LAYOUT, at.tolist(), 30.0)
    width, height = COARSE_SIZE
    planes = [{"width": width, "height": height, "data": view.reshape(-1)} for view in views]
    parts = port("receiver/pilots/search/parts.js")
    rough = parts.roughSeries(planes, LAYOUT)
    steps = parts.shiftedTogglings(rough, blocks.reshape(-1), LAYOUT, at.tolist(), 30.0)
    ported = run_to_end(iter(steps))
    for one, other in zip(ported, found, strict=True):
        assert one.clock.period == other.clock.period == 0.5
        apart = [each.number(12.0) - clock.number(12.0) for each in (one.clock, other.clock)]
        assert np.abs((np.array(apart) + 63) % 126 - 63).max() <= 1


@pytest.mark.slow
def test_a_coded_film_is_read_with_its_clock(port: Port) -> None:
    """Scores of the same frame pairs, by their numbers modulo the code's period."""
    images, _ = filmed(LAYOUT, 64, seed=4, hold=1)  # fewer frame pairs than the code has
    decoder = Decoder(GRAPH, threads=1, time_limit_s=60)
    decoder.layout = LAYOUT
    receiver = Receiver([decoder], FPS, FilmGraph(FILM_GRAPH, 1))
    ported = port("receiver/receiver.js").Receiver([LAYOUT], page_graphs(port), FPS)
    known, found = {}, {}
    for number, image in enumerate(images[::2]):
        for reader, pairs in ((receiver, known), (ported, found)):
            for pair in reader.push(image, number / FPS).pairs:
                pairs[pair.number % CODE.period] = getattr(pair, "soft", pair).scores
    both = known.keys() & found.keys()
    assert len(both) > 20
    alike = [((known[pair] > 0) == (found[pair] > 0)).mean() for pair in both]
    assert np.mean(alike) > BITS_ALIKE
    assert abs(ported.stateHz / (2 * FPS) - 1) < CLOCKS_APART
