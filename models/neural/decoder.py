"""PhiDecoder: two rectified frames in, block scores and the head out; one graph, one convex fit."""

from dataclasses import asdict, dataclass

import numpy as np
import torch
from numpy.polynomial import Legendre
from numpy.typing import NDArray
from torch import Tensor, nn

from link.errors import InputError, UnsuitedError, choose
from link.images import LUMA
from link.layout import Layout
from link.ratex import SAMPLES, TILES, sample_grid, sample_position, tile_labels
from models.classical.oorc import inverse_response
from models.neural.phi import PhiPolynomial, legendre
from models.neural.reduce import Reduce
from models.neural.refine import MOMENTS, Refiner
from models.neural.register import channel_mean, derivatives, register
from models.neural.solver import fit_head

CHANNELS = {
    "luma": (LUMA,),
    "quiet": ((0.27, 0.5, 0.23),),
    "rgb": ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
}
"""Weights of R, G, B in each intensity: one, or Phi per colour channel with one shared head. quiet:
where cameras' noise is least in their sum; a colour matrix subtracts what crosstalk added, so that
neighbouring channels err against each other."""
MARGIN = 1 / 6
"""Of a tile, on each side, that "area" leaves out: the blur of its neighbours."""
MAX_ROUNDS = 8


@dataclass(frozen=True)
class DecoderConfig:
    """What defines the graph; saved as config.json beside the weights."""

    degree: int = 4
    """Of the inverse response g."""
    drift_degree: int = 0
    """Of the polynomial of i_o beside Phi; 0 for none."""
    channels: str = "luma"
    """What an intensity is, of `CHANNELS`: "luma", "quiet", or "rgb" for each by itself."""
    register: bool = False
    """Remove the motion between the frames first (`models.neural.register`)."""
    train_on: str = "tile"
    """Per-frame training samples: means over a "tile" (as quiet as a block) at 36 points of its
    inner half or over its "area" but `MARGIN`, or each "pixel" of the 36."""
    coarsen: int = 1
    """Pixels averaged per axis before all else: 1, or 2, which takes a quarter of the time."""
    texture: float = 0.0
    """Gradient, in intensity a pixel, at which a pixel's weight in its block is halved: little
    light scatters there, but much motion. 0 weighs all alike."""
    refine: int = 0
    """Rounds of decision-directed refinement (`models.neural.refine`); the rest needs it."""
    rows: bool = False
    """A gain for every row of blocks: flicker."""
    space: bool = False
    """Calibration that varies smoothly over the display."""

    def __post_init__(self) -> None:
        choose(CHANNELS, self.channels, "--decoder.channels")
        choose(dict.fromkeys(("tile", "area", "pixel")), self.train_on, "--decoder.train-on")
        for field, value in asdict(self).items():
            kind = type(getattr(DecoderConfig, field))
            if type(value) is not kind:
                raise InputError(f"{field} must be of type {kind.__name__}")
        if self.coarsen not in (1, 2) or not 0 <= self.refine <= MAX_ROUNDS:
            raise InputError(f"--decoder.coarsen: 1 or 2; --decoder.refine: 0 to {MAX_ROUNDS}")
        if not 0 <= self.texture < 1:
            raise InputError("--decoder.texture: 0 or more, below 1")
        if self.refine == 0 and (self.rows or self.space):
            raise InputError("--decoder.rows and space: need --decoder.refine 1 or more")


FULL = DecoderConfig(
    drift_degree=2,
    register=True,
    channels="quiet",
    train_on="area",
    coarsen=2,
    texture=0.02,
    refine=3,
    rows=True,
    space=True,
)
"""All that pays (docs/ablation.md)."""


