"""Waves in the residuals of blocks, and what the decoder on pilots gains by them."""

import cv2
import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from tolerances import FLOAT32
from torch import Tensor
from torch.nn.functional import conv2d, conv_transpose2d, pad

from link.embed import embed
from link.layout import make_layout
from link.observation import Observation
from link.types import Array
from models import PRETRAINED_PILOTS
from models.phi.checkpoint import load_checkpoint
from models.phi.methods import decode_with
from models.phi.refine_pilots import PilotRefiner
from models.phi.ripple import WINDOW, Ripple

SHAPES = [(16, 16), (24, 32), (19, 45)]
on_shapes = pytest.mark.parametrize("shape", SHAPES, ids=str)


def noise_of(shape: tuple[int, int], seed: int = 0) -> Tensor:
    return torch.randn((1, 1, *shape), generator=torch.Generator().manual_seed(seed))


def wave_of(shape: tuple[int, int], amplitude: float) -> Tensor:
    """A wave that perspective bends."""
    y, x = torch.meshgrid(*(torch.arange(float(n)) for n in shape), indexing="ij")
    return amplitude * torch.cos(1.1 * x + 0.003 * x * x - 0.8 * y)[None, None]


@on_shapes
def test_all_waves_together_are_the_residual(shape: tuple[int, int]) -> None:
    """Tapered windows and the waves in them take nothing away and add nothing."""
    ripple, step = Ripple(*shape), WINDOW // 2
    below, beside = (-n % step for n in shape)
    whole = noise_of(shape)
    spectrum = conv2d(
        pad(whole, (step, step + beside, step, step + below)), ripple.waves(), None, step
    )
    again = conv_transpose2d(spectrum, ripple.waves(), stride=step)
    kept = again[:, :, step : step + shape[0], step : step + shape[1]]
    torch.testing.assert_close(kept, whole, rtol=0, atol=FLOAT32)


def test_a_wave_alone_lies_in_few_frequencies() -> None:
    """Against numpy's discrete Fourier transform of one window."""
    ripple = Ripple(16, 16)
    window = noise_of((16, 16), 3)
    taper = np.outer(*2 * [np.sin(np.pi * (np.arange(16) + 0.5) / 16)])
    power = np.abs(np.fft.fft2(window[0, 0].numpy() * taper)) ** 2 / WINDOW**2
    spectrum = conv2d(window, ripple.waves()).reshape(-1, 2)
    mine = (spectrum**2).sum(1) / ripple.freedoms[:, 0]
    np.testing.assert_allclose(np.sort(mine), np.sort(unique_half(power)), rtol=1e-3, atol=1e-6)


def unique_half(power: Array) -> Array:
    """One of each pair of a frequency and its negative."""
    half = WINDOW // 2
    return np.array(
        [
            power[down, along]
            for down in range(WINDOW)
            for along in range(half + 1)
            if not (along in (0, half) and down > half)
        ]
    )


@on_shapes
def test_a_bent_wave_is_found_in_noise(shape: tuple[int, int]) -> None:
    wave = wave_of(shape, 2.0)
    left = wave - Ripple(*shape)(wave + noise_of(shape))
    assert left.std() < 0.6 * wave.std()


@on_shapes
def test_noise_has_no_waves(shape: tuple[int, int]) -> None:
    noise = noise_of(shape)
    found = Ripple(*shape)(noise)
    assert found.std() < 0.3
    assert abs((found * noise).mean()) < 0.05  # nothing of a block's own residual


def test_a_block_does_not_explain_itself() -> None:
    """Where the gains do not change, its estimate does not depend on its own residual."""
    ripple, wave = Ripple(32, 32), wave_of((32, 32), 2.0)
    with torch.no_grad():
        before = ripple(wave)
        for row, col in ((0, 0), (7, 20), (16, 16), (31, 5)):
            moved = wave.clone()
            moved[0, 0, row, col] -= 0.1 * wave[0, 0, row, col].sign()
            change = (ripple(moved) - before)[0, 0]
            assert change[row, col].abs() < 0.005
            assert change.abs().max() > 0.0005  # its neighbours do depend on it


def test_no_change_at_all_stays_finite() -> None:
    assert Ripple(24, 32)(torch.zeros(2, 1, 24, 32)).abs().max() == 0


def test_coarse_grids_have_no_room_for_it() -> None:
    assert not Ripple.fits(8, 8)
    assert Ripple.fits(24, 32)
    decoder = load_checkpoint(PRETRAINED_PILOTS)
    assert decoder.layout.rows == 8
    assert isinstance(decoder.refiner, PilotRefiner)
    assert decoder.refiner.ripple is None


def moire_pair() -> tuple[Observation, NDArray[np.intp]]:
    """A cloudy picture, with noise, and a wave in its embedded frame that perspective bends."""
    rng = np.random.default_rng(0)
    layout = make_layout(48, 64, modulation="antipodal", pilots="auto")
    grain = rng.normal(128, 30, (layout.height // 16, layout.width // 16, 3))
    picture = cv2.resize(grain, (layout.width, layout.height)).clip(30, 220).astype(np.uint8)
    bits = rng.integers(0, 2, layout.n_bits)
    shown = embed(picture, bits, layout, 3)
    wave = wave_of((layout.height // 4, layout.width // 4), 4.0)[0, 0].numpy()
    moire = cv2.resize(wave, (layout.width, layout.height))[..., None]
    frames = [
        (frame + more + rng.normal(0, 4, frame.shape)).round().clip(0, 255).astype(np.uint8)
        for frame, more in ((shown.original, 0.0), (shown.embedded, moire))
    ]
    return Observation.still(frames[0], frames[1], layout, 3), bits


def test_moire_that_moves_is_read_through() -> None:
    pair, bits = moire_pair()
    decoder = load_checkpoint(PRETRAINED_PILOTS, pair.layout)
    without = load_checkpoint(PRETRAINED_PILOTS, pair.layout)
    assert isinstance(without.refiner, PilotRefiner)
    without.refiner.ripple = None
    assert (decode_with(without, pair).bits != bits).sum() > 100
    assert (decode_with(decoder, pair).bits == bits).all()
