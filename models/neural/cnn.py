"""A calibration-free baseline: one convolutional network from frame pair to bits, like LightNet.

DeepLight's LightNet (Tran et al. 2021) and Light Field Messaging's decoder (Wengrowski and Dana
2019) learn one mapping for all cameras and displays. So does this one. Nothing is fitted to a frame
pair, and the ratex patches are part of the picture like everything else.
"""

from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path

import torch
from torch import Tensor, nn
from torch.nn.functional import adaptive_avg_pool2d, avg_pool2d, silu

from link.errors import InputError, ParameterError
from link.frames import Rectified, SoftBits
from link.images import as_batch, intensity
from link.types import Image
from models import PRETRAINED_CNN
from models.neural.checkpoint import load_weights, read_config

CELLS_Y, CELLS_X = 12, 16
"""Numbers of cells along a block's height and width to which frames are averaged; the network's
first stages shrink both fourfold."""
CONTRAST = 20.0
"""Factor by which the difference of the frames is multiplied. They differ by a few gray levels of
255, and the factor brings that to the order of 1."""
TRAINED_BY = "python -m reports.lab.cnn_baseline at the tag results-2026-11"
"""Command that trained the shipped network; the repository no longer holds it."""
GROUP = 8
"""Number of channels that are normalised together, over the whole frame."""


@dataclass(frozen=True)
class CnnConfig:
    """What defines the network; it is saved in config.json beside the weights.

    Raises:
        ParameterError: a value is out of range.
    """

    width: int = 32
    """Number of channels of the first stage; the later stages have twice as many."""
    rounds: int = 3
    """Number of rounds of context and convolution among the blocks."""

    def __post_init__(self) -> None:
        for field, value in asdict(self).items():
            if type(value) is not int or not 1 <= value <= 128:
                raise ParameterError(field, f"need a whole number, 1 to 128, got {value!r}")
        if self.width % GROUP:
            raise ParameterError("width", f"need a multiple of {GROUP}, got {self.width}")


