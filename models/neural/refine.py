"""Decision-directed refinement: the message blocks become training data of further convex solves.

A block's brightness change is modelled as
    y = b s + d + noise,    s = S a,    d = N c,
with bit b, known columns S and N, and Gaussian a and c of known spread. S holds what kappa gray
levels become in the capture, h(i) = 1 / g'(i), and how that bends with intensity and place. N holds
what drift, flicker and fall-off add.

Given the bits, or their probabilities, a and c follow from one ridge solve. Given a and c, the bits
follow from a likelihood ratio. Ratex tiles enter the same solve with their known labels. The first
probabilities are those of the SVM's decision. A block weighs more than a tile because it is larger,
so two or three rounds bring far more than the tiles alone can. Each round also estimates how large
kappa, flicker and noise are in this frame pair; the next round takes that for their spread.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from numpy.polynomial.legendre import legvander
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn.functional import pad

from link.layout import Layout
from link.ratex import TILES, tile_labels, tile_levels
from models.neural.solver import inverse, solve_spd

MOMENTS = 4
"""Number of Legendre moments of i_o over a tile or block. It is also the degree of the inverse
response g here, and of the polynomial on which 1 / g' is projected."""
GRID = np.linspace(0, 1, 65)
"""Intensities in [0, 1] at which the curves g and 1 / g' are evaluated."""
SHARPNESS = 10.0
"""How sharply the soft floor bends that keeps g' above its least value, per unit of g'."""
GRAY_LEVELS = 255.0
"""Number of gray levels that make the intensity 1."""
BENDS = 4
"""Number of columns by which the signal may depart from h: along x, along y, and with the first two
moments of i_o."""
LEAST_SIGNAL = 0.4
"""Smallest signal at any place of the display, as a share of h."""
LEAST_AMPLITUDE = 0.1
"""Gray levels that are added to the estimated amplitude of the signal, so that it is never 0."""
CERTAIN = 1e3
"""Log-likelihood ratio at which float64 holds the probability 1."""
LEAST_NOISE = 0.01
"""Standard deviation, in gray levels, that rounding to 8 bits leaves in the mean of some thousand
pixels."""


