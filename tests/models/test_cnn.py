import json
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
import torch
from conftest import cases

from link.errors import InputError
from link.frames import Captured, Rectified
from link.layout import make_layout
from models import PRETRAINED_CNN, make_decoder
from models.neural.checkpoint import save_checkpoint
from models.neural.cnn import BlockNet, Cnn, CnnConfig, load_cnn

LAYOUT = make_layout(4, 4, 192, 144, 2)
SMALL = CnnConfig(width=16, rounds=1)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    torch.manual_seed(0)
    save_checkpoint(tmp_path, BlockNet(SMALL), {})
    return tmp_path


def noise(*shape: int) -> torch.Tensor:
    return torch.randint(256, shape, generator=torch.Generator().manual_seed(0), dtype=torch.uint8)


def parameters(module: BlockNet) -> dict[str, list[float]]:
    return {name: value.flatten().tolist() for name, value in module.state_dict().items()}


# The network


@cases((8, 8, 512, 384), (3, 7, 333, 101), (1, 1, 40, 40), (6, 4, 16, 24))
def test_one_network_reads_any_grid_and_size(rows: int, cols: int, width: int, height: int) -> None:
    module = load_cnn(PRETRAINED_CNN)
    frames = noise(2, 3, height, width), noise(2, 3, height, width)
    logits = module(*frames, rows, cols)
    assert logits.shape == (2, rows, cols)
    assert torch.isfinite(logits).all()


def test_black_frames_without_any_change_give_finite_scores() -> None:
    black = torch.zeros(1, 3, 96, 128)
    assert torch.isfinite(load_cnn(PRETRAINED_CNN)(black, black, 2, 2)).all()


def test_the_gradient_reaches_every_parameter() -> None:
    module = BlockNet(CnnConfig())
    module(noise(2, 3, 96, 128), noise(2, 3, 96, 128).flip(0), 2, 2).square().sum().backward()
    for name, parameter in module.named_parameters():
        assert parameter.grad is not None, name
        assert parameter.grad.abs().max() > 0, name


def test_the_network_is_small() -> None:
    assert sum(p.numel() for p in BlockNet(CnnConfig()).parameters()) <= 300_000


@cases(("width", 12), ("width", 0), ("rounds", 1.5))
def test_a_config_that_makes_no_network_is_refused(field: str, value: float) -> None:
    with pytest.raises(InputError, match=f"^{field}: need a"):
        CnnConfig(**{**asdict(SMALL), field: value})


# The method


def test_the_shipped_network_decodes(rectified: Rectified, captured: Captured) -> None:
    soft = make_decoder("cnn").decode(rectified)
    assert soft.scores.shape == (59,)
    assert np.mean(soft.bits == captured.bits) > 0.9
    assert soft.scores.tolist() == make_decoder("cnn").decode(rectified).scores.tolist()


def test_gray_frames_are_read_as_colour_ones(rectified: Rectified) -> None:
    gray = replace(
        rectified, original=rectified.original[..., 1], embedded=rectified.embedded[..., 1]
    )
    colour = replace(
        gray, original=np.stack(3 * [gray.original], -1), embedded=np.stack(3 * [gray.embedded], -1)
    )
    assert Cnn().decode(gray).scores.tolist() == Cnn().decode(colour).scores.tolist()


def test_no_patches_are_needed(rectified: Rectified) -> None:
    bare = replace(rectified, layout=replace(rectified.layout, ratex=()))
    scores = Cnn().decode(bare).scores.reshape(8, 8)
    assert scores[rectified.layout.message_mask].tolist() == Cnn().decode(rectified).scores.tolist()


# Checkpoints


def test_a_checkpoint_returns_the_same_network(folder: Path) -> None:
    torch.manual_seed(0)
    saved = BlockNet(SMALL)
    assert parameters(load_cnn(folder)) == parameters(saved)
    assert load_cnn(folder).config == SMALL


def damage_weights(folder: Path) -> None:
    data = (folder / "decoder.pt").read_bytes()
    (folder / "decoder.pt").write_bytes(data[:-100])


def other_width(folder: Path) -> None:
    config = json.loads((folder / "config.json").read_text())
    config["cnn"]["width"] = 24
    (folder / "config.json").write_text(json.dumps(config))


def not_finite(folder: Path) -> None:
    module = BlockNet(SMALL)
    torch.nn.init.constant_(module.read.bias, float("nan"))
    save_checkpoint(folder, module, {})


@cases(
    (damage_weights, "decoder.pt: differs from the sha256"),
    (other_width, "decoder.pt: does not fit config.json"),
    (not_finite, "not finite"),
    (
        lambda folder: (folder / "decoder.pt").unlink(),
        "not found; train first: python -m reports.lab.cnn_baseline at the tag",
    ),
    (lambda folder: (folder / "config.json").write_text("{"), "not a decoder configuration"),
    (
        lambda folder: (folder / "config.json").write_text('{"sha256": "", "cnn": {"w": 1}}'),
        "not a network's configuration",
    ),
)
def test_a_damaged_checkpoint_is_refused(
    damage: Callable[[Path], object], message: str, folder: Path
) -> None:
    damage(folder)
    with pytest.raises(InputError, match=message):
        load_cnn(folder)
