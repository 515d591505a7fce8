"""The film decoder reads windows of frames whose exposures mix the display's states."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.optimize import minimize_scalar
from tolerances import CERTAINTY, FILM_SCORE

from export.film_graph import FilmGraph
from export.parity import FILM_TOLERANCE, compare_films, synthetic_window
from link.clock import DisplayClock
from link.errors import UnsuitedError
from link.layout import make_layout
from link.observation import mixture_of_exposures
from models import DECODERS, FILM_GRAPH, make_decoder
from models.film.decoder import CERTAINTY_PRIOR, FilmDecoder, certainty
from models.film.methods import load_film_decoder
from models.film.training import film_loss
from models.film.window import film_inputs, reads_films
from models.pairwise import decode_by_pairs

LAYOUT = make_layout(24, 32, modulation="antipodal", pilots="auto")
WELL_READ = 0.99
"""Least share of right bits of a film with little noise."""
MIXED_BITS = 0.98
"""Least share of right bits where each frame mixes states."""


@pytest.fixture(scope="module")
def decoder():
    return load_film_decoder()


def score(decoder, observation):
    """Scores (P, rows, cols) of all blocks, those of the pilots included."""
    with torch.no_grad():
        inputs = [torch.from_numpy(values) for values in film_inputs(observation).values()]
        return decoder(*inputs).double().numpy()


def window_of(noise, frames=24, seed=0):
    window, _ = synthetic_window(LAYOUT, np.random.default_rng(seed), frames, noise)
    return window.observation, window.bits


def share_right(scores, bits):
    """Share of right bits in the pairs of which frames show both states."""
    decided = scores[1:-1, LAYOUT.message_mask] > 0
    return (decided == bits[1:-1].astype(bool)).mean()


@pytest.mark.parametrize("name", [name for name, card in DECODERS.items() if card.frames != "pair"])
def test_all_that_read_windows_read_one_that_is_easy(name):
    window, bits = window_of(noise=2.0)
    scores = make_decoder(name).decode(window).scores.reshape(bits.shape)
    assert ((scores[1:-1] > 0) == bits[1:-1]).mean() > WELL_READ


def test_pairs_put_together_from_a_film_are_read():
    window, bits = window_of(noise=2.0)
    scores = decode_by_pairs(make_decoder("naive"), window).scores.reshape(bits.shape)
    pure = scores[1:-1] != 0
    assert pure.mean() > 0.6
    assert ((scores[1:-1] > 0) == bits[1:-1])[pure].mean() > WELL_READ


def test_decoders_of_frame_pairs_refuse_films():
    window, _ = window_of(noise=2.0)
    for name in ("naive", "learned", "blind"):
        with pytest.raises(UnsuitedError, match="frame pairs"):
            make_decoder(name).decode(window)


def test_windows_are_decoded_alike_by_oorc_and_its_twin():
    window, _ = window_of(noise=20.0)
    oorc, phi = (make_decoder(name).decode(window).scores for name in ("oorc", "phi"))
    np.testing.assert_allclose(oorc, phi, atol=1e-2 * np.abs(oorc).mean())


def test_an_exposure_mixes_what_its_clock_says():
    clock, times = DisplayClock(0.1, 0.03, 0.004, -0.02, 0.07), np.arange(6) / 17
    mixture = mixture_of_exposures(clock, times, LAYOUT, first=0, count=3)
    row, col = 5, 20
    place = np.array([[(col + 0.5) / LAYOUT.cols, (row + 0.5) / LAYOUT.rows]])
    for frame, time in enumerate(times):
        for pair in range(3):
            shown = [clock.shares(time, place, state)[0] for state in (2 * pair, 2 * pair + 1)]
            found = mixture.shares[frame, mixture.pair[frame] == pair, row, col].sum()
            np.testing.assert_allclose(found, (shown[1] - shown[0]) / 2, atol=1e-6)


def test_pilots_keep_their_bits_and_unseen_blocks_say_nothing(decoder):
    window, _ = window_of(noise=2.0)
    seen = window.blocks_seen.copy()
    seen[:, :, :8] = 0
    scores = score(decoder, replace(window, seen=seen))
    assert np.abs(scores[:, :, :8]).max() < 1e-6
    assert np.abs(scores[2, :, 8:]).mean() > 1


def test_frames_that_each_mix_two_states_are_read(decoder):
    """A camera whose exposures are as long as a state sees hardly any state alone."""
    rng = np.random.default_rng(1)
    window, _ = synthetic_window(LAYOUT, rng, 32, noise=4.0, shutter_s=1 / 31)
    assert share_right(score(decoder, window.observation), window.bits) >= MIXED_BITS


@pytest.mark.slow
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

    best = minimize_scalar(unlikely, bounds=(0.01, 9.0), method="bounded").x
    found = certainty(torch.from_numpy(scores), torch.from_numpy(known)).item()
    assert found == pytest.approx(best, abs=CERTAINTY)
    assert (found < 0.9, found > 1.1) == (boast > 1, boast < 1)


def test_a_lamp_that_flickers_and_a_hand_that_trembles_cost_little(decoder):
    window, bits = window_of(noise=4.0)
    rng = np.random.default_rng(5)
    rows = np.linspace(0, 1, len(window.frames[0]), dtype=np.float32)[:, None]
    frames = []
    for frame in window.frames:
        flicker = 0.01 * np.sin(2 * np.pi * (rows + rng.random(dtype=np.float32)))
        frames.append(frame * (1 + flicker) + np.float32(2 * rng.standard_normal()))
    moved = replace(window, frames=tuple(frames))
    assert share_right(score(decoder, moved), bits) >= MIXED_BITS


def test_a_window_trains_every_learned_number():
    module, (window, bits) = FilmDecoder(), window_of(noise=40.0, frames=10)
    film_loss(module, window, bits).backward()
    for name, parameter in module.named_parameters():
        assert parameter.grad is not None, name
        assert torch.isfinite(parameter.grad).all(), name


@pytest.mark.slow
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
    ):
        assert not reads_films(other)
