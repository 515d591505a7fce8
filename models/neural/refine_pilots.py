"""Decision-directed refinement on pilots: known blocks start it, the message's blocks finish it.

The change of a block's intensity is modelled as
    y = m S a + N c + noise,
with m the block's change in units of kappa (`link.layout.MODULATIONS`), known columns S and N, and
Gaussian a and c of learned spread. S holds what kappa gray levels become in the capture, and how
that bends with intensity and place. N holds what changes whatever the bit: drift, flicker and
fall-off, the motion and blur that registration left (by the picture's gradients), and the light
that neighbouring blocks spill over.

The first ridge solve sees the pilots alone. Its likelihood ratios give the message's bits their
probabilities, with which all blocks enter the next solve. `models.neural.refine` does this for
ratex patches, whose displayed intensities are known, and so knows the response beforehand; here the
response is a learned typical curve, and each frame pair's own blocks bend it.
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

    x: Tensor
    y: Tensor
    waves: Tensor
    frequency: Tensor
    known: Tensor
    labels: Tensor
    order: Tensor
    place: Tensor
    is_band: Tensor

    def __init__(self, layout: Layout, pixels: float, rounds: int, rows: bool, space: bool) -> None:
        super().__init__()
        self.layout, self.pixels, self.rounds = layout, pixels, rounds
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
        n_other = len(self.nuisance) + (7 if space else 0) + len(self.motion) + len(self.spill)
        message = layout.message_mask.reshape(-1).nonzero()[0]
        order = np.concatenate([layout.pilot_blocks, message])
        row, col = np.divmod(order, layout.cols)
        frequency = np.arange(n_bands)
        waves = np.cos(np.pi * np.outer(row + 0.5, frequency) / layout.rows) / 2
        labels = np.concatenate([layout.pilot_bits, np.zeros(len(message))])
        for name, value in (
            ("x", (2 * col + 1) / layout.cols - 1),
            ("y", (2 * row + 1) / layout.rows - 1),
            ("waves", waves),
            ("frequency", frequency.astype(np.float64)),
            ("known", (np.arange(len(order)) < layout.pilots).astype(np.float64)),
            ("labels", labels.astype(np.float64)),
            ("order", order),  # numbers of the blocks, pilots first
            ("place", np.argsort(order)),  # where each block of the grid stands among them
            ("is_band", (np.arange(n_bands + n_other) < n_bands).astype(np.float64)),
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
        n_pilots = pilots.shape[1]
        S, N, y, variance = self.design(torch.cat([pilots, blocks], dim=1))
        low, high = (float(change) for change in self.layout.change_of_bits)
        none, one = torch.zeros_like(y), torch.ones_like(y[:, :1])
        p, known, labels = none + self.labels, none + self.known, (none + self.labels)[:, :n_pilots]
        entered, signal, spilled = known, none, torch.stack([none, none], dim=-1)
        amplitude, noise, flicker = one * self.amplitude.double().exp(), one, one
        trust, trust_r = self.noise_trust.double().exp(), self.band_trust.double().exp()
        relative, n_bands = (2 * self.spread.double()).exp(), self.is_band.sum()
        llr = none
        for _ in range(1 + self.rounds):
            F = torch.cat([N, spilled * self.spill.double().exp()], dim=-1)
            own = noise * variance
            total = [own + relative * (m * signal) ** 2 for m in (high, low)]
            weight = [entered * q / t for q, t in zip((p, 1 - p), total, strict=True)]
            covariance, solution = self.solve(S, F, y, weight, amplitude, flicker)
            k = S.shape[-1]
            signal, still = (
                (columns @ part).squeeze(-1)
                for columns, part in ((S, solution[:, :k]), (F, solution[:, k:]))
            )
            residual = [y - m * signal - still for m in (high, low)]
            # covariance of a block's two predictions, from those of its parts
            SC, FC = S @ covariance[:, :k], F @ covariance[:, k:, k:]
            ss, sf = (SC[..., :k] * S).sum(-1), (SC[..., k:] * F).sum(-1)
            ff = (FC * F).sum(-1)
            doubt = [m * m * ss + 2 * m * sf + ff for m in (high, low)]
            shared = high * low * ss + (high + low) * sf + ff
            # what this frame pair says of its own amplitude, noise and flicker
            amplitude = solution[:, 0].abs() + LEAST_AMPLITUDE
            halves = list(zip((p, 1 - p), total, residual, strict=True))
            misfit = torch.stack([q * own * r**2 / (t * variance) for q, t, r in halves]).sum(0)
            spent = torch.stack([w * d for w, d in zip(weight, doubt, strict=True)]).sum(0)
            excess = trust + (entered * misfit).sum(-1, keepdim=True)
            noise = excess / (trust + (entered - spent).sum(-1, keepdim=True))
            diagonal = (covariance * torch.eye(covariance.shape[-1], dtype=y.dtype)).sum(-1)
            power = (solution.squeeze(-1) ** 2 + diagonal)[:, k:] @ self.is_band.unsqueeze(-1)
            flicker = (trust_r + power) / (trust_r + n_bands)
            total = [noise * variance + relative * (m * signal) ** 2 for m in (high, low)]
            both = (torch.cat(v, dim=1) for v in (residual, total, doubt, weight))
            llr = cavity_llr(shared, *both)
            p = torch.cat([labels, said_of_bits(llr[:, n_pilots:], together).sigmoid()], dim=1)
            entered = none + 1
            shown = (low + (high - low) * p) * S[..., 0] * amplitude
            spilled = self.neighbours(shown)
        return with_surprises(self.temperature.exp() * llr[:, n_pilots:], self.surprise)

    def solve(
        self,
        S: Tensor,
        F: Tensor,
        y: Tensor,
        weight: list[Tensor],
        amplitude: Tensor,
        flicker: Tensor,
    ) -> tuple[Tensor, Tensor]:
        """Solve the ridge problem in which each block counts as bit 1 and as bit 0, by its weights.

        Args:
            S: (B, R, k) columns of the signal.
            F: (B, R, K - k) columns that count whatever the bit.
            y: (B, R) change of intensity, gray levels.
            weight: (B, R) inverse variances of each block as bit 1 and as bit 0.
            amplitude: (B, 1) prior standard deviation of the signal's coefficients, gray levels.
            flicker: (B, 1) prior variance of the bands' coefficients.

        Returns:
            (B, K, K) covariance of the coefficients, and (B, K, 1) their mean.
        """
        low, high = (float(change) for change in self.layout.change_of_bits)
        one, zero = weight
        first, second = high * one + low * zero, high * high * one + low * low * zero
        St, Ft = S.transpose(1, 2), F.transpose(1, 2)
        SF = (St * first.unsqueeze(1)) @ F
        upper = torch.cat([(St * second.unsqueeze(1)) @ S, SF], dim=2)
        lower = torch.cat([SF.transpose(1, 2), (Ft * (one + zero).unsqueeze(1)) @ F], dim=2)
        right = torch.cat([St * first.unsqueeze(1), Ft * (one + zero).unsqueeze(1)], dim=1)
        prior = torch.cat(
            [
                amplitude**-2 + 0 * S[:, 0],
                1 - self.is_band + self.is_band / flicker,
            ],
            dim=1,
        )
        eye = torch.eye(S.shape[-1] + F.shape[-1], dtype=y.dtype)
        covariance = inverse(torch.cat([upper, lower], dim=1) + eye * prior.unsqueeze(1))
        return covariance, covariance @ (right @ y.unsqueeze(-1))

    def neighbours(self, shown: Tensor) -> Tensor:
        """Add up what the neighbours of each block show, along its row and along its column.

        Args:
            shown: (B, R) expected change of each block, pilots first.

        Returns:
            (B, R, 2) sums over the left and right, and over the upper and lower neighbour.
        """
        rows, cols = self.layout.rows, self.layout.cols
        grid = shown.index_select(1, self.place).reshape(-1, rows, cols)
        around = pad(grid, (1, 1, 1, 1))
        beside = around[:, 1:-1, :-2] + around[:, 1:-1, 2:]
        above = around[:, :-2, 1:-1] + around[:, 2:, 1:-1]
        return torch.stack([beside, above], dim=-1).flatten(1, 2).index_select(1, self.order)

    def design(self, statistics: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Build the linear model of a frame pair, whose R rows are its pilots, then its blocks.

        Args:
            statistics: (B, R, STATISTICS) float64.

        Returns:
            S: (B, R, k) columns of the signal, the first of which is the typical response.
            N: (B, R, K) columns that count whatever the bit; the bands come first.
            y: (B, R) change of intensity, gray levels.
            variance: (B, R) learned variance of y, squared gray levels.
        """
        change, rest = statistics[..., 0], statistics[..., 1 + MOMENTS :]
        one = torch.ones_like(change)
        x, y = self.x * one, self.y * one
        P = torch.cat([one.unsqueeze(-1), statistics[..., 1 : 1 + MOMENTS]], dim=-1)
        curves = torch.stack([self.response, self.exposure], dim=-1).double()
        response, gain = (P @ curves).unbind(-1)
        response = LEAST_RESPONSE + (response - LEAST_RESPONSE).relu()
        bends = P[..., 1:4] * self.bends.double().exp()
        signal = [one.unsqueeze(-1), bends]
        if self.tilts is not None:
            signal.append(torch.stack([x, y], dim=-1) * self.tilts.double().exp())
        S = response.unsqueeze(-1) * torch.cat(signal, dim=-1)
        columns = []
        if self.bands is not None:
            scale = (self.bands[0] + self.bands[1] * self.frequency).exp()
            columns.append(self.waves * gain.unsqueeze(-1) * scale)
        columns.append(torch.cat([P, gain.unsqueeze(-1)], dim=-1) * self.nuisance.double().exp())
        if self.space_nuisance is not None:
            where = torch.stack([x, y, x * x, x * y, y * y], dim=-1) * gain.unsqueeze(-1)
            plane = torch.stack([x, y], dim=-1)
            scale = self.space_nuisance.double().exp()
            columns.append(torch.cat([where, plane], dim=-1) * scale)
        dx, dy, curvature = (GRAY_LEVELS * rest[..., :3]).unbind(-1)
        moved = torch.stack([dx, dx * x, dx * y, dy, dy * x, dy * y, curvature], dim=-1)
        columns.append(moved * self.motion.double().exp())
        squared, pixels = GRAY_LEVELS**2 * rest[..., 3], self.pixels * rest[..., 4]
        jitter = (2 * self.jitter.double()).exp()
        variance = (2 * (P[..., :3] @ self.pixel_noise.double())).exp() / pixels
        variance = variance + squared * (jitter[0] / pixels + jitter[1])
        variance = variance + (2 * self.block_noise.double()).exp()
        return S, torch.cat(columns, dim=-1), GRAY_LEVELS * change, variance


def _logs(*values: float) -> nn.Parameter:
    return nn.Parameter(torch.tensor(values).log())
