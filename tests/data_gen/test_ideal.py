from pathlib import Path

import numpy as np
import pytest
from conftest import Command, cases
from scipy.stats import binomtest, norm

import evaluate
from data_gen.effects import EFFECTS
from data_gen.frame_pair import Cell, FramePair, Source
from data_gen.ideal import OriginalSeen, captured_blocks, log_likelihood_ratios, observe_ideally
from link.captures import save_captures
from link.layout import Layout, make_layout
from link.types import Array, Image
from models import make_decoder
from reports.engine.methods import METHODS

SMALL = make_layout(4, 4, 256, 192, 2)
HARD = Cell("canon-samsung", 45.0, 1)


SIDE, COUNT, SIGMA, LOW, STEP, TRIALS = 16, 64, 8.0, 128.0, 0.75, 12
BLOCKS = np.kron(np.arange(COUNT).reshape(8, 8), np.ones((SIDE, SIDE), np.int16)).astype(np.int16)
SHAPE = (*BLOCKS.shape, 3)


def noisy(level: float | Array, rng: np.random.Generator, *many: int) -> Image:
    """Captures of ``level`` under white noise: (*many, H, W, 3)."""
    noise = SIGMA * rng.standard_normal((*many, *SHAPE))
    return np.asarray((level + noise).round().astype(np.uint8))


def draws_of_both_bits(rng: np.random.Generator) -> Image:
    noise = SIGMA * rng.standard_normal((64, *SHAPE))
    return np.stack([LOW + noise, LOW + STEP + noise]).round().astype(np.uint8)


@pytest.mark.slow
def test_log_likelihood_ratios_of_white_noise_are_those_of_the_formula() -> None:
    rng = np.random.default_rng(0)
    draws = draws_of_both_bits(rng)
    bits = rng.integers(0, 2, (TRIALS, COUNT))
    errors, slopes = 0, []
    for message in bits:
        seen = noisy(LOW + STEP * message[BLOCKS][..., None], rng)
        found = log_likelihood_ratios(seen, draws, BLOCKS, COUNT)
        each = norm.logpdf(seen, LOW + STEP, SIGMA) - norm.logpdf(seen, LOW, SIGMA)
        exact = np.bincount(BLOCKS.ravel(), each.sum(axis=2).ravel())
        errors += int(((found > 0) != message).sum())
        slopes.append(np.polyfit(exact, found, 1)[0])
        assert np.corrcoef(exact, found)[0, 1] > 0.9
    assert np.mean(slopes) == pytest.approx(1, abs=0.15)
    d_prime = STEP * np.sqrt(3 * SIDE**2) / SIGMA
    assert binomtest(errors, bits.size, norm.sf(d_prime / 2)).pvalue > 0.001


@pytest.mark.slow
def test_the_change_alone_has_the_noise_of_both_frames() -> None:
    """Error rates are those of twice the variance."""
    rng = np.random.default_rng(1)
    draws, other = draws_of_both_bits(rng), noisy(LOW, rng, 64)
    bits = rng.integers(0, 2, (TRIALS, COUNT))
    errors = 0
    for message in bits:
        original = OriginalSeen(noisy(LOW, rng), other[None], BLOCKS)
        embedded = noisy(LOW + STEP * message[BLOCKS][..., None], rng)
        found = log_likelihood_ratios(embedded, draws, BLOCKS, COUNT, original)
        errors += int(((found > 0) != message).sum())
    d_prime = STEP * np.sqrt(3 * SIDE**2 / 2) / SIGMA
    assert binomtest(errors, bits.size, norm.sf(d_prime / 2)).pvalue > 0.001


def test_bits_that_look_alike_are_left_undecided() -> None:
    burnt = np.full((2, 4, 32, 32, 3), 255, np.uint8)
    blocks = np.zeros((32, 32), np.int16)
    assert log_likelihood_ratios(burnt[0, 0], burnt, blocks, 2).tolist() == [0, 0]


@cases(
    SMALL,
    make_layout(3, 5, 117, 201, 1),
    make_layout(4, 4, 256, 192, 2, "antipodal"),
    make_layout(6, 7, 219, 205, modulation="antipodal", pilots=11),
    make_layout(6, 7, 219, 205, pilots=11),
)
def test_a_channel_without_effects_leaves_no_error(layout: Layout) -> None:
    source = Source(layout, "train", without=tuple(EFFECTS))
    cell = Cell("canon-lg", 20.0, 1)
    pair = FramePair(source, cell, 0)
    for change in (False, True):
        soft = observe_ideally(pair, 4, change)
        assert np.array_equal(soft.bits, pair.displayed.bits)
        assert np.isfinite(soft.scores).all()


@pytest.mark.slow
def test_the_change_of_both_frames_has_twice_the_signal() -> None:
    """Bits that change the original frame too, the other way, are an amplitude of 2."""
    rng = np.random.default_rng(2)
    draws, other = draws_of_both_bits(rng), draws_of_both_bits(rng)[::-1]
    bits = rng.integers(0, 2, (TRIALS, COUNT))
    errors = 0
    for message in bits:
        high = STEP * message[BLOCKS][..., None]
        original = OriginalSeen(noisy(LOW + STEP - high, rng), other, BLOCKS)
        found = log_likelihood_ratios(noisy(LOW + high, rng), draws, BLOCKS, COUNT, original)
        errors += int(((found > 0) != message).sum())
    d_prime = 2 * STEP * np.sqrt(3 * SIDE**2 / 2) / SIGMA
    assert binomtest(errors, bits.size, norm.sf(d_prime / 2)).pvalue > 0.001


