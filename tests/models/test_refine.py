from collections.abc import Callable

import numpy as np
import pytest
import torch
from conftest import slow
from numpy.polynomial.legendre import legval
from tolerances import FLOAT64
from torch import Tensor

from link.layout import make_layout
from models.phi.refine import MOMENTS, Fit, Hypotheses, cavity_llr, with_surprises
from models.phi.refine_ratex import RatexRefiner

LAYOUT = make_layout(4, 5, 160, 96, 2)


def randn(*shape: int, seed: int = 0) -> Tensor:
    return torch.from_numpy(np.random.default_rng(seed).standard_normal(shape))


def test_cavity_is_the_fit_without_the_block() -> None:
    """Against the posterior that is computed anew from all other blocks, block by block."""
    K, N = 4, 7
    S, rest = randn(N, 2), randn(N, K - 2, seed=1)
    one, zero = torch.cat([S, rest], 1), torch.cat([0 * S, rest], 1)
    y, p = randn(N, seed=2), torch.rand(N, generator=torch.Generator().manual_seed(0)).double()
    var = 0.3 + torch.rand(N, generator=torch.Generator().manual_seed(1)).double()
    p1, p0 = p / var, (1 - p) / var

    def posterior(keep: Tensor) -> tuple[Tensor, Tensor]:
        A = torch.eye(K).double()
        right = torch.zeros(K).double()
        for F, weight in ((one, p1), (zero, p0)):
            A = A + (F[keep] * weight[keep, None]).T @ F[keep]
            right = right + F[keep].T @ (weight * y)[keep]
        return torch.linalg.inv(A), torch.linalg.solve(A, right)

    covariance, w = posterior(torch.arange(N))
    both = torch.cat([one, zero])
    variance = torch.einsum("nk,kl,nl->n", both, covariance, both)
    shared = torch.einsum("nk,kl,nl->n", one, covariance, zero)
    hypotheses = Hypotheses(torch.cat([y, y]) - both @ w, variance, torch.cat([shared, shared]))
    fit = Fit(covariance, w, torch.cat([p1, p0]))
    llr = cavity_llr(fit, hypotheses, torch.cat([var, var]), lambda v: v.roll(N))
    torch.testing.assert_close(llr[:N], -llr[N:])
    for n in range(N):
        covariance, w = posterior(torch.tensor([k for k in range(N) if k != n]))
        logs = [
            torch.distributions.Normal(F[n] @ w, (var[n] + F[n] @ covariance @ F[n]).sqrt())
            .log_prob(y[n])
            .item()
            for F in (one, zero)
        ]
        assert llr[n].item() == pytest.approx(logs[0] - logs[1], abs=FLOAT64)


@pytest.mark.parametrize("surprise", [1e-6, 1e-2, 0.5])
def test_surprises_flip_a_bit_with_half_their_probability(surprise: float) -> None:
    llr = torch.linspace(-12, 12, 25).double()
    p = llr.sigmoid() * (1 - surprise) + surprise / 2
    limited = with_surprises(llr, torch.tensor(surprise, dtype=torch.float64).log())
    torch.testing.assert_close(limited, (p / (1 - p)).log(), rtol=0, atol=1e-8)
    most = with_surprises(
        torch.tensor([400.0]).double(), torch.tensor(surprise, dtype=torch.float64).log()
    )
    assert most.item() == pytest.approx(np.log(2 / surprise - 1))


def moments_of(i: Tensor) -> Tensor:
    x = (2 * i - 1).numpy()
    each = [legval(x, np.eye(MOMENTS + 1)[k]) for k in range(1, MOMENTS + 1)]
    return torch.from_numpy(np.stack(each, axis=-1))


Curve = Callable[[Tensor], Tensor]


def scene(
    noise: float, kappa: float, seed: int, curve: Curve = lambda i: i, drift: float = 0.0
) -> tuple[Tensor, Tensor, Tensor]:
    """Tiles, blocks and bits of a display whose capture is ``curve`` of what it shows."""
    refiner = RatexRefiner(LAYOUT, 1, True, True)
    rng = np.random.default_rng(seed)
    shown = torch.from_numpy(rng.uniform(0.1, 0.9, LAYOUT.n_bits))
    bits = torch.from_numpy(rng.integers(0, 2, LAYOUT.n_bits)).double()
    parts = []
    for rho, b in ((refiner.levels, refiner.switched[: len(refiner.levels), 0]), (shown, bits)):
        change = curve((rho + b * kappa / 255) * (1 + drift)) - curve(rho)
        change = change + noise / 255 * torch.from_numpy(rng.standard_normal(len(rho)))
        parts.append(torch.cat([change[:, None], moments_of(curve(rho))], dim=1)[None])
    return parts[0], parts[1], bits


