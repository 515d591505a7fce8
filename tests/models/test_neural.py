import hashlib
import io
import json
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from conftest import cases, slow
from hypothesis import given
from hypothesis import strategies as st
from numpy.polynomial.legendre import legval
from sklearn.svm import LinearSVC
from tolerances import FLOAT32, FLOAT64, ONNX_SCORE, RESIDUAL_PX, SVM_OBJECTIVE_GAP, TWIN_SCORE
from torch import Tensor

from data_gen.frame_pair import Cell, FramePair, Source
from data_gen.pairs import PAIRS
from link.errors import InputError
from link.frames import Captured
from link.images import as_batch
from link.layout import Layout, make_layout
from link.observation import Observation
from link.types import Array
from models import PRETRAINED, make_decoder
from models.onnx_ops import exported_sum
from models.phi.checkpoint import load_checkpoint, load_weights, save_checkpoint, unpack
from models.phi.config import CHANNELS, FULL, MAX_DEGREE, DecoderConfig
from models.phi.decoder import PhiDecoder, bin_mean
from models.phi.methods import Phi, decode_with
from models.phi.phi import PhiPolynomial
from models.phi.reduce import Reduce
from models.phi.refine import MOMENTS
from models.phi.register import derivatives, register
from models.phi.solver import fit_head

EVERY_CONFIG = [
    DecoderConfig(),
    DecoderConfig(degree=6, drift_degree=4, channels="rgb", register=True),
    FULL,
    replace(FULL, channels="rgb", coarsen=1, train_on="tile", space=False, texture=0.0),
]


@pytest.fixture(scope="module")
def pairs(layout: Layout) -> list[Observation]:
    """Ten simulated frame pairs, every camera and display among them."""
    names = list(PAIRS)
    return [
        FramePair(Source(layout), Cell(names[k % 9], 3.0 * k, 1 + k % 8), k).rectified
        for k in range(10)
    ]


def perturbed(module: PhiDecoder) -> PhiDecoder:
    """The same module with parameters as training might leave them."""
    generator = torch.Generator().manual_seed(1)
    with torch.no_grad():
        for parameter in module.parameters():
            parameter += 0.3 * torch.randn(parameter.shape, generator=generator)
    return module.eval()


def batch(pairs: list[Observation]) -> tuple[Tensor, Tensor]:
    return (
        torch.from_numpy(np.concatenate([as_batch(pair.original) for pair in pairs])),
        torch.from_numpy(np.concatenate([as_batch(pair.embedded) for pair in pairs])),
    )


# --- Phi


@pytest.mark.parametrize(("dtype", "atol"), [(torch.float64, FLOAT64), (torch.float32, FLOAT32)])
@cases((1, 0), (7, 2), (MAX_DEGREE, MAX_DEGREE))
def test_phi_agrees_with_numpy(degree: int, drift: int, dtype: torch.dtype, atol: float) -> None:
    i_o, i_e = np.random.default_rng(0).uniform(0, 1, (2, 5, 6))
    phi = PhiPolynomial(degree, drift)
    features = torch.stack(
        phi(torch.from_numpy(i_o).to(dtype), torch.from_numpy(i_e).to(dtype)), dim=-1
    )
    of_o = np.polynomial.legendre.legvander(2 * i_o - 1, degree)[..., 1:]
    of_e = np.polynomial.legendre.legvander(2 * i_e - 1, degree)[..., 1:]
    expected = np.concatenate([of_o - of_e, of_o[..., :drift]], axis=-1)
    assert features.dtype == dtype
    assert features.shape == (5, 6, phi.n_features)
    assert len(phi.names) == phi.n_features
    np.testing.assert_allclose(features.numpy(), expected, rtol=0, atol=atol)


def test_unknown_options_list_the_valid_ones() -> None:
    with pytest.raises(InputError, match=r"channels 'hsv'.*luma, quiet, rgb"):
        DecoderConfig(channels="hsv")
    with pytest.raises(InputError, match=r"train_on 'frame'.*tile, area"):
        DecoderConfig(train_on="frame")


