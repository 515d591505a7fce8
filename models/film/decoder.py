"""FilmDecoder: a window of film frames in, scores of all the frame pairs in it out, in one graph.

The paper decodes two frames. A film says more: the picture goes on from frame to frame, and each
frame is a mixture of display states in known shares. With y the mean of a block, less that of the
window's mean picture, in a frame t,
    y_t = p_t + sum_p s_tp x_p S a + N c_t + noise_t,
where p_t is what the picture shows, which stands still, drifts or jumps (`models.film.background`),
x_p in {-1, 1} is the bit of frame pair p and s_tp half the difference of the shares that the
embedded and the original state of the pair have of the exposure at that block, which follow from
the clock. S holds what kappa gray levels become in the capture, and N what changes all blocks
together whatever the bits, with coefficients of each frame's own. No frame is left out for being
mixed: pairs that share a frame are solved together.

As in `models.phi.refine`, the pilots start it and the message's blocks finish it: each round
solves the ridge problems of all frames (convex, in closed form) with the bits expected so far,
estimates how the picture of each block moves and how noisy it is at each time, and then the bits.
Rounds also know what many blocks do together (`models.film.patterns`), and the pilots tell in the
end whether the scores are as sure as they are right (`certainty`). The rounds are those of
expectation maximisation (Dempster, Laird & Rubin 1977) with a mean field over the pairs.
"""

from __future__ import annotations  # export cannot trace those of inner functions

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.functional import conv2d, pad

from link.strength import (
    AROUND_BLOCKS,
    MASKING_EXPONENT,
    MASKING_SCALE,
    MASKING_WEIGHT,
    SIGNAL_EXPONENT,
    STILL_SENSITIVITY,
    UNCERTAINTY_BLOCKS,
)
from models.film.background import Background, background_of
from models.film.patterns import find_patterns
from models.onnx_ops import inverse_of_one, repeat, scan
from models.phi.decoder import bin_mean
from models.phi.phi import PhiPolynomial
from models.phi.refine import GRAY_LEVELS, MOMENTS, logs, typical_response, with_surprises
from models.phi.refine_pilots import LEAST_RESPONSE
from models.phi.register import derivatives

ROUNDS, LEARNED = 5, 2
"""Number of rounds, and number of times in each that noise and motion are estimated."""
FIRST_BAND, BANDS = 3, 6
"""Number of half waves over the rows of the slowest band of flicker, and how many bands there are;
slower ones are polynomials."""
LEAST_VARIANCE = 1e-3
"""Squared gray levels that are added to the variance of a block, so that it is never 0."""
LEAST_AMPLITUDE = 0.02
"""Smallest change of a block, in gray levels, for each unit of its bit's change."""
CLIP = 3.0
"""Residual, in standard deviations, up to which a block counts in a frame's coefficients and in
its own noise."""
NEAR_BLOCKS, NEAR_FRAMES = 3, 3
"""Number of blocks along each axis, and of frames, over which squares are averaged to tell how a
block moves, and how noisy it is, at a time: what passes covers some blocks for some frames."""
LEAST_START, LEAST_DRIFT = 0.02, 1e-3
"""Smallest variance of a step of a block's level, in variances of its noise, before anything is
known and later."""
UNSEEN = 1e6
"""Variance, in squared gray levels, of a block that a frame does not show."""
MOST_SURPRISING = 25.0
"""Largest square of an innovation, in its variances, that counts as noise."""
CERTAINTY_STEPS, CERTAINTY_PRIOR = 4, 100.0
"""Number of Newton steps by which `certainty` is found, and how precisely it is known beforehand to
be 1, as an inverse variance."""
DISPLAY_GAMMA, BLACK_LIGHT = 2.2, 0.01
"""Exponent by which captured levels become light, roughly, and the light that is added to a
block's surroundings where contrasts are taken."""


@dataclass(frozen=True)
class ReferenceBlocks:
    """Model of the B blocks that follows from the reference, the mean of all frames."""

    S: Tensor
    """(k, B) columns of the signal; the first is the typical response."""
    N: Tensor
    """(n, B) columns of what changes in each frame whatever the bits, scaled by their priors."""
    variance: Tensor
    """(1, B) typical variance of a block's mean, relative to that of the others."""


