from collections.abc import Callable
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest
from conftest import cases
from numpy.typing import NDArray
from tolerances import FLOAT32, FLOAT64

from link.embed import embed
from link.errors import InputError, UnsuitedError
from link.images import intensity
from link.images.equalise import equalise
from link.layout import MODULATIONS, Layout, make_layout
from link.observation import Observation
from link.ratex import training_pixels
from link.types import Array
from models import DECODERS, make_decoder
from models.paper.common import fit_svm, training_samples
from models.paper.hidden_ratex import HiddenRatex, cluster_threshold
from models.paper.oorc import explicit_map, legendre
from models.paper.two_step import fit_inverse_response

KAPPA = 8
SHRINKAGE = HiddenRatex().shrinkage
WITH_RATEX = ["naive", "two_step", "oorc"]
CLASSICAL = [*WITH_RATEX, "hidden_ratex"]
Curve = Callable[[Array], Array]


def bright(i: Array) -> Array:
    """A CDTF that raises dark tones, so that the same kappa is captured as 4 to 20 levels."""
    return np.asarray(i**0.6)


def make_pair(
    cdtf: Curve = bright,
    gain: float = 1.0,
    *,
    hidden: bool = False,
    colour: bool = False,
    layout: Layout | None = None,
) -> tuple[Observation, NDArray[np.intp]]:
    """A noise-free capture of a smooth picture, and the message in it.

    Args:
        cdtf: displayed to captured intensity, both in [0, 1].
        gain: of the embedded frame against the original.
        hidden: equalised, and without ratex patches.
        colour: (H, W, 3) in place of (H, W).
        layout: in place of the usual one.
    """
    layout = layout or make_layout(ratex=0 if hidden else 5)
    rng = np.random.default_rng(4)
    coarse = rng.uniform(0, 255, (7, 9, 3) if colour else (7, 9)).astype(np.float32)
    picture = cv2.resize(coarse, (layout.width, layout.height), interpolation=cv2.INTER_LINEAR)
    picture = picture.round().astype(np.uint8)
    bits = rng.integers(0, 2, layout.n_bits)
    shown = embed(equalise(picture) if hidden else picture, bits, layout, KAPPA)
    frames = [
        np.asarray((255 * g * cdtf(frame / 255)).round().clip(0, 255), np.uint8)
        for frame, g in ((shown.original, 1.0), (shown.embedded, gain))
    ]
    return Observation.still(frames[0], frames[1], layout, KAPPA), bits


def errors(name: str, pair: Observation, bits: NDArray[np.intp], **options: Any) -> int:
    return int((make_decoder(name, **options).decode(pair).bits != bits).sum())


@pytest.mark.parametrize("name", CLASSICAL)
@pytest.mark.parametrize("colour", [False, True], ids=["gray", "colour"])
def test_every_method_reads_a_noise_free_pair_through_a_curved_cdtf(
    name: str, colour: bool
) -> None:
    pair, bits = make_pair(hidden=name == "hidden_ratex", colour=colour)
    assert errors(name, pair, bits) == 0


# Pilots and antipodal blocks

both_modulations = pytest.mark.parametrize("modulation", MODULATIONS)


def differs(pair: Observation, scores: Array, name: str, **options: Any) -> bool:
    return not np.array_equal(make_decoder(name, **options).decode(pair).scores, scores)


@both_modulations
@pytest.mark.parametrize("name", ["naive", "oorc"])
@pytest.mark.parametrize("grid", [(8, 8, 16), (24, 32, 38)])
def test_methods_that_learn_from_pilots_read_the_noise_free_pair(
    name: str, grid: tuple[int, int, int], modulation: str
) -> None:
    rows, cols, pilots = grid
    layout = make_layout(rows, cols, modulation=modulation, pilots=pilots)
    pair, bits = make_pair(layout=layout)
    assert errors(name, pair, bits) == 0


@both_modulations
@pytest.mark.parametrize("name", ["naive", "oorc"])
def test_pilots_need_no_kappa_and_their_places_and_bits_decide(name: str, modulation: str) -> None:
    pair, bits = make_pair(layout=make_layout(modulation=modulation, pilots=16))
    scores = make_decoder(name).decode(pair).scores
    for kappa in (None, 3):
        assert not differs(replace(pair, kappa=kappa), scores, name)
    fewer = replace(pair, layout=replace(pair.layout, pilots=8))
    assert differs(fewer, scores, name)
    swapped = replace(pair, frames=pair.frames[::-1])
    known = make_decoder(name).decode(swapped).bits  # the pilots tell which way bits change
    np.testing.assert_array_equal(known, bits)