class Refiner(nn.Module):
    """Soft-label ridge solves over tiles and blocks; about fifty learned numbers.

    Args:
        layout: grid of blocks and ratex patches, which says where tiles and blocks lie.
        rounds: number of times that it solves and decides anew, at least 1.
        rows: whether every row of blocks has a gain of its own, for flicker and rolling shutters.
        space: whether gain, offset and g may vary smoothly over the display.
    """

    levels: Tensor
    places: Tensor
    waves: Tensor
    frequency: Tensor
    is_tile: Tensor
    grid: Tensor
    project: Tensor
    diagonal: Tensor
    switched: Tensor
    other: Tensor
    is_block: Tensor
    is_one: Tensor
    is_observed: Tensor
    is_signal: Tensor
    scales: Tensor
    fixed: Tensor
    kinds: Tensor
    sums: Tensor
    counts: Tensor

    def __init__(self, layout: Layout, rounds: int, rows: bool, space: bool) -> None:
        super().__init__()
        self.rounds, self.space = rounds, space
        # log standard deviations of the coefficients, for frames of [0, 255] gray levels
        self.signal = _logs(1.0, 0.05)
        self.bends = _logs(0.15, 0.05, 0.1, 0.2) if space else None  # relative to the amplitude
        self.nuisance = _logs(20.0, 20.0, 20.0, 1.5, 30.0)
        self.space_nuisance = _logs(0.1, 0.3, 0.2, 0.1, 20.0, 0.01, 0.02) if space else None
        # log standard deviation of the bands' mean, and how it falls with their frequency
        self.bands = nn.Parameter(torch.tensor([0.0, -0.4])) if rows else None
        # what a relative change of exposure adds, as Legendre coefficients in i_o: a camera's toe
        # and shoulder make it a hump; the start is the mean of the cameras of data_gen/pairs.py
        self.exposure = nn.Parameter(torch.tensor([0.7, 0.25, -0.5, -0.1, 0.0]))
        # log standard deviation of the noise: constant, linear and quadratic in i_o
        self.tile_noise = nn.Parameter(torch.tensor([-0.9, 0.0, 0.0]))
        self.block_noise = nn.Parameter(torch.tensor([-3.5, 0.0, 0.0]))
        # log relative standard deviation of the signal from block to block
        self.spread = _logs(0.03)
        # observations that learned noise and learned bands count for, beside this frame pair's
        self.noise_trust = _logs(20.0, 20.0)
        self.band_trust = _logs(8.0)
        self.level_ridge = _logs(1e-4, 1e-3, 3e-2, 1e-1, 1.0)
        self.least_slope = _logs(0.8)
        self.start = _logs(5.0)
        self.temperature = _logs(1.0)
        self.surprise = _logs(1e-5)
        rest = 5 + (7 if space else 0)
        kinds = "s" * 2 + "b" * (BENDS if space else 0) + "d" * rest
        kinds += "r" * (layout.rows if rows else 0)
        for name, value in {**_positions(layout), **_curves(), **_rows(layout, kinds)}.items():
            self.register_buffer(name, torch.from_numpy(value), persistent=False)
        # kappa takes at most a few levels off their range, which the receiver need not know
        levels = torch.from_numpy(tile_levels(layout, 0).reshape(-1) / GRAY_LEVELS)
        self.register_buffer("levels", levels, persistent=False)

    def forward(
        self, tiles: Tensor, blocks: Tensor, scores: Tensor, together: bool = False
    ) -> Tensor:
        """Compute the log-likelihood ratios of the message bits.

        Args:
            tiles: (B, tiles, 1 + MOMENTS) float64: for each ratex tile the mean change of
                intensity, in [-1, 1], then the moments P_k of i_o.
            blocks: (B, n_bits, 1 + MOMENTS) float64: the mean change and the moments of each
                message block.
            scores: (B, n_bits) float64 scores of the SVM, with margins of about 1, from which the
                first probabilities are made.
            together: whether the batch holds captures of one frame pair, whose bits are the same.

        Returns:
            (B, n_bits) float64 natural log-likelihood ratios, positive for bit 1. Those of captures
            that are fitted together are still what each capture says by itself, and add.
        """
        T, n_bits = tiles.shape[1], blocks.shape[1]
        S, N, y, var = self.design(tiles, blocks)
        K = S.shape[-1] + N.shape[-1]
        # rows: tiles with their labels, blocks as bit 1, the same blocks as bit 0; and the priors
        # of the coefficients, each of which says that one coefficient is 0
        S = torch.cat([S * self.switched, 0 * S[:, T:]], dim=1)
        observed = torch.cat([S, torch.cat([N, N[:, T:]], dim=1)], dim=-1)
        rows = torch.cat([observed, self.diagonal.expand(S.shape[0], -1, -1)], dim=1)
        y, var = (torch.cat([v, v[:, T:]], dim=1).unsqueeze(1) for v in (y, var))
        y, var = pad(y, (0, K)), pad(var, (0, K), value=1.0)  # (B, 1, R)
        columns = rows.transpose(1, 2)  # (B, K, R)
        others = columns.index_select(2, self.other) * self.is_block
        swings = columns * self.is_signal * (self.is_one * self.spread.double().exp())
        aimed = torch.cat([columns, y], dim=1)
        ones, floor = torch.ones_like(self.diagonal[:1]), LEAST_NOISE**2 * self.is_observed
        trust = torch.cat([self.noise_trust, self.band_trust]).double().exp()
        trusts = torch.cat([trust, trust]) + self.counts
        least = floor / var
        scale, total = torch.ones_like(y), var + floor
        llr = pad(self.start.exp() * scores, (T, n_bits + K)).unsqueeze(1)
        llr = llr - llr.index_select(2, self.other)
        for _ in range(self.rounds):
            # whatever is no block has no other: it counts in full
            q = (said_of_bits(llr, together) + CERTAIN * (1 - self.is_block)).sigmoid()
            weight = q / total
            normal = (aimed * weight) @ rows  # (B, K + 1, K)
            covariance = inverse(normal[:, :K])
            solution = normal[:, K:] @ covariance  # (B, 1, K)
            residual = y - solution @ columns
            projected = covariance @ columns
            doubt = ones @ (projected * columns)  # variance that the coefficients leave in the mean
            shared = ones @ (projected * others)
            # what this frame pair says of its own: amplitude, flicker, and noise relative to the
            # learned one, degrees of freedom allowed for
            square = residual * residual
            says = [weight * (scale + least) * square, weight * doubt, square + doubt]
            sums = (torch.cat(says, dim=1) @ self.kinds.T).reshape(-1, 1, 9) @ self.sums + trusts
            amplitude = (self.signal[0].exp() * solution[..., :1]).abs() + LEAST_AMPLITUDE
            levels = [sums[..., :3] / sums[..., 3:], amplitude * amplitude]
            scale = torch.cat(levels, dim=-1) @ self.scales + self.fixed
            scatter = solution @ swings
            total = scale * var + floor + scatter * scatter
            llr = cavity_llr(
                shared, residual, total, doubt, weight, lambda v: v.index_select(2, self.other)
            )
        llr = llr[:, 0, T : T + n_bits]
        return with_surprises(self.temperature.exp() * llr, self.surprise)

    def calibrate(self, tiles: Tensor) -> tuple[Tensor, Tensor]:
        """Fit g, the inverse of the CDTF, to the captured levels of the tiles.

        Args:
            tiles: (B, tiles, 1 + MOMENTS) float64, as `forward` takes them.

        Returns:
            curves: (B, MOMENTS + 1, 2) Legendre coefficients of h = 1 / g' and of h^2.
            tilt: (B, 3) amounts by which g' grows with x, y and x^2 + y^2; (B, 0) where the
                calibration does not vary over the display.
        """
        ones = torch.ones_like(tiles[..., :1])
        legendre = torch.cat([ones, tiles[..., 1:]], dim=-1)
        ridge = self.level_ridge.exp()
        scales = [torch.full_like(ridge[:1], 1e-6), ridge[:-1]]
        if self.space:
            i = (1 + tiles[..., 1:2]) / 2
            legendre = torch.cat([legendre, self.places[: tiles.shape[1]] * i], dim=-1)
            scales.append(ridge[-1:].expand(3))
        ridges = 0.08 * torch.cat(scales)
        normal, right = _weighted(legendre, self.levels, torch.ones_like(tiles[..., 0]))
        solution = solve_spd(normal + torch.diag(ridges), right)
        c, tilt = solution[:, : MOMENTS + 1], solution[:, MOMENTS + 1 :]
        g = c @ self.grid.T  # (B, 65)
        rise = (g[:, 1:] - g[:, :-1]) * (len(GRID) - 1)
        slope = torch.cat([rise[:, :1], (rise[:, 1:] + rise[:, :-1]) / 2, rise[:, -1:]], dim=-1)
        h = 1 / self.soft_floor(slope)
        return self.project @ torch.stack([h, h * h], dim=-1), tilt

    def soft_floor(self, slope: Tensor) -> Tensor:
        """Keep slopes above their learned least value, as softplus(slope - least) + least does.

        It is made of operations that onnxruntime has for float64.
        """
        above = SHARPNESS * (slope - self.least_slope.exp())
        softplus = above.relu() + (1 + (-above.abs()).exp()).log()
        return self.least_slope.exp() + softplus / SHARPNESS

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
        P = pad(statistics[..., 1:], (1, 0), value=1.0)
        x, y = self.places[:, :1], self.places[:, 1:2]
        # as a matrix of one column: onnxruntime 1.31 gets a transposed matrix times a vector wrong
        gain = P @ self.exposure.double().unsqueeze(-1)
        both = P @ curves
        signal, square = both[..., :1], both[..., 1:]
        nuisance = self.nuisance.double().exp()
        columns, gains = [P[..., :4] * nuisance[:4]], [torch.ones_like(x) * nuisance[4]]
        if self.bends is not None and self.space_nuisance is not None:
            # g' grows by tilt . (x, y, x^2 + y^2), so h = 1 / g' falls by h^2 times that
            least = LEAST_SIGNAL * signal
            signal = least + (signal - (self.places @ tilt.unsqueeze(-1)) * square - least).relu()
            scale = self.space_nuisance.double().exp()
            columns.append((self.places[:, :2] * scale[5:]).expand(P.shape[0], -1, -1))
            gains.append(torch.cat([x, y, x * x, x * y, y * y], dim=-1) * scale[:5])
        if self.bands is not None:
            gains.append(self.waves * (self.bands[0] + self.bands[1] * self.frequency).exp())
        S = torch.cat([signal, gain], dim=-1) * self.signal.exp()
        if self.bends is not None:
            bends = torch.cat([self.places[:, :2].expand(P.shape[0], -1, -1), P[..., 1:3]], dim=-1)
            S = torch.cat([S, bends * (signal * self.bends.double().exp())], dim=-1)
        columns.append(gain * torch.cat(gains, dim=-1))
        log_noise = self.is_tile * self.tile_noise + (1 - self.is_tile) * self.block_noise
        variance = (2 * (P[..., :3] * log_noise).sum(-1)).exp()
        return S, torch.cat(columns, dim=-1), GRAY_LEVELS * statistics[..., 0], variance


