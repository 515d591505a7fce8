"""Refinement on ratex patches: their tiles calibrate the response, and enter each solve.

The displayed intensities of tiles are known. They give g, the inverse of the CDTF, and h = 1 / g',
what kappa gray levels become in the capture at each intensity. The columns S of the signal start
from h (`models.phi.refine` says what S and N are).

Tiles enter the same solve as the blocks, with their known labels. The first probabilities of the
blocks are those of the SVM's decision. A block weighs more than a tile because it is larger, so two
or three rounds bring far more than the tiles alone can.
"""

from dataclasses import dataclass

import numpy as np
import torch
from numpy.polynomial.legendre import legvander
from torch import Tensor, nn
from torch.nn.functional import pad

from link.layout import Layout
from link.ratex import TILES, tile_labels, tile_levels
from models.onnx_ops import column_sum, inverse, softplus, table, times_vector
from models.phi.refine import (
    GAIN_BENDS,
    GRAY_LEVELS,
    INTENSITY_GRID,
    MOMENTS,
    Fit,
    Hypotheses,
    Refiner,
    cavity_llr,
    logs,
)

SHARPNESS = 10.0
"""How sharply the soft floor bends that keeps g' above its least value, per unit of g'."""
BENDS = 4
"""Number of columns by which the signal may depart from h: along x, along y, and with the first two
moments of i_o."""
LEAST_SHARE_OF_H = 0.4
"""Smallest signal at any place of the display, as a share of h."""
LEAST_PATCH_AMPLITUDE = 0.1
"""Gray levels that are added to the estimated amplitude of the signal, so that it is never 0."""
CERTAIN = 1e3
"""Log-likelihood ratio at which float64 holds the probability 1."""
LEAST_NOISE = 0.01
"""Standard deviation, in gray levels, that rounding to 8 bits leaves in the mean of some thousand
pixels."""


@dataclass(frozen=True)
class Rows:
    """The R rows of a frame pair's least squares, for K coefficients.

    The rows are the tiles with their labels, the blocks as bit 1, the same blocks as bit 0, and the
    priors of the coefficients, each of which says that one coefficient is 0.
    """

    rows: Tensor
    """(B, R, K) the rows."""
    columns: Tensor
    """(B, K, R) the same, transposed."""
    others: Tensor
    """(B, K, R) at each block's place the row of its other bit, and 0 elsewhere."""
    swings: Tensor
    """(B, K, R) what of each row scatters from block to block, in standard deviations."""
    y: Tensor
    """(B, 1, R) change of intensity, gray levels."""
    variance: Tensor
    """(B, 1, R) learned variance of y, squared gray levels; 1 for priors."""
    floor: Tensor
    """(1, R) variance that y has at least, squared gray levels."""