@both_modulations
@pytest.mark.parametrize("name", WITH_RATEX)
def test_methods_read_antipodal_pairs_by_their_patches(name: str, modulation: str) -> None:
    pair, bits = make_pair(layout=make_layout(modulation=modulation), colour=True)
    assert errors(name, pair, bits) == 0


@both_modulations
def test_two_step_finds_what_the_display_showed_in_either_modulation(modulation: str) -> None:
    pair, _ = make_pair(lambda i: i, layout=make_layout(modulation=modulation))
    g = fit_inverse_response(pair, training_pixels(pair.layout, KAPPA), degree=4)
    i = np.linspace(0, 1, 50)
    np.testing.assert_allclose(g(i), 255 * i, rtol=0, atol=255 * FLOAT32)


def test_two_step_needs_patches_and_pilots_are_none() -> None:
    pair, _ = make_pair(layout=make_layout(pilots=16))
    with pytest.raises(UnsuitedError, match="trains on ratex patches and the layout has none"):
        make_decoder("two_step").decode(pair)


@pytest.mark.parametrize("threshold", ["clusters", "constant"])
@pytest.mark.parametrize("pilots", [0, 16])
def test_hidden_ratex_reads_antipodal_pairs(threshold: str, pilots: int) -> None:
    layout = make_layout(ratex=0, modulation="antipodal", pilots=pilots)
    pair, bits = make_pair(hidden=True, layout=layout)
    assert errors("hidden_ratex", pair, bits, threshold=threshold) == 0


@both_modulations
def test_training_samples_are_the_pixels_of_the_pilots(modulation: str) -> None:
    layout = make_layout(3, 5, 53, 47, modulation=modulation, pilots=6)
    pair = Observation.still(*np.zeros((2, 47, 53), np.uint8), layout)
    maps = np.random.default_rng(0).normal(size=(47, 53, 2))
    u, labels = training_samples(pair, maps)
    means = []
    for block in layout.pilot_blocks:
        top, bottom, left, right = layout.cell_box(*divmod(int(block), 5))
        means.append(maps[top:bottom, left:right].mean(axis=(0, 1)))
    np.testing.assert_allclose(u, means, rtol=0, atol=FLOAT64)
    np.testing.assert_array_equal(labels, layout.pilot_bits)


def step_pair(changes: NDArray[np.intp]) -> Observation:
    """Linear capture of gray 100 whose message blocks change by these gray levels, noise-free."""
    layout = make_layout()
    picture = np.full((layout.height, layout.width), 100, np.uint8)
    shown = embed(picture, np.zeros(layout.n_bits), layout, KAPPA)
    grid = np.zeros((layout.rows, layout.cols), int)
    grid[layout.message_mask] = changes
    of_pixel = np.kron(grid, np.ones((48, 64), int))
    embedded = (shown.embedded + of_pixel).astype(np.uint8)
    return Observation.still(shown.original, embedded, layout, KAPPA)


CHANGES = np.arange(59) % 10 - 1  # -1 to 8 gray levels


@pytest.mark.parametrize("threshold", [0.5, 2.0, 2.5, -0.5])
def test_naive_with_a_fixed_threshold_scores_the_distance_from_it(threshold: float) -> None:
    soft = make_decoder("naive", threshold=threshold).decode(step_pair(CHANGES))
    np.testing.assert_allclose(255 * soft.scores, CHANGES - threshold, atol=255 * FLOAT32)


@pytest.mark.parametrize("levels", [2.5, -0.5])
def test_two_step_counts_a_fixed_threshold_in_displayed_levels(levels: float) -> None:
    soft = make_decoder("two_step", threshold=levels).decode(step_pair(CHANGES))
    np.testing.assert_allclose(soft.scores, CHANGES - levels, atol=255 * FLOAT32)


