"""The decoder on pilots, and the refinement that starts from them."""

from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from tolerances import FLOAT32, FLOAT64, ONNX_SCORE
from torch import Tensor

from data_gen.frame_pair import Cell, FramePair, Source
from export.parity import compare_with_torch
from export.runtime import Decoder
from export.to_onnx import to_onnx
from link.embed import embed
from link.errors import UnsuitedError
from link.layout import MODULATIONS, Layout, count_pilots, make_layout
from link.observation import Observation
from models import PRETRAINED, PRETRAINED_PILOTS, make_decoder, shipped_checkpoint
from models.phi.checkpoint import load_checkpoint
from models.phi.config import FULL, DecoderConfig
from models.phi.decoder import PhiDecoder
from models.phi.refine import MOMENTS
from models.phi.refine_pilots import STATISTICS, Model, PilotRefiner

GRIDS = [(8, 8), (24, 32)]
both_modulations = pytest.mark.parametrize("modulation", MODULATIONS)
on_grids = pytest.mark.parametrize("grid", GRIDS, ids=str)


def layout_of(grid: tuple[int, int], modulation: str) -> Layout:
    pilots = count_pilots("auto", *grid)
    return make_layout(*grid, modulation=modulation, pilots=pilots)


def shown_pair(layout: Layout, kappa: int = 5) -> tuple[Observation, NDArray[np.intp]]:
    """A cloudy picture as a camera with a gamma of its own sees it, without noise."""
    grain = np.random.default_rng(0).normal(128, 40, (layout.height // 8, layout.width // 8, 3))
    picture = cv2.resize(grain, (layout.width, layout.height)).clip(0, 255)
    bits = np.random.default_rng(1).integers(0, 2, layout.n_bits)
    shown = embed(picture.astype(np.uint8), bits, layout, kappa)
    curve = (255 * np.linspace(0, 1, 256) ** 0.8).round().astype(np.uint8)
    return Observation.still(curve[shown.original], curve[shown.embedded], layout, kappa), bits


def tensors(pair: Observation) -> tuple[Tensor, Tensor]:
    first, second = (
        torch.from_numpy(frame).permute(2, 0, 1).unsqueeze(0)
        for frame in (pair.original, pair.embedded)
    )
    return first, second


def statistics_of(layout: Layout, batch: int = 2) -> tuple[Tensor, Tensor, Tensor]:
    rng = np.random.default_rng(0)
    drawn = torch.from_numpy(rng.uniform(-0.3, 0.3, (batch, layout.message_mask.size, STATISTICS)))
    drawn[..., -2:] = drawn[..., -2:].abs() + 0.1  # the squared gradient and the weight
    scores = torch.from_numpy(rng.standard_normal((batch, layout.n_bits)))
    return drawn[:, : layout.pilots], drawn[:, layout.pilots :], scores


@both_modulations
@on_grids
def test_it_reads_a_pair_without_noise_untrained(grid: tuple[int, int], modulation: str) -> None:
    pair, bits = shown_pair(layout_of(grid, modulation))
    with torch.no_grad():
        scores, head = PhiDecoder(pair.layout, FULL)(*tensors(pair))
    assert ((scores[0] > 0).numpy() == bits).all()
    assert head.shape == (1, FULL.degree + FULL.drift_degree + 1)


@both_modulations
def test_without_refinement_it_is_oorc_on_pilots(modulation: str) -> None:
    pair, _ = shown_pair(layout_of((8, 8), modulation))
    decided = [make_decoder(name).decode(pair).bits for name in ("phi", "oorc")]
    np.testing.assert_array_equal(*decided)


def test_swapped_frames_carry_the_same_bits() -> None:
    """Pilots tell which state came first: the signal's sign is an unknown like all others."""
    pair, bits = shown_pair(layout_of((24, 32), "antipodal"))
    with torch.no_grad():
        scores, _ = PhiDecoder(pair.layout, FULL)(*reversed(tensors(pair)))
    assert ((scores[0] > 0).numpy() == bits).all()


@both_modulations
def test_a_batch_is_decoded_as_its_pairs_are(modulation: str) -> None:
    layout = layout_of((8, 8), modulation)
    refiner = PilotRefiner(layout, 768.0, rounds=2, rows=True, space=True)
    given = statistics_of(layout, 3)
    with torch.no_grad():
        together = refiner(*given)
        alone = torch.cat([refiner(*(each[i : i + 1] for each in given)) for i in range(3)])
    assert together.shape == (3, layout.n_bits)
    torch.testing.assert_close(together, alone, rtol=0, atol=FLOAT64)


@both_modulations
def test_the_solve_is_weighted_ridge_regression(modulation: str) -> None:
    """Against rows written out twice, once for each bit."""
    layout = layout_of((8, 8), modulation)
    refiner = PilotRefiner(layout, 768.0, rounds=1, rows=True, space=True).double()
    model = refiner.design(torch.cat(statistics_of(layout)[:2], dim=1))
    S, N = model.S.detach(), model.N.detach()
    rng = np.random.default_rng(2)
    weight = torch.from_numpy(rng.uniform(0, 2, (2, 2, N.shape[2])))
    amplitude, flicker = (torch.from_numpy(rng.uniform(0.5, 2, (2, 1, 1))) for _ in range(2))
    spilled = torch.from_numpy(rng.uniform(-1, 1, (2, 2, N.shape[2])))
    k, n, n_bands = S.shape[1], N.shape[1], len(refiner.frequency)
    low, high = layout.change_of_bits
    for beside in (spilled, None):
        fit = refiner.solve(Model(S, N, model.variance, beside), weight, amplitude, flicker)
        covariance, solution = fit.covariance, fit.mean
        for i in range(2):
            F, y = N[i, :-1], N[i, -1].numpy()
            still = F if beside is None else torch.cat([F, beside[i]])
            A = np.concatenate([np.vstack([m * S[i], still]).T for m in (high, low)])
            w = weight[i].numpy().reshape(-1)
            prior = np.ones(len(A.T))
            prior[:k] = amplitude[i].item() ** -2
            prior[k : k + n_bands] = 1 / flicker[i].item()
            normal = A.T @ (w[:, None] * A) + np.diag(prior)
            expected = np.linalg.solve(normal, A.T @ (w * np.tile(y, 2)))
            # in the decoder's order: what counts whatever the bit, the signal, the spilled light
            order = np.r_[k : k + n - 1, :k, k + n - 1 : len(expected)]
            free = np.delete(np.arange(solution.shape[2]), n - 1)
            np.testing.assert_allclose(
                solution[i, 0, free], expected[order], rtol=0, atol=1e3 * FLOAT64
            )
            assert solution[i, 0, n - 1] == -1
            found = covariance[i].numpy()
            np.testing.assert_allclose(
                found[np.ix_(free, free)] @ normal[np.ix_(order, order)],
                np.eye(len(normal)),
                atol=1e3 * FLOAT64,
            )
            assert not found[n - 1].any() and not found[:, n - 1].any()


def test_neighbours_are_those_of_the_grid() -> None:
    layout = make_layout(4, 5, 80, 64, modulation="antipodal", pilots=6)
    refiner = PilotRefiner(layout, 16.0, rounds=1, rows=False, space=False)
    grid = np.random.default_rng(0).normal(size=(4, 5))
    message = layout.message_mask.reshape(-1).nonzero()[0]
    order = np.concatenate([layout.pilot_blocks, message])
    shown = torch.from_numpy(grid.reshape(1, 1, -1)[..., order])
    found = refiner.neighbours(shown)[0].T.numpy()
    for number, block in enumerate(order):
        row, col = divmod(int(block), 5)
        beside = sum(grid[row, c] for c in (col - 1, col + 1) if 0 <= c < 5)
        above = sum(grid[r, col] for r in (row - 1, row + 1) if 0 <= r < 4)
        np.testing.assert_allclose(found[number], [beside, above], rtol=0, atol=FLOAT64)


@pytest.mark.parametrize("rows", [True, False])
@pytest.mark.parametrize("space", [True, False])
def test_every_parameter_gets_a_gradient(rows: bool, space: bool) -> None:
    layout = layout_of((8, 8), "antipodal")
    refiner = PilotRefiner(layout, 768.0, rounds=2, rows=rows, space=space)
    refiner(*statistics_of(layout)).square().sum().backward()  # type: ignore[no-untyped-call]
    without = [name for name, p in refiner.named_parameters() if p.grad is None or not p.grad.any()]
    assert without == ([] if rows else ["band_trust"])


def test_decoders_of_several_grids_share_their_parameters() -> None:
    decoder = PhiDecoder(layout_of((8, 8), "antipodal"), FULL)
    other = decoder.for_layout(layout_of((24, 32), "on_off"))
    assert other.layout.rows == 24
    ours, theirs = dict(decoder.named_parameters()), dict(other.named_parameters())
    assert ours.keys() == theirs.keys()
    assert all(ours[name] is theirs[name] for name in ours)


def test_a_checkpoint_is_for_patches_or_for_pilots() -> None:
    layouts = {PRETRAINED: make_layout(), PRETRAINED_PILOTS: layout_of((8, 8), "antipodal")}
    for folder, layout in layouts.items():
        assert shipped_checkpoint(layout) == folder
        assert load_checkpoint(folder, layout).layout == layout
    with pytest.raises(UnsuitedError, match="trained on layouts with ratex patches, not with pil"):
        load_checkpoint(PRETRAINED, layouts[PRETRAINED_PILOTS])
    with pytest.raises(UnsuitedError, match="trained on layouts with pilots, not with ratex"):
        load_checkpoint(PRETRAINED_PILOTS, layouts[PRETRAINED])


@both_modulations
def test_learned_reads_pilots_with_the_shipped_checkpoint(modulation: str) -> None:
    source = Source(layout_of((24, 32), modulation))
    pair = FramePair(source, Cell("nikon-samsung", 45.0, 5), 3)  # number 0 is mostly black
    wrong = make_decoder("learned").decode(pair.rectified).bits != pair.displayed.bits
    assert wrong.mean() < 0.02


@pytest.mark.exhaustive
def test_the_exported_graph_decides_as_torch_does(tmp_path: Path) -> None:
    """Without refinement, which takes long to export; shipped graphs have it."""
    layout = layout_of((24, 32), "antipodal")
    decoder = PhiDecoder(layout, DecoderConfig())
    (tmp_path / "decoder.onnx").write_bytes(to_onnx(decoder, "run"))
    parity = compare_with_torch(decoder, Decoder(tmp_path / "decoder.onnx"), frames=6, seed=3)
    assert parity.different_bits == 0
    assert parity.max_difference < ONNX_SCORE


def test_neither_patches_nor_pilots_are_not_enough() -> None:
    with pytest.raises(UnsuitedError, match="ratex patches or pilots"):
        PhiDecoder(make_layout(ratex=0), DecoderConfig())


def test_moments_are_where_the_refiner_takes_them() -> None:
    """A flat gray pair has the Legendre polynomials of its intensity as moments, and no texture."""
    layout = layout_of((8, 8), "antipodal")
    frame = torch.full((1, 3, 384, 512), 204, dtype=torch.uint8)
    decoder = PhiDecoder(layout, FULL)
    with torch.no_grad():
        pilots, _ = decoder.summarise(frame, frame)
    t = 2 * 204 / 255 - 1
    legendre = [t, (3 * t**2 - 1) / 2, (5 * t**3 - 3 * t) / 2, (35 * t**4 - 30 * t**2 + 3) / 8]
    expected = [0.0, *legendre, 0.0, 0.0, 0.0, 0.0, 1.0]
    assert len(legendre) == MOMENTS
    assert len(expected) == STATISTICS
    found = decoder.statistics(pilots)[0]
    np.testing.assert_allclose(found, np.tile(expected, (16, 1)), rtol=0, atol=FLOAT32)
