"""Φ is what runs: decoders that ship evaluate it by its layer, and no head is fitted in vain."""

from collections.abc import Callable

import numpy as np
import pytest
import torch
from torch import Tensor

import models.phi.decoder as phi_decoder
from data_gen.frame_pair import Cell, FramePair, Source
from export.parity import synthetic_window
from link.layout import Layout, make_layout
from link.observation import Observation
from link.presets import PRESETS
from models import make_decoder
from models.phi.decoder import PhiDecoder
from models.phi.phi import PhiPolynomial

PILOTS = make_layout(24, 32, modulation="antipodal", pilots="auto")


def still(layout: Layout) -> Observation:
    return FramePair(Source(layout), Cell("canon-lg", 0.0, 5), 3).rectified


def window(layout: Layout) -> Observation:
    return synthetic_window(layout, np.random.default_rng(0), frames=10)[0].observation


@pytest.mark.parametrize(
    ("name", "seen"),
    [
        ("phi", still(make_layout())),
        ("phi", still(PILOTS)),
        ("phi", window(PILOTS)),
        ("learned", still(make_layout())),
        ("learned", still(PILOTS)),
        ("linear", window(PILOTS)),
        ("film", window(PRESETS["robust"].layout)),
    ],
    ids=lambda each: each if isinstance(each, str) else f"{len(each.frames)} frames",
)
def test_decoders_call_the_forward_of_phi(
    name: str, seen: Observation, monkeypatch: pytest.MonkeyPatch
) -> None:
    called = []
    forward = PhiPolynomial.forward

    def counted(self: PhiPolynomial, i_o: Tensor, i_e: Tensor) -> list[Tensor]:
        called.append(self)
        return forward(self, i_o, i_e)

    monkeypatch.setattr(PhiPolynomial, "forward", counted)
    make_decoder(name).decode(seen)
    assert called


@pytest.mark.parametrize("layout", [make_layout(), PILOTS], ids=["ratex", "pilots"])
@pytest.mark.parametrize("name", ["phi", "learned"])
def test_a_fitted_head_reaches_the_scores(
    name: str, layout: Layout, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen = still(layout)
    scores = make_decoder(name).decode(seen).scores
    fit: Callable[..., Tensor] = phi_decoder.fit_head
    monkeypatch.setattr(phi_decoder, "fit_head", lambda *given: 0.5 * fit(*given))
    assert np.abs(make_decoder(name).decode(seen).scores - scores).max() > 1e-6


@pytest.mark.parametrize("layout", [make_layout(), PILOTS], ids=["ratex", "pilots"])
def test_what_shapes_the_head_gets_a_gradient(layout: Layout) -> None:
    decoder = PhiDecoder(layout, phi_decoder.DecoderConfig(drift_degree=2, refine=1))
    frames = torch.randint(0, 256, (2, 1, 3, layout.height, layout.width), dtype=torch.uint8)
    scores, _ = decoder(*frames)
    scores.square().sum().backward()
    for parameter in (decoder.log_ridge, decoder.prior, decoder.log_C):
        assert parameter.grad is not None
        assert parameter.grad.abs().max() > 0


def test_means_of_powers_become_means_of_polynomials() -> None:
    rng = np.random.default_rng(0)
    i_o, i_e = (torch.from_numpy(rng.random((1, 1, 50))) for _ in range(2))
    plain, quick = PhiPolynomial(3, 2, moments=4), PhiPolynomial(3, 2, moments=4, by_powers=True)
    expected, powers = (
        torch.cat(each(i_o, i_e), 1).mean(2, keepdim=True) for each in (plain, quick)
    )
    assert expected.shape == (1, 7, 1)
    torch.testing.assert_close(quick.of_means(powers), expected, rtol=0, atol=1e-12)