@cases(
    ({"degree": 0}, "degree: need 1 to 12, got 0"),
    ({"degree": MAX_DEGREE + 1}, "degree: need 1 to 12, got 13"),
    ({"drift_degree": 5}, "drift_degree: need 0 to degree 4, got 5"),
    ({"drift_degree": -1}, "drift_degree: need 0 to degree 4, got -1"),
    ({"coarsen": 3}, "coarsen: need 1 or 2, got 3"),
    ({"refine": 9}, "refine: need 0 to 8, got 9"),
    ({"texture": -0.1}, "texture: need at least 0 and below 1, got -0.1"),
    ({"rows": True}, "rows: needs refine"),
    ({"space": True}, "space: needs refine"),
    ({"space": 1}, "space: must be of type bool"),
    ({"drift_degree": 1.5}, "drift_degree: must be of type int"),
)
def test_options_that_make_no_decoder_are_refused(options: dict[str, Any], flag: str) -> None:
    with pytest.raises(InputError, match=flag):
        DecoderConfig(**options)


# --- solver


def sklearn_head(X: Array, y: Array, C: float) -> Array:
    """What scikit-learn makes of features whose last column is ones; that is the intercept's."""
    svm = LinearSVC(C=C, loss="squared_hinge", dual=False, tol=1e-8, max_iter=100_000)
    svm.fit(X[:, :-1], y)
    return np.append(svm.coef_[0], svm.intercept_[0])


def objective_gap(X: Array, y: Array, C: float) -> float:
    """Objective of `fit_head` relative to scikit-learn's, minus 1."""

    def value(w: Array) -> float:
        return float(0.5 * w @ w + C * (np.maximum(0, 1 - y * (X @ w)) ** 2).sum())

    zeros = torch.zeros(X.shape[1], dtype=torch.float64)
    ours = fit_head(
        torch.from_numpy(X)[None],
        torch.from_numpy(y),
        torch.tensor(C, dtype=torch.float64),
        zeros + 1,
        zeros,
    )
    return value(ours[0].numpy()) / value(sklearn_head(X, y, C)) - 1


SHORT_STEPS = [1525, 1438, 2828, 747, 2368, 1728]
"""Frames, all but separable and with a large C, that need Newton steps shorter than 1/180."""


@pytest.mark.parametrize("seed", [*range(30), *SHORT_STEPS])
def test_fit_head_reaches_scikit_learns_objective_on_random_frames(seed: int) -> None:
    rng = np.random.default_rng(seed)
    N, D = int(rng.integers(8, 200)), int(rng.integers(1, 12))
    features = rng.normal(0, 1, (N, D)) @ rng.normal(0, 1, (D, D))  # correlated
    features /= np.sqrt((features**2).mean(axis=0))
    X = np.column_stack([features, np.ones(N)])
    noise = rng.choice([0, 0.01, 1, 2])
    y = np.where(X @ rng.normal(0, 1, D + 1) + rng.normal(0, noise, N) > 0, 1.0, -1.0)
    y[:2] = 1, -1
    assert abs(objective_gap(X, y, 10 ** rng.uniform(-2, 3))) < SVM_OBJECTIVE_GAP


@pytest.mark.parametrize("train_on", ["area", "tile"])
def test_fit_head_reaches_scikit_learns_objective_on_simulated_frames(
    layout: Layout, pairs: list[Observation], train_on: str
) -> None:
    module = PhiDecoder(layout, DecoderConfig(drift_degree=2, train_on=train_on))
    original, embedded = batch(pairs)
    ratex = module.summarise(original, embedded)[0].numpy()
    assert ratex.shape == (10, 80, 6)
    for k, u in enumerate(ratex):
        X = np.column_stack([u / np.sqrt((u**2).mean(axis=0)), np.ones(len(u))])
        gap = objective_gap(X, module.labels.numpy(), 10 ** (-2 + 5 * k / 9))
        assert abs(gap) < SVM_OBJECTIVE_GAP