class PhiDecoder(nn.Module):
    """OORC in torch, and what goes beyond it.

    With the default configuration it is, untrained, the twin of `models.classical.oorc` (the
    method ``phi``): ridge 1, prior 0, C = 1. Training (the method ``learned``) changes what is
    shared across frames: ridge (which scales each feature) and prior of the head, C, the spreads of
    the `Refiner`, and the temperature that turns scores into log-likelihood ratios. The head itself
    is always fitted to the ratex pixels of the frame pair at hand.

    Raises:
        UnsuitedError: the layout has no ratex patch.
    """

    labels: Tensor
    tile: Tensor
    step: Tensor
    rows: Tensor
    cols: Tensor
    tile_rows: Tensor
    tile_cols: Tensor
    tile_index: Tensor
    message_index: Tensor

    def __init__(self, layout: Layout, config: DecoderConfig) -> None:
        super().__init__()
        if not layout.ratex:
            raise UnsuitedError("it trains on ratex patches and the layout has none")
        self.layout, self.config = layout, config
        self.phi = PhiPolynomial(config.degree, config.drift_degree)
        n_weights = self.phi.n_features + 1
        self.log_ridge = nn.Parameter(torch.zeros(n_weights))
        self.prior = nn.Parameter(torch.zeros(n_weights))
        self.log_C = nn.Parameter(torch.zeros(()))
        self.refiner = None
        if config.refine:
            self.refiner = Refiner(layout, config.refine, config.rows, config.space)
        else:
            self.log_temperature = nn.Parameter(torch.zeros(()))
        self.reduce = Reduce(CHANNELS[config.channels], config.coarsen)
        grid = sample_grid(layout)
        rows, row = np.unique(grid.tile_y[:: SAMPLES * SAMPLES], return_inverse=True)
        cols, col = np.unique(grid.tile_x[:: SAMPLES * SAMPLES], return_inverse=True)
        signs = torch.from_numpy(2.0 * tile_labels(layout).reshape(-1) - 1)
        repeats = SAMPLES * SAMPLES if config.train_on == "pixel" else 1
        for name, value in (
            ("labels", signs.repeat_interleave(repeats)),
            # whole numbers in float64, which onnxruntime divides and rounds down quickest
            ("tile", torch.from_numpy(np.stack([grid.tile_y, grid.tile_x]).astype(np.float64))),
            ("step", torch.from_numpy(np.stack([grid.step_y, grid.step_x]).astype(np.float64))),
            ("rows", torch.arange(layout.rows)),
            ("cols", torch.arange(layout.cols)),
            ("tile_rows", torch.from_numpy(rows)),
            ("tile_cols", torch.from_numpy(cols)),
            ("tile_index", torch.from_numpy(len(cols) * row + col)),
            ("message_index", torch.from_numpy(layout.message_mask.reshape(-1).nonzero()[0])),
        ):
            self.register_buffer(name, value, persistent=False)

    def forward(self, original: Tensor, embedded: Tensor) -> tuple[Tensor, Tensor]:
        """Decode a batch of rectified frame pairs.

        Args:
            original: (B, 3, H, W) uint8, or float in [0, 255]; encoded RGB, any H and W of at
                least 4 pixels a block.
            embedded: the same shape.

        Returns:
            scores: (B, n_bits) float32, positive for bit 1, row-major over the message cells.
            head: (B, n_features + 1) float32, weights of the features as they are, then the bias.
        """
        return self.solve_and_score(*self.summarise(original, embedded))

    def summarise(self, original: Tensor, embedded: Tensor) -> tuple[Tensor, Tensor]:
        """All that is computed before the first learned parameter; arguments as of `forward`.

        Returns:
            ratex: (B, N, F) float64, features of the training samples, tiles or pixels.
            blocks: (B, n_bits, F) float64, features averaged over message blocks. F is n_features,
                and with refinement `degree` + MOMENTS if that is more: P_k(i_o) go on up to there.
        """
        i_o, i_e = self.reduce(original), self.reduce(embedded)
        if self.config.register or self.config.texture:
            dx, dy, xx, yy = derivatives(i_o)
        if self.config.register:
            i_e = register(i_o, i_e, xx, yy)
        maps = self.phi(i_o, i_e)
        if self.refiner is not None:
            maps += legendre(i_o, MOMENTS)[self.config.drift_degree :]
        stacked = torch.cat([channel_mean(each) for each in maps], dim=1)
        weights = torch.ones_like(stacked[:, :1])
        if self.config.texture:
            limit = (self.config.coarsen * self.config.texture) ** 2
            weights = limit / (limit + channel_mean(dx) ** 2 + channel_mean(dy) ** 2)
        return self.ratex_samples(stacked), self.block_means(stacked, weights)

    def solve_and_score(self, ratex: Tensor, blocks: Tensor) -> tuple[Tensor, Tensor]:
        """Fit each pair's head to its ratex samples and score its blocks; arguments as above."""
        n = self.phi.n_features
        u = ratex[..., :n]
        scale = (u**2).mean(1).sqrt().clamp_min(1e-6)
        ones = torch.ones_like(u[:, :, :1])
        X = torch.cat([u / scale.unsqueeze(1), ones], dim=-1)  # (B, N, n_features + 1)
        ridge, prior = self.log_ridge.double().exp(), self.prior.double()
        w = fit_head(X, self.labels, self.log_C.double().exp(), ridge, prior)
        head = torch.cat([w[:, :-1] / scale, w[:, -1:]], dim=-1)
        scores = (blocks[..., :n] @ head[:, :-1].unsqueeze(-1)).squeeze(-1) + head[:, -1:]
        if self.refiner is None:
            scores = self.log_temperature.exp() * scores
        else:
            tiles = ratex
            if self.config.train_on == "pixel":
                B, _, F = tiles.shape
                tiles = tiles.reshape(B, -1, SAMPLES * SAMPLES, F).mean(2)  # (B, tiles, F)
            scores = self.refiner(self.statistics(tiles), self.statistics(blocks), scores)
        return scores.float(), head.float()

    def statistics(self, features: Tensor) -> Tensor:
        """Of `summarise`'s F features those that the refiner takes: (B, N, 1 + MOMENTS).

        The change of intensity, i_e - i_o = (P_1(i_o) - P_1(i_e)) / -2, and P_k(i_o).
        """
        degree = self.config.degree
        return torch.cat([features[..., :1] / -2, features[..., degree : degree + MOMENTS]], dim=-1)

    def ratex_samples(self, maps: Tensor) -> Tensor:
        """Features of the training samples: (B, F, H, W) -> (B, N, F) float64.

        Float64: the fit is small, and torch and onnxruntime then agree on the active set.
        """
        height, width = maps.shape[-2:]
        if self.config.train_on == "area":
            rows = bin_mean(height, TILES * self.layout.rows, self.tile_rows, MARGIN, maps)
            cols = bin_mean(width, TILES * self.layout.cols, self.tile_cols, MARGIN, maps)
            means = (rows @ maps @ cols.T).flatten(2)  # (B, F, tile rows x tile cols)
            return means.index_select(2, self.tile_index).transpose(1, 2).double()
        tiles = self.tile.new_tensor([[self.layout.rows * TILES], [self.layout.cols * TILES]])
        length = torch.cat([self.tile.new_full((1, 1), n) for n in (height, width)])
        y, x = torch.minimum(sample_position(self.tile, self.step, tiles, length), length - 1)
        u = maps.flatten(2).index_select(2, (y * width + x).long()).double()  # (B, F, pixels)
        if self.config.train_on == "tile":
            u = u.reshape(u.shape[0], u.shape[1], -1, SAMPLES * SAMPLES).mean(3)
        return u.transpose(1, 2)

    def block_means(self, maps: Tensor, weights: Tensor) -> Tensor:
        """Weighted mean over each message block: (B, F, H, W) -> (B, n_bits, F) float64."""
        height, width = maps.shape[-2:]
        rows = bin_mean(height, self.layout.rows, self.rows, 0.0, maps)
        cols = bin_mean(width, self.layout.cols, self.cols, 0.0, maps)
        total = rows @ weights @ cols.T
        means = (rows @ (maps * weights) @ cols.T) / total  # (B, F, rows, cols)
        return means.flatten(2).index_select(2, self.message_index).transpose(1, 2).double()

    def inverse_response(self, head: NDArray[np.float64]) -> Legendre:
        """g of a frame pair from the (n_features + 1,) head: captured [0, 1] -> displayed.

        Up to scale and offset, which the SVM leaves free.
        """
        return inverse_response(head[: self.config.degree])

    def to_config(self) -> dict[str, object]:
        """Layout and configuration, enough to rebuild the module for `load_state_dict`."""
        return {"layout": self.layout.to_dict(), "decoder": asdict(self.config)}


def bin_mean(length: int, count: int, bins: Tensor, margin: float, like: Tensor) -> Tensor:
    """(len(bins), length) matrix that averages the pixels of each bin, in the dtype of ``like``.

    A pixel counts by the share of it that lies inside, so every bin has some, however small.

    Args:
        length: pixels.
        count: equal bins over them.
        bins: (N,) those that are averaged.
        margin: share of a bin that is left out at each end, below 1/2.
        like: says dtype and device.
    """
    start = (bins.double().unsqueeze(1) + margin) * (length / count)
    stop = (bins.double().unsqueeze(1) + (1 - margin)) * (length / count)
    left = torch.arange(length, device=like.device)
    inside = torch.minimum(left + 1, stop) - torch.maximum(left, start)
    return (inside.clamp_min(0) / (stop - start)).to(like.dtype)