class Residual(nn.Module):
    """A residual stage: it normalises, bends, convolves 3 x 3 and adds the result."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.norm = nn.GroupNorm(channels // GROUP, channels)
        self.conv = nn.Conv2d(channels, channels, 3, padding=1)

    def forward(self, maps: Tensor) -> Tensor:
        """Apply the stage to (B, C, H, W) maps; the result has the same shape."""
        grown: Tensor = maps + self.conv(silu(self.norm(maps)))
        return grown


class Context(nn.Module):
    """A stage that scales and shifts every channel by what the whole frame shows.

    This lets the network subtract what exposure drift adds to all blocks.
    """

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.squeeze = nn.Linear(2 * channels, channels)
        self.excite = nn.Linear(channels, 2 * channels)

    def forward(self, maps: Tensor) -> Tensor:
        """Apply the stage to (B, C, H, W) maps; the result has the same shape."""
        mean = maps.mean((2, 3))
        spread = (maps - mean[:, :, None, None]).square().mean((2, 3)).add(1e-6).sqrt()
        squeezed = silu(self.squeeze(torch.cat([mean, spread], dim=1)))
        scale, shift = self.excite(squeezed)[:, :, None, None].chunk(2, dim=1)
        shifted: Tensor = maps * (1 + scale) + shift
        return shifted


class BlockNet(nn.Module):
    """A network that takes both frames and gives one logit a block.

    It is fully convolutional, so any grid and any size of the frames will do.

    >>> network = BlockNet(CnnConfig(width=8, rounds=1))
    >>> frames = torch.zeros(1, 3, 48, 64, dtype=torch.uint8)
    >>> network(frames, frames, rows=4, cols=4).shape
    torch.Size([1, 4, 4])
    """

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
            embedded: (B, 3, H, W) uint8, or float in [0, 255]; encoded RGB.
            rows: number of rows of blocks.
            cols: number of columns of blocks.

        Returns:
            (B, rows, cols) logits, positive for bit 1; those of ratex patches mean nothing.
        """
        return self.decide(*(to_cells(frame, rows, cols) for frame in (original, embedded)))

    def decide(self, original: Tensor, embedded: Tensor) -> Tensor:
        """Decide on frames that `to_cells` has averaged.

        Args:
            original: (B, 3, rows CELLS_Y, cols CELLS_X) in [0, 1], encoded RGB.
            embedded: (B, 3, rows CELLS_Y, cols CELLS_X) in [0, 1], encoded RGB.

        Returns:
            (B, rows, cols) logits, positive for bit 1.
        """
        change = CONTRAST * (embedded - original)
        centred = change - change.mean((2, 3), keepdim=True)
        maps = self.pixels(torch.cat([4 * original - 2, change, centred], dim=1))
        window = (CELLS_Y // 4, CELLS_X // 4)
        weights = self.weigh(maps).sigmoid()  # texture may count for less than flat areas
        pooled = avg_pool2d(weights * maps, window) / avg_pool2d(weights, window).clamp_min(1e-3)
        logits: Tensor = self.read(self.blocks(pooled))
        return logits[:, 0]

    def to_config(self) -> dict[str, object]:
        """Give the configuration, enough to rebuild the module for `load_state_dict`."""
        return {"cnn": asdict(self.config)}


def to_cells(frame: Tensor, rows: int, cols: int) -> Tensor:
    """Average frames over the cells of each block.

    Args:
        frame: (B, 3, H, W) uint8, or float in [0, 255]; encoded RGB.
        rows: number of rows of blocks.
        cols: number of columns of blocks.

    Returns:
        (B, 3, rows CELLS_Y, cols CELLS_X) float32 in [0, 1].
    """
    return adaptive_avg_pool2d(frame.float() / 255, (rows * CELLS_Y, cols * CELLS_X))


def load_cnn(folder: Path) -> BlockNet:
    """Rebuild the network saved in ``folder``.

    Raises:
        InputError: a file is missing, damaged, or does not fit the other.
    """
    config = read_config(folder, TRAINED_BY)
    try:
        module = BlockNet(CnnConfig(**config["cnn"]))
    except (ValueError, KeyError, TypeError) as error:
        message = f"{folder / 'config.json'}: not a network's configuration ({error})"
        raise InputError(message) from None
    load_weights(folder, config, module)
    return module.eval()


def as_shown_in_training(frame: Image, colour: str) -> Tensor:
    """Arrange a frame as the network was trained on: bits make all three channels brighter.

    Where bits have another colour, the intensity that they change stands in all three channels.

    Args:
        frame: an `Image`.
        colour: colour direction of the layout's bits, a key of `link.layout.COLOURS`.

    Returns:
        (1, 3, H, W) uint8, or float32 in [0, 255] where the colour is not "gray".
    """
    if colour == "gray":
        return torch.from_numpy(as_batch(frame))
    return 255 * torch.from_numpy(intensity(frame, colour)).expand(1, 3, -1, -1)


@lru_cache(maxsize=4)
def _trained(folder: Path) -> BlockNet:
    return load_cnn(folder)


@dataclass(frozen=True)
class Cnn:
    """One network for all cameras and displays; nothing is calibrated on the frame pair."""

    checkpoint: Path = PRETRAINED_CNN
    """Folder with decoder.pt and config.json, which `TRAINED_BY` wrote."""

    def decode(self, pair: Rectified) -> SoftBits:
        """Score every message block of a frame pair, in natural log-likelihood ratios."""
        colour = pair.layout.colour
        frames = (as_shown_in_training(frame, colour) for frame in (pair.original, pair.embedded))
        with torch.inference_mode():
            logits = _trained(self.checkpoint)(*frames, pair.layout.rows, pair.layout.cols)
        return SoftBits(logits[0].double().numpy()[pair.layout.message_mask])
