"""PhiDecoder: two rectified frames in, block scores and the head out; one graph, one convex fit."""

from dataclasses import asdict, dataclass

import numpy as np
import torch
from numpy.polynomial import Legendre
from numpy.typing import NDArray
from torch import Tensor, nn

from link.errors import InputError, UnsuitedError, choose
from link.layout import MIN_BLOCK_PX, Layout
from link.ratex import SAMPLES, TILES, sample_grid, sample_position, tile_labels
from models.classical.oorc import inverse_response
from models.neural.phi import PhiPolynomial
from models.neural.register import register
from models.neural.solver import fit_head

BINS = MIN_BLOCK_PX
"""Pooling weights per block and axis; every block is at least this many pixels wide."""
CHANNELS = {"luma": (0.299, 0.587, 0.114), "rgb": None}
"""Luma (ITU-R BT.601), or Phi per colour channel with one shared head."""


@dataclass(frozen=True)
class DecoderConfig:
    """What defines the graph; saved as config.json beside the weights."""

    degree: int = 4
    """Of the inverse response g."""
    drift_degree: int = 0
    """Of the polynomial of i_o beside Phi; 0 for none."""
    channels: str = "luma"
    """"luma" or "rgb"."""
    register: bool = False
    """Remove the motion between the frames first (`models.neural.register`)."""
    train_on: str = "tile"
    """Per-frame training samples: "tile" means (as quiet as a block), or single "pixel"."""

    def __post_init__(self) -> None:
        choose(CHANNELS, self.channels, "--decoder.channels")
        choose({"tile": 0, "pixel": 0}, self.train_on, "--decoder.train-on")
        for name, kind in (("degree", int), ("drift_degree", int), ("register", bool)):
            if type(getattr(self, name)) is not kind:
                raise InputError(f"{name} must be of type {kind.__name__}")