@pytest.mark.parametrize("change", [False, True])
def test_antipodal_messages_are_decided_from_both_frames(change: bool) -> None:
    cell = Cell("canon-samsung", 45.0, 1)
    wrong, scores = {}, {}
    for modulation in ("on_off", "antipodal"):
        layout = make_layout(16, 16, 256, 192, modulation=modulation, pilots=16)
        pair = FramePair(Source(layout, "train", 7), cell, 0)
        soft = observe_ideally(pair, 8, change)
        bits = pair.displayed.bits
        assert soft.scores.shape == (layout.n_bits,) == (240,)
        wrong[modulation] = int((soft.bits != bits).sum())
        scores[modulation] = float((soft.scores * (2 * bits - 1)).mean())
    assert wrong["antipodal"] < wrong["on_off"]
    assert scores["antipodal"] > 1.5 * scores["on_off"]


@pytest.mark.slow
def test_no_decoder_passes_the_ideal_observer(layout: Layout) -> None:
    source = Source(layout, "train", 7)
    ideal, change, oorc = 0, 0, 0
    for index in range(2):
        pair = FramePair(source, HARD, index)
        bits = pair.displayed.bits
        ideal += int((observe_ideally(pair, 8).bits != bits).sum())
        change += int((observe_ideally(pair, 8, change=True).bits != bits).sum())
        oorc += int((make_decoder("oorc").decode(pair.rectified).bits != bits).sum())
    assert ideal <= change < oorc / 4


@pytest.mark.slow
def test_scores_are_calibrated(layout: Layout) -> None:
    source = Source(layout, "train", 7, parameters=(("metering", 1.0),))
    cell = Cell("nikon-samsung", 60.0, 1)
    wrong, expected = 0, 0.0
    for index in range(4):
        pair = FramePair(source, cell, index)
        soft = observe_ideally(pair, 16)
        wrong += int((soft.bits != pair.displayed.bits).sum())
        expected += float((1 / (1 + np.exp(np.abs(soft.scores)))).sum())
    assert wrong > 0
    assert expected == pytest.approx(wrong, abs=3 * np.sqrt(expected))


def test_the_observer_draws_the_channel_of_the_capture(layout: Layout) -> None:
    source = Source(layout, "train", 7, parameters=(("jitter_px", 1.0), ("drift", 0.1)))
    captured = FramePair(source, HARD, 3).captured
    again = FramePair(source, HARD, 3)
    shot = again.shots[1]
    exposure = shot.expose(again.displayed.embedded)
    noise_rng = again.channel_rng().spawn(2)[1]
    assert np.array_equal(shot.develop(exposure, noise_rng), captured.embedded)
    mean = np.mean([shot.develop(exposure, np.random.default_rng(i)) for i in range(6)], axis=0)
    assert abs(float((captured.embedded - mean).mean())) < 0.02
    blocks = captured_blocks(layout, shot.H_captured_from_display, mean.shape)
    assert mean[blocks >= 0].mean() > 3 * mean[blocks < 0].mean()
    assert np.array_equal(np.unique(blocks), np.arange(-1, layout.rows * layout.cols))


def test_a_message_given_in_place_of_the_drawn_one_changes_nothing_else() -> None:
    source, cell = Source(SMALL), Cell("canon-lg", 0.0, 5)
    usual = FramePair(source, cell, 1)
    given = FramePair(source, cell, 1, message=tuple(1 - usual.displayed.bits))
    assert np.array_equal(given.displayed.original, usual.displayed.original)
    assert np.array_equal(given.displayed.bits, 1 - usual.displayed.bits)
    assert given.channel_rng().random() == usual.channel_rng().random()


# The comparison


@pytest.mark.slow
def test_the_comparison_knows_it_as_a_method(tmp_path: Path, command: Command) -> None:
    methods = ("oorc", "ideal", "ideal_change")
    flags = ["--pairs", "canon-lg", "--views", 0, "--kappas", 5, "--frames", 1, "--jobs", 1]
    command(evaluate.main, *flags, "--methods", *methods, "--out", tmp_path)
    tables = (tmp_path / "tables.md").read_text()
    assert all(f"| {method} |" in tables for method in methods)
    assert "ideal" not in evaluate.EvaluateConfig().methods
    assert "ideal" in METHODS  # which are named where one is unknown


@pytest.mark.slow
def test_captures_without_a_simulation_leave_it_out(
    layout: Layout, tmp_path: Path, command: Command
) -> None:
    save_captures(
        tmp_path / "real", iter([FramePair(Source(layout), Cell("canon-lg", 0.0, 5), 0).captured])
    )
    flags = ["--captures", tmp_path / "real", "--out", tmp_path / "out"]
    result = command(evaluate.main, *flags, "--methods", "oorc", "ideal")
    assert "ideal: left out of 1 of 1, needs the simulation's true channel" in result.stdout
    assert "ideal" not in (tmp_path / "out" / "tables.md").read_text()