def said_of_bits(llr: Tensor, together: bool) -> Tensor:
    """Add up what captures of one frame pair say of its bits.

    Args:
        llr: (B, n_bits) log-likelihood ratios, by what each frame pair says.
        together: whether the batch holds captures of one frame pair, whose bits are the same.

    Returns:
        (B, n_bits) log-likelihood ratios by all that is known of each frame pair's bits.

    >>> said_of_bits(torch.tensor([[1.0, 2.0], [3.0, -3.0]]), together=True)
    tensor([[ 4., -1.],
            [ 4., -1.]])
    """
    return llr.sum(0, keepdim=True).expand_as(llr) if together else llr


def cavity_llr(
    shared: Tensor,
    residual: Tensor,
    noise: Tensor,
    variance: Tensor,
    weight: Tensor,
    swapped: Callable[[Tensor], Tensor],
) -> Tensor:
    """Compute the LLR of each block's bit from a fit to all other blocks, in closed form.

    Let A be the 2 x 2 covariance of the block's two predictions, as bit 1 and as bit 0, r their
    residuals, and P the diagonal of the weights with which the block entered the fit. The fit
    without the block, its cavity (Minka 2001, expectation propagation), has
        A' = (I - A P)^-1 A,  r' = (I - A P)^-1 r.
    Without it, a block that sways the fit would confirm its own label.

    All tensors have the same shape. Each block has two places in them, one for each bit.

    Args:
        shared: covariance of the two predictions of each block, at both its places.
        residual: change less its prediction, gray levels.
        noise: variance of the noise, squared gray levels.
        variance: variance of the prediction, squared gray levels.
        weight: inverse variance with which the row entered the fit.
        swapped: puts what stands at a block's one place at its other place.

    Returns:
        natural log-likelihood ratios, positive at the place of the bit that is likelier.
    """
    own, cross = 1 - variance * weight, shared * weight  # I - A P: diagonal, and less the rest
    other, across = swapped(own), swapped(cross)
    determinant = own * other - cross * across
    moved = other * residual + across * swapped(residual)
    spread = noise * determinant + other * variance + across * shared
    # both are too large by the determinant, which is the same for both bits
    cost = moved * moved / (determinant * spread) + spread.log()
    return (swapped(cost) - cost) / 2