@dataclass(frozen=True)
class Shares:
    """Frame pairs that each exposure mixes, and their shares (`link.observation.Mixture`)."""

    shares: Tensor
    """(T, S, B) half the difference of the shares of a pair's two states, in [-1/2, 1/2]; 0 where a
    frame does not show a block."""
    of_pair: Tensor
    """(P, T S) 1 where a slot of a frame belongs to a pair, else 0."""
    pair: Tensor
    """(T S,) place among the pairs of the pair that each slot belongs to; 0 where none does, and
    its shares are 0."""
    goes_to: Tensor
    """(T, S, S) 1 where a slot of the next frame (along axis 1) belongs to the pair of a slot of
    this frame (along axis 2), else 0."""

    def sums(self, values: Tensor) -> Tensor:
        """Add up what the slots of each pair hold: (T, S, B) to (P, B)."""
        return self.of_pair @ values.flatten(0, 1)

    def of_slots(self, values: Tensor) -> Tensor:
        """Give each slot what its pair holds: (P, B) to (T, S, B)."""
        return values.index_select(0, self.pair).reshape(self.shares.shape)

    def mixed(self, values: Tensor) -> Tensor:
        """Mix what pairs hold as the exposures do: (P, B) to (T, B)."""
        return (self.shares * self.of_slots(values)).sum(1)

    def energy(self, background: Background) -> Tensor:
        """Give the energy s' L s of each pair's shares, L the precision of the background: (P, B).

        With R the noise and V the covariance of the level by all frames, L is R^-1 - R^-1 V R^-1,
        and V between two frames is the product of what is carried from each to the next. So what a
        pair showed so far is carried along, in the slot that the pair has in each frame.
        """
        weighted = self.shares / background.noise.unsqueeze(1)  # (T, S, B)
        spread = background.spread()

        def step(
            before: Tensor, now: Tensor, variance: Tensor, carry: Tensor, goes_to: Tensor
        ) -> tuple[Tensor, Tensor]:
            shown = now * (now + 2 * before) * variance
            return goes_to @ (carry * (before + now)), shown

        start = torch.zeros_like(weighted[0])
        inputs = weighted, spread.variance, spread.carry, self.goes_to
        (known,) = scan(step, start, *inputs)
        return self.sums(self.shares * weighted - known)


def shares_seen(shares: Tensor, pair: Tensor, pairs: Tensor, seen: Tensor) -> Shares:
    """Arrange a `link.observation.Mixture` for sums over pairs.

    Args:
        shares: (T, S, rows, cols) as there.
        pair: (T, S) int64 as there.
        pairs: (P,) int64, 0 to P - 1.
        seen: (T, B) 1 where a frame shows a block, else 0.
    """
    of_pair = (pair.reshape(1, -1) == pairs.unsqueeze(1)).float()
    ahead = torch.cat([pair[1:], pair[-1:]])
    goes_to = ((ahead.unsqueeze(2) == pair.unsqueeze(1)) & (pair >= 0).unsqueeze(1)).float()
    mixed = shares.flatten(2) * seen.unsqueeze(1)
    return Shares(mixed, of_pair, pair.clamp_min(0).flatten(), goes_to)