def test_ridge_and_prior_enter_the_minimum() -> None:
    """The gradient of J vanishes at the head, whatever ridge and prior."""
    rng = np.random.default_rng(3)
    X = torch.from_numpy(rng.normal(0, 1, (4, 60, 5)))
    y = torch.from_numpy(np.where(rng.normal(0, 1, 60) > 0, 1.0, -1.0))
    C, ridge = torch.tensor(0.7).double(), torch.tensor([1.0, 20, 0.5, 0.1, 3]).double()
    prior = torch.tensor([0.3, -1, 0, 2, 5]).double()
    w = fit_head(X, y, C, ridge, prior).requires_grad_()
    slack = (1 - y * (X @ w.unsqueeze(-1)).squeeze(-1)).relu()
    J = (ridge * (w - prior) ** 2).sum(-1) / 2 + C * (slack**2).sum(-1)
    (gradient,) = torch.autograd.grad(J.sum(), w)
    assert gradient.abs().max() < 1e-6  # of an objective of about 60


def test_without_violators_the_head_is_the_prior() -> None:
    X = torch.tensor([[[2.0, 1.0], [-3.0, 1.0]]]).double()
    y, one = torch.tensor([1.0, -1.0]).double(), torch.ones(2).double()
    prior = torch.tensor([1.0, 0.0]).double()
    torch.testing.assert_close(fit_head(X, y, one[0], one, prior), prior[None])


@pytest.mark.parametrize("C", [0.05, slow(30.0)])
def test_fit_head_has_the_right_gradient(C: float) -> None:
    generator = torch.Generator().manual_seed(5)
    X = torch.randn((2, 25, 4), generator=generator, dtype=torch.float64)
    y = torch.randn(25, generator=generator, dtype=torch.float64).sign()
    X[:, :, 0] += 2 * y
    ridge = torch.tensor([0.5, 1, 2, 1.5], dtype=torch.float64)
    prior = torch.tensor([0.1, -0.2, 0.5, 0], dtype=torch.float64)
    inputs = [X, torch.tensor(C, dtype=torch.float64), ridge, prior]
    margins = y * (X @ fit_head(X, y, *inputs[1:]).unsqueeze(-1)).squeeze(-1)
    assert (margins - 1).abs().min() > 1e-4  # the hinge has no second derivative at 1
    assert 0 < (margins < 1).sum() < margins.numel()

    def fit(X: Tensor, C: Tensor, ridge: Tensor, prior: Tensor) -> Tensor:
        return fit_head(X, y, C, ridge, prior)

    assert torch.autograd.gradcheck(fit, [t.requires_grad_() for t in inputs])


# --- registration


def smooth_scene(x: Array, y: Array) -> Array:
    """Encoded intensities in [0.1, 0.9]; its period of some 40 px leaves no aliasing."""
    return (
        0.5
        + 0.2 * np.sin(x / 7) * np.cos(y / 6)
        + 0.1 * np.sin(0.11 * x - 0.13 * y)
        + 0.1 * np.cos(0.05 * x + 0.17 * y)
    )


def as_maps(image: Array) -> Tensor:
    return torch.from_numpy(image.astype(np.float32))[None, None]


def motion_left(moved: Array, still: Array) -> float:
    """Largest mean shift in x or y, in pixels, by least squares on the slopes of ``still``."""
    inner = np.s_[8:-8, 8:-8]
    slope_y, slope_x = np.gradient(still)
    columns = np.stack([slope_x[inner].ravel(), slope_y[inner].ravel()], axis=1)
    shift, *_ = np.linalg.lstsq(columns, (still - moved)[inner].ravel())
    return float(np.abs(shift).max())


Y, X = np.mgrid[:192, :256].astype(np.float64)
PHOTOMETRY: dict[str, Callable[[Array], Array]] = {
    "none": lambda i: i,
    "gain": lambda i: 0.9 * i,
    "gain and offset": lambda i: 1.05 * i - 0.03,
    "curve": lambda i: i + 0.1 * i * (1 - i),
}


def aligned(i_o: torch.Tensor, i_e: torch.Tensor) -> torch.Tensor:
    return register(i_o, i_e, *derivatives(i_o)[2:])


