"""FilmDecoder: a window of film frames in, scores of all the frame pairs in it out, in one graph.

The paper decodes two frames. A film says more: the picture stays, so its mean over the window is a
reference with little noise, and each frame is a mixture of display states in known shares. With
d the change of a block's mean from that reference, in a frame t,
    d_t = sum_p s_tp x_p S a + N c_t + m + noise,
where x_p in {-1, 1} is the bit of frame pair p and s_tp half the difference of the shares that the
embedded and the original state of the pair have of the exposure at that block, which follow from
the clock. S holds what kappa gray levels become in the capture, N what changes whatever the bits,
with coefficients of each frame's own, and m how far the mean is off. No frame is left out for
being mixed: pairs that share a frame are solved together.

As in `models.phi.refine`, the pilots start it and the message's blocks finish it: each round
solves the ridge problems of all frames (convex, in closed form) with the bits expected so far,
estimates the noise of each block over time and of each frame over the blocks, and then the bits.
The last round also knows what many blocks do together (`models.film.patterns`), and the pilots
tell in the end whether the scores are too sure (`certainty`).
The rounds are those of expectation maximisation (Dempster, Laird & Rubin 1977) with a mean field
over the pairs.
"""

from dataclasses import dataclass

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
from models.film.patterns import find_patterns
from models.onnx_ops import inverse_of_one
from models.phi.decoder import bin_mean
from models.phi.phi import PhiPolynomial
from models.phi.refine import GRAY_LEVELS, MOMENTS, logs, typical_response, with_surprises
from models.phi.refine_pilots import LEAST_RESPONSE
from models.phi.register import derivatives

ROUNDS = 3
"""Number of rounds after the first, in which the pilots alone are known."""
FIRST_BAND, BANDS = 3, 6
"""Number of half waves over the rows of the slowest band of flicker, and how many bands there are;
slower ones are polynomials."""
LEAST_VARIANCE = 1e-3
"""Squared gray levels that are added to the variance of a block, so that it is never 0."""
LEAST_AMPLITUDE = 0.02
"""Smallest change of a block, in gray levels, for each unit of its bit's change."""
LEAST_NOISE = 0.2
"""Smallest share of a block's variance that counts as noise before any bit is known."""
CLIP = 3.0
"""Residual, in standard deviations, up to which a block counts in a frame's coefficients."""
CERTAINTY_STEPS, CERTAINTY_PRIOR = 4, 25.0
"""Number of Newton steps by which `certainty` is found, and how precisely it is known beforehand to
be 1, as an inverse variance."""
DISPLAY_GAMMA, BLACK_LIGHT = 2.2, 0.01
"""Exponent by which captured levels become light, roughly, and the light that is added to a
block's surroundings where contrasts are taken."""


@dataclass(frozen=True)
class ReferenceBlocks:
    """What the reference says of its B blocks."""

    S: Tensor
    """(k, B) columns of the signal; the first is the typical response."""
    N: Tensor
    """(n, B) columns of what changes in each frame whatever the bits, scaled by their priors."""
    variance: Tensor
    """(1, B) typical variance of a block's mean, relative to that of the others."""
    x: Tensor
    """(1, B) place of each block's centre, from -1 to 1 over the display."""
    y: Tensor
    """(1, B) the same from top to bottom."""


@dataclass(frozen=True)
class Shares:
    """Which frame pairs each exposure mixes, and in which shares (`link.observation.Mixture`)."""

    shares: Tensor
    """(T, S, B) half the difference of the shares of a pair's two states, in [-1/2, 1/2]; 0 where a
    frame does not show a block."""
    of_pair: Tensor
    """(P, T S) 1 where a slot of a frame belongs to a pair, else 0."""
    pair: Tensor
    """(T S,) place among the pairs of the pair that each slot belongs to; 0 where none does, and
    its shares are 0."""

    def sums(self, values: Tensor) -> Tensor:
        """Add up what the slots of each pair hold: (T, S, B) to (P, B)."""
        return self.of_pair @ values.flatten(0, 1)

    def of_slots(self, values: Tensor) -> Tensor:
        """Give each slot what its pair holds: (P, B) to (T, S, B)."""
        return values.index_select(0, self.pair).reshape(self.shares.shape)

    def mixed(self, values: Tensor) -> Tensor:
        """Mix what pairs hold as the exposures do: (P, B) to (T, B)."""
        return (self.shares * self.of_slots(values)).sum(1)