def test_two_step_undoes_the_cdtf_before_its_fixed_threshold() -> None:
    pair = step_pair(CHANGES)
    dimmed = replace(pair, frames=(pair.original // 2, pair.embedded // 2))
    soft = make_decoder("two_step", threshold=2.5).decode(dimmed)
    assert np.abs(soft.scores - (CHANGES - 2.5)).max() < 1.1  # halves are rounded down


def test_the_paper_threshold_reads_hidden_ratex_through_a_linear_cdtf() -> None:
    pair, bits = make_pair(lambda i: i, hidden=True)
    assert errors("hidden_ratex", pair, bits, threshold="constant") == 0


@pytest.mark.parametrize("name", ["naive", "two_step"])
def test_gain_drift_breaks_the_thresholds_and_oorc_withstands_it(name: str) -> None:
    pair, bits = make_pair(lambda i: 0.9 * bright(i), gain=0.93)
    assert errors(name, pair, bits) > 5
    assert errors("oorc", pair, bits) == 0


def test_clusters_follow_the_offset_that_gain_drift_makes() -> None:
    pair, bits = make_pair(lambda i: 0.9 * bright(i), gain=1.03, hidden=True)
    assert errors("hidden_ratex", pair, bits, threshold="constant") > 5
    assert errors("hidden_ratex", pair, bits, threshold="clusters") == 0


def test_intensity_of_a_colour_frame_is_its_luma() -> None:
    colours = np.array([[[255, 0, 0], [0, 255, 0], [0, 0, 255], [255, 255, 255]]], np.uint8)
    np.testing.assert_allclose(intensity(colours), [[0.299, 0.587, 0.114, 1]], atol=FLOAT32)
    np.testing.assert_array_equal(intensity(np.array([[0, 255]], np.uint8)), [[0, 1]])


def random_pixels(count: int, seed: int) -> Array:
    """(count, 2) columns i_o, i_e."""
    i_o = np.random.default_rng(seed).uniform(0.1, 0.9, count)
    return np.column_stack([i_o, i_o + np.random.default_rng(seed + 1).normal(0, 0.05, count)])


@pytest.mark.parametrize("degree", [1, 4, 7])
def test_legendre_agrees_with_numpy(degree: int) -> None:
    i = np.linspace(0, 1, 101)
    expected = np.polynomial.legendre.legvander(2 * i - 1, degree)[:, 1:]
    np.testing.assert_allclose(legendre(i, degree), expected, rtol=0, atol=FLOAT64)


def test_explicit_map_spans_the_papers_differences_of_powers() -> None:
    i_o, i_e = random_pixels(100, 2).T
    powers = np.column_stack([i_o**k - i_e**k for k in (4, 3, 2, 1)])
    solution, residual, rank, _ = np.linalg.lstsq(powers, explicit_map(i_o, i_e))
    assert rank == 4
    assert (residual < FLOAT64).all()
    assert abs(np.linalg.det(solution)) > 1  # and so each basis expresses the other


@pytest.mark.parametrize("gamma", [0.5, 1.0, 1.6])
def test_oorc_finds_an_increasing_inverse_of_a_gamma_cdtf(gamma: float) -> None:
    pair, _ = make_pair(lambda i: i**gamma)
    soft = make_decoder("oorc").decode(pair)
    assert soft.head is not None
    displayed = np.linspace(0.05, 0.95, 100)
    g = legendre(displayed**gamma, degree=4) @ -soft.head[:-1]
    assert (np.diff(g) > 0).all()
    assert np.corrcoef(g, displayed)[0, 1] > 0.98


def test_the_head_scores_as_the_decoder_does() -> None:
    pair, _ = make_pair()
    soft = make_decoder("oorc").decode(pair)
    assert soft.head is not None
    u = explicit_map(intensity(pair.original), intensity(pair.embedded))
    pixels = u @ soft.head[:-1] + soft.head[-1]
    of_blocks = pixels.reshape(8, 48, 8, 64).mean(axis=(1, 3))[pair.layout.message_mask]
    np.testing.assert_allclose(soft.scores, of_blocks, rtol=0, atol=FLOAT32)


def test_svm_of_two_points_has_the_exact_answer() -> None:
    """w.x + b with x = -1, 1 and labels 0, 1: minimise w^2 / 2 + 2 C (1 - w)^2, hence 4C/(1+4C)."""
    for C in (0.25, 1.0, 100.0):
        head = fit_svm(np.array([[-1.0], [1.0]]), np.array([0, 1]), C)
        assert head[0] == pytest.approx(4 * C / (1 + 4 * C), abs=FLOAT32)
        assert head[1] == pytest.approx(0, abs=FLOAT32)


def test_svm_weights_are_for_features_as_they_are() -> None:
    u, labels = random_pixels(80, 4), np.arange(80) % 2
    plain, scaled = fit_svm(u, labels, 1.0), fit_svm(u * [1e-3, 1e3], labels, 1.0)
    np.testing.assert_allclose(u @ plain[:-1], u * [1e-3, 1e3] @ scaled[:-1], atol=1e-4)


@pytest.mark.parametrize("ones", [2, 10, 30, 50, 57])
@pytest.mark.parametrize("spread", [(0.3, 0.3), (0.1, 1.0), (1.0, 0.1)])
def test_the_cut_lies_between_two_clusters_however_uneven(
    ones: int, spread: tuple[float, float]
) -> None:
    rng = np.random.default_rng(ones)
    low = rng.uniform(-1, 1, 59 - ones) * spread[0]
    high = 5 + rng.uniform(-1, 1, ones) * spread[1]
    for offset in (0.0, -20.0, 7.0):
        differences = offset + rng.permutation(np.concatenate([low, high]))
        cut = cluster_threshold(differences, SHRINKAGE)
        assert offset + low.max() < cut < offset + high.min()


def test_the_cut_lies_nearer_to_the_narrow_cluster_where_they_touch() -> None:
    rng = np.random.default_rng(8)
    differences = np.concatenate([rng.normal(0, 0.3, 500), rng.normal(4, 1.5, 500)])
    assert 0.6 < cluster_threshold(differences, SHRINKAGE) < 1.6


def test_the_cut_scales_with_the_differences() -> None:
    differences = np.random.default_rng(9).normal(0, 1, 59) + np.repeat([0, 6], [30, 29])
    cut = cluster_threshold(differences, SHRINKAGE)
    assert cluster_threshold(3 * differences, SHRINKAGE) == pytest.approx(3 * cut, abs=FLOAT64)


@pytest.mark.parametrize("count", [1, 2, 3, 4, 59])
def test_the_cut_of_equal_differences_is_their_value(count: int) -> None:
    assert cluster_threshold(np.full(count, 2.5), SHRINKAGE) == pytest.approx(2.5, abs=FLOAT64)


def test_unknown_names_list_the_valid_ones() -> None:
    pair, _ = make_pair()
    with pytest.raises(InputError) as error:
        make_decoder("ooorc")
    assert all(name in str(error.value) for name in ("'ooorc'", *DECODERS))
    with pytest.raises(InputError, match=r"unknown threshold 'otsu'.*clusters, constant"):
        make_decoder("hidden_ratex", threshold="otsu").decode(pair)


@pytest.mark.parametrize("name", [*WITH_RATEX, "phi"])
def test_methods_that_train_on_patches_refuse_a_layout_without(name: str) -> None:
    pair, _ = make_pair(hidden=True)
    assert not DECODERS[name].equalised
    with pytest.raises(InputError, match=r"ratex patches.*layout has none"):
        make_decoder(name).decode(pair)


@cases(("two_step", {}), ("hidden_ratex", {"threshold": "constant"}))
def test_methods_that_need_kappa_say_so(name: str, options: dict[str, str]) -> None:
    pair, _ = make_pair()
    with pytest.raises(InputError, match="needs kappa"):
        make_decoder(name, **options).decode(replace(pair, kappa=None))


@pytest.mark.parametrize("name", ["naive", "oorc", "hidden_ratex"])
def test_the_other_methods_do_not_use_kappa(name: str) -> None:
    pair, _ = make_pair(hidden=name == "hidden_ratex")
    decoder = make_decoder(name)
    without = decoder.decode(replace(pair, kappa=None)).scores
    np.testing.assert_array_equal(decoder.decode(pair).scores, without)


@cases(
    make_layout(16, 16, 512, 512),
    make_layout(5, 9, 333, 250, ratex=2),
    make_layout(ratex=1),
    ids=["16x16", "5x9", "one patch"],
)
def test_oorc_reads_other_grids(layout: Layout) -> None:
    rng = np.random.default_rng(10)
    picture = rng.integers(60, 200, (layout.height, layout.width), np.uint8)
    bits = rng.integers(0, 2, layout.n_bits)
    shown = embed(cv2.GaussianBlur(picture, (0, 0), 4), bits, layout, KAPPA)
    pair = Observation.still(shown.original, shown.embedded, layout)
    np.testing.assert_array_equal(make_decoder("oorc").decode(pair).bits, bits)