def with_surprises(llr: Tensor, log_surprise: Tensor) -> Tensor:
    """Bound LLRs by allowing for a rare cause outside the model.

    With probability ``surprise`` the bit is drawn anew, so that the LLR becomes
    2 artanh((1 - surprise) tanh(llr / 2)). It is monotone and stays within log(2 / surprise).

    Args:
        llr: natural log-likelihood ratios, any shape, float64.
        log_surprise: (1,) log of the probability of a surprise.

    Returns:
        natural log-likelihood ratios with the shape of ``llr``.

    >>> bounded = with_surprises(torch.tensor([2.0, 1000.0]), torch.tensor([-5.0]))
    >>> [round(llr, 4) for llr in bounded.tolist()]
    [1.9758, 5.6898]
    """
    z = (1 - log_surprise.double().exp()) * (llr / 2).tanh()
    return ((1 + z) / (1 - z)).log()


def _logs(*values: float) -> nn.Parameter:
    return nn.Parameter(torch.tensor(values).log())


def _weighted(F: Tensor, y: Tensor, weight: Tensor) -> tuple[Tensor, Tensor]:
    """Set up the normal equations F' W F (B, K, K) and F' W y (B, K) of weighted least squares.

    F is (B, N, K), y is (B, N) or (N,), and the weights are (B, N).
    """
    weighted = F.transpose(1, 2) * weight.unsqueeze(1)
    right = (weighted * y.unsqueeze(-2)).sum(-1)
    return weighted @ F, right


