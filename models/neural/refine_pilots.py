"""Decision-directed refinement on pilots: known blocks start it, the message's blocks finish it.

The change of a block's intensity is modelled as
    y = m S a + N c + noise,
with m the block's change in units of kappa (`link.layout.MODULATIONS`), known columns S and N, and
Gaussian a and c of learned spread. S holds what kappa gray levels become in the capture, and how
that bends with intensity and place. N holds what changes whatever the bit: drift, flicker and
fall-off, the motion and blur that registration left (by the picture's gradients), and the light
that neighbouring blocks spill over.

The first ridge solve sees the pilots alone. Its likelihood ratios give the message's bits their
probabilities, with which all blocks enter the next solve. On fine grids each solve is followed by
an estimate of the waves that moire and flicker leave in the residuals (`models.neural.ripple`),
which the next solve takes for granted.

`models.neural.refine` starts from ratex patches, whose displayed intensities are known, and so
knows the response beforehand; here the response is a learned typical curve, and each frame pair's
own blocks bend it.
"""

import numpy as np
import torch
from numpy.polynomial.legendre import legfit
from torch import Tensor, nn
from torch.nn.functional import pad

from link.layout import Layout
from models.neural.refine import (
    GRAY_LEVELS,
    GRID,
    MOMENTS,
    cavity_llr,
    said_of_bits,
    with_surprises,
)
from models.neural.ripple import Ripple
from models.neural.solver import inverse

TEXTURES = 5
"""Number of statistics that tell a block's texture: the gradients along x and y, the curvature, the
squared gradient, and the mean weight of its pixels."""
STATISTICS = 1 + MOMENTS + TEXTURES
"""Number of statistics of a block: the change of intensity, the moments P_k of i_o, the texture."""
BANDS = 8
"""Largest number of cosines over the rows of the display that flicker may be made of."""
LEAST_RESPONSE = 0.15
"""Smallest response to kappa at any intensity, relative to about its largest."""
LEAST_AMPLITUDE = 0.05
"""Gray levels that are added to the estimated amplitude of the signal, so that it is never 0."""


