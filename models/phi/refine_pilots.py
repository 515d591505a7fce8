"""Refinement on pilots: known blocks start it, the message's blocks finish it.

The linear model is that of `models.phi.refine`. Its columns N hold two things more: the motion
and blur that registration left, by the picture's gradients, and the light that neighbouring blocks
spill over.

The scores of the head, which was fitted to the pilots alone, give the message's bits their first
probabilities, with which all blocks enter the first solve. On fine grids each solve is followed by
an estimate of the waves that moire and flicker leave in the residuals (`models.phi.ripple`),
which the next solve takes for granted.

Ratex patches show known intensities and so teach the response beforehand; here the response is a
learned typical curve, and each frame pair's own blocks bend it.
"""

from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.functional import pad

from link.layout import Layout
from models.onnx_ops import column_sum, inverse, table
from models.phi.refine import (
    GAIN_BENDS,
    GRAY_LEVELS,
    MOMENTS,
    TEXTURES,
    Fit,
    Hypotheses,
    Refiner,
    cavity_llr,
    logs,
    typical_response,
)
from models.phi.ripple import Ripple

STATISTICS = 1 + MOMENTS + TEXTURES
"""Number of statistics of a block: the change of intensity, the moments P_k of i_o, the texture."""
MOST_BANDS = 8
"""Largest number of cosines over the rows of the display that flicker may be made of."""
LEAST_RESPONSE = 0.15
"""Smallest response to kappa at any intensity, relative to about its largest."""
LEAST_PILOT_AMPLITUDE = 0.05
"""Gray levels that are added to the estimated amplitude of the signal, so that it is never 0."""


@dataclass(frozen=True)
class Model:
    """The linear model of a frame pair's R blocks, which are its pilots and then its message."""

    S: Tensor
    """(B, k, R) columns of the signal, the first of which is the typical response."""
    N: Tensor
    """(B, n, R) columns that count whatever the bit. The bands come first, and the change of
    intensity, in gray levels, comes last."""
    variance: Tensor
    """(B, 1, R) learned variance of the change, squared gray levels."""
    spilled: Tensor | None = None
    """(B, 2, R) columns of the light that neighbours along rows and along columns spill over;
    None while nothing is known of the neighbours' bits."""


@dataclass(frozen=True)
class Verdict:
    """Scores of the bits from one fit, and measures of how well the fit explains the blocks."""

    llr: Tensor
    """(B, 1, R) natural log-likelihood ratios of the bits, each by all other blocks."""
    residual: Tensor
    """(B, 2, R) change less its prediction as bit 1 and as bit 0, gray levels."""
    signal: Tensor
    """(B, 1, R) change of each block for each unit of its bit's change, gray levels."""
    noise: Tensor
    """(B, 1, 1) variance of the noise, relative to the learned one."""
    variance: Tensor
    """(B, 2, R) variance of the change as bit 1 and as bit 0, squared gray levels."""