def test_derivatives_of_a_polynomial() -> None:
    def f(x: Array, y: Array) -> Array:
        return (2 + x + 3 * y + x * y - x * x + 2 * y * y) / 10_000

    x, y = X[:8, :9], Y[:8, :9]
    found = derivatives(torch.from_numpy(f(x, y))[None, None])
    exact = (1 + y - 2 * x, 3 + x + 4 * y, -2 + 0 * x, 4 + 0 * x)
    for one, other in zip(found, exact, strict=True):
        inner = one[0, 0, 1:-1, 1:-1].numpy()
        np.testing.assert_allclose(1e4 * inner, other[1:-1, 1:-1], rtol=0, atol=FLOAT64)


@pytest.mark.parametrize("photometry", PHOTOMETRY)
@pytest.mark.parametrize("shift", [(0.0, -0.3), (1.0, 0.8)])
def test_registration_removes_a_shift_whatever_the_gain(
    shift: tuple[float, float], photometry: str
) -> None:
    change = PHOTOMETRY[photometry]
    still = change(smooth_scene(X, Y))
    moved = change(smooth_scene(X - shift[0], Y - shift[1]))
    registered = aligned(as_maps(smooth_scene(X, Y)), as_maps(moved))[0, 0].double().numpy()
    assert motion_left(moved, still) > 0.25
    assert motion_left(registered, still) < RESIDUAL_PX


def test_registration_removes_a_zoom_and_a_turn() -> None:
    u, v = X - 128, Y - 96
    still = smooth_scene(X, Y)
    moved = smooth_scene(X - 0.003 * u + 0.002 * v, Y - 0.003 * v - 0.002 * u)
    registered = aligned(as_maps(still), as_maps(moved))[0, 0].double().numpy()
    for part in (np.s_[:96, :128], np.s_[96:, :128], np.s_[:96, 128:], np.s_[96:, 128:]):
        assert motion_left(moved[part], still[part]) > 0.1
        assert motion_left(registered[part], still[part]) < RESIDUAL_PX


@pytest.mark.parametrize("photometry", PHOTOMETRY)
def test_registration_leaves_still_frames_as_they_are(photometry: str) -> None:
    still = smooth_scene(X, Y)
    changed = as_maps(PHOTOMETRY[photometry](still))
    torch.testing.assert_close(aligned(as_maps(still), changed), changed, rtol=0, atol=FLOAT32)


def test_registration_leaves_flat_frames_as_they_are() -> None:
    flat = torch.full((1, 3, 32, 48), 0.5)
    torch.testing.assert_close(aligned(flat, 0.9 * flat), 0.9 * flat, rtol=0, atol=FLOAT32)


def test_a_message_is_not_taken_for_motion(captured: Captured) -> None:
    """Frames whose corners are right: registration may change no bit."""
    pair = captured.rectified()
    plain, registered = (Phi(DecoderConfig(register=on)).decode(pair) for on in (False, True))
    right = [(soft.bits == captured.bits).mean() for soft in (plain, registered)]
    assert right[1] >= right[0] - 2 / 59


def test_registration_saves_the_messages_of_moved_frames(layout: Layout) -> None:
    wrong = np.zeros(2, int)
    for index in range(4):
        captured = FramePair(Source(layout), Cell("nikon-imac", 0.0, 2), index).captured
        moved = replace(captured, corners_embedded=captured.corners_embedded + 0.8).rectified()
        for i, on in enumerate((False, True)):
            bits = Phi(DecoderConfig(register=on)).decode(moved).bits
            wrong[i] += (bits != captured.bits).sum()
    assert wrong[1] < 0.5 * wrong[0]


# --- the whole decoder


def test_phi_is_the_twin_of_oorc(pairs: list[Observation]) -> None:
    for pair in pairs:
        ours, theirs = make_decoder("phi").decode(pair), make_decoder("oorc").decode(pair)
        np.testing.assert_array_equal(ours.bits, theirs.bits)
        np.testing.assert_allclose(ours.scores, theirs.scores, rtol=0, atol=TWIN_SCORE)