class RatexRefiner(Refiner):
    """Soft-label ridge solves over tiles and blocks; about fifty learned numbers.

    Args:
        layout: grid of blocks and ratex patches, which says where tiles and blocks lie.
        rounds: number of times that it solves and decides anew, at least 1.
        rows: whether every row of blocks has a gain of its own, for flicker and rolling shutters.
        space: whether gain, offset and g may vary smoothly over the display.
    """

    def __init__(self, layout: Layout, rounds: int, rows: bool, space: bool) -> None:
        super().__init__(rounds, rows, spread=0.03, surprise=1e-5)
        # log standard deviations of the coefficients, for frames of [0, 255] gray levels
        self.signal = logs(1.0, 0.05)
        self.bends = logs(0.15, 0.05, 0.1, 0.2) if space else None  # relative to the amplitude
        self.nuisance = logs(20.0, 20.0, 20.0, 1.5, 30.0)
        self.space_nuisance = logs(0.1, 0.3, 0.2, 0.1, 20.0, 0.01, 0.02) if space else None
        # log standard deviation of the noise: constant, linear and quadratic in i_o
        self.tile_noise = nn.Parameter(torch.tensor([-0.9, 0.0, 0.0]))
        self.block_noise = nn.Parameter(torch.tensor([-3.5, 0.0, 0.0]))
        # observations that learned noise counts for, beside this frame pair's
        self.noise_trust = logs(20.0, 20.0)
        self.level_ridge = logs(1e-4, 1e-3, 3e-2, 1e-1, 1.0)
        self.least_slope = logs(0.8)
        self.start = logs(5.0)
        # kappa takes at most a few levels off their range, which the receiver need not know
        self.levels = table(tile_levels(layout, 0).reshape(-1) / GRAY_LEVELS)
        legendre = legvander(2 * INTENSITY_GRID - 1, MOMENTS)
        self.legendre, self.project = table(legendre), table(np.linalg.pinv(legendre))
        self._tabulate_places(layout)
        kinds = "s" * len(self.signal) + "b" * (BENDS if space else 0) + "d" * len(self.nuisance)
        kinds += "d" * (GAIN_BENDS + 2 if space else 0) + "r" * (layout.rows if rows else 0)
        self._tabulate_rows(layout, kinds)

    def _tabulate_places(self, layout: Layout) -> None:
        """Tabulate where the tiles and then the blocks lie.

        Centres x and y run from -1 to 1 over the display; the waves are cosines over its rows.
        """
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
        n = layout.rows
        frequency = np.arange(n, dtype=np.float64)  # half periods over the display
        self.places = table(np.stack([x, y, x * x + y * y], axis=-1))
        self.waves = table(np.sqrt(2 / n) * np.cos(np.pi * np.outer(rows + 0.5, frequency) / n))
        self.frequency = table(frequency)
        self.is_tile = table(is_tile.astype(np.float64)[:, None])

    def _tabulate_rows(self, layout: Layout, kinds: str) -> None:
        """Tabulate what each of the R `Rows` is.

        Args:
            layout: grid of blocks and ratex patches.
            kinds: a letter for each of the K coefficients: "s" the signal, "b" its bends, "r" the
                bands of rows, "d" all else.
        """
        labels = tile_labels(layout).reshape(-1)
        tiles, n = len(labels), layout.n_bits
        row = np.array(["t"] * tiles + ["1"] * n + ["0"] * n + list(kinds))
        other = np.arange(len(row))
        other[tiles : tiles + 2 * n] = tiles + (np.arange(2 * n) + n) % (2 * n)
        is_block, is_observed = np.isin(row, ["0", "1"]), np.isin(row, ["t", "0", "1"])
        # what scales the rows' variance: the noise of tiles and of blocks, flicker, the bends'
        # spread; nothing scales the priors of all other coefficients
        scaled = np.stack([row == "t", is_block, row == "r", row == "b"]).astype(np.float64)
        # from three quantities of three kinds of rows to the three sums above and the three below
        # a line: misfit and squares, and degrees of freedom that the fit has spent
        sums = np.zeros((3, 3, 6))
        sums[0, 0, 0] = sums[0, 1, 1] = sums[2, 2, 2] = 1
        sums[1, 0, 3] = sums[1, 1, 4] = -1
        self.switched = table(np.append(labels, np.ones(n))[:, None])
        self.prior_rows = table(np.eye(len(kinds)))
        self.is_signal = table(np.isin(list(kinds), ["s", "b"]).astype(np.float64)[:, None])
        self.other = table(other)
        self.is_block = table(is_block.astype(np.float64))
        self.is_one = table((row == "1").astype(np.float64))
        self.is_observed = table(is_observed.astype(np.float64))
        self.scaled = table(scaled)
        self.unscaled = table(np.isin(row, ["s", "d"]).astype(np.float64))
        self.kinds = table(scaled[:3])
        self.sums_of_kinds = table(sums.reshape(9, 6))
        self.counts = table(np.array([0.0, 0, 0, tiles, n, kinds.count("r")]))

    def forward(self, tiles: Tensor, blocks: Tensor, scores: Tensor) -> Tensor:
        """Compute the log-likelihood ratios of the message bits.

        Args:
            tiles: (B, tiles, 1 + MOMENTS) float64: for each ratex tile the mean change of
                intensity, in [-1, 1], then the moments P_k of i_o.
            blocks: (B, n_bits, 1 + MOMENTS) float64: the mean change and the moments of each
                message block.
            scores: (B, n_bits) float64 scores of the SVM, with margins of about 1, from which the
                first probabilities are made.

        Returns:
            (B, n_bits) float64 natural log-likelihood ratios, positive for bit 1.
        """
        T, n_bits = tiles.shape[1], blocks.shape[1]
        rows = self._stack(*self.design(tiles, blocks), tiles=T)
        aimed = torch.cat([rows.columns, rows.y], dim=1)  # (B, K + 1, R)
        trust = torch.cat([self.noise_trust, self.band_trust]).double().exp()
        trusts = torch.cat([trust, trust]) + self.counts
        least = rows.floor / rows.variance
        scale, total = torch.ones_like(rows.y), rows.variance + rows.floor  # (B, 1, R)
        llr = pad(self.start.exp() * scores, (T, n_bits + len(self.prior_rows))).unsqueeze(1)
        llr = llr - self._swapped(llr)  # (B, 1, R)
        for _ in range(self.rounds):
            # whatever is no block has no other: it counts in full
            q = (llr + CERTAIN * (1 - self.is_block)).sigmoid()
            fit = self._solve(rows, aimed, q / total)
            hypotheses = self._predict(rows, fit)
            scale = self._scale(fit, hypotheses, scale + least, trusts)
            scatter = fit.mean @ rows.swings
            total = scale * rows.variance + rows.floor + scatter * scatter
            llr = cavity_llr(fit, hypotheses, total, self._swapped)
        return self.bounded(llr[:, 0, T : T + n_bits])

    def _swapped(self, rows: Tensor) -> Tensor:
        """Put what stands at a block's one place among R rows at its other place: (B, _, R)."""
        return rows.index_select(2, self.other)

    def _stack(self, S: Tensor, N: Tensor, y: Tensor, variance: Tensor, tiles: int) -> Rows:
        """Stack the rows that `design` gives, as bit 1 and as bit 0, and those of the priors."""
        K = len(self.prior_rows)
        S = torch.cat([S * self.switched, 0 * S[:, tiles:]], dim=1)  # blocks as bit 0 come last
        observed = torch.cat([S, torch.cat([N, N[:, tiles:]], dim=1)], dim=-1)
        rows = torch.cat([observed, self.prior_rows.expand(S.shape[0], -1, -1)], dim=1)
        y, variance = (torch.cat([v, v[:, tiles:]], dim=1).unsqueeze(1) for v in (y, variance))
        columns = rows.transpose(1, 2)  # (B, K, R)
        return Rows(
            rows,
            columns,
            others=self._swapped(columns) * self.is_block,
            swings=columns * self.is_signal * (self.is_one * self.spread.double().exp()),
            y=pad(y, (0, K)),
            variance=pad(variance, (0, K), value=1.0),
            floor=LEAST_NOISE**2 * self.is_observed,
        )

    def _solve(self, rows: Rows, aimed: Tensor, weight: Tensor) -> Fit:
        """Solve the least squares; ``aimed`` are their columns and y, (B, K + 1, R)."""
        normal = (aimed * weight) @ rows.rows  # (B, K + 1, K)
        K = normal.shape[2]
        covariance = inverse(normal[:, :K])
        return Fit(covariance, normal[:, K:] @ covariance, weight)

    def _predict(self, rows: Rows, fit: Fit) -> Hypotheses:
        """Predict the change of every row from a fit; all results are (B, 1, R)."""
        residual = rows.y - fit.mean @ rows.columns
        projected = fit.covariance @ rows.columns
        variance, shared = (column_sum(projected * v) for v in (rows.columns, rows.others))
        return Hypotheses(residual, variance, shared)

    def _scale(self, fit: Fit, hypotheses: Hypotheses, expected: Tensor, trusts: Tensor) -> Tensor:
        """Estimate noise, flicker and amplitude of this frame pair, degrees of freedom allowed for.

        They become the (B, 1, R) variance of each row, relative to the learned one, as ``expected``
        was in this fit. The (6,) ``trusts`` are what sums above and below a line begin with: the
        observations that learned spreads count for, and below also those of the frame pair.
        """
        square = hypotheses.residual * hypotheses.residual
        says = [fit.weight * expected * square, fit.weight * hypotheses.variance]
        says.append(square + hypotheses.variance)
        of_kinds = (torch.cat(says, dim=1) @ self.kinds.T).reshape(-1, 1, 9)  # from (B, 3, 3)
        sums = of_kinds @ self.sums_of_kinds + trusts
        amplitude = (self.signal[0].exp() * fit.mean[..., :1]).abs() + LEAST_PATCH_AMPLITUDE
        levels = [sums[..., :3] / sums[..., 3:], amplitude * amplitude]
        return torch.cat(levels, dim=-1) @ self.scaled + self.unscaled

    def calibrate(self, tiles: Tensor) -> tuple[Tensor, Tensor]:
        """Fit g, the inverse of the CDTF, to the captured levels of the tiles.

        Args:
            tiles: (B, tiles, 1 + MOMENTS) float64, as `forward` takes them.

        Returns:
            curves: (B, MOMENTS + 1, 2) Legendre coefficients of h = 1 / g' and of h^2.
            tilt: (B, 3) amounts by which g' grows with x, y and x^2 + y^2; (B, 0) where the
                calibration does not vary over the display.
        """
        terms = pad(tiles[..., 1:], (1, 0), value=1.0)  # (B, tiles, MOMENTS + 1)
        ridge = self.level_ridge.exp()
        scales = [torch.full_like(ridge[:1], 1e-6), ridge[:-1]]
        if self.space_nuisance is not None:
            i = (1 + tiles[..., 1:2]) / 2
            terms = torch.cat([terms, self.places[: tiles.shape[1]] * i], dim=-1)
            scales.append(ridge[-1:].expand(3))
        columns = terms.transpose(1, 2)
        # 0.08, chosen by hand, is the unit of the ridges: these are learned, so only the product
        # counts, but for the constant, whose ridge is as good as none
        normal = columns @ terms + torch.diag(0.08 * torch.cat(scales))
        aimed = (columns * self.levels).sum(-1).unsqueeze(-1)
        solution = (inverse(normal) @ aimed).squeeze(-1)
        c, tilt = solution[:, : MOMENTS + 1], solution[:, MOMENTS + 1 :]
        g = c @ self.legendre.T  # (B, 65)
        rise = (g[:, 1:] - g[:, :-1]) * (len(INTENSITY_GRID) - 1)
        slope = torch.cat([rise[:, :1], (rise[:, 1:] + rise[:, :-1]) / 2, rise[:, -1:]], dim=-1)
        h = 1 / self._soft_floor(slope)
        return self.project @ torch.stack([h, h * h], dim=-1), tilt

    def _soft_floor(self, slope: Tensor) -> Tensor:
        """Keep slopes above their learned least value, as softplus(slope - least) + least does."""
        least = self.least_slope.exp()
        return least + softplus(SHARPNESS * (slope - least)) / SHARPNESS

    def design(self, tiles: Tensor, blocks: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Build the linear model of a frame pair, whose R rows are its tiles and then its blocks.

        Columns are scaled so that their coefficients have variance 1. The coefficients of the bends
        have the square of the signal's amplitude as their variance instead.

        Args:
            tiles: (B, tiles, 1 + MOMENTS) float64, as `forward` takes them.
            blocks: (B, n_bits, 1 + MOMENTS) float64, as `forward` takes them.

        Returns:
            S: (B, R, 2 or 2 + BENDS) columns that a bit 1 switches on.
            N: (B, R, K) columns that count whatever the bit.
            y: (B, R) change of intensity, gray levels.
            variance: (B, R) learned variance of y, squared gray levels.
        """
        curves, tilt = self.calibrate(tiles)
        statistics = torch.cat([tiles, blocks], dim=1)
        P = pad(statistics[..., 1:], (1, 0), value=1.0)  # (B, R, MOMENTS + 1)
        gain = times_vector(P, self.exposure.double())  # (B, R, 1)
        signal = self._response(P @ curves, tilt)
        S = torch.cat([signal, gain], dim=-1) * self.signal.exp()
        if self.bends is not None:
            bends = torch.cat([self.places[:, :2].expand(P.shape[0], -1, -1), P[..., 1:3]], dim=-1)
            S = torch.cat([S, bends * (signal * self.bends.double().exp())], dim=-1)
        log_noise = self.is_tile * self.tile_noise + (1 - self.is_tile) * self.block_noise
        variance = (2 * (P[..., :3] * log_noise).sum(-1)).exp()
        return S, self._nuisances(P, gain), GRAY_LEVELS * statistics[..., 0], variance

    def _response(self, curves: Tensor, tilt: Tensor) -> Tensor:
        """Give what kappa becomes at each row, (B, R, 1), by its h and h^2, (B, R, 2).

        g' grows by tilt . (x, y, x^2 + y^2), so h = 1 / g' falls by h^2 times that.
        """
        h, square = curves[..., :1], curves[..., 1:]
        if self.space_nuisance is None:
            return h
        least = LEAST_SHARE_OF_H * h
        return least + (h - (self.places @ tilt.unsqueeze(-1)) * square - least).relu()

    def _nuisances(self, P: Tensor, gain: Tensor) -> Tensor:
        """Build the (B, R, K) columns N: offset by tone and place, gain by place and row."""
        x, y = self.places[:, :1], self.places[:, 1:2]  # (R, 1) each
        nuisance = self.nuisance.double().exp()
        columns, gains = [P[..., :4] * nuisance[:4]], [torch.ones_like(x) * nuisance[4]]
        if self.space_nuisance is not None:
            scale = self.space_nuisance.double().exp()
            offset = self.places[:, :2] * scale[GAIN_BENDS:]
            columns.append(offset.expand(P.shape[0], -1, -1))
            gains.append(torch.cat([x, y, x * x, x * y, y * y], dim=-1) * scale[:GAIN_BENDS])
        if self.bands is not None:
            gains.append(self.row_gains(self.bands))
        columns.append(gain * torch.cat(gains, dim=-1))
        return torch.cat(columns, dim=-1)
