"""The estimators of the comparison with reality, on frames whose noise and CDTF are known."""

from pathlib import Path

import numpy as np
import pytest
from conftest import Command
from tolerances import FLOAT32

from reports.lab import noise, reality

SHAPE = (256, 320)


def ramp() -> np.ndarray:
    """A smooth picture from 10 to 245."""
    return np.linspace(10, 245, SHAPE[1]) * np.ones((SHAPE[0], 1))


@pytest.mark.parametrize("sigma", [0.5, 2.0])
def test_the_noise_is_found_under_drift_and_a_message(sigma: float) -> None:
    rng = np.random.default_rng(0)
    message = 5.0 * np.kron(rng.integers(0, 2, (8, 8)), np.ones((32, 40)))
    original = ramp() + sigma * rng.standard_normal(SHAPE)
    embedded = 1.03 * (ramp() + message) + sigma * rng.standard_normal(SHAPE)
    found = noise.noise_by_level(original, embedded)
    assert set(found) == set(noise.LEVELS)
    assert np.median(list(found.values())) == pytest.approx(sigma, rel=0.1)


def test_noise_that_grows_with_the_level_is_seen_to_grow() -> None:
    rng = np.random.default_rng(0)
    frames = [ramp() + 0.01 * ramp() * rng.standard_normal(SHAPE) for _ in range(2)]
    found = list(noise.noise_by_level(*frames).values())
    assert np.all(np.diff(found) > 0)


def test_levels_without_flat_pixels_are_left_out() -> None:
    dark = np.full(SHAPE, 16.0)
    assert set(noise.noise_by_level(dark, dark)) == {16}


def test_a_cubic_is_found_again_and_not_extrapolated() -> None:
    displayed = ramp()
    x = displayed / 255
    fit = noise.fit_cubic(displayed, 255 * (0.1 + 0.3 * x + 0.9 * x**2 - 0.4 * x**3))
    assert fit.r2 == pytest.approx(1.0, abs=1e-3)
    at = fit(np.array([0.0, 100.0, 255.0]))
    x100 = 100 / 255
    expected = 255 * (0.1 + 0.3 * x100 + 0.9 * x100**2 - 0.4 * x100**3)
    assert at[1] == pytest.approx(expected, abs=0.5)
    assert np.isnan(at[0]) and np.isnan(at[2])


def test_the_ripple_is_that_of_flat_parts_without_their_shading() -> None:
    flat = np.full(SHAPE, 128.0)
    busy = flat.copy()
    busy[:, 64:] += 50 * np.random.default_rng(0).standard_normal((SHAPE[0], SHAPE[1] - 64))
    wave = 3.0 * np.sqrt(2) * np.sin(2 * np.pi * np.arange(SHAPE[1]) / 8)
    shading = np.linspace(0, 40, SHAPE[0])[:, None]
    assert noise.ripple(busy, busy + wave + shading) == pytest.approx(3.0, rel=0.02)


def test_the_high_pass_is_undone_exactly() -> None:
    white = np.random.default_rng(0).standard_normal((600, 600))
    left = white - noise._blur(white, noise.HIGH_PASS_PX)
    assert left.std() == pytest.approx(noise.passed_share(noise.HIGH_PASS_PX), rel=0.01)


def test_a_uniform_histogram_gives_the_quantiles() -> None:
    captured = 255 * np.linspace(0, 1, 100_000) ** 2
    curve = reality.cdtf_of_histogram(captured)
    np.testing.assert_allclose(curve / 255, (reality.RHO / 255) ** 2, atol=FLOAT32)


def test_missing_data_is_one_line(tmp_path: Path, command: Command) -> None:
    done = command(reality.main, "--data", tmp_path / "none", "--out", tmp_path / "page.md")
    assert done.status == 2
    assert done.stderr.splitlines() == [f"error: --data: {tmp_path / 'none'} is not a folder"]
    done = command(reality.main, "--data", tmp_path, "--out", tmp_path / "page.md")
    assert done.status == 2 and len(done.stderr.splitlines()) == 1