@pytest.mark.parametrize("config", EVERY_CONFIG)
def test_three_pairs_at_once_score_as_one_by_one(
    layout: Layout, pairs: list[Observation], config: DecoderConfig
) -> None:
    module = perturbed(PhiDecoder(layout, config))
    with torch.inference_mode():
        scores, heads = module(*batch(pairs[:3]))
        assert scores.shape == (3, layout.n_bits)
        assert heads.shape == (3, module.phi.n_features + 1)
        for k, pair in enumerate(pairs[:3]):
            alone, _ = module(*batch([pair]))
            torch.testing.assert_close(scores[k : k + 1], alone, rtol=0, atol=ONNX_SCORE)


@pytest.mark.parametrize("config", EVERY_CONFIG)
@pytest.mark.parametrize("size", [(733, 555)])
def test_one_module_decodes_frames_of_any_size(
    captured: Captured, config: DecoderConfig, size: tuple[int, int]
) -> None:
    resized = replace(captured.layout, width=size[0], height=size[1])
    pair = replace(captured, layout=resized).rectified()
    usual = decode_with(PhiDecoder(captured.layout, config).eval(), pair)
    made_for_it = decode_with(PhiDecoder(resized, config).eval(), pair)
    np.testing.assert_array_equal(usual.scores, made_for_it.scores)
    full_size = decode_with(PhiDecoder(captured.layout, config).eval(), captured.rectified())
    assert (usual.bits == full_size.bits).mean() > 0.9


def test_the_smallest_frame_still_decodes(layout: Layout) -> None:
    frame = torch.zeros((1, 3, 32, 32), dtype=torch.uint8)
    for config in EVERY_CONFIG:
        scores, _ = PhiDecoder(layout, config).eval()(frame, frame)
        assert torch.isfinite(scores).all()


@pytest.mark.parametrize("level", [0, 255])
def test_flat_frames_give_finite_scores(layout: Layout, level: int) -> None:
    frame = torch.full((1, 3, layout.height, layout.width), level, dtype=torch.uint8)
    for config in EVERY_CONFIG:
        scores, head = PhiDecoder(layout, config).eval()(frame, frame)
        assert torch.isfinite(scores).all()
        assert torch.isfinite(head).all()


@pytest.mark.parametrize("config", [EVERY_CONFIG[1], FULL])
def test_every_learned_parameter_receives_a_gradient(
    layout: Layout, rectified: Observation, config: DecoderConfig
) -> None:
    module = perturbed(PhiDecoder(layout, config))
    scores, _ = module(*batch([rectified]))
    scores.square().mean().backward()
    for name, parameter in module.named_parameters():
        assert parameter.grad is not None, name
        assert torch.isfinite(parameter.grad).all(), name
        assert parameter.grad.abs().sum() > 0, name


@given(st.integers(1, 300), st.integers(1, 40), st.floats(0, 0.45))
def test_bin_mean_integrates_over_every_bin_however_small(
    length: int, count: int, margin: float
) -> None:
    values = np.random.default_rng([length, count]).uniform(0, 1, length)
    total = np.concatenate([[0], np.cumsum(values)])  # its difference quotients are exact means
    start, stop = ((np.arange(count) + m) * length / count for m in (margin, 1 - margin))
    edges = (np.interp(at, np.arange(length + 1), total) for at in (stop, start))
    expected = np.subtract(*edges) / (stop - start)
    like = torch.zeros(0, dtype=torch.float64)
    matrix = bin_mean(length, count, torch.arange(count), margin, like)
    np.testing.assert_allclose(matrix.numpy() @ values, expected, rtol=0, atol=FLOAT64)


@cases((0.0, [1 / 6] * 6), (1 / 6, [0, *[1 / 4] * 4, 0]))
def test_bin_mean_leaves_the_margins_out(margin: float, expected: list[float]) -> None:
    like = torch.zeros(0, dtype=torch.float64)
    matrix = bin_mean(12, 2, torch.tensor([1]), margin, like)
    np.testing.assert_allclose(matrix.numpy(), [[0] * 6 + expected], rtol=0, atol=FLOAT64)


every_intensity = pytest.mark.parametrize("channels", CHANNELS)


