"""A calibration-free baseline: one convolutional network from frame pair to bits, as LightNet does.

DeepLight's LightNet (Tran et al. 2021) and Light Field Messaging's decoder (Wengrowski and Dana
2019) learn one mapping for all cameras and displays. So does this one: nothing is fitted to a frame
pair, and ratex patches are picture like all else.
"""

from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import ClassVar

import torch
from torch import Tensor, nn
from torch.nn.functional import adaptive_avg_pool2d, avg_pool2d, silu

from link.errors import InputError
from link.frames import Rectified, SoftBits
from link.images import as_batch
from models.neural.checkpoint import load_weights, read_config

PRETRAINED = Path(__file__).parent / "pretrained_cnn"
CELLS_Y, CELLS_X = 12, 16
"""Cells per block to which frames are averaged; the stages below shrink both fourfold."""
CONTRAST = 20.0
"""The frames differ by a few gray levels of 255: of the order of 1 once multiplied."""
GROUP = 8
"""Channels normalised together, over the whole frame."""


@dataclass(frozen=True)
class CnnConfig:
    """What defines the network; saved as config.json beside the weights."""

    width: int = 32
    """Channels of the first stage; the later ones have twice as many."""
    rounds: int = 3
    """Of context and convolution among the blocks."""

    def __post_init__(self) -> None:
        for field, value in asdict(self).items():
            if type(value) is not int or not 1 <= value <= 128:
                raise InputError(f"--cnn.{field}: a whole number, 1 to 128")
        if self.width % GROUP:
            raise InputError(f"--cnn.width: a multiple of {GROUP}")


class Residual(nn.Module):
    """Normalise, bend, convolve 3 x 3, add."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.norm = nn.GroupNorm(channels // GROUP, channels)
        self.conv = nn.Conv2d(channels, channels, 3, padding=1)

    def forward(self, maps: Tensor) -> Tensor:
        """(B, C, H, W) -> the same shape."""
        grown: Tensor = maps + self.conv(silu(self.norm(maps)))
        return grown


class Context(nn.Module):
    """Scales and shifts every channel by what the whole frame shows: room to subtract drift."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.squeeze = nn.Linear(2 * channels, channels)
        self.excite = nn.Linear(channels, 2 * channels)

    def forward(self, maps: Tensor) -> Tensor:
        """(B, C, H, W) -> the same shape."""
        mean = maps.mean((2, 3))
        spread = (maps - mean[:, :, None, None]).square().mean((2, 3)).add(1e-6).sqrt()
        hidden = silu(self.squeeze(torch.cat([mean, spread], dim=1)))
        scale, shift = self.excite(hidden)[:, :, None, None].chunk(2, dim=1)
        shifted: Tensor = maps * (1 + scale) + shift
        return shifted


class BlockNet(nn.Module):
    """Both frames in, one logit a block out; fully convolutional, so any grid and size will do."""

    def __init__(self, config: CnnConfig) -> None:
        super().__init__()
        self.config = config
        narrow, wide = config.width, 2 * config.width
        self.pixels = nn.Sequential(
            nn.Conv2d(9, narrow, 4, stride=2, padding=1),
            Context(narrow),
            Residual(narrow),
            nn.GroupNorm(narrow // GROUP, narrow),
            nn.SiLU(),
            nn.Conv2d(narrow, wide, 4, stride=2, padding=1),
            Context(wide),
            Residual(wide),
        )
        self.weigh = nn.Conv2d(wide, wide, 1)
        stages: list[nn.Module] = []
        for _ in range(config.rounds):
            stages += [Context(wide), Residual(wide)]
        self.blocks = nn.Sequential(*stages, nn.GroupNorm(wide // GROUP, wide), nn.SiLU())
        self.read = nn.Conv2d(wide, 1, 1)

    def forward(self, original: Tensor, embedded: Tensor, rows: int, cols: int) -> Tensor:
        """Decode a batch of rectified frame pairs.

        Args:
            original: (B, 3, H, W) uint8, or float in [0, 255]; encoded RGB.
            embedded: the same shape.
            rows: of blocks.
            cols: of blocks.

        Returns:
            (B, rows, cols) logits, positive for bit 1; those of ratex patches mean nothing.
        """
        return self.decide(*(to_cells(frame, rows, cols) for frame in (original, embedded)))

    def decide(self, original: Tensor, embedded: Tensor) -> Tensor:
        """(B, 3, rows CELLS_Y, cols CELLS_X) in [0, 1], from `to_cells` -> (B, rows, cols)."""
        change = CONTRAST * (embedded - original)
        centred = change - change.mean((2, 3), keepdim=True)
        maps = self.pixels(torch.cat([4 * original - 2, change, centred], dim=1))
        window = (CELLS_Y // 4, CELLS_X // 4)
        weights = self.weigh(maps).sigmoid()  # texture may count for less than flat areas
        pooled = avg_pool2d(weights * maps, window) / avg_pool2d(weights, window).clamp_min(1e-3)
        logits: Tensor = self.read(self.blocks(pooled))
        return logits[:, 0]

    def to_config(self) -> dict[str, object]:
        """Enough to rebuild the module for `load_state_dict`."""
        return {"cnn": asdict(self.config)}


def to_cells(frame: Tensor, rows: int, cols: int) -> Tensor:
    """(B, 3, H, W) in [0, 255] -> (B, 3, rows CELLS_Y, cols CELLS_X) in [0, 1], averaged."""
    return adaptive_avg_pool2d(frame.float() / 255, (rows * CELLS_Y, cols * CELLS_X))


def load_cnn(folder: Path) -> BlockNet:
    """Rebuild the network saved in ``folder``.

    Raises:
        InputError: a file is missing, damaged, or does not fit the other.
    """
    config = read_config(folder, "python -m reports.lab.cnn_baseline")
    try:
        module = BlockNet(CnnConfig(**config["cnn"]))
    except (ValueError, KeyError, TypeError) as error:
        message = f"{folder / 'config.json'}: not a network's configuration ({error})"
        raise InputError(message) from None
    load_weights(folder, config, module)
    return module.eval()


@lru_cache(maxsize=4)
def _trained(folder: Path) -> BlockNet:
    return load_cnn(folder)


@dataclass(frozen=True)
class Cnn:
    """One network for all cameras and displays; nothing is calibrated on the frame pair."""

    checkpoint: Path = PRETRAINED
    """Folder with decoder.pt and config.json, written by ``python -m reports.lab.cnn_baseline``."""
    """It uses no patches, but is shown the captures that it was trained on and others get."""

    def decode(self, pair: Rectified) -> SoftBits:
        """Score every message block."""
        frames = (torch.from_numpy(as_batch(frame)) for frame in (pair.original, pair.embedded))
        with torch.inference_mode():
            logits = _trained(self.checkpoint)(*frames, pair.layout.rows, pair.layout.cols)
        return SoftBits(logits[0].double().numpy()[pair.layout.message_mask])
