"""The film decoder reads windows of frames whose exposures mix the display's states."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.optimize import minimize_scalar
from tolerances import CERTAINTY, FILM_SCORE

from export.film_graph import FilmGraph, reads_films
from export.parity import FILM_TOLERANCE, compare_films, film_tensors, synthetic_window
from lab.train_film import load_window, loss_of, save_window
from link.layout import make_layout
from models import FILM_GRAPH
from models.film.decoder import CERTAINTY_PRIOR, FilmDecoder, certainty
from models.phi.checkpoint import load_weights, read_config

LAYOUT = make_layout(24, 32, modulation="antipodal", pilots="auto")
PURE_BITS, MIXED_BITS = 0.999, 0.98
"""Least share of right bits where exposures are pure, and where each frame mixes states."""


@pytest.fixture(scope="module")
def decoder():
    folder, module = FILM_GRAPH.parent, FilmDecoder()
    load_weights(folder, read_config(folder), module)
    return module.eval()


def score(decoder, window):
    with torch.no_grad():
        return decoder(*film_tensors(window)).double().numpy()


def window_of(noise, shutter=None, frames=24, seed=0):
    window, bits = synthetic_window(LAYOUT, np.random.default_rng(seed), frames, noise)
    return window, bits


def share_right(scores, bits, window):
    """Share of right bits in the pairs of which frames show both states."""
    decided = scores[1:-1, LAYOUT.message_mask] > 0
    return (decided == bits[1:-1].astype(bool)).mean()


def test_bits_of_a_film_are_read(decoder):
    window, bits = window_of(noise=2.0)
    assert share_right(score(decoder, window), bits, window) >= PURE_BITS


def test_pilots_keep_their_bits_and_unseen_blocks_say_nothing(decoder):
    window, _ = window_of(noise=2.0)
    seen = window.seen.copy()
    seen[:, :, :8] = 0
    scores = score(decoder, replace(window, seen=seen))
    assert np.abs(scores[:, :, :8]).max() < 1e-6
    assert np.abs(scores[2, :, 8:]).mean() > 1


def test_frames_that_each_mix_two_states_are_read(decoder):
    """A camera whose exposures are as long as a state sees hardly any state alone."""
    rng = np.random.default_rng(1)
    window, bits = synthetic_window(LAYOUT, rng, 32, noise=4.0, shutter_s=1 / 31)
    assert share_right(score(decoder, window), bits, window) >= MIXED_BITS


def test_scores_are_as_sure_as_they_are_right(decoder):
    right, said = [], []
    for seed in range(8):
        window, bits = window_of(noise=60.0, seed=seed)
        scores = score(decoder, window)[1:-1, LAYOUT.message_mask]
        right.append((scores > 0) == bits[1:-1].astype(bool))
        said.append(1 / (1 + np.exp(-np.abs(scores))))
    right, said = (np.concatenate(each).mean() for each in (right, said))
    assert abs(right - said) < 0.05
    assert 0.55 < right < 0.98


@pytest.mark.parametrize("boast", [0.5, 1.0, 2.0, 4.0])
def test_certainty_is_the_likeliest_factor(boast):
    rng = np.random.default_rng(3)
    known = np.where(rng.random((1, 400)) < 0.3, rng.choice([-1.0, 1.0], (1, 400)), 0.0)
    mean = 1.5 * known  # scores of variance 2 m around m x are as sure as they are right
    scores = boast * (mean + np.sqrt(3.0) * rng.standard_normal((6, 400)))
    right = (known * scores)[:, known[0] != 0]

    def unlikely(factor):
        doubt = np.logaddexp(0, -factor * right).sum()
        return doubt + CERTAINTY_PRIOR / 2 * (1 - factor) ** 2

    best = minimize_scalar(unlikely, bounds=(0.01, 1.0), method="bounded").x
    found = certainty(torch.from_numpy(scores), torch.from_numpy(known)).item()
    assert found == pytest.approx(best, abs=CERTAINTY)
    assert (found < 0.9) == (boast > 1)


def test_a_lamp_that_flickers_and_a_hand_that_trembles_cost_little(decoder):
    window, bits = window_of(noise=4.0)
    rng = np.random.default_rng(5)
    rows = np.linspace(0, 1, window.frames.shape[2])[:, None]
    frames = window.frames.copy()
    for frame in frames:
        phase = rng.uniform(0, 2 * np.pi)
        frame *= 1 + 0.01 * np.sin(2 * np.pi * rows + phase).astype(np.float32)
        frame += 2 * rng.standard_normal()
    moved = replace(window, frames=frames)
    assert share_right(score(decoder, moved), bits, moved) >= MIXED_BITS


def test_a_kept_window_trains_every_learned_number(tmp_path):
    module, (window, bits) = FilmDecoder(), window_of(noise=40.0, frames=10)
    save_window(tmp_path / "window.npz", window, bits.astype(np.float32), LAYOUT)
    for kept, given in zip(
        load_window(tmp_path / "window.npz")[0], film_tensors(window), strict=True
    ):
        torch.testing.assert_close(kept, given, atol=0, rtol=2**-11)  # frames have 11 bits
    loss_of(module, tmp_path / "window.npz").backward()
    for name, parameter in module.named_parameters():
        assert parameter.grad is not None, name
        assert torch.isfinite(parameter.grad).all(), name


def test_the_shipped_graph_is_the_shipped_checkpoint(decoder):
    parity = compare_films(decoder, FilmGraph(FILM_GRAPH, 1))
    assert parity.holds, parity
    assert parity.median_score < 0.5 * parity.largest_score
    assert FILM_TOLERANCE == FILM_SCORE


def test_layouts_that_are_read():
    assert reads_films(LAYOUT)
    for other in (
        make_layout(),
        make_layout(8, 8, modulation="antipodal", pilots="auto"),
        make_layout(24, 32, modulation="on_off", pilots="auto"),
        make_layout(24, 32, modulation="antipodal", pilots="auto", colour="chroma"),
    ):
        assert not reads_films(other)
