import re
from pathlib import Path

import numpy as np
import pytest
import torch
from tolerances import AUGMENT_LEVELS

import data_gen.augment
from data_gen.augment import augment
from data_gen.frame_pair import Source, shuffled_pictures
from link.layout import make_layout

SMALL = make_layout(4, 4, 256, 192, 2)
SIGMAS = ("CORNER_PX", "SHIFT_PX", "TURN", "GAMMA", "GAIN_DRIFT", "PIXEL_NOISE")


@pytest.fixture(scope="module")
def frames() -> tuple[torch.Tensor, torch.Tensor]:
    """A picture with detail, and the same 4 levels brighter."""
    picture = shuffled_pictures(Source(SMALL, "train"))[0].rgb
    batch = torch.from_numpy(np.stack([picture, picture])).permute(0, 3, 1, 2).clamp(0, 250)
    return batch, batch + 4


def quiet(monkeypatch: pytest.MonkeyPatch, *but: str) -> None:
    for name in SIGMAS:
        if name not in but:
            monkeypatch.setattr(data_gen.augment, name, 0.0)


def generator(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def test_these_are_all_the_sigmas_of_the_module() -> None:
    names = re.findall(r"^([A-Z_]+) = ", Path(data_gen.augment.__file__).read_text(), re.MULTILINE)
    assert tuple(names) == SIGMAS


def test_augmented_frames_keep_shape_and_range(frames: tuple[torch.Tensor, torch.Tensor]) -> None:
    for frame in augment(*frames, generator()):
        assert frame.shape == frames[0].shape
        assert frame.dtype == torch.float32
        assert frame.min() >= 0
        assert frame.max() <= 255


def test_augmentation_is_reproduced_by_its_generator_alone(
    frames: tuple[torch.Tensor, torch.Tensor],
) -> None:
    state = torch.get_rng_state()
    first, again, other = (augment(*frames, generator(seed)) for seed in (1, 1, 2))
    assert torch.equal(first[0], again[0])
    assert torch.equal(first[1], again[1])
    assert not torch.equal(first[0], other[0])
    assert torch.equal(torch.get_rng_state(), state)


def test_augmentation_without_randomness_is_the_identity(
    frames: tuple[torch.Tensor, torch.Tensor], monkeypatch: pytest.MonkeyPatch
) -> None:
    quiet(monkeypatch)
    for before, after in zip(frames, augment(*frames, generator()), strict=True):
        torch.testing.assert_close(after, before.float(), atol=AUGMENT_LEVELS, rtol=0)


def test_each_frame_of_a_batch_has_its_own_draw(frames: tuple[torch.Tensor, torch.Tensor]) -> None:
    original, _ = augment(*frames, generator())
    assert torch.equal(frames[0][0], frames[0][1])
    assert (original[0] - original[1]).abs().mean() > 1


@pytest.mark.parametrize("name", ["CORNER_PX", "GAMMA"])
def test_corners_and_gamma_are_common_to_both_frames(
    name: str, frames: tuple[torch.Tensor, torch.Tensor], monkeypatch: pytest.MonkeyPatch
) -> None:
    quiet(monkeypatch, name)
    original, embedded = augment(frames[0], frames[0], generator())
    torch.testing.assert_close(original, embedded, atol=AUGMENT_LEVELS, rtol=0)
    assert (original - frames[0]).abs().mean() > 0.5


@pytest.mark.parametrize("name", ["SHIFT_PX", "GAIN_DRIFT"])
def test_motion_and_drift_touch_the_embedded_frame_alone(
    name: str, frames: tuple[torch.Tensor, torch.Tensor], monkeypatch: pytest.MonkeyPatch
) -> None:
    quiet(monkeypatch, name)
    original, embedded = augment(*frames, generator())
    torch.testing.assert_close(original, frames[0].float(), atol=AUGMENT_LEVELS, rtol=0)
    assert (embedded - frames[1]).abs().mean() > 0.1


def test_noise_has_its_sigma(monkeypatch: pytest.MonkeyPatch) -> None:
    quiet(monkeypatch, "PIXEL_NOISE")
    gray = torch.full((1, 3, 192, 256), 128, dtype=torch.uint8)
    original, embedded = augment(gray, gray, generator())
    for frame in (original, embedded):
        assert abs(frame.std().item() - data_gen.augment.PIXEL_NOISE) < 0.02
    assert (original - embedded).std() > 1.3  # independent between the frames
