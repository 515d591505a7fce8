"""PhiDecoder: two rectified frames in, block scores and the fitted head out, in one graph."""

from dataclasses import asdict

import numpy as np
import torch
from torch import Tensor, nn

from link.errors import UnsuitedError
from link.layout import Layout
from link.ratex import SAMPLES, TILES, sample_grid, sample_position, tile_labels
from models.onnx_ops import table
from models.phi.config import CHANNELS, DecoderConfig
from models.phi.phi import PhiPolynomial
from models.phi.reduce import Reduce
from models.phi.refine import MOMENTS, TEXTURES
from models.phi.refine_pilots import PilotRefiner
from models.phi.refine_ratex import RatexRefiner
from models.phi.register import channel_mean, derivatives, register
from models.phi.solver import fit_head

MARGIN = 1 / 6
"""Share of a tile's side that ``train_on="area"`` leaves out at each end, where neighbouring tiles
blur into it."""
START_LOG_TEMPERATURE = 3.0
"""Log temperature with which training starts a decoder that has no refinement: its margins are
about 1, and log-likelihood ratios about 20."""


class PhiDecoder(nn.Module):
    """Optimal online radiometric calibration in torch, and what goes beyond it.

    With the default configuration and untrained it is the twin of `models.paper.oorc`, the
    method ``phi``: ridge 1, prior 0, C = 1. Training, the method ``learned``, changes what frame
    pairs share: the ridge (which scales each feature) and the prior of the head, C, the spreads of
    the refiner, and the temperature that turns scores into log-likelihood ratios. The head itself
    is always fitted to the ratex patches, or else the pilots, of the frame pair at hand.

    Args:
        layout: grid of blocks and ratex patches that the frames show.
        config: which parts the graph has.

    Raises:
        UnsuitedError: the layout has neither ratex patches nor pilots.

    >>> from link.layout import make_layout
    >>> layout = make_layout(rows=4, cols=4, width=64, height=48, ratex=2)
    >>> decoder = PhiDecoder(layout, DecoderConfig())
    >>> frames = torch.full((1, 3, 48, 64), 128, dtype=torch.uint8)
    >>> scores, head = decoder(frames, frames)
    >>> scores.shape, head.shape
    (torch.Size([1, 14]), torch.Size([1, 5]))
    """

    def __init__(self, layout: Layout, config: DecoderConfig) -> None:
        super().__init__()
        if not layout.ratex and not layout.pilots:
            raise UnsuitedError("it trains on ratex patches or pilots and the layout has none")
        self.layout, self.config = layout, config
        # of higher powers than these, float32 keeps too few digits
        by_powers = config.refine > 0 and config.degree <= MOMENTS
        moments = MOMENTS if config.refine else 0
        self.phi = PhiPolynomial(config.degree, config.drift_degree, moments, by_powers)
        n_weights = self.phi.n_features + 1
        self.log_ridge = nn.Parameter(torch.zeros(n_weights))
        self.prior = nn.Parameter(torch.zeros(n_weights))
        self.log_C = nn.Parameter(torch.zeros(()))
        self.refiner: RatexRefiner | PilotRefiner | None = None
        if config.refine and layout.ratex:
            self.refiner = RatexRefiner(layout, config.refine, config.rows, config.space)
        elif config.refine:
            pixels = layout.width * layout.height / layout.message_mask.size / config.coarsen**2
            self.refiner = PilotRefiner(layout, pixels, config.refine, config.rows, config.space)
        else:
            self.log_temperature = nn.Parameter(torch.zeros(()))
        self.reduce = Reduce(CHANNELS[config.channels], config.coarsen)
        self.textured = self.refiner is not None and self.refiner.needs_texture
        self._tabulate_samples()

    def _tabulate_samples(self) -> None:
        """Tabulate where training samples and message blocks lie, and the labels of the former."""
        layout = self.layout
        grid = sample_grid(layout)
        self.tile = table(grid[:2].astype(np.float64))
        self.step = table(grid[2:].astype(np.float64))
        rows, row = np.unique(grid[0, :: SAMPLES * SAMPLES], return_inverse=True)
        cols, col = np.unique(grid[1, :: SAMPLES * SAMPLES], return_inverse=True)
        self.tile_rows, self.tile_cols = table(rows), table(cols)
        self.tile_index = table(len(cols) * row + col)
        self.rows, self.cols = table(np.arange(layout.rows)), table(np.arange(layout.cols))
        self.pilot_index = table(layout.pilot_blocks)
        self.message_index = table(layout.message_mask.reshape(-1).nonzero()[0])
        known = tile_labels(layout).reshape(-1) if layout.ratex else layout.pilot_bits
        self.labels = table(2.0 * known - 1)

    def forward(self, original: Tensor, embedded: Tensor) -> tuple[Tensor, Tensor]:
        """Decode a batch of rectified frame pairs.

        Args:
            original: (B, 3, H, W) uint8, or float in [0, 255]; encoded RGB, any H and W of at
                least 4 pixels a block.
            embedded: (B, 3, H, W) uint8, or float in [0, 255]; encoded RGB.

        Returns:
            scores: (B, n_bits) float32, positive for bit 1, row-major over the message cells.
            head: (B, n_features + 1) float32, weights of the features as they are, then the bias.
        """
        return self.solve_and_score(*self.summarise(original, embedded))

    def summarise(self, original: Tensor, embedded: Tensor) -> tuple[Tensor, Tensor]:
        """Compute all that comes before the first learned parameter.

        F is the number of features. It is n_features without refinement. With refinement, the
        terms P_k(i_o) go on up to k = MOMENTS if the drift terms end before that. With refinement
        on pilots, five features of the picture's texture follow (`refine_pilots.STATISTICS`).

        Args:
            original: (B, 3, H, W) uint8, or float in [0, 255]; encoded RGB.
            embedded: (B, 3, H, W) uint8, or float in [0, 255]; encoded RGB.

        Returns:
            known: (B, N, F) float64, features of the N training samples: ratex tiles or pilots.
            blocks: (B, n_bits, F) float64, features averaged over message blocks.
        """
        return self.average(*self.pixel_maps(original, embedded))

    def pixel_maps(self, original: Tensor, embedded: Tensor) -> tuple[Tensor, Tensor]:
        """Compute the features and the weight of every pixel, of the registered frames.

        Args:
            original: (B, 3, H, W) uint8, or float in [0, 255]; encoded RGB.
            embedded: (B, 3, H, W) uint8, or float in [0, 255]; encoded RGB.

        Returns:
            maps: (B, F, h, w) float32 features of the pixels that `Reduce` leaves, in the order of
                `summarise`, but for the mean weight of a block's pixels, which comes last there.
                With refinement, powers of 2 i - 1 stand in the places of Legendre polynomials.
            weights: (B, 1, h, w) float32 weight of each pixel in its block's mean.
        """
        i_o, i_e = self.reduce(original), self.reduce(embedded)  # (B, C, h, w) each
        if self.config.register or self.config.texture or self.textured:
            dx, dy, xx, yy = derivatives(i_o)
        if self.config.register:
            i_e = register(i_o, i_e, xx, yy)
        parts = [channel_mean(each) for each in self.phi(i_o, i_e)]  # (B, 1, h, w) each
        weights = torch.ones_like(parts[0])
        if self.config.texture or self.textured:
            dx, dy = channel_mean(dx), channel_mean(dy)
            steepness = dx * dx + dy * dy
        if self.config.texture:
            limit = (self.config.coarsen * self.config.texture) ** 2
            weights = limit / (limit + steepness)
        if self.textured:
            parts += [dx, dy, channel_mean(xx + yy), steepness]
        return torch.cat(parts, dim=1), weights

    def average(self, maps: Tensor, weights: Tensor) -> tuple[Tensor, Tensor]:
        """Average the features of pixels over training samples and message blocks.

        Args:
            maps: (B, F, h, w) features, from `pixel_maps`.
            weights: (B, 1, h, w) weights of the pixels.

        Returns:
            what `summarise` returns.
        """
        means = self.phi.of_means(self.block_means(maps, weights, with_weight=self.textured))
        blocks, pilots = (
            means.index_select(2, index).transpose(1, 2).double()
            for index in (self.message_index, self.pilot_index)
        )
        return self.ratex_samples(maps) if self.layout.ratex else pilots, blocks

    def solve_and_score(self, known: Tensor, blocks: Tensor) -> tuple[Tensor, Tensor]:
        """Fit each pair's head to its training samples and score its blocks.

        Args:
            known: (B, N, F) float64 features of the training samples, from `summarise`.
            blocks: (B, n_bits, F) float64 features of the message blocks, from `summarise`.

        Returns:
            scores: (B, n_bits) float32, positive for bit 1.
            head: (B, n_features + 1) float32, weights of the features, then the bias.
        """
        head = self._fit_head(known)
        n = self.phi.n_features
        scores = (blocks[..., :n] @ head[:, :-1].unsqueeze(-1)).squeeze(-1) + head[:, -1:]
        if self.refiner is None:
            scores = self.log_temperature.exp() * scores
        else:
            scores = self.refiner(self.statistics(known), self.statistics(blocks), scores)
        return scores.float(), head.float()

    def _fit_head(self, known: Tensor) -> Tensor:
        """Fit the (B, n_features + 1) heads to features that are scaled to a mean square of 1."""
        u = known[..., : self.phi.n_features]
        scale = (u**2).mean(1).sqrt().clamp_min(1e-6)  # (B, n_features)
        X = torch.cat([u / scale.unsqueeze(1), torch.ones_like(u[:, :, :1])], dim=-1)
        ridge, prior = self.log_ridge.double().exp(), self.prior.double()
        w = fit_head(X, self.labels, self.log_C.double().exp(), ridge, prior)
        return torch.cat([w[:, :-1] / scale, w[:, -1:]], dim=-1)

    def statistics(self, features: Tensor) -> Tensor:
        """Pick the features that the refiner takes from all of `summarise`'s.

        Args:
            features: (B, N, F) float64 features of tiles or blocks.

        Returns:
            (B, N, 1 + MOMENTS): the change of intensity, i_e - i_o = (P_1(i_o) - P_1(i_e)) / -2,
            then the moments P_k(i_o); on pilots the features of texture follow.
        """
        degree = self.config.degree
        parts = [features[..., :1] / -2, features[..., degree : degree + MOMENTS]]
        if self.textured:
            parts.append(features[..., -TEXTURES:])
        return torch.cat(parts, dim=-1)

    def ratex_samples(self, maps: Tensor) -> Tensor:
        """Take the training samples from feature maps: (B, F, H, W) to (B, N, F) float64.

        The fit is small, and in float64 torch and onnxruntime agree on its active set.
        """
        height, width = maps.shape[-2:]
        if self.config.train_on == "area":
            rows = bin_mean(height, TILES * self.layout.rows, self.tile_rows, MARGIN, maps)
            cols = bin_mean(width, TILES * self.layout.cols, self.tile_cols, MARGIN, maps)
            means = (rows @ maps @ cols.T).flatten(2)  # (B, F, tile rows x tile cols)
            means = self.phi.of_means(means.index_select(2, self.tile_index))
            return means.transpose(1, 2).double()
        tiles = self.tile.new_tensor([[self.layout.rows * TILES], [self.layout.cols * TILES]])
        length = torch.cat([self.tile.new_full((1, 1), n) for n in (height, width)])
        y, x = torch.minimum(sample_position(self.tile, self.step, tiles, length), length - 1)
        u = maps.flatten(2).index_select(2, (y * width + x).long()).double()  # (B, F, pixels)
        u = u.reshape(*u.shape[:2], -1, SAMPLES * SAMPLES).mean(3)
        return self.phi.of_means(u).transpose(1, 2)

    def block_means(self, maps: Tensor, weights: Tensor, with_weight: bool) -> Tensor:
        """Average feature maps over each block of the grid.

        Args:
            maps: (B, F, H, W) features.
            weights: (B, 1, H, W) weight of each pixel.
            with_weight: whether the mean weight of a block's pixels follows as one more feature.

        Returns:
            (B, F or F + 1, rows * cols) weighted means, row-major over the blocks.
        """
        height, width = maps.shape[-2:]
        rows = bin_mean(height, self.layout.rows, self.rows, 0.0, maps)
        cols = bin_mean(width, self.layout.cols, self.cols, 0.0, maps)
        total = rows @ weights @ cols.T
        means = (rows @ (maps * weights) @ cols.T) / total  # (B, F, rows, cols)
        if with_weight:
            means = torch.cat([means, total], dim=1)
        return means.flatten(2)

    def for_layout(self, layout: Layout) -> "PhiDecoder":
        """Build a decoder for another layout of the same kind that shares this one's parameters.

        Args:
            layout: with ratex patches if this decoder's layout has them, else with pilots.
        """
        other = type(self)(layout, self.config).to(self.log_C.device)
        for name, parameter in self.named_parameters():
            owner, _, leaf = name.rpartition(".")
            setattr(other.get_submodule(owner), leaf, parameter)
        return other

    def to_config(self) -> dict[str, object]:
        """Give layout and configuration, enough to rebuild the module for `load_state_dict`."""
        return {"layout": self.layout.to_dict(), "decoder": asdict(self.config)}


def bin_mean(length: int, count: int, bins: Tensor, margin: float, like: Tensor) -> Tensor:
    """Make the matrix that averages the pixels of each bin along one axis.

    A pixel counts by the share of it that lies inside, so every bin has some, however small.

    Args:
        length: number of pixels along the axis.
        count: number of equal bins over them.
        bins: (N,) indices of the bins that are averaged.
        margin: share of a bin that is left out at each end, below 1/2.
        like: tensor whose dtype and device the matrix gets.

    Returns:
        (N, length) weights, each row of which sums to 1.

    >>> bin_mean(3, 2, torch.arange(2), 0.0, torch.zeros(1)).round(decimals=2)
    tensor([[0.6700, 0.3300, 0.0000],
            [0.0000, 0.3300, 0.6700]])
    """
    start = (bins.double().unsqueeze(1) + margin) * (length / count)
    stop = (bins.double().unsqueeze(1) + (1 - margin)) * (length / count)
    left = torch.arange(length, device=like.device)
    inside = torch.minimum(left + 1, stop) - torch.maximum(left, start)
    return (inside.clamp_min(0) / (stop - start)).to(like.dtype)