def _positions(layout: Layout) -> dict[str, NDArray[Any]]:
    """Describe where the tiles and then the blocks lie, by the names of the Refiner's buffers.

    Centres x and y run from -1 to 1 over the display; ``waves`` are cosines over the block rows.
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
    waves = np.sqrt(2 / n) * np.cos(np.pi * np.outer(rows + 0.5, frequency) / n)
    return {
        "places": np.stack([x, y, x * x + y * y], axis=-1),
        "waves": waves,
        "frequency": frequency,
        "is_tile": is_tile.astype(np.float64)[:, None],
    }


def _rows(layout: Layout, kinds: str) -> dict[str, NDArray[Any]]:
    """Describe the rows of the Refiner's least squares, by the names of its buffers.

    The rows are the tiles, the blocks as bit 1, the blocks as bit 0, and the priors of the
    coefficients.

    Args:
        layout: grid of blocks and ratex patches.
        kinds: a letter for each coefficient: "s" the signal, "b" its bends, "r" the bands of rows,
            "d" all else.
    """
    labels = tile_labels(layout).reshape(-1)
    tiles, n, K = len(labels), layout.n_bits, len(kinds)
    row = np.array(["t"] * tiles + ["1"] * n + ["0"] * n + list(kinds))
    other = np.arange(len(row))
    other[tiles : tiles + 2 * n] = tiles + (np.arange(2 * n) + n) % (2 * n)
    is_block = np.isin(row, ["0", "1"])
    # what scales the rows' variance: the noise of tiles and of blocks, flicker, the bends' spread
    scales = np.stack([row == "t", is_block, row == "r", row == "b"])
    sums = np.zeros((3, 3, 6))  # from quantity and kind to three sums above and three below a line
    sums[0, 0, 0] = sums[0, 1, 1] = sums[2, 2, 2] = 1
    sums[1, 0, 3] = sums[1, 1, 4] = -1
    return {
        "diagonal": np.eye(K),
        "switched": np.append(labels, np.ones(n))[:, None],
        "other": other,
        "is_block": is_block.astype(np.float64),
        "is_one": (row == "1").astype(np.float64),
        "is_observed": (np.arange(len(row)) < tiles + 2 * n).astype(np.float64),
        "is_signal": np.isin(list(kinds), ["s", "b"]).astype(np.float64)[:, None],
        "scales": scales.astype(np.float64),
        "fixed": np.isin(row, ["s", "d"]).astype(np.float64),
        "kinds": scales[:3].astype(np.float64),
        "sums": sums.reshape(9, 6),
        "counts": np.array([0.0, 0, 0, tiles, n, kinds.count("r")]),
    }


def _curves() -> dict[str, NDArray[Any]]:
    """Tabulate Legendre polynomials on `GRID`, and the matrix that projects curves on them."""
    grid = legvander(2 * GRID - 1, MOMENTS)
    return {"grid": grid, "project": np.linalg.pinv(grid)}