class PilotRefiner(nn.Module):
    """Soft-label ridge solves over pilots and message blocks; about fifty learned numbers.

    Args:
        layout: grid with pilots, which says where the blocks lie and how bits change them.
        pixels: number of pixels in a block, as they are counted where noise is averaged.
        rounds: number of solves over all blocks after the first, at least 1.
        rows: whether flicker may vary over the rows of the display.
        space: whether signal, gain and offset may vary smoothly over the display.
    """

    places: Tensor
    bends_of_place: Tensor
    waves: Tensor
    frequency: Tensor
    changes: Tensor
    known: Tensor
    unknown: Tensor
    beside: Tensor
    order: Tensor
    rank: Tensor
    bands_alone: Tensor
    two_sums: Tensor
    three_sums: Tensor
    times: Tensor
    free: Tensor
    change_alone: Tensor
    priors: Tensor

    def __init__(self, layout: Layout, pixels: float, rounds: int, rows: bool, space: bool) -> None:
        super().__init__()
        self.layout, self.pixels, self.rounds = layout, pixels, rounds
        fine = Ripple.fits(layout.rows, layout.cols)
        self.ripple = Ripple(layout.rows, layout.cols) if fine else None
        # typical response to kappa, as Legendre coefficients in i_o: flat at black and white
        i = GRID
        response = 2 * np.sqrt((i + 0.02) * (1.02 - i)) / 1.04
        self.response = nn.Parameter(torch.from_numpy(legfit(2 * i - 1, response, MOMENTS)).float())
        # log standard deviations of the coefficients, in gray levels of [0, 255] or relative
        self.amplitude = _logs(1.5)
        self.bends = _logs(0.4, 0.4, 0.2)
        self.tilts = _logs(0.15, 0.15) if space else None
        self.nuisance = _logs(5.0, 8.0, 5.0, 3.0, 2.0, 5.0)
        self.space_nuisance = _logs(0.5, 0.5, 0.5, 0.5, 0.5, 0.3, 0.3) if space else None
        self.bands = nn.Parameter(torch.tensor([0.0, -0.4])) if rows else None
        self.motion = _logs(0.15, 0.05, 0.05, 0.15, 0.05, 0.05, 0.1)
        self.spill = _logs(0.1, 0.1)
        # what a relative change of exposure adds, as Legendre coefficients in i_o
        self.exposure = nn.Parameter(torch.tensor([0.7, 0.25, -0.5, -0.1, 0.0]))
        # log standard deviation of a pixel's noise: constant, linear and quadratic in i_o
        self.pixel_noise = nn.Parameter(torch.tensor([0.5, 0.0, 0.0]))
        # noise that a block's mean keeps, gray levels; jitter of single pixels and of whole blocks
        self.block_noise = _logs(0.03)
        self.jitter = _logs(0.05, 0.02)
        self.spread = _logs(0.05)
        self.noise_trust = _logs(20.0)
        self.band_trust = _logs(8.0)
        self.temperature = _logs(1.0)
        self.surprise = _logs(1e-4)
        n_bands = min(BANDS, layout.rows) if rows else 0
        n_other = len(self.nuisance) + (7 if space else 0) + len(self.motion)
        message = layout.message_mask.reshape(-1).nonzero()[0]
        order = np.concatenate([layout.pilot_blocks, message])  # numbers of the blocks
        row, col = np.divmod(order, layout.cols)
        # where each block's neighbours stand among them: left, above, right, below; R where none
        place = np.full((layout.rows + 2, layout.cols + 2), len(order))
        place[row + 1, col + 1] = np.arange(len(order))
        ways = ((1, 0), (0, 1), (1, 2), (2, 1))
        neighbours = np.concatenate([place[row + down, col + along] for down, along in ways])
        frequency = np.arange(n_bands)
        waves = np.cos(np.pi * np.outer(row + 0.5, frequency) / layout.rows) / 2
        rank = np.argsort(order)  # where each block of the grid stands among them
        bits = np.concatenate([layout.pilot_bits, np.full(len(message), np.nan)])
        low, high = layout.change_of_bits
        x, y = (2 * col + 1) / layout.cols - 1, (2 * row + 1) / layout.rows - 1
        n_signal, n_spill = 1 + len(self.bends) + (2 if space else 0), len(self.spill)
        # coefficients: bands, other nuisances, the change of intensity, the signal, spilled light
        kinds = np.repeat([1, 2, 2, 0, 2], [n_bands, n_other, 1, n_signal, n_spill])
        change = np.arange(len(kinds)) == n_bands + n_other
        ends = np.repeat(np.eye(3), [n_signal, n_spill, 1], axis=0).T
        for name, value in (
            ("places", np.stack([np.ones_like(x), x, y])),
            ("bends_of_place", np.stack([x, y, x * x, x * y, y * y])),
            ("waves", waves.T),
            ("frequency", frequency.astype(np.float64)[:, None]),
            # by hypothesis, bit 1 and bit 0: its change in units of kappa, and what pilots are
            ("changes", np.array([[high], [low]], np.float64)),
            ("known", np.stack([bits == 1, bits == 0]).astype(np.float64)),
            ("unknown", np.isnan(bits).astype(np.float64)),
            ("beside", neighbours),
            ("order", order),
            ("rank", rank),
            ("bands_alone", np.eye(n_bands)),
            ("two_sums", np.delete(ends[[0, 2]], np.s_[n_signal:-1], axis=1)),
            ("three_sums", ends),
            ("times", np.repeat([1.0, 2.0], [n_signal, n_spill])[:, None]),
            ("free", 1.0 - (change | change[:, None])),
            ("change_alone", change.astype(np.float64)),
            ("priors", np.stack([np.diag(kinds == kind) for kind in range(3)]).astype(np.float64)),
        ):
            self.register_buffer(name, torch.from_numpy(value), persistent=False)

    def forward(self, pilots: Tensor, blocks: Tensor, together: bool = False) -> Tensor:
        """Compute the log-likelihood ratios of the message bits.

        Args:
            pilots: (B, pilots, STATISTICS) float64 statistics of the pilots.
            blocks: (B, n_bits, STATISTICS) float64 statistics of the message blocks.
            together: whether the batch holds captures of one frame pair, whose bits are the same.

        Returns:
            (B, n_bits) float64 natural log-likelihood ratios, positive for bit 1. Those of captures
            that are fitted together are still what each capture says by itself, and add.
        """
        P, R = pilots.shape[1], pilots.shape[1] + blocks.shape[1]
        S, N, variance = self.design(torch.cat([pilots, blocks], dim=1))
        k, n = S.shape[1], N.shape[1]
        # of a block's predictions: variance as bit 1, variance as bit 0, covariance; by their parts
        m, both = self.changes, self.changes.sum()
        of_signal = torch.cat([m * m, m[:1] * m[1:]])
        of_product = torch.cat([2 * m, both.reshape(1, 1)])
        relative = (2 * self.spread.double()).exp() * m * m
        trust, trust_r = self.noise_trust.double().exp(), self.band_trust.double().exp()
        ones = torch.ones_like(variance)
        amplitude = ones[..., :1] * self.amplitude.double().exp()
        noise = flicker = torch.ones_like(amplitude)
        # pilots alone, before anything is known of the other blocks
        weight, counted = self.known[:, :P] / variance[..., :P], P
        covariance, solution = self.solve(S[..., :P], N[..., :P], None, weight, amplitude, flicker)
        weight = pad(weight, (0, R - P))
        S_one = torch.cat([S, ones], dim=1)
        spilled: Tensor | None = None
        change, ripple = N[:, -1:], torch.zeros_like(variance)
        for left in reversed(range(1 + self.rounds)):
            # a row of `covariance` below makes a share of the variance that the coefficients leave
            # in a prediction, and the mean of the coefficients, beside it, makes the prediction
            of_S = torch.cat([covariance[:, n : n + k, n : n + k], solution[..., n : n + k]], dim=1)
            in_signal, signal = (self.two_sums @ ((of_S @ S) * S_one)).chunk(2, dim=1)
            rest = _column_sum((covariance[:, :n, :n] @ N) * N)
            times = self.times[: covariance.shape[1] - n]
            across = torch.cat([covariance[:, n:, :n] * times, solution[..., :n]], dim=1) @ N
            if spilled is None:
                product, excess = (self.two_sums @ (across * S_one)).chunk(2, dim=1)
            else:
                of_spill = torch.cat([covariance[:, n:, n + k :], solution[..., n + k :]], dim=1)
                across = (across + of_spill @ spilled) * torch.cat([S, spilled, ones], dim=1)
                product, beside, excess = (self.three_sums @ across).chunk(3, dim=1)
                rest = rest + beside
            residual = -excess - m * signal
            doubts = of_signal * in_signal + of_product * product + rest  # (B, 3, R)
            doubt, shared = doubts[:, :2], doubts[:, 2:]
            # what this frame pair says of its own amplitude, noise and flicker
            misfit = (weight * residual * residual).sum((1, 2), keepdim=True)
            spent = (weight * doubt).sum((1, 2), keepdim=True)
            noise = (trust + noise * misfit) / (trust + counted - spent)
            swing = relative * (signal * signal)
            total = noise * variance + swing
            llr = cavity_llr(shared, residual, total, doubt, weight, lambda v: v.flip(1))[:, :1]
            if left == 0:
                break
            amplitude = solution[..., n : n + 1].abs() + LEAST_AMPLITUDE
            if self.bands is not None:
                K = len(self.frequency)
                spread = covariance[:, :K, :K] * self.bands_alone
                bent = solution[..., :K]
                power = (bent * bent).sum((1, 2), keepdim=True) + spread.sum((1, 2), keepdim=True)
                flicker = (trust_r + power) / (trust_r + K)
            q = said_of_bits(llr, together).sigmoid() * self.unknown + self.known[:1]
            q = torch.cat([q, 1 - q], dim=1)
            spilled = self.neighbours((m.T @ q) * (S[:, :1] * amplitude))
            spilled = spilled * self.spill.double().exp().unsqueeze(1)
            if self.ripple is not None:
                left_over = (q * residual).sum(1, keepdim=True) + ripple
                bit = (m[0] - m[1]) ** 2 * q[:, :1] * q[:, 1:] * (signal * signal)  # variance
                deviation = (noise * variance + bit).sqrt()
                on_grid = (left_over / deviation).float().index_select(2, self.rank)
                shape = (-1, 1, self.layout.rows, self.layout.cols)
                estimate = self.ripple(on_grid.reshape(shape)).reshape(ones.shape)
                ripple = deviation * estimate.index_select(2, self.order).double()
                N = torch.cat([N[:, :-1], change - ripple], dim=1)
            weight, counted = q / total, R
            covariance, solution = self.solve(S, N, spilled, weight, amplitude, flicker)
        return with_surprises(self.temperature.exp() * llr[:, 0, P:], self.surprise)

    def solve(
        self,
        S: Tensor,
        N: Tensor,
        spilled: Tensor | None,
        weight: Tensor,
        amplitude: Tensor,
        flicker: Tensor,
    ) -> tuple[Tensor, Tensor]:
        """Solve the ridge problem in which each block counts as bit 1 and as bit 0, by its weights.

        The coefficients stand in the order of N, S and the spilled light. The change of intensity
        is one of the rows of N, so that the same products make both sides of the normal equations.
        Its coefficient is -1, known for certain: then all rows together predict what is left over.

        Args:
            S: (B, k, R) columns of the signal.
            N: (B, n, R) columns that count whatever the bit, and last the change of intensity in
                gray levels.
            spilled: (B, 2, R) columns of the light that neighbours spill over, if there is any.
            weight: (B, 2, R) inverse variances of each block as bit 1 and as bit 0.
            amplitude: (B, 1, 1) prior standard deviation of the signal's coefficients, gray levels.
            flicker: (B, 1, 1) prior variance of the bands' coefficients.

        Returns:
            (B, K, K) covariance of the coefficients, and (B, 1, K) their mean.
        """
        k, n = S.shape[1], N.shape[1]
        powers = torch.cat([self.changes, self.changes**2, self.changes**0], dim=1).T
        crossed, squared, all_weight = (powers @ weight).chunk(3, dim=1)  # (B, 1, R) each
        among_N = (N * all_weight) @ N.transpose(1, 2)
        among_T = (S * squared) @ S.transpose(1, 2)
        weighted = S * crossed
        if spilled is not None:
            weighted = torch.cat([weighted, spilled * all_weight], dim=1)
            beside = weighted @ spilled.transpose(1, 2)
            upper = torch.cat([among_T, beside[:, :k].transpose(1, 2)], dim=1)
            among_T = torch.cat([upper, beside], dim=2)
        across = weighted @ N.transpose(1, 2)
        left = torch.cat([among_N, across], dim=1)
        normal = torch.cat([left, torch.cat([across.transpose(1, 2), among_T], dim=1)], dim=2)
        K = normal.shape[1]
        a, b, c = self.priors[:, :K, :K]
        free = self.free[:K, :K]
        prior = a / (amplitude * amplitude) + b / flicker + c
        covariance = inverse(normal * free + prior) * free
        solution = (covariance @ left[:, :, n - 1 : n]).transpose(1, 2)
        return covariance, solution - self.change_alone[:K]

    def neighbours(self, shown: Tensor) -> Tensor:
        """Add up what the neighbours of each block show, along its row and along its column.

        Args:
            shown: (B, 1, R) expected change of each block, pilots first.

        Returns:
            (B, 2, R) sums over the left and right, and over the upper and lower neighbour.
        """
        B, _, R = shown.shape
        index = self.beside.expand(B, 1, -1)
        around = pad(shown, (0, 1)).gather(2, index)
        return (around[..., : 2 * R] + around[..., 2 * R :]).reshape(-1, 2, R)

    def design(self, statistics: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Build the linear model of a frame pair, whose R rows are its pilots, then its blocks.

        Args:
            statistics: (B, R, STATISTICS) float64.

        Returns:
            S: (B, k, R) columns of the signal, the first of which is the typical response.
            N: (B, n, R) columns that count whatever the bit; the bands come first, and the change
                of intensity, in gray levels, comes last.
            variance: (B, 1, R) learned variance of y, squared gray levels.
        """
        B = statistics.shape[0]
        each = statistics.transpose(1, 2)
        P = pad(each[:, 1 : 1 + MOMENTS], (0, 0, 1, 0), value=1.0)
        dx, dy, curvature, squared, share = (
            each[:, i : i + 1] for i in range(STATISTICS - TEXTURES, STATISTICS)
        )
        response, gain = self.response.double() @ P, self.exposure.double() @ P
        response = LEAST_RESPONSE + (response.unsqueeze(1) - LEAST_RESPONSE).relu()
        signal = [P[:, :1], P[:, 1:4] * self.bends.double().exp().unsqueeze(1)]
        if self.tilts is not None:
            tilts = self.places[1:] * self.tilts.double().exp().unsqueeze(1)
            signal.append(tilts.expand(B, -1, -1))
        nuisance = self.nuisance.double().exp().unsqueeze(1)
        gains, columns = [self.places[:1] * nuisance[-1:]], [P * nuisance[:-1]]
        if self.bands is not None:
            gains.insert(0, self.waves * (self.bands[0] + self.bands[1] * self.frequency).exp())
        if self.space_nuisance is not None:
            scale = self.space_nuisance.double().exp().unsqueeze(1)
            gains.append(self.bends_of_place * scale[:5])
            columns.append((self.places[1:] * scale[5:]).expand(B, -1, -1))
        motion = GRAY_LEVELS * self.motion.double().exp().unsqueeze(1)
        columns += [dx * (self.places * motion[:3]), dy * (self.places * motion[3:6])]
        columns.append(curvature * motion[6:])
        columns.insert(0, gain.unsqueeze(1) * torch.cat(gains))
        pixels, jitter = self.pixels * share, (2 * self.jitter.double()).exp()
        varies = GRAY_LEVELS**2 * squared
        noise = (2 * (self.pixel_noise.double() @ P[:, :3])).exp().unsqueeze(1)
        variance = (noise + varies * jitter[0]) / pixels + varies * jitter[1]
        variance = variance + (2 * self.block_noise.double()).exp()
        columns.append(GRAY_LEVELS * each[:, :1])
        return response * torch.cat(signal, dim=1), torch.cat(columns, dim=1), variance


def _column_sum(columns: Tensor) -> Tensor:
    """Add up (B, K, R) over K: (B, 1, R), as a product, which onnxruntime does quickest."""
    return columns.new_ones((1, columns.shape[1])) @ columns


def _logs(*values: float) -> nn.Parameter:
    return nn.Parameter(torch.tensor(values).log())