class FilmDecoder(nn.Module):
    """Decodes all frame pairs of a window of frames together; about fifty learned numbers.

    Layouts have pilots and the modulation "antipodal". The grid is free, so one module and one
    graph serve all of them.

    >>> decoder = FilmDecoder()
    >>> known = torch.zeros(16, 16)
    >>> known[::2, ::2], known[1::4, 1::4] = 1, -1
    >>> frames, seen = torch.full((4, 1, 96, 128), 99.0), torch.ones(4, 16, 16)
    >>> shares = torch.tensor([-0.5, 0.5, -0.5, 0.5]).reshape(4, 1, 1, 1).expand(4, 1, 16, 16)
    >>> pair, pairs = torch.tensor([[0], [0], [1], [1]]), torch.arange(2)
    >>> decoder(frames, seen, known, shares, pair, pairs).shape
    torch.Size([2, 16, 16])
    """

    def __init__(self) -> None:
        super().__init__()
        # how each frame differs from the reference, and the tone of the reference's blocks
        self.phi = PhiPolynomial(degree=1, moments=MOMENTS)
        self.response = typical_response()
        # Where training starts from; films then teach each of these numbers. Starts without another
        # reason were chosen by hand.
        # log standard deviations of the coefficients, in gray levels or relative
        self.amplitude = logs(1.5)
        self.bends = logs(0.4, 0.4, 0.2, 0.15, 0.15, 0.7)
        self.nuisance = logs(3.0, 3.0, 3.0, 3.0, 3.0, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5)
        self.bands = logs(0.5)
        self.motion = logs(0.1, 0.05, 0.05, 0.1, 0.05, 0.05, 0.05, 0.1)
        self.spill = logs(0.06, 0.06)
        # gradient, in gray levels per pixel, at which a pixel's weight in its block is halved: a
        # misregistration by a tenth of a pixel there moves it by as much as a bit does
        self.texture = logs(16.0)
        # how the log variance of blocks follows P_1 and P_2 of the intensity and the gradient
        self.noise = nn.Parameter(torch.tensor([0.0, 0.0, 0.3]))
        # how the eye's masking of flicker follows contrast: starts of `link.strength.masking`, by
        # which the sender chooses the strength of each block
        self.masking = logs(MASKING_WEIGHT, MASKING_SCALE * STILL_SENSITIVITY)
        # frames for which the usual noise of such a block counts, blocks in all neighbouring frames
        # for which noise and motion count as they were learned, and variance of a step of the
        # level before anything was learned below which it counts as noise, in variances
        self.block_trust, self.surprise_trust, self.drift_start = logs(16.0), logs(10.0), logs(6.0)
        # relative standard deviation of the signal from block to block
        self.spread, self.surprise, self.temperature = logs(0.1), logs(1e-4), logs(1.0)

    def forward(
        self,
        frames: Tensor,
        seen: Tensor,
        known: Tensor,
        shares: Tensor,
        pair: Tensor,
        pairs: Tensor,
    ) -> Tensor:
        """Decode the frame pairs that a window of frames shows.

        Args:
            frames: (T, 1, h, w) float32 gray levels in [0, 255] of the rectified display.
            seen: (T, rows, cols) float32, 1 where a frame shows a block, else 0.
            known: (rows, cols) float32, -1 or 1 where a block is a pilot, else 0.
            shares: (T, S, rows, cols) float32 shares of what each exposure mixes, as in
                `link.observation.Mixture`.
            pair: (T, S) int64, to which pair each of these belongs; -1 for none.
            pairs: (P,) int64, the numbers 0 to P - 1 of the pairs.

        Returns:
            (P, rows, cols) float32 natural log-likelihood ratios, positive for bit 1.
        """
        rows, cols = known.shape
        known = known.reshape(1, -1)
        picture, changes = self.look(frames / GRAY_LEVELS, rows, cols)
        near = Neighbourhood(seen, rows, cols)
        mixture = shares_seen(shares, pair, pairs, near.seen)

        def improve(*state: Tensor) -> tuple[Tensor, ...]:
            return self._round(Estimates(*state), changes, known, picture, mixture, near)

        begun = self._begin(changes, picture, near)
        none, bits = torch.zeros_like(changes), known.expand(pairs.shape[0], -1)
        start = Estimates(bits, bits, torch.zeros_like(known), none, none, none, *begun)
        llr = Estimates(*repeat(ROUNDS, improve, tuple(each.clone() for each in start))).llr
        llr = self.temperature.double().exp() * llr.double()
        if not self.training:  # the temperature is learned without this correction
            llr = certainty(llr, known) * llr
        llr = with_surprises(llr, self.surprise)
        return llr.float().reshape(pairs.shape[0], rows, cols)

    def look(self, frames: Tensor, rows: int, cols: int) -> tuple[ReferenceBlocks, Tensor]:
        """Describe the blocks of the reference, and how each frame's blocks differ from it.

        Args:
            frames: (T, 1, h, w) intensities in [0, 1].
            rows: number of rows of blocks.
            cols: number of columns of blocks.

        Returns:
            the blocks of the reference, which is the frames' mean, and (T, B) changes of their
            weighted means, in gray levels.
        """
        reference = frames.mean(0, keepdim=True)  # (1, 1, h, w)
        height, width = reference.shape[-2:]
        down = bin_mean(height, rows, torch.arange(rows), 0.0, reference)
        along = bin_mean(width, cols, torch.arange(cols), 0.0, reference).T
        gx, gy, xx, yy = derivatives(reference)
        steepness = GRAY_LEVELS**2 * (gx * gx + gy * gy)
        limit = (2 * self.texture).exp()
        weights = limit / (limit + steepness)
        change, *moments = self.phi(reference, frames)  # (T, 1, h, w), and MOMENTS of (1, 1, h, w)
        total = down @ weights @ along
        maps = torch.cat([torch.ones_like(reference), *moments, gx, gy, xx + yy, steepness], dim=1)
        means = (down @ (maps * weights) @ along / total)[0].flatten(1)  # (MOMENTS + 5, B)
        # P_1 is 2 i - 1, and the change counts from the frame to the reference
        changes = -GRAY_LEVELS / 2 * (down @ (change * weights) @ along / total)
        x, y = block_places(rows, cols)
        light = (means[1] / 2 + 0.5).clamp_min(0.002) ** DISPLAY_GAMMA
        mask = self._masking(light.reshape(1, 1, rows, cols)).reshape(1, -1)
        return ReferenceBlocks(
            self._signal(means[:5], x, y, mask),
            self._nuisances(means[:5], means[5:8], x, y),
            self._variance(means[1:3], means[8:]),
        ), changes.flatten(1)

    def _signal(self, P: Tensor, x: Tensor, y: Tensor, mask: Tensor) -> Tensor:
        """Build the (k, B) columns S from the (MOMENTS + 1, B) moments of the intensity."""
        response = (self.response @ P).unsqueeze(0)
        response = LEAST_RESPONSE + (response - LEAST_RESPONSE).relu()
        bends = torch.cat([P[1:4], x, y, mask]) * self.bends.exp().unsqueeze(1)
        return response * torch.cat([P[:1], bends])

    def _masking(self, light: Tensor) -> Tensor:
        """Guess by how much the sender strengthened each block over busy parts, less 1.

        Args:
            light: (1, 1, rows, cols) light of the blocks; a preset without this strength has a
                small coefficient for what comes of it.
        """
        around = blur(light, AROUND_BLOCKS)
        contrast = blur((light - around).abs() / (around + BLACK_LIGHT), UNCERTAINTY_BLOCKS)
        weight, scale = self.masking.exp()
        above = 1 + weight * (scale * contrast + 1e-6) ** MASKING_EXPONENT
        masked: Tensor = above ** (1 / SIGNAL_EXPONENT) - 1
        return masked

    def _nuisances(self, P: Tensor, slopes: Tensor, x: Tensor, y: Tensor) -> Tensor:
        """Build the (n, B) columns N: tones and places, flicker over the rows, motion and blur."""
        tones = [P, x, y, x * x, x * y, y * y, x * P[1:2], y * P[1:2]]
        waves = torch.arange(FIRST_BAND, FIRST_BAND + BANDS).unsqueeze(1) * (torch.pi / 2)
        places = torch.cat([torch.ones_like(x), x, y])
        motion = GRAY_LEVELS * self.motion.exp().unsqueeze(1)
        return torch.cat(
            [
                torch.cat(tones) * self.nuisance.exp().unsqueeze(1),
                torch.cos(waves * (y + 1)) * self.bands.exp(),
                slopes[:1] * places * motion[:3],
                slopes[1:2] * places * motion[3:6],
                (slopes[:1] * x + slopes[1:2] * y) * places[1:] * motion[6:7],
                slopes[2:] * motion[7:],
            ]
        )

    def _variance(self, P: Tensor, steepness: Tensor) -> Tensor:
        """Give each block's typical variance, relative to the mean of all: (1, B)."""
        log = self.noise[:2] @ P + self.noise[2] * (steepness / 4 + 0.01).log() / 2
        relative = (2 * log).exp()
        return relative / relative.mean()

    def _begin(self, changes: Tensor, picture: ReferenceBlocks, near: Neighbourhood) -> Background:
        """Guess noise and motion of each block by how much it changes from frame to frame."""
        steps = (changes[1:] - changes[:-1]) ** 2
        usual = usual_square(steps / picture.variance)
        noise = picture.variance * usual / 2 + LEAST_VARIANCE
        moved = near.mean(torch.cat([steps, steps[-1:]]))
        drift = (moved - self.drift_start.exp() * noise).maximum(LEAST_START * noise)
        return background_of(near.where_seen(noise.expand_as(changes)), drift)

    def _round(
        self,
        last: Estimates,
        changes: Tensor,
        known: Tensor,
        picture: ReferenceBlocks,
        mixture: Shares,
        near: Neighbourhood,
    ) -> Estimates:
        """Estimate everything anew, in turn, by what the round before found.

        Args:
            last: what was found so far.
            changes: (T, B) change of each block from the window's mean picture, gray levels.
            known: (1, B) bits of the pilots, else 0.
            picture: blocks of the reference.
            mixture: what each exposure mixes.
            near: averages over neighbouring blocks and frames.
        """
        background = Background(last.noise, last.drift, last.before)
        shared = self._explain(changes - last.signal, last.shared, picture, background)
        values = changes - last.signal - shared
        doubt = (mixture.shares**2 * (1 - mixture.of_slots(last.x**2))).sum(1) * last.amplitude**2
        for _ in range(LEARNED):
            background = self._learn(values, doubt, picture, near, background)
        background = self._weigh_surprises(values, doubt, near, background)
        mixed = mixture.mixed(last.x)
        white = background.whiten(torch.stack([values + last.own, mixed, values], 1))
        shown, expected, left = white.unbind(1)
        energy = mixture.energy(background)
        amplitude = self._fit_amplitude(expected * known * known, shown, picture.S)
        llr = self._decide(shown, expected, left, energy, last.x, amplitude, mixture, background)
        x = known + (1 - known * known) * (llr / 2).tanh()
        own = mixture.mixed(x) * amplitude
        signal = own + self._spilled(own.reshape(-1, 1, *near.grid))  # (T, B) -> (T, 1, rows, cols)
        return Estimates(llr, x, amplitude, own, signal, shared, *background)

    def _explain(
        self, target: Tensor, shared: Tensor, picture: ReferenceBlocks, background: Background
    ) -> Tensor:
        """Fit what changes all blocks together in each frame, by what the levels leave over.

        One ridge solve serves all frames, since blocks count alike in all; where a block stands
        out, it counts no more than `CLIP` deviations (Huber 1981, section 7.8).

        Args:
            target: (T, B) what the bits as they are known do not explain.
            shared: (T, B) what was found to change all blocks together so far.
            picture: blocks of the reference.
            background: how the picture of each block moves, and how noisy it is.

        Returns:
            (T, B) gray levels.
        """
        N, noise = picture.N, background.noise
        weight = (1 / noise).mean(0, keepdim=True)
        products = ((N * weight) @ N.t()).double() + torch.eye(N.shape[0], dtype=torch.float64)
        solver = inverse_of_one(products) @ (N * weight)  # (n, B)
        limit = CLIP * noise.sqrt()
        left = background.left(target - shared)
        return shared + (clip(left, limit) @ solver.t()) @ N

    def _learn(
        self,
        values: Tensor,
        doubt: Tensor,
        picture: ReferenceBlocks,
        near: Neighbourhood,
        background: Background,
    ) -> Background:
        """Estimate the noise of each block, and the motion of its picture at each time.

        Args:
            values: (T, B) what neither the bits as they are known nor common changes explain.
            doubt: (T, B) variance that bits which are not known leave in each frame.
            picture: blocks of the reference.
            near: averages over neighbouring blocks and frames.
            background: what is known of both so far.
        """
        left, spread = background.left(values), background.spread()
        squares = left**2 + spread.variance + doubt
        squares = squares.minimum(CLIP**2 * background.noise) * near.seen
        frames, trust = near.seen.sum(0, keepdim=True), self.block_trust.exp()
        usual = picture.variance * usual_square(squares / picture.variance)
        noise = (trust * usual + squares.sum(0, keepdim=True)) / (trust + frames) + LEAST_VARIANCE
        drift = near.mean(spread.steps(values - left)) + LEAST_DRIFT * noise
        return background_of(near.where_seen(noise.expand_as(values)), drift)

    def _weigh_surprises(
        self, values: Tensor, doubt: Tensor, near: Neighbourhood, background: Background
    ) -> Background:
        """Raise or lower noise and motion together where innovations are larger or smaller."""
        squares = (background.whiten(values) ** 2).clamp_max(MOST_SURPRISING)
        squares = squares / (1 + doubt / background.noise)
        trust, count = self.surprise_trust.exp(), NEAR_BLOCKS**2 * NEAR_FRAMES
        factor = (count * near.mean(squares) + trust) / (count + trust)
        ahead = torch.cat([factor[1:], factor[-1:]])
        noise = near.where_seen(background.noise * factor)
        return background_of(noise, background.drift * (factor + ahead) / 2)

    def _decide(
        self,
        shown: Tensor,
        expected: Tensor,
        left: Tensor,
        energy: Tensor,
        x: Tensor,
        amplitude: Tensor,
        mixture: Shares,
        background: Background,
    ) -> Tensor:
        """Decide all pairs: (P, B) log-likelihood ratios.

        Args:
            shown: (T, B) what the bits of the blocks show, whitened.
            expected: (T, B) what the exposures mix of the expected bits, whitened.
            left: (T, B) what nothing explains, whitened.
            energy: (P, B) energy of each pair's shares.
            x: (P, B) expected bits.
            amplitude: (1, B) change of a block for each unit of its bit's change, gray levels.
            mixture: what each exposure mixes.
            background: how the picture of each block moves, and how noisy it is.
        """
        patterns = find_patterns(left.clamp(-CLIP, CLIP))
        strengths = background.unwhiten(patterns.V.unsqueeze(2))  # (T, K, 1) -> (T, K, B)
        energy = patterns.energy(energy, mixture.shares, strengths, mixture.sums)
        weighed = torch.stack([patterns.weigh(shown), patterns.weigh(expected)], 1)
        shown, expected = background.unwhiten(weighed).unbind(1)
        matched = mixture.sums(mixture.shares * shown.unsqueeze(1))
        explained = mixture.sums(mixture.shares * expected.unsqueeze(1)) - energy * x
        doubted = 1 + (self.spread.exp() * amplitude) ** 2 * energy
        llr: Tensor = 2 * amplitude * (matched - amplitude * explained) / doubted
        return llr

    def _fit_amplitude(self, mixed: Tensor, shown: Tensor, S: Tensor) -> Tensor:
        """Fit the change of each block by a ridge problem over the columns S: (1, B) gray levels.

        The pilots alone tell it. Fitted to the message's blocks, too, with the bits that the
        amplitude itself made likely, it was a little worse.

        Args:
            mixed: (T, B) what the exposures mix of the pilots' bits, whitened, and 0 at the blocks
                of the message.
            shown: (T, B) what the bits show, whitened.
            S: (k, B) columns of the signal.
        """
        across = (mixed * shown).sum(0)
        among = (mixed * mixed).sum(0)
        prior = torch.eye(S.shape[0], dtype=torch.float64) / (2 * self.amplitude.double()).exp()
        covariance = inverse_of_one(((S * among) @ S.t()).double().add(prior))
        return ((covariance @ (S @ across.unsqueeze(1))).t() @ S).clamp_min(LEAST_AMPLITUDE)

    def _spilled(self, own: Tensor) -> Tensor:
        """Give the light that blocks get of their neighbours' bits.

        Args:
            own: (T, 1, rows, cols) what bits explain of their own blocks, gray levels.

        Returns:
            (T, B) gray levels.
        """
        beside, above = pad(own, (1, 1, 0, 0)), pad(own, (0, 0, 1, 1))
        along, down = self.spill.exp()
        light = along * (beside[..., :-2] + beside[..., 2:])
        light = light + down * (above[:, :, :-2] + above[:, :, 2:])
        spilled: Tensor = light.flatten(1)
        return spilled


