import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from tolerances import FLOAT64, IDENTITY_LEVELS

from link.images.equalise import equalise, uniform_mapping
from link.types import Image

frames = arrays(np.uint8, st.tuples(st.integers(1, 12), st.integers(1, 12)))


@pytest.fixture(scope="module")
def photo() -> Image:
    """Random, but dark and smooth as photographs are."""
    rng = np.random.default_rng(5)
    coarse = rng.uniform(0, 1, (12, 16, 3)).astype(np.float32)
    smooth = cv2.resize(coarse, (320, 240), interpolation=cv2.INTER_CUBIC).clip(0, 1)
    return np.asarray((255 * smooth**2).round(), np.uint8)


def unevenness(picture: Image) -> float:
    """Largest distance of the cumulative histogram from that of even intensities."""
    shares = np.cumsum(np.bincount(picture.ravel(), minlength=256)) / picture.size
    return float(np.abs(shares - np.arange(1, 257) / 256).max())


def test_the_histogram_becomes_near_uniform(photo: Image) -> None:
    assert unevenness(photo) > 0.2
    assert unevenness(equalise(photo)) < 0.03
    assert equalise(photo).shape == photo.shape
    assert equalise(photo).dtype == np.uint8


@given(frames)
def test_each_intensity_becomes_its_mid_rank(frame: Image) -> None:
    """And so the mapping never falls, tells apart what the frame has, and has mid gray as mean."""
    levels = np.arange(256)[:, None]
    ranks = (frame.ravel() < levels).mean(axis=1) + (frame.ravel() == levels).mean(axis=1) / 2
    np.testing.assert_allclose(uniform_mapping(frame), 255 * ranks, rtol=0, atol=255 * FLOAT64)


def test_equalising_again_changes_next_to_nothing(photo: Image) -> None:
    once = equalise(photo)
    assert np.abs(equalise(once).astype(int) - once).max() <= IDENTITY_LEVELS


def test_a_constant_picture_becomes_mid_gray() -> None:
    for level in (0, 77, 255):
        flat = np.full((6, 8), level, np.uint8)
        assert (equalise(flat) == 128).all()
        np.testing.assert_array_equal(uniform_mapping(flat)[flat], 127.5)


def test_a_tone_curve_between_leaves_no_trace(photo: Image) -> None:
    curve = np.sort(np.random.default_rng(6).permutation(256)[:128]).astype(np.uint8)
    darker = photo // 2  # 128 levels, which the curve spreads unevenly but in order
    np.testing.assert_array_equal(equalise(curve[darker]), equalise(darker))


def test_one_mapping_serves_all_channels(photo: Image) -> None:
    side_by_side = np.concatenate(list(photo.transpose(2, 0, 1)), axis=1)
    np.testing.assert_array_equal(uniform_mapping(photo), uniform_mapping(side_by_side))
