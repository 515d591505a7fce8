"""Decision-directed refinement: the message blocks become training data of further convex solves.

A block's brightness change is modelled as
    y = b s + d + noise,    s = S a,    d = N c,
with bit b, known columns S and N, and Gaussian a and c of known spread. S holds what kappa gray
levels become in the capture, h(i) = 1 / g'(i); N what drift, flicker and fall-off add.
Given the bits, or their probabilities, a and c follow from one ridge solve; given a and c, the bits
follow from a likelihood ratio. Ratex tiles enter the same solve with their known labels. The start
is the SVM's decision; a block weighs more than a tile for it is larger, so two or three rounds
bring far more than the tiles alone can.
"""

from typing import Any

import numpy as np
import torch
from numpy.polynomial.legendre import legvander
from numpy.typing import NDArray
from torch import Tensor, nn

from link.layout import Layout
from link.ratex import TILES, tile_labels, tile_levels
from models.neural.solver import inverse, solve_spd

MOMENTS = 4
"""Legendre moments of i_o over a block; the degree of g, on which 1 / g' is projected too."""
GRID = np.linspace(0, 1, 65)
SHARPNESS = 10.0
"""Of the soft floor that keeps g' above its least value."""
GRAY_LEVELS = 255.0


class Refiner(nn.Module):
    """Soft-label ridge solves over tiles and blocks; about thirty learned numbers.

    Args:
        layout: says where tiles and blocks lie.
        rounds: of solving and deciding anew, at least 1.
        rows: a gain for every row of blocks (flicker, rolling shutter).
        space: gain, offset and g vary smoothly over the display.
    """

    levels: Tensor
    labels: Tensor
    x: Tensor
    y: Tensor
    of_row: Tensor
    is_tile: Tensor
    grid: Tensor
    project: Tensor

    def __init__(self, layout: Layout, rounds: int, rows: bool, space: bool) -> None:
        super().__init__()
        self.rounds, self.space = rounds, space
        # standard deviations of the coefficients; frames of [0, 255] gray levels
        self.signal = _logs(3.0, 1.0)
        self.nuisance = _logs(2.0, 2.0, 1.0, 0.5, 10.0)
        self.space_nuisance = _logs(1.5, 1.5, 0.7, 0.7, 0.7, 0.3, 0.3) if space else None
        self.row_nuisance = _logs(0.7) if rows else None
        # log standard deviation of the noise: constant, linear and quadratic in i_o
        self.tile_noise = nn.Parameter(torch.tensor([-0.5, 0.0, 0.0]))
        self.block_noise = nn.Parameter(torch.tensor([-1.9, 0.0, 0.0]))
        # observations that the learned noise counts for, beside this frame pair's
        self.noise_trust = _logs(20.0, 20.0)
        self.level_ridge = _logs(1e-3, 1e-2, 1e-1, 1e-1, 1e-3)
        self.least_slope = _logs(0.25)
        self.start = _logs(5.0)
        self.temperature = _logs(1.0)
        self.surprise = _logs(1e-5)
        for name, value in {**_positions(layout), **_curves()}.items():
            self.register_buffer(name, torch.from_numpy(value), persistent=False)
        # kappa takes at most a few levels off their range, which the receiver need not know
        levels = torch.from_numpy(tile_levels(layout, 0).reshape(-1) / GRAY_LEVELS)
        self.register_buffer("levels", levels, persistent=False)
        labels = torch.from_numpy(tile_labels(layout).reshape(-1).astype(np.float64))
        self.register_buffer("labels", labels, persistent=False)

    def forward(self, tiles: Tensor, blocks: Tensor, scores: Tensor) -> Tensor:
        """Log-likelihood ratios of the message bits.

        Args:
            tiles: (B, tiles, 1 + MOMENTS) float64, as are all tensors here: mean change of luma in
                [-1, 1] and moments P_k of i_o.
            blocks: (B, n_bits, 1 + MOMENTS).
            scores: (B, n_bits) of the SVM, margins of about 1; the start.

        Returns:
            (B, n_bits).
        """
        h, D = self.calibrate(tiles)
        S, N, y, var = self.design(torch.cat([tiles, blocks], dim=1), h, D)
        T, n_bits = tiles.shape[1], blocks.shape[1]
        # rows: tiles with their labels, then blocks as bit 1, then the same blocks as bit 0
        S = torch.cat([S[:, :T] * self.labels.unsqueeze(1), S[:, T:], 0 * S[:, T:]], dim=1)
        F = torch.cat([S, torch.cat([N, N[:, T:]], dim=1)], dim=-1)  # (B, T + 2 n_bits, K)
        y, var = (torch.cat([v, v[:, T:]], dim=1) for v in (y, var))
        prior = torch.eye(F.shape[-1], dtype=F.dtype, device=F.device)
        trust_t, trust = self.noise_trust.exp().unbind()
        known, noise = torch.ones_like(y[:, :T]), torch.ones_like(y)
        llr = self.start.exp() * scores
        for _ in range(self.rounds):
            p = llr.sigmoid()
            q = torch.cat([known, p, 1 - p], dim=1)
            weight = q / (noise * var)
            normal, right = _weighted(F, y, weight)
            covariance = inverse(prior + normal)
            projected = F @ covariance
            mean = (projected @ right.unsqueeze(-1)).squeeze(-1)
            variance = (projected * F).sum(-1)  # of the coefficients, without noise
            # noise of this frame pair relative to the learned one, degrees of freedom allowed for
            excess, used = q * (y - mean) ** 2 / var, weight * variance
            noise_t = (trust_t + excess[:, :T].sum(1)) / (trust_t + T - used[:, :T].sum(1))
            noise_b = (trust + excess[:, T:].sum(1)) / (trust + n_bits - used[:, T:].sum(1))
            of_blocks = noise_b.unsqueeze(1).expand(-1, 2 * n_bits)
            noise = torch.cat([noise_t.unsqueeze(1).expand(-1, T), of_blocks], dim=1)
            shared = (projected[:, T : T + n_bits] * F[:, T + n_bits :]).sum(-1)
            given = (v[:, T:] for v in (y, noise * var, mean, variance, weight))
            llr = cavity_llr(shared, *given)
        return with_surprises(self.temperature.exp() * llr, self.surprise)

    def calibrate(self, tiles: Tensor) -> tuple[Tensor, Tensor]:
        """Legendre coefficients (B, MOMENTS + 1) of h = 1 / g' and D = g / g'.

        D is how a relative change of exposure shows in the capture.
        """
        ones = torch.ones_like(tiles[..., :1])
        legendre = torch.cat([ones, tiles[..., 1:]], dim=-1)
        ridge = self.level_ridge.exp()
        scales = [torch.full_like(ridge[:1], 1e-6), ridge[:-1]]
        if self.space:
            x, y = self.x[: tiles.shape[1]], self.y[: tiles.shape[1]]
            i = (1 + tiles[..., 1:2]) / 2
            legendre = torch.cat([legendre, torch.stack([x, y, x * x + y * y], -1) * i], dim=-1)
            scales.append(ridge[-1:].expand(3))
        ridges = 0.08 * torch.cat(scales)
        normal, right = _weighted(legendre, self.levels, torch.ones_like(tiles[..., 0]))
        c = solve_spd(normal + torch.diag(ridges), right)[:, : MOMENTS + 1]
        g = c @ self.grid.T  # (B, 65)
        rise = (g[:, 1:] - g[:, :-1]) * (len(GRID) - 1)
        slope = torch.cat([rise[:, :1], (rise[:, 1:] + rise[:, :-1]) / 2, rise[:, -1:]], dim=-1)
        slope = self.soft_floor(slope)
        return (1 / slope) @ self.project.T, (g.clamp(0, 1) / slope) @ self.project.T

    def soft_floor(self, slope: Tensor) -> Tensor:
        """softplus(slope - least) + least, in what onnxruntime has for float64."""
        above = SHARPNESS * (slope - self.least_slope.exp())
        softplus = above.relu() + (1 + (-above.abs()).exp()).log()
        return self.least_slope.exp() + softplus / SHARPNESS

    def design(
        self, statistics: Tensor, h: Tensor, D: Tensor
    ) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Columns S (B, R, 2) and N (B, R, K), change y (B, R) and its variance (B, R).

        Rows are tiles, then blocks. Columns are scaled so that their coefficients have variance 1;
        y is in gray levels.
        """
        x, y, one = self.x, self.y, torch.ones_like(statistics[..., 0])
        P = torch.cat([one.unsqueeze(-1), statistics[..., 1:]], dim=-1)
        signal, gain = (P @ h.unsqueeze(-1)).squeeze(-1), (P @ D.unsqueeze(-1)).squeeze(-1)
        S = torch.stack([signal, gain], dim=-1) * self.signal.exp()
        columns = [torch.cat([P[..., :4], gain.unsqueeze(-1)], dim=-1) * self.nuisance.exp()]
        if self.space_nuisance is not None:
            where = torch.stack([x, y, x * x, x * y, y * y], dim=-1) * gain.unsqueeze(-1)
            plane = torch.stack([x, y], dim=-1) * one.unsqueeze(-1)
            columns.append(torch.cat([where, plane], dim=-1) * self.space_nuisance.exp())
        if self.row_nuisance is not None:
            columns.append(self.of_row * gain.unsqueeze(-1) * self.row_nuisance.exp())
        log_noise = self.is_tile * self.tile_noise + (1 - self.is_tile) * self.block_noise
        variance = (2 * (P[..., :3] * log_noise).sum(-1)).exp()
        return S, torch.cat(columns, dim=-1), GRAY_LEVELS * statistics[..., 0], variance


def cavity_llr(
    shared: Tensor, y: Tensor, noise: Tensor, mean: Tensor, variance: Tensor, weight: Tensor
) -> Tensor:
    """LLR of each block's bit given all others: the fit without that block, in closed form.

    With A the 2 x 2 covariance of the two predictions (``shared`` off its diagonal), m their means
    and P the diagonal of weights with which the block entered, the cavity (Minka 2001, expectation
    propagation) is
        A' = (I - A P)^-1 A,  m' = (I - A P)^-1 (m - A P y).
    Otherwise a block that sways the fit would confirm its own label.

    Args:
        shared: (B, n_bits).
        y: (B, 2 n_bits), as are all others: first of the blocks as bit 1, then as bit 0.
        noise: variance.
        mean: predicted y.
        variance: of that prediction.
        weight: inverse variance.
    """
    (y, _), (noise, _) = y.chunk(2, 1), noise.chunk(2, 1)
    (m1, m0), (a11, a00), (p1, p0) = (v.chunk(2, 1) for v in (mean, variance, weight))
    a10 = shared
    # I - A P and its determinant
    i11, i10, i01, i00 = 1 - a11 * p1, -a10 * p0, -a10 * p1, 1 - a00 * p0
    determinant = (i11 * i00 - i10 * i01).clamp_min(1e-9)
    r1, r0 = m1 - (a11 * p1 + a10 * p0) * y, m0 - (a10 * p1 + a00 * p0) * y
    mean1, mean0 = (i00 * r1 - i10 * r0) / determinant, (i11 * r0 - i01 * r1) / determinant
    var1 = noise + (i00 * a11 - i10 * a10) / determinant
    var0 = noise + (i11 * a00 - i01 * a10) / determinant
    return ((y - mean0) ** 2 / var0 - (y - mean1) ** 2 / var1 + (var0 / var1).log()) / 2


def with_surprises(llr: Tensor, log_surprise: Tensor) -> Tensor:
    """LLR of a bit that a rare cause outside the model flips with probability surprise / 2.

    2 artanh((1 - surprise) tanh(llr / 2)): monotone, bounded by log(2 / surprise).
    """
    z = (1 - log_surprise.double().exp()) * (llr / 2).tanh()
    return ((1 + z) / (1 - z)).log()


def _logs(*values: float) -> nn.Parameter:
    return nn.Parameter(torch.tensor(values).log())


def _weighted(F: Tensor, y: Tensor, weight: Tensor) -> tuple[Tensor, Tensor]:
    """Normal equations F' W F and F' W y: (B, N, K), (B, N) or (N,), (B, N)."""
    weighted = F.transpose(1, 2) * weight.unsqueeze(1)
    right = (weighted * y.unsqueeze(-2)).sum(-1)
    return weighted @ F, right


def _positions(layout: Layout) -> dict[str, NDArray[Any]]:
    """Of tiles, then message blocks: centres in -1 to 1, row of blocks one-hot, and kind."""
    row, col = np.nonzero(layout.message_mask)
    cells = np.array(layout.ratex, np.intp).reshape(-1, 2)
    across = np.arange(TILES * TILES)
    tile_y = (TILES * cells[:, :1] + across // TILES).reshape(-1)  # (patches, 16) -> (tiles,)
    tile_x = (TILES * cells[:, 1:] + across % TILES).reshape(-1)
    size = np.array([[layout.cols], [layout.rows]])
    tiles = (2 * np.stack([tile_x, tile_y]) + 1) / (TILES * size)
    blocks = (2 * np.stack([col, row]) + 1) / size
    x, y = np.concatenate([tiles, blocks], axis=1) - 1
    rows = np.concatenate([np.repeat(cells[:, 0], TILES * TILES), row])
    is_tile = np.arange(len(rows)) < tile_y.size
    return {
        "x": x,
        "y": y,
        "of_row": np.eye(layout.rows)[rows],
        "is_tile": is_tile.astype(np.float64)[:, None],
    }


def _curves() -> dict[str, NDArray[Any]]:
    """Legendre polynomials on the grid of [0, 1], and the projection of curves on them."""
    grid = legvander(2 * GRID - 1, MOMENTS)
    return {"grid": grid, "project": np.linalg.pinv(grid)}