class Neighbourhood:
    """Averages over neighbouring blocks and frames, of what is seen.

    Args:
        seen: (T, rows, cols) 1 where a frame shows a block, else 0.
        rows: number of rows of blocks.
        cols: number of columns of blocks.
    """

    def __init__(self, seen: Tensor, rows: int, cols: int) -> None:
        self.grid = rows, cols
        """Number of rows and of columns of blocks."""
        self.seen = seen.flatten(1)
        """(T, B) 1 where a frame shows a block, else 0."""
        self._count = self._sum(self.seen).clamp_min(1)

    def mean(self, values: Tensor) -> Tensor:
        """Average (T, B) values over `NEAR_BLOCKS` by `NEAR_BLOCKS` blocks of `NEAR_FRAMES`."""
        return self._sum(values * self.seen) / self._count

    def where_seen(self, noise: Tensor) -> Tensor:
        """Give (T, B) variances a very large value where a block is not seen."""
        return noise + UNSEEN * (1 - self.seen)

    def _sum(self, values: Tensor) -> Tensor:
        rows, cols = self.grid
        space, time = NEAR_BLOCKS // 2, NEAR_FRAMES // 2
        maps = values.reshape(-1, 1, rows, cols)  # (T, B) -> (T, 1, rows, cols)
        kernel = maps.new_ones(1, 1, NEAR_BLOCKS, NEAR_BLOCKS)
        summed = conv2d(maps, kernel, padding=space).flatten(1)
        padded, count = pad(summed, (0, 0, time, time)), summed.shape[0]
        near = padded[:count]
        for k in range(1, NEAR_FRAMES):
            near = near + padded[k : k + count]
        return near