def shares_seen(shares: Tensor, pair: Tensor, pairs: Tensor, seen: Tensor) -> Shares:
    """Arrange a `link.observation.Mixture` for sums over pairs.

    Args:
        shares: (T, S, rows, cols) as there.
        pair: (T, S) int64 as there.
        pairs: (P,) int64, 0 to P - 1.
        seen: (T, B) 1 where a frame shows a block, else 0.
    """
    of_pair = (pair.reshape(1, -1) == pairs.unsqueeze(1)).float()
    return Shares(shares.flatten(2) * seen.unsqueeze(1), of_pair, pair.clamp_min(0).flatten())


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
        # frames, and blocks, for which what was learned of the noise counts; degrees of freedom
        self.block_trust, self.frame_trust, self.tails = logs(16.0), logs(100.0), logs(6.0)
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
        seen = seen.flatten(1)
        mixture = shares_seen(shares, pair, pairs, seen)
        state = Estimates(
            x=known.expand(pairs.shape[0], -1),
            amplitude=torch.zeros_like(known),
            signal=torch.zeros_like(changes),
            spilled=torch.zeros_like(changes),
            offset=torch.zeros_like(known),
            variance=picture.variance * ((changes * seen) ** 2).mean() + LEAST_VARIANCE,
            frame_noise=torch.ones_like(changes[:, :1]),
        )
        llr = state.x
        for number in range(ROUNDS + 1):
            left = self._explain(changes, seen, picture, state)
            self._estimate_noise(left, seen, picture, mixture, state)
            llr = self._decide(left, seen, known, picture, mixture, state, number)
            self._expect(mixture, state, rows, cols)
        llr = self.temperature.double().exp() * llr.double()
        if not self.training:  # or else the temperature would rise without bound
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
            x,
            y,
        ), changes.flatten(1)

    def to_config(self) -> dict[str, object]:
        """Give the configuration for the checkpoint: there is none, as the grid is free."""
        return {"decoder": {}}

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

    def _explain(
        self,
        changes: Tensor,
        seen: Tensor,
        picture: ReferenceBlocks,
        state: "Estimates",
    ) -> Tensor:
        """Take away what changes whatever the bits: (T, B) what neither it nor the bits explain.

        One ridge solve serves all frames, since blocks count alike in all; where a block is unseen
        or stands out, what the fit says of it takes its place (Huber 1981, section 7.8).
        """
        N, weight = picture.N, 1 / state.variance
        products = ((N * weight) @ N.T).double() + torch.eye(N.shape[0], dtype=torch.float64)
        solver = inverse_of_one(products) @ (N * weight)  # (n, B)
        limit = CLIP * (state.variance * state.frame_noise).sqrt()
        target = (changes - state.offset - state.signal) * seen
        fitted = (clip(target, limit) @ solver.T) @ N
        for _ in range(2):
            fitted = ((fitted + seen * clip(target - fitted, limit)) @ solver.T) @ N
        left = (target - fitted) * seen
        frames = seen.sum(0, keepdim=True).clamp_min(1)
        shift = clip(left, limit).sum(0, keepdim=True) / frames
        state.offset = state.offset + shift
        return (left - shift) * seen

    def _estimate_noise(
        self,
        left: Tensor,
        seen: Tensor,
        picture: ReferenceBlocks,
        mixture: Shares,
        state: "Estimates",
    ) -> None:
        """Estimate the variance of each block over time, and of each frame over its blocks."""
        doubt = mixture.shares**2 * (1 - mixture.of_slots(state.x**2))
        most = CLIP**2 * state.variance * state.frame_noise
        squares = ((left * left).minimum(most) + doubt.sum(1) * state.amplitude**2) * seen
        trust, frame_trust = self.block_trust.exp(), self.frame_trust.exp()
        of_frames = (squares / state.variance).sum(1, keepdim=True)
        noise = (frame_trust + of_frames) / (frame_trust + seen.sum(1, keepdim=True))
        state.frame_noise = noise / noise.mean()
        squares = squares / state.frame_noise
        scale = squares.sum() / (picture.variance * seen).sum().clamp_min(1e-6)
        frames = seen.sum(0, keepdim=True)
        own = (trust * scale * picture.variance + squares.sum(0, keepdim=True)) / (trust + frames)
        state.variance = own + LEAST_VARIANCE

    def _decide(
        self,
        left: Tensor,
        seen: Tensor,
        known: Tensor,
        picture: ReferenceBlocks,
        mixture: Shares,
        state: "Estimates",
        number: int,
    ) -> Tensor:
        """Fit the signal's amplitude, then decide all pairs: (P, B) log-likelihood ratios.

        In the first round the pilots alone tell the amplitude, and a block's variance still holds
        what its bits do. In the last round patterns over the blocks count less.
        """
        variance, shares = state.variance * state.frame_noise, mixture.shares
        tails, squares = self.tails.exp(), left * left / variance
        weight = seen * (tails + 1) / (tails + squares) / variance
        shown = left + state.signal - state.spilled  # what the bits of the blocks themselves show
        energy, mixed = shares * shares, mixture.mixed(state.x)
        certain = torch.ones_like(known) if number else known * known
        doubt = (energy * (certain - mixture.of_slots(state.x**2))).sum(1)
        amplitude = self._fit_amplitude(mixed, doubt, shown, weight, picture.S)
        if number == 0:
            signal = amplitude**2 * (energy.sum(1) * seen).sum(0) / seen.sum(0).clamp_min(1)
            noise = (1 - signal / state.variance).clamp_min(LEAST_NOISE)
            weight, state.variance = weight / noise, state.variance * noise
        if number == ROUNDS:
            patterns = find_patterns((left / variance.sqrt()).clamp(-CLIP, CLIP))
            weight = weight / patterns.rest
            shown, mixed = (patterns.weigh(each, weight) for each in (shown, mixed))
            own = patterns.energy(shares, weight, mixture.sums)
        else:
            shown, mixed = shown * weight, mixed * weight
            own = mixture.sums(energy * weight.unsqueeze(1))
        matched = mixture.sums(shares * shown.unsqueeze(1))
        explained = mixture.sums(shares * mixed.unsqueeze(1)) - own * state.x
        doubted = 1 + (self.spread.exp() * amplitude) ** 2 * own
        llr: Tensor = 2 * amplitude * (matched - amplitude * explained) / doubted
        state.x = known + (1 - known * known) * (llr / 2).tanh()
        state.amplitude = amplitude
        return llr

    def _fit_amplitude(
        self, mixed: Tensor, doubt: Tensor, shown: Tensor, weight: Tensor, S: Tensor
    ) -> Tensor:
        """Fit the change of each block by a ridge problem over the columns S: (1, B) gray levels.

        Args:
            mixed: (T, B) what the exposures mix of the expected bits.
            doubt: (T, B) variance of that, as the bits are not known.
            shown: (T, B) what the bits show, gray levels.
            weight: (T, B) inverse variances.
            S: (k, B) columns of the signal.
        """
        across = (mixed * shown * weight).sum(0)
        among = ((mixed * mixed + doubt) * weight).sum(0)
        prior = torch.eye(S.shape[0], dtype=torch.float64) / (2 * self.amplitude.double()).exp()
        covariance = inverse_of_one(((S * among) @ S.T).double().add(prior))
        return ((covariance @ (S @ across.unsqueeze(1))).T @ S).clamp_min(LEAST_AMPLITUDE)

    def _expect(self, mixture: Shares, state: "Estimates", rows: int, cols: int) -> None:
        """Work out what the bits explain of each block, light of neighbouring blocks included."""
        signal = mixture.mixed(state.x) * state.amplitude
        grid = signal.reshape(signal.shape[0], 1, rows, cols)
        beside, above = pad(grid, (1, 1, 0, 0)), pad(grid, (0, 0, 1, 1))
        along, down = self.spill.exp()
        light = along * (beside[..., :-2] + beside[..., 2:])
        light = light + down * (above[:, :, :-2] + above[:, :, 2:])
        state.spilled = light.flatten(1)
        state.signal = signal + state.spilled