@pytest.mark.parametrize("drift", [0.0, 0.03])
@pytest.mark.parametrize("gamma", [0.7, 1.0, 1.6])
def test_blocks_of_the_model_are_decided_right(gamma: float, drift: float) -> None:
    tiles, blocks, bits = scene(0.1, 3, 1, lambda i: 0.1 + 0.8 * i**gamma, drift)
    start = torch.zeros_like(bits)[None]  # knows nothing: the tiles must do
    llr = RatexRefiner(LAYOUT, 4, True, True)(tiles, blocks, start)[0]
    assert torch.equal(llr > 0, bits > 0.5)


def test_calibration_finds_the_slope_of_the_response() -> None:
    tiles, _, _ = scene(0.0, 3, 2, lambda i: 0.1 + 0.8 * i**0.7)
    refiner = RatexRefiner(LAYOUT, 1, True, True)
    curves, tilt = refiner.calibrate(tiles)
    h, square = (refiner.legendre @ curves)[0].unbind(-1)
    shown = torch.linspace(0.15, 0.85, 8).double()
    index = (64 * (0.1 + 0.8 * shown**0.7)).round().long()
    slope = 0.56 * shown**-0.3
    torch.testing.assert_close(h[index], slope, rtol=0.05, atol=0.02)
    torch.testing.assert_close(square[index], slope**2, rtol=0.1, atol=0.04)
    torch.testing.assert_close(tilt, torch.zeros_like(tilt), rtol=0, atol=0.02)


def test_the_signal_follows_a_response_that_changes_over_the_display() -> None:
    layout = make_layout()
    refiner = RatexRefiner(layout, 1, False, True)
    gain = 1 / (1.2 + 0.2 * refiner.places[:, 0] - 0.1 * refiner.places[:, 1])  # g(i) = i / gain
    T = len(refiner.levels)
    shown = torch.cat([refiner.levels, torch.full((layout.n_bits,), 0.5).double()])
    i = gain * shown
    statistics = torch.cat([0 * i[:, None], moments_of(i)], dim=1)[None]
    S, _, _, _ = refiner.design(statistics[:, :T], statistics[:, T:])
    signal = S[0, T:, 0] / refiner.signal[0].exp()
    torch.testing.assert_close(signal, gain[T:], rtol=0.1, atol=0)


def test_noisier_frames_get_weaker_scores() -> None:
    strength = []
    for noise in (1.0, 2.5, 6.0):
        tiles, blocks, bits = scene(noise, 3, 3)
        llr = RatexRefiner(LAYOUT, 4, True, True)(tiles, blocks, 2 * bits[None] - 1)[0]
        strength.append(llr.abs().median().item())
    assert strength[0] > 1.2 * strength[1] > 1.44 * strength[2]


@pytest.mark.parametrize("switches", [(True, True), slow((False, False))])
def test_refinement_has_the_right_gradient(switches: tuple[bool, bool]) -> None:
    tiles, blocks, _ = scene(0.5, 3, 4)
    refiner = RatexRefiner(LAYOUT, 2, *switches).double()
    with torch.no_grad():
        refiner.block_noise[0] = -0.7  # as the scene has it
    scores = (0.3 * randn(1, LAYOUT.n_bits, seed=5)).requires_grad_()
    names = [name for name, _ in refiner.named_parameters()]

    def decide(scores: Tensor, *values: Tensor) -> Tensor:
        parameters = dict(zip(names, values, strict=True))
        result: Tensor = torch.func.functional_call(refiner, parameters, (tiles, blocks, scores))
        return result

    values = [p.detach().double().requires_grad_() for p in refiner.parameters()]
    assert torch.autograd.gradcheck(decide, (scores, *values), eps=1e-5, atol=1e-5, rtol=1e-3)