class Estimates(NamedTuple):
    """Estimates after a round of the decoder."""

    llr: Tensor
    """(P, B) log-likelihood ratios of the bits."""
    x: Tensor
    """(P, B) expected bits in [-1, 1]; those of pilots are known."""
    amplitude: Tensor
    """(1, B) change of a block for each unit of its bit's change, gray levels."""
    own: Tensor
    """(T, B) what the bits of the blocks themselves explain of each frame, gray levels."""
    signal: Tensor
    """(T, B) what all bits explain, light of neighbouring blocks included, gray levels."""
    shared: Tensor
    """(T, B) what changes all blocks together, gray levels."""
    noise: Tensor
    """(T, B) as `models.film.background.Background` has it."""
    drift: Tensor
    """(T, B) as `models.film.background.Background` has it."""
    before: Tensor
    """(T, B) as `models.film.background.Background` has it."""


def certainty(llr: Tensor, known: Tensor) -> Tensor:
    """Find by how much scores must be scaled to be as sure as the pilots say that they are right.

    The score of a pilot leaves out that its bit is known. So the factor is the likeliest one for
    the pilots' bits (Platt 1999, without his offset).

    Args:
        llr: (P, B) float64 natural log-likelihood ratios.
        known: (1, B), -1 or 1 where a block is a pilot, else 0.

    Returns:
        a positive number, float64.

    >>> known = torch.tensor([[1.0, -1.0, 1.0, 0.0]])
    >>> llr = torch.tensor([[2.0, -2.0, -2.0, 9.0]], dtype=torch.float64).expand(999, -1)
    >>> round(certainty(llr, known).item(), 2)  # two of three are right, so 0.69 of 2 is due
    0.37
    """
    right, factor = known * llr, torch.ones((), dtype=torch.float64)
    for _ in range(CERTAINTY_STEPS):
        wrong = (-factor * right).sigmoid()
        slope = (wrong * right).sum() + CERTAINTY_PRIOR * (1 - factor)
        curvature = (wrong * (1 - wrong) * right * right).sum() + CERTAINTY_PRIOR
        factor = (factor + slope / curvature).maximum(factor / 2)
    return factor