@dataclass
class Estimates:
    """What the rounds have found so far."""

    x: Tensor
    """(P, B) expected bits in [-1, 1]; those of pilots are known."""
    amplitude: Tensor
    """(1, B) change of a block for each unit of its bit's change, gray levels."""
    signal: Tensor
    """(T, B) what the bits explain of each frame, gray levels."""
    spilled: Tensor
    """(T, B) the part of it that comes from neighbouring blocks."""
    offset: Tensor
    """(1, B) how far the mean over the window is off, gray levels."""
    variance: Tensor
    """(1, B) variance of each block's mean from frame to frame, squared gray levels."""
    frame_noise: Tensor
    """(T, 1) variance of each frame relative to the others."""


def certainty(llr: Tensor, known: Tensor) -> Tensor:
    """Find by how much scores must shrink to be no surer than the pilots say that they are right.

    The score of a pilot leaves out that its bit is known. So the factor is the likeliest one for
    the pilots' bits (Platt 1999, without his offset), or 1 where that is larger.

    Args:
        llr: (P, B) float64 natural log-likelihood ratios.
        known: (1, B), -1 or 1 where a block is a pilot, else 0.

    Returns:
        a number in (0, 1], float64.

    >>> known = torch.tensor([[1.0, -1.0, 1.0, 0.0]])
    >>> llr = torch.tensor([[2.0, -2.0, -2.0, 9.0]], dtype=torch.float64).expand(99, -1)
    >>> round(certainty(llr, known).item(), 2)  # two of three are right, so 0.69 of 2 is due
    0.4
    """
    right, factor = known * llr, torch.ones((), dtype=torch.float64)
    for _ in range(CERTAINTY_STEPS):
        wrong = (-factor * right).sigmoid()
        slope = (wrong * right).sum() + CERTAINTY_PRIOR * (1 - factor)
        curvature = (wrong * (1 - wrong) * right * right).sum() + CERTAINTY_PRIOR
        factor = (factor + slope / curvature).maximum(factor / 2).clamp_max(1)
    return factor


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