class PhiDecoder(nn.Module):
    """OORC in torch.

    As constructed it is the untrained twin of `models.classical.oorc` (the method ``phi``):
    ridge 1, prior 0, C = 1, all parts of a block alike. Training (the method ``learned``) changes
    what is shared across frames: ridge (which scales each feature) and prior of the head, C,
    pooling weights inside a block, and the temperature that turns scores into log-likelihood
    ratios. The head itself is always fitted to the ratex pixels of the frame pair at hand.

    Raises:
        UnsuitedError: the layout has no ratex patch.
    """

    labels: Tensor
    tile_y: Tensor
    tile_x: Tensor
    step_y: Tensor
    step_x: Tensor
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
        self.pool_y = nn.Parameter(torch.zeros(BINS))
        self.pool_x = nn.Parameter(torch.zeros(BINS))
        self.log_temperature = nn.Parameter(torch.zeros(()))
        grid = sample_grid(layout)
        signs = torch.from_numpy(2.0 * tile_labels(layout).reshape(-1) - 1)
        repeats = 1 if config.train_on == "tile" else SAMPLES * SAMPLES
        for name, value in (
            ("labels", signs.repeat_interleave(repeats)),
            ("tile_y", torch.from_numpy(grid.tile_y)),
            ("tile_x", torch.from_numpy(grid.tile_x)),
            ("step_y", torch.from_numpy(grid.step_y)),
            ("step_x", torch.from_numpy(grid.step_x)),
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
            ratex: (B, N, n_features) float64, features of the training samples, tiles or pixels.
            bins: (B, n_features, 4 rows, 4 cols) float32, features averaged over parts of blocks.
        """
        i_o, i_e = self.intensity(original), self.intensity(embedded)
        if self.config.register:
            i_e = register(i_o, i_e)
        return self.ratex_features(i_o, i_e), self.bin_features(i_o, i_e)

    def solve_and_score(self, ratex: Tensor, bins: Tensor) -> tuple[Tensor, Tensor]:
        """Fit each pair's head to its ratex samples and score its blocks; arguments as above."""
        scale = (ratex**2).mean(1).sqrt().clamp_min(1e-6)
        ones = torch.ones_like(ratex[:, :, :1])
        X = torch.cat([ratex / scale.unsqueeze(1), ones], dim=-1)  # (B, N, n_features + 1)
        ridge, prior = self.log_ridge.double().exp(), self.prior.double()
        w = fit_head(X, self.labels, self.log_C.double().exp(), ridge, prior)
        head = torch.cat([w[:, :-1] / scale, w[:, -1:]], dim=-1)
        blocks = self.pool(bins.double())  # (B, n_bits, n_features)
        scores = (blocks @ head[:, :-1].unsqueeze(-1)).squeeze(-1) + head[:, -1:]
        return (self.log_temperature.exp() * scores).float(), head.float()

    def intensity(self, frame: Tensor) -> Tensor:
        """(B, 3, H, W) in [0, 255] -> (B, C, H, W) float32 in [0, 1]; C is 1 (luma) or 3."""
        scaled = frame.float() / 255
        weights = CHANNELS[self.config.channels]
        if weights is None:
            return scaled
        return torch.stack([w * scaled[:, c] for c, w in enumerate(weights)]).sum(0).unsqueeze(1)

    def ratex_features(self, i_o: Tensor, i_e: Tensor) -> Tensor:
        """Features of the training samples: (B, C, H, W) in [0, 1] -> (B, N, n_features) float64.

        Float64: the fit is small, and torch and onnxruntime then agree on the active set.
        """
        height, width = i_o.shape[-2:]
        y = sample_position(self.tile_y, self.step_y, self.layout.rows * TILES, height)
        x = sample_position(self.tile_x, self.step_x, self.layout.cols * TILES, width)
        index = y * width + x
        features = self.phi(
            i_o.flatten(2)[:, :, index].double(), i_e.flatten(2)[:, :, index].double()
        )
        u = torch.stack([f.mean(1) for f in features], dim=-1)  # (B, pixels, n_features)
        if self.config.train_on == "pixel":
            return u
        tiles = u.reshape(u.shape[0], -1, SAMPLES * SAMPLES, u.shape[2])
        return tiles.mean(2)  # (B, tiles, n_features)

    def bin_features(self, i_o: Tensor, i_e: Tensor) -> Tensor:
        """Features averaged over BINS x BINS parts of each block, and over colour channels."""
        features = self.phi(i_o, i_e)
        maps = torch.stack([f.mean(1) for f in features], dim=1)  # (B, n_features, H, W)
        height, width = maps.shape[-2:]
        rows = bin_mean(height, self.layout.rows * BINS, maps)
        cols = bin_mean(width, self.layout.cols * BINS, maps)
        return rows @ maps @ cols.T  # (B, n_features, rows * BINS, cols * BINS)

    def pool(self, bins: Tensor) -> Tensor:
        """Weighted mean over each message block: bins -> (B, n_bits, n_features)."""
        B, F, rows, cols = bins.shape[0], bins.shape[1], self.layout.rows, self.layout.cols
        parts = bins.reshape(B, F, rows, BINS, cols, BINS)  # a block is BINS x BINS parts
        weights = self.pool_y.double().softmax(0).unsqueeze(1) * self.pool_x.double().softmax(0)
        blocks = (parts * weights.unsqueeze(1)).sum((3, 5))  # (B, F, rows, cols)
        return blocks.flatten(2)[:, :, self.message_index].transpose(1, 2)

    def inverse_response(self, head: NDArray[np.float64]) -> Legendre:
        """g of a frame pair from the (n_features + 1,) head: captured [0, 1] -> displayed.

        Up to scale and offset, which the SVM leaves free.
        """
        return inverse_response(head[: self.config.degree])

    def to_config(self) -> dict[str, object]:
        """Layout and configuration, enough to rebuild the module for `load_state_dict`."""
        return {"layout": self.layout.to_dict(), "decoder": asdict(self.config)}


def bin_mean(length: int, count: int, like: Tensor) -> Tensor:
    """(count, length) matrix that averages the pixels of each bin, in the dtype of ``like``."""
    index = torch.arange(length, device=like.device) * count // length
    member = (index == torch.arange(count, device=like.device).unsqueeze(1)).to(like.dtype)
    return member / member.sum(1, keepdim=True)
