"""What evaluate.py measures beside the predictions: sweeps, reasons of failures, responses."""

import numpy as np
import pandas as pd
import pytest
from conftest import cases

from data_gen.frame_pair import Cell, FramePair, Source
from data_gen.pairs import PAIRS
from link.geometry import homography_from_corners
from link.layout import Layout
from link.ratex import training_pixels
from reports.engine.methods import Method
from reports.evaluation.reasons import Parts, block_lumas, explain, take_apart
from reports.evaluation.response import measure_response
from reports.evaluation.stories import Place, _caption, typical_pairs
from reports.evaluation.sweeps import SWEEPS, SWEPT_PAIRS, sweep_conditions


@pytest.mark.slow
@pytest.mark.parametrize("name", SWEEPS)
def test_every_value_of_a_sweep_can_be_filmed(name: str, layout: Layout) -> None:
    sweep = SWEEPS[name]
    assert set(sweep.quick) <= set(sweep.values)
    assert list(sweep.values) == sorted(sweep.values)
    conditions, (curve,) = sweep_conditions([name], Source(layout), 1, quick=False)
    assert [point.value for point in curve.points] == list(sweep.values)
    assert [point.condition for point in curve.points] == [c.name for c in conditions]
    assert len({(c.source, c.cells) for c in conditions}) == len(conditions)
    for condition in (conditions[0], conditions[-1]):
        cell = Cell("canon-lg", condition.cells[0].view_deg, condition.cells[0].kappa)
        assert FramePair(condition.source, cell, 0).captured.kappa == cell.kappa
    assert len({curve.words(value) for value in sweep.values}) == len(sweep.values)


def test_sweeps_use_every_camera_and_display_alike() -> None:
    for pairs, count in ((SWEPT_PAIRS, 2), (SWEPT_PAIRS[:3], 1)):
        assert set(pairs) <= set(PAIRS)
        names = [part for pair in pairs for part in pair.split("-")]
        assert {names.count(name) for name in names} == {count}


def test_the_parts_of_a_frame_pair_add_up(layout: Layout) -> None:
    pair = FramePair(Source(layout), Cell("canon-lg", 45.0, 5), 0)
    parts, captured = take_apart(pair), pair.captured
    message = layout.message_mask
    assert np.all(parts.signal[message] > 0)
    assert np.all(np.abs(parts.signal[~message]) < 0.2)  # patches carry no bit
    bits = np.zeros(message.shape)
    bits[message] = captured.bits
    # up to the reported corners, which are half a pixel off
    H = homography_from_corners(captured.corners, layout.width, layout.height)
    seen = block_lumas(captured.embedded, H, layout)
    seen -= block_lumas(captured.original, H, layout)
    expected = bits * parts.signal + parts.drift + parts.motion + parts.noise
    error = (seen - expected)[message]
    assert np.abs(error).mean() < 0.15 * parts.signal[message].mean()


def test_typical_frame_pairs_are_of_several_displays_and_count_whole_bits(layout: Layout) -> None:
    rows = [
        {"pair": pair, "view_deg": 0.0, "kappa": kappa, "index": 0, "condition": "",
         "method": "oorc", "known": 59.0, "correct": 59.0}
        for kappa in (3, 5)
        for pair in ("canon-lg", "nikon-samsung", "sony-lg")
    ]  # fmt: skip
    place = Place(Source(layout), "", "main comparison")
    chosen = [
        each.by_method["oorc"] for each in typical_pairs(pd.DataFrame(rows), {"": place}, ["oorc"])
    ]
    assert [row["pair"] for row in chosen] == ["canon-lg", "nikon-samsung"]
    assert _caption(chosen[0]) == "oorc: 0 of 59 bits wrong"


@cases(
    ({"signal": 0.2, "level": 10.0}, "arrives there as 0.20 gray levels, for the picture"),
    ({"signal": 0.2, "level": 250.0}, "near saturation"),
    ({"noise": 3.0}, "noise changes it by 3.00 gray levels, a bit by 2.00"),
    ({"motion": -3.0}, "motion of 0.70 px over texture changes it by 3.00"),
    ({}, "neither motion nor drift nor noise by half of that"),
)
def test_the_reason_names_the_largest_obstacle(change: dict[str, float], words: str) -> None:
    wrong = np.zeros((2, 3), bool)
    wrong[1, 2] = True
    usual = {"level": 100.0, "signal": 2.0, "drift": 0.0, "motion": 0.0, "noise": 0.0}
    arrays = {name: np.full(wrong.shape, value) for name, value in usual.items()}
    for name, value in change.items():
        arrays[name][wrong] = value
    reason, found = explain(Parts(**arrays, shift_px=0.7), wrong)
    assert reason.startswith("1 wrong block: ")
    assert words in reason
    for name, value in change.items():
        key = {"level": "captured level", "signal": "signal of a bit"}.get(name, name)
        key = "motion left" if name == "motion" else key
        assert found[key][0] == pytest.approx(abs(value))
    inverted, _ = explain(Parts(**arrays, shift_px=0.7), ~wrong)
    assert "more than half of the bits" in inverted


def test_the_true_response_rises_and_lies_in_its_band(layout: Layout) -> None:
    pair = FramePair(Source(layout), Cell("canon-lg", 45.0, 5), 0)
    found = measure_response(pair, [Method("naive"), Method("two_step"), Method("blind")])
    low, median, high = (np.array(v) for v in (found.low, found.median, found.high))
    assert np.all(np.diff(median) > -1)
    assert np.all((low <= median) & (median <= high))
    assert set(found.found) == set(found.error) == {"naive", "two_step"}
    pixels = training_pixels(layout, 5)
    seen = pair.rectified.original[pixels.y, pixels.x].mean()
    assert found.found["naive"][0][1] <= seen <= found.found["naive"][-1][1]