class PilotRefiner(Refiner):
    """Soft-label ridge solves over pilots and message blocks; about fifty learned numbers.

    Coefficients stand in the order of N, S and the spilled light (`Model`).

    Args:
        layout: grid with pilots, which says where the blocks lie and how bits change them.
        pixels: number of pixels in a block, as they are counted where noise is averaged.
        rounds: number of solves over all blocks after the first, at least 1.
        rows: whether flicker may vary over the rows of the display.
        space: whether signal, gain and offset may vary smoothly over the display.
    """

    needs_texture = True

    def __init__(self, layout: Layout, pixels: float, rounds: int, rows: bool, space: bool) -> None:
        super().__init__(rounds, rows, spread=0.05, surprise=1e-4)
        self.layout, self.pixels = layout, pixels
        fine = Ripple.fits(layout.rows, layout.cols)
        self.ripple = Ripple(layout.rows, layout.cols) if fine else None
        self.response = typical_response()
        # log standard deviations of the coefficients, in gray levels of [0, 255] or relative
        self.amplitude = logs(1.5)
        self.bends = logs(0.4, 0.4, 0.2)
        self.tilts = logs(0.15, 0.15) if space else None
        self.nuisance = logs(5.0, 8.0, 5.0, 3.0, 2.0, 5.0)
        self.space_nuisance = logs(0.5, 0.5, 0.5, 0.5, 0.5, 0.3, 0.3) if space else None
        self.motion = logs(0.15, 0.05, 0.05, 0.15, 0.05, 0.05, 0.1)
        self.spill = logs(0.1, 0.1)
        # log standard deviation of a pixel's noise: constant, linear and quadratic in i_o
        self.pixel_noise = nn.Parameter(torch.tensor([0.5, 0.0, 0.0]))
        # noise that a block's mean keeps, gray levels; jitter of single pixels and of whole blocks
        self.block_noise = logs(0.03)
        self.jitter = logs(0.05, 0.02)
        self.noise_trust, self.start = logs(20.0), logs(4.0)
        n_bands = min(MOST_BANDS, layout.rows) if rows else 0
        self._tabulate_blocks(layout, n_bands)
        n_other = len(self.nuisance) + (GAIN_BENDS + 2 if space else 0) + len(self.motion)
        self._tabulate_coefficients(n_bands, n_other, 1 + len(self.bends) + (2 if space else 0))

    def _tabulate_blocks(self, layout: Layout, n_bands: int) -> None:
        """Tabulate where the R blocks lie, what is known of their bits, and how bits change them.

        Centres x and y run from -1 to 1 over the display; the waves are cosines over its rows.
        """
        message = layout.message_mask.reshape(-1).nonzero()[0]
        order = np.concatenate([layout.pilot_blocks, message])  # numbers of the blocks
        row, col = np.divmod(order, layout.cols)
        x, y = (2 * col + 1) / layout.cols - 1, (2 * row + 1) / layout.rows - 1
        # where each block's neighbours stand among them: left, above, right, below; R where none
        stands = np.full((layout.rows + 2, layout.cols + 2), len(order))
        stands[row + 1, col + 1] = np.arange(len(order))
        ways = ((1, 0), (0, 1), (1, 2), (2, 1))
        neighbours = np.concatenate([stands[row + down, col + along] for down, along in ways])
        frequency = np.arange(n_bands)
        waves = np.cos(np.pi * np.outer(row + 0.5, frequency) / layout.rows) / 2
        bits = np.concatenate([layout.pilot_bits, np.full(len(message), np.nan)])
        low, high = layout.change_of_bits
        self.order, self.rank = table(order), table(np.argsort(order))  # and back to the grid
        self.places = table(np.stack([np.ones_like(x), x, y]))
        self.gain_bends = table(np.stack([x, y, x * x, x * y, y * y]))
        self.waves, self.frequency = table(waves.T), table(frequency.astype(np.float64)[:, None])
        self.neighbour_places = table(neighbours)
        # by hypothesis, bit 1 and bit 0: its change in units of kappa, and what pilots are
        self.changes = table(np.array([[high], [low]], np.float64))
        self.known = table(np.stack([bits == 1, bits == 0]).astype(np.float64))
        self.unknown = table(np.isnan(bits).astype(np.float64))
        # shares in a prediction's variance as bit 1, as bit 0, and in the covariance of the two:
        # of the signal's variance, and of its covariance with all else
        self.signal_shares = table(np.array([[high * high], [low * low], [high * low]], np.float64))
        crossed = np.array([[2 * high], [2 * low], [high + low]], np.float64)
        self.crossed_shares = table(crossed)

    def _tabulate_coefficients(self, n_bands: int, n_other: int, n_signal: int) -> None:
        """Tabulate what each coefficient is, and sums over the coefficients of one kind.

        Args:
            n_bands: number of bands of flicker.
            n_other: number of other columns of N, but for the change of intensity.
            n_signal: number of columns of S.
        """
        n_spill = len(self.spill)
        kinds = np.repeat([1, 2, 2, 0, 2], [n_bands, n_other, 1, n_signal, n_spill])
        change = np.arange(len(kinds)) == n_bands + n_other
        self.is_band = table(np.eye(n_bands))
        self.free = table(1.0 - (change | change[:, None]))
        self.is_change = table(change.astype(np.float64))
        # 1 on the diagonal for the signal's coefficients, for the bands', and for all others
        priors = np.stack([np.diag(kinds == kind) for kind in range(3)])
        self.priors = table(priors.astype(np.float64))
        # sums over the signal's rows, over those of spilled light, and the last row by itself
        sums = np.repeat(np.eye(3), [n_signal, n_spill, 1], axis=0).T
        self.sums_with_spill = table(sums)
        self.sums_without_spill = table(np.delete(sums[[0, 2]], np.s_[n_signal:-1], axis=1))
        # a variance holds the covariance of two parts twice; `crossed_shares` says so for S
        self.spill_twice = table(np.repeat([1.0, 2.0], [n_signal, n_spill])[:, None])

    def forward(self, pilots: Tensor, blocks: Tensor, scores: Tensor) -> Tensor:
        """Compute the log-likelihood ratios of the message bits.

        Args:
            pilots: (B, pilots, STATISTICS) float64 statistics of the pilots.
            blocks: (B, n_bits, STATISTICS) float64 statistics of the message blocks.
            scores: (B, n_bits) float64 scores of the SVM, with margins of about 1, from which the
                first probabilities are made.

        Returns:
            (B, n_bits) float64 natural log-likelihood ratios, positive for bit 1.
        """
        P = pilots.shape[1]
        model = self.design(torch.cat([pilots, blocks], dim=1))
        # variance by which blocks scatter as bit 1 and as bit 0, relative to their squared signal
        scatter = (2 * self.spread.double()).exp() * self.changes * self.changes  # (2, 1)
        noise_trust, band_trust = (v.double().exp() for v in (self.noise_trust, self.band_trust))
        amplitude = torch.ones_like(model.variance)[..., :1] * self.amplitude.double().exp()
        flicker = torch.ones_like(amplitude)  # (B, 1, 1)
        change, ripple = model.N[:, -1:], torch.zeros_like(model.variance)  # (B, 1, R)
        q = self._probabilities(pad(self.start.exp() * scores, (P, 0)).unsqueeze(1))
        fit = self.solve(model, q / model.variance, amplitude, flicker)
        verdict = self._judge(model, fit, flicker, noise_trust, scatter)
        for _ in range(self.rounds):
            amplitude = self._amplitude(model, fit)
            flicker = self._flicker(fit, flicker, band_trust)
            q = self._probabilities(verdict.llr)
            model = replace(model, spilled=self._spilled_light(model, q, amplitude))
            if self.ripple is not None:
                ripple = self._wave(self.ripple, model, verdict, q, ripple)
                model = replace(model, N=torch.cat([model.N[:, :-1], change - ripple], dim=1))
            fit = self.solve(model, q / verdict.variance, amplitude, flicker)
            verdict = self._judge(model, fit, verdict.noise, noise_trust, scatter)
        return self.bounded(verdict.llr[:, 0, P:])

    def _probabilities(self, llr: Tensor) -> Tensor:
        """Give the (B, 2, R) probabilities of bit 1 and of bit 0; those of pilots are certain."""
        q = llr.sigmoid() * self.unknown + self.known[:1]
        return torch.cat([q, 1 - q], dim=1)

    def _judge(
        self, model: Model, fit: Fit, noise: Tensor, trust: Tensor, scatter: Tensor
    ) -> Verdict:
        """Decide each block by a fit to all others, and estimate the noise of this frame pair.

        The blocks entered the fit with (B, 1, 1) ``noise`` relative to the learned one, which
        counts for ``trust`` blocks.
        """
        hypotheses, signal = self._predict(model, fit)
        squares = fit.weight * hypotheses.residual * hypotheses.residual
        misfit = squares.sum((1, 2), keepdim=True)  # (B, 1, 1)
        spent = (fit.weight * hypotheses.variance).sum((1, 2), keepdim=True)  # degrees of freedom
        noise = (trust + noise * misfit) / (trust + model.variance.shape[2] - spent)
        variance = noise * model.variance + scatter * (signal * signal)
        llr = cavity_llr(fit, hypotheses, variance, lambda places: places.flip(1))
        return Verdict(llr[:, :1], hypotheses.residual, signal, noise, variance)

    def _predict(self, model: Model, fit: Fit) -> tuple[Hypotheses, Tensor]:
        """Predict the change of every block as bit 1 and as bit 0; and their (B, 1, R) signal, S a.

        Rows of the covariance times columns of the model, summed by kind, make the shares of the
        variance that the coefficients leave. A row of means beside them makes the prediction.
        """
        k, n = model.S.shape[1], model.N.shape[1]
        ones = torch.ones_like(model.variance)
        S_and_one = torch.cat([model.S, ones], dim=1)  # (B, k + 1, R)
        among_S, among_N = fit.covariance[:, n : n + k, n : n + k], fit.covariance[:, :n, :n]
        of_S = torch.cat([among_S, fit.mean[..., n : n + k]], dim=1) @ model.S  # (B, k + 1, R)
        of_S = self.sums_without_spill @ (of_S * S_and_one)
        signal_variance, signal = of_S.chunk(2, dim=1)  # (B, 1, R) each
        rest = column_sum((among_N @ model.N) * model.N)  # variance of all but the signal
        crossed = fit.covariance[:, n:, :n]
        crossed = crossed * self.spill_twice[: crossed.shape[1]]
        across = torch.cat([crossed, fit.mean[..., :n]], dim=1) @ model.N
        if model.spilled is None:
            across = self.sums_without_spill @ (across * S_and_one)
            product, excess = across.chunk(2, dim=1)
        else:
            of_spill = torch.cat([fit.covariance[:, n:, n + k :], fit.mean[..., n + k :]], dim=1)
            columns = torch.cat([model.S, model.spilled, ones], dim=1)  # (B, k + 3, R)
            across = self.sums_with_spill @ ((across + of_spill @ model.spilled) * columns)
            product, of_light, excess = across.chunk(3, dim=1)
            rest = rest + of_light
        # the change of intensity is one of the columns N, with the coefficient -1
        residual = -excess - self.changes * signal  # (B, 2, R)
        doubts = self.signal_shares * signal_variance + self.crossed_shares * product + rest
        return Hypotheses(residual, doubts[:, :2], doubts[:, 2:]), signal

    def _amplitude(self, model: Model, fit: Fit) -> Tensor:
        """Read the amplitude of the signal off a fit: (B, 1, 1), gray levels."""
        n = model.N.shape[1]
        return fit.mean[..., n : n + 1].abs() + LEAST_PILOT_AMPLITUDE

    def _flicker(self, fit: Fit, flicker: Tensor, trust: Tensor) -> Tensor:
        """Estimate the bands' (B, 1, 1) variance, as if ``trust`` more had the learned one, 1."""
        if self.bands is None:
            return flicker
        K = len(self.frequency)
        variance, mean = fit.covariance[:, :K, :K] * self.is_band, fit.mean[..., :K]
        power = (mean * mean).sum((1, 2), keepdim=True) + variance.sum((1, 2), keepdim=True)
        return (trust + power) / (trust + K)

    def _spilled_light(self, model: Model, q: Tensor, amplitude: Tensor) -> Tensor:
        """Make the (B, 2, R) columns of spilled light, by the bits' (B, 2, R) probabilities."""
        shown = self.neighbours((self.changes.T @ q) * (model.S[:, :1] * amplitude))
        return shown * self.spill.double().exp().unsqueeze(1)

    def _wave(
        self, estimator: Ripple, model: Model, verdict: Verdict, q: Tensor, before: Tensor
    ) -> Tensor:
        """Estimate the (B, 1, R) wave in the residuals, gray levels, beside the one of ``before``.

        ``q`` are the (B, 2, R) probabilities of bit 1 and of bit 0.
        """
        high, low = self.changes
        left_over = (q * verdict.residual).sum(1, keepdim=True) + before
        bit_variance = (high - low) ** 2 * q[:, :1] * q[:, 1:] * (verdict.signal * verdict.signal)
        deviation = (verdict.noise * model.variance + bit_variance).sqrt()
        in_rows = (left_over / deviation).float().index_select(2, self.rank)  # (B, 1, R)
        grid = in_rows.reshape(-1, 1, self.layout.rows, self.layout.cols)
        estimate = estimator(grid).reshape(before.shape)
        wave: Tensor = deviation * estimate.index_select(2, self.order).double()
        return wave

    def solve(self, model: Model, weight: Tensor, amplitude: Tensor, flicker: Tensor) -> Fit:
        """Solve the ridge problem in which each block counts as bit 1 and as bit 0, by its weights.

        The coefficient of the change of intensity is -1, known for certain: then all columns
        together predict what is left over.

        Args:
            model: linear model of the blocks.
            weight: (B, 2, R) inverse variances of each block as bit 1 and as bit 0.
            amplitude: (B, 1, 1) prior standard deviation of the signal's coefficients, gray levels.
            flicker: (B, 1, 1) prior variance of the bands' coefficients.
        """
        n = model.N.shape[1]
        normal, left = self._products(model, weight)
        K = normal.shape[1]
        of_signal, of_bands, of_others = self.priors[:, :K, :K]
        free = self.free[:K, :K]
        prior = of_signal / (amplitude * amplitude) + of_bands / flicker + of_others
        covariance = inverse(normal * free + prior) * free
        mean = (covariance @ left[:, :, n - 1 : n]).transpose(1, 2)
        return Fit(covariance, mean - self.is_change[:K], weight)

    def _products(self, model: Model, weight: Tensor) -> tuple[Tensor, Tensor]:
        """Multiply columns by columns, as bit 1 and as bit 0: (B, K, K), and of it (B, K, n) for N.

        They make both sides of the normal equations, as the change of intensity is a column of N.
        """
        S, N, spilled = model.S, model.N, model.spilled
        k = S.shape[1]
        powers = torch.cat([self.changes, self.changes**2, self.changes**0], dim=1).T
        crossed, squared, all_weight = (powers @ weight).chunk(3, dim=1)  # (B, 1, R) each
        among_N = (N * all_weight) @ N.transpose(1, 2)
        among_rest = (S * squared) @ S.transpose(1, 2)
        weighted = S * crossed
        if spilled is not None:
            weighted = torch.cat([weighted, spilled * all_weight], dim=1)  # (B, k + 2, R)
            with_spilled = weighted @ spilled.transpose(1, 2)
            upper = torch.cat([among_rest, with_spilled[:, :k].transpose(1, 2)], dim=1)
            among_rest = torch.cat([upper, with_spilled], dim=2)
        across = weighted @ N.transpose(1, 2)
        left = torch.cat([among_N, across], dim=1)
        right = torch.cat([across.transpose(1, 2), among_rest], dim=1)
        return torch.cat([left, right], dim=2), left

    def neighbours(self, shown: Tensor) -> Tensor:
        """Add up what the neighbours of each block show, along its row and along its column.

        Args:
            shown: (B, 1, R) expected change of each block, pilots first.

        Returns:
            (B, 2, R) sums over the left and right, and over the upper and lower neighbour.
        """
        B, _, R = shown.shape
        index = self.neighbour_places.expand(B, 1, -1)
        around = pad(shown, (0, 1)).gather(2, index)  # (B, 1, 4 R): left, above, right, below
        return (around[..., : 2 * R] + around[..., 2 * R :]).reshape(-1, 2, R)

    def design(self, statistics: Tensor) -> Model:
        """Build the linear model of a frame pair, whose R rows are its pilots, then its blocks.

        Args:
            statistics: (B, R, STATISTICS) float64.
        """
        each = statistics.transpose(1, 2)  # (B, STATISTICS, R)
        P = pad(each[:, 1 : 1 + MOMENTS], (0, 0, 1, 0), value=1.0)  # (B, MOMENTS + 1, R)
        N = [*self._nuisances(P), *self._motions(each), GRAY_LEVELS * each[:, :1]]
        variance = self._variance(P, squared_gradient=each[:, -2:-1], share=each[:, -1:])
        return Model(self._signal(P), torch.cat(N, dim=1), variance)

    def _signal(self, P: Tensor) -> Tensor:
        """Build the (B, k, R) columns S from the (B, MOMENTS + 1, R) moments of i_o."""
        response = (self.response.double() @ P).unsqueeze(1)  # (B, 1, R)
        response = LEAST_RESPONSE + (response - LEAST_RESPONSE).relu()
        bends = [P[:, :1], P[:, 1:4] * self.bends.double().exp().unsqueeze(1)]
        if self.tilts is not None:
            tilts = self.places[1:] * self.tilts.double().exp().unsqueeze(1)
            bends.append(tilts.expand(P.shape[0], -1, -1))
        return response * torch.cat(bends, dim=1)

    def _nuisances(self, P: Tensor) -> list[Tensor]:
        """Build the (B, _, R) columns of gain by row and place, and of offset by tone and place."""
        gain = (self.exposure.double() @ P).unsqueeze(1)  # (B, 1, R)
        nuisance = self.nuisance.double().exp().unsqueeze(1)
        gains, columns = [self.places[:1] * nuisance[-1:]], [P * nuisance[:-1]]
        if self.bands is not None:
            gains.insert(0, self.row_gains(self.bands))
        if self.space_nuisance is not None:
            scale = self.space_nuisance.double().exp().unsqueeze(1)
            gains.append(self.gain_bends * scale[:GAIN_BENDS])
            offset = self.places[1:] * scale[GAIN_BENDS:]
            columns.append(offset.expand(P.shape[0], -1, -1))
        return [gain * torch.cat(gains), *columns]

    def _motions(self, each: Tensor) -> list[Tensor]:
        """Build the (B, 3 or 1, R) columns of motion along x, of motion along y, and of blur."""
        dx, dy, curvature = each[:, -5:-4], each[:, -4:-3], each[:, -3:-2]  # (B, 1, R) each
        motion = GRAY_LEVELS * self.motion.double().exp().unsqueeze(1)
        along_x, along_y = dx * (self.places * motion[:3]), dy * (self.places * motion[3:6])
        return [along_x, along_y, curvature * motion[6:]]

    def _variance(self, P: Tensor, squared_gradient: Tensor, share: Tensor) -> Tensor:
        """Give the learned variance of each block's change: (B, 1, R), squared gray levels."""
        pixels, jitter = self.pixels * share, (2 * self.jitter.double()).exp()
        varies = GRAY_LEVELS**2 * squared_gradient
        noise = (2 * (self.pixel_noise.double() @ P[:, :3])).exp().unsqueeze(1)
        variance = (noise + varies * jitter[0]) / pixels + varies * jitter[1]
        return variance + (2 * self.block_noise.double()).exp()