def usual_square(squares: Tensor) -> Tensor:
    """Give the usual size of (T, B) squares, the geometric mean over blocks: a number.

    Some blocks may have very large squares, where something moves.
    """
    return (squares.mean(0) + LEAST_VARIANCE).log().mean().exp()


def block_places(rows: int, cols: int) -> tuple[Tensor, Tensor]:
    """Give the (1, B) places x and y of the centres of a grid's blocks, from -1 to 1."""
    y, x = (
        ((2 * torch.arange(count) + 1) / count - 1).reshape(shape).expand(rows, cols)
        for count, shape in ((rows, (-1, 1)), (cols, (1, -1)))
    )
    return x.reshape(1, -1), y.reshape(1, -1)


def clip(values: Tensor, limit: Tensor) -> Tensor:
    """Clip values to [-limit, limit], which broadcasts with them."""
    return values.minimum(limit).maximum(-limit)


def blur(image: Tensor, deviation: float) -> Tensor:
    """Blur a (1, 1, rows, cols) image by a Gaussian; its edges repeat beyond it."""
    reach = int(np.ceil(3 * deviation))
    steps = np.arange(-reach, reach + 1)
    kernel = np.exp(-(steps**2) / (2 * deviation**2))
    weights = image.new_tensor(kernel / kernel.sum())
    padded = pad(image, (reach, reach, reach, reach), mode="replicate")
    return conv2d(conv2d(padded, weights.reshape(1, 1, 1, -1)), weights.reshape(1, 1, -1, 1))