def intensities(frames: Array, channels: str) -> Array:
    """Weigh the channels of (B, 3, H, W) frames in [0, 1] as `Reduce` should."""
    return np.asarray(np.einsum("kc,bchw->bkhw", np.array(CHANNELS[channels]), frames))


@every_intensity
@pytest.mark.parametrize("k", [1, 2])
def test_intensities_are_weighted_means_of_pixels(channels: str, k: int) -> None:
    frame = np.random.default_rng(7).integers(0, 256, (2, 3, 6, 8), dtype=np.uint8)
    means = frame.reshape(2, 3, 6 // k, k, 8 // k, k).mean(axis=(3, 5)) / 255
    expected = intensities(means, channels)
    reduce = Reduce(CHANNELS[channels], k)
    np.testing.assert_allclose(reduce(torch.from_numpy(frame)), expected, rtol=0, atol=FLOAT32)
    assert reduce.whole == (channels != "luma")
    assert reduce.weights.min() >= 0  # uint8 in the exported graph
    if reduce.whole:
        exported = exported_sum(torch.from_numpy(frame), reduce.weights.to(torch.uint8), k)
        np.testing.assert_array_equal(exported, (100 * 255 * k * k * expected).round())


@every_intensity
def test_the_refiner_sees_the_change_of_intensity_and_its_moments(channels: str) -> None:
    layout = make_layout(4, 5, 160, 96, 2)
    config = replace(FULL, channels=channels, register=False, texture=0.0, coarsen=1)
    module = PhiDecoder(layout, config)
    rng = np.random.default_rng(8)
    frames = rng.integers(0, 256, (2, 1, 3, 96, 160), dtype=np.uint8)
    _, blocks = module.summarise(*torch.from_numpy(frames))
    i_o, i_e = intensities(frames[:, 0] / 255, channels)
    x = 2 * i_o - 1
    maps = [i_e - i_o, *(legval(x, np.eye(MOMENTS + 1)[k]) for k in range(1, MOMENTS + 1))]
    cells = np.stack(maps).mean(axis=1).reshape(-1, 4, 24, 5, 32).mean(axis=(2, 4))
    expected = cells.reshape(MOMENTS + 1, -1).T[layout.message_mask.reshape(-1)]
    found = module.statistics(blocks)[0, :, : MOMENTS + 1].numpy()
    np.testing.assert_allclose(found, expected, rtol=0, atol=FLOAT32)


# --- checkpoints


@pytest.fixture
def checkpoint(layout: Layout, tmp_path: Path) -> Path:
    decoder = perturbed(PhiDecoder(layout, EVERY_CONFIG[1]))
    save_checkpoint(tmp_path, decoder, decoder.to_config() | {"pair": "canon-lg"})
    return tmp_path


@pytest.mark.parametrize("config", EVERY_CONFIG)
def test_a_checkpoint_restores_bit_identical_scores(
    layout: Layout, rectified: Observation, tmp_path: Path, config: DecoderConfig
) -> None:
    module = perturbed(PhiDecoder(layout, config))
    save_checkpoint(tmp_path, module, module.to_config())
    loaded = load_checkpoint(tmp_path).eval()
    assert (loaded.layout, loaded.config) == (layout, config)
    expected = decode_with(module, rectified)
    np.testing.assert_array_equal(decode_with(loaded, rectified).scores, expected.scores)
    learned = make_decoder("learned", checkpoint=tmp_path).decode(rectified)
    np.testing.assert_array_equal(learned.scores, expected.scores)


def test_a_checkpoint_may_be_loaded_for_another_layout(checkpoint: Path) -> None:
    other = make_layout(6, 10, 500, 300, ratex=3)
    loaded, usual = load_checkpoint(checkpoint, other), load_checkpoint(checkpoint)
    assert loaded.layout == other
    for name, parameter in usual.named_parameters():
        assert torch.equal(loaded.get_parameter(name), parameter)


def test_learned_without_a_named_checkpoint_loads_the_shipped_one(rectified: Observation) -> None:
    shipped = make_decoder("learned", checkpoint=PRETRAINED).decode(rectified)
    assert make_decoder("learned").decode(rectified).scores.tolist() == shipped.scores.tolist()


@pytest.mark.parametrize("name", ["decoder.pt", "config.json"])
def test_a_missing_file_of_a_checkpoint_is_named(checkpoint: Path, name: str) -> None:
    (checkpoint / name).unlink()
    with pytest.raises(InputError, match=rf"{name}: not found; train first: python train.py"):
        load_checkpoint(checkpoint)


def saved(state: Any) -> bytes:
    buffer = io.BytesIO()
    torch.save(state, buffer)
    return buffer.getvalue()


def changed(state: dict[str, Tensor], **changes: Any) -> dict[str, Tensor]:
    return {k: v for k, v in {**state, **changes}.items() if v is not None}


BAD_WEIGHTS: dict[str, Callable[[dict[str, Tensor]], bytes]] = {
    "empty": lambda state: b"",
    "text": lambda state: b"these are words, not weights\n" * 100,
    "no tail": lambda state: saved(state)[:-100],
    "a list": lambda state: saved([1, 2, 3]),
    "code": lambda state: saved({"prior": Path("run me")}),
    "a key too many": lambda state: saved(changed(state, extra=torch.zeros(3))),
    "a key too few": lambda state: saved(changed(state, prior=None)),
    "another shape": lambda state: saved(changed(state, prior=torch.zeros(3))),
    "not a tensor": lambda state: saved(changed(state, prior="none")),
    "nan": lambda state: saved(changed(state, prior=state["prior"] * torch.nan)),
}


@pytest.mark.parametrize("damage", BAD_WEIGHTS)
def test_damaged_weights_are_an_input_error_that_names_the_file(
    checkpoint: Path, damage: str
) -> None:
    module = load_checkpoint(checkpoint)
    weights = BAD_WEIGHTS[damage](module.state_dict())
    (checkpoint / "decoder.pt").write_bytes(weights)
    with pytest.raises(InputError, match=r"decoder\.pt: "):
        load_weights(checkpoint, {"sha256": hashlib.sha256(weights).hexdigest()}, module)


def test_compressed_weights_are_not_unpacked() -> None:
    with zipfile.ZipFile(packed := io.BytesIO(), "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("data.pkl", bytes(1000))
    with pytest.raises(ValueError, match="it is compressed"):
        unpack(packed.getvalue())


CONFIG: dict[str, Any] = PhiDecoder(make_layout(), EVERY_CONFIG[1]).to_config()


def config_with(key: str, **changes: Any) -> bytes:
    return json.dumps({**CONFIG, key: {**CONFIG[key], **changes}}).encode()


BAD_CONFIGS = {
    "empty": b"",
    "a list": b"[]",
    "no decoder": json.dumps({"layout": CONFIG["layout"]}).encode(),
    "no layout": json.dumps({"decoder": CONFIG["decoder"]}).encode(),
    "decoder is a list": json.dumps({**CONFIG, "decoder": [4]}).encode(),
    "unknown key": config_with("decoder", depth=3),
    "unknown channels": config_with("decoder", channels="hsv"),
    "degree out of range": config_with("decoder", degree=40),
    "degree is text": config_with("decoder", degree="6"),
    "rows is text": config_with("layout", rows="8"),
    "no patches": config_with("layout", ratex=[]),
}


@pytest.mark.parametrize("damage", BAD_CONFIGS)
def test_a_damaged_config_is_an_input_error_that_names_the_file(
    checkpoint: Path, damage: str
) -> None:
    (checkpoint / "config.json").write_bytes(BAD_CONFIGS[damage])
    with pytest.raises(InputError, match=r"config\.json: "):
        load_checkpoint(checkpoint)


def test_one_flipped_bit_in_the_weights_is_noticed(checkpoint: Path) -> None:
    data = bytearray((checkpoint / "decoder.pt").read_bytes())
    data[len(data) // 2] ^= 1
    (checkpoint / "decoder.pt").write_bytes(data)
    with pytest.raises(InputError, match=r"decoder\.pt: differs from the sha256"):
        load_checkpoint(checkpoint)
