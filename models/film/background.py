"""What a block shows of the picture: a level that drifts, and noise of its own at each time.

A message is a small change on top of a picture, which may stand still, move, or be cut. So the mean
y_t of a block in frame t, less what the bits explain, is taken for
    y_t = p_t + e_t,  p_{t+1} = p_t + d_t,  e_t ~ N(0, r_t),  d_t ~ N(0, q_t),
a random walk in noise, of which nothing is known at first. Where the picture stands still q is
small, and the level is known from all frames; where something passes q is large for as long as it
takes, and only the nearest frames count; a cut is one large q. The Kalman filter (Kalman 1960)
gives the innovations, which are white, and the smoother of Rauch, Tung & Striebel (1965) the level
by all frames. From these, r and q are estimated as Shumway & Stoffer (1982) do, by expectation
maximisation.

All functions are linear recursions over the T frames, for all B blocks at once.
"""

from __future__ import annotations  # export cannot trace those of inner functions

from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from models.onnx_ops import scan

UNKNOWN = 1e4
"""Variance of the level before the first frame, in variances of the first frame's noise."""


@dataclass(frozen=True)
class Spread:
    """Precision with which all frames together determine the level of each block."""

    variance: Tensor
    """(T, B) variances, squared gray levels."""
    carry: Tensor
    """(T, B) covariance of the level with that of the next frame, over the variance there; of the
    last frame 0."""

    def steps(self, level: Tensor) -> Tensor:
        """Give the expected square of each step of the level, (T, B); of the last frame 0.

        Args:
            level: (T, B) means, gray levels.
        """
        ahead, variance = (torch.cat([each[1:], each[-1:]]) for each in (level, self.variance))
        squares = (ahead - level) ** 2 + self.variance + (1 - 2 * self.carry) * variance
        return torch.cat([squares[:-1], torch.zeros_like(squares[:1])])


class Background(NamedTuple):
    """The model of each block's level and noise; `background_of` makes it.

    >>> still = background_of(torch.ones(4, 1), torch.zeros(4, 1))
    >>> y = torch.tensor([[1.0], [3.0], [1.0], [3.0]])
    >>> (y - still.left(y)).flatten().numpy().round(2).tolist()  # the mean of all frames
    [2.0, 2.0, 2.0, 2.0]
    """

    noise: Tensor
    """(T, B) variances r_t, squared gray levels; very large where a block is not seen."""
    drift: Tensor
    """(T, B) variances q_t of the step from each frame to the next; that of the last is not used.
    """
    before: Tensor
    """(T, B) variance of the level before each frame is seen."""

    @property
    def innovation(self) -> Tensor:
        """(T, B) variance of what each frame differs from the level by the frames before it."""
        return self.before + self.noise

    @property
    def gain(self) -> Tensor:
        """(T, B) share of each innovation that counts as a change of the level."""
        return self.before / self.innovation

    def whiten(self, values: Tensor) -> Tensor:
        """Give what frames say beyond those before them: (T, ..., B), each of variance 1."""
        return self.innovations(values) * _like(self.innovation.rsqrt(), values)

    def unwhiten(self, values: Tensor) -> Tensor:
        """Apply the transpose of `whiten`, which is linear: (T, ..., B) to (T, ..., B)."""
        weighted = values * _like(self.innovation.rsqrt(), values)

        def step(level: Tensor, value: Tensor, gain: Tensor) -> tuple[Tensor, Tensor]:
            carried = gain * level
            return level - carried - value, carried

        zero = torch.zeros_like(weighted[0])
        (carried,) = scan(step, zero, weighted, _like(self.gain, values), reverse=True)
        return weighted + carried

    def innovations(self, values: Tensor) -> Tensor:
        """Give what each frame differs from the level by the frames before it: (T, ..., B)."""

        def step(level: Tensor, value: Tensor, gain: Tensor) -> tuple[Tensor, Tensor]:
            innovation = value - level
            return level + gain * innovation, innovation

        zero = torch.zeros_like(values[0])
        (apart,) = scan(step, zero, values, _like(self.gain, values))
        return apart

    def left(self, values: Tensor) -> Tensor:
        """Give what the level by all frames leaves of values, (T, B) each."""
        return self.noise * self.unwhiten(self.whiten(values))

    def spread(self) -> Spread:
        """Tell how well all frames together tell the level."""
        filtered = self.before * self.noise / self.innovation
        after = torch.cat([self.before[1:], torch.ones_like(filtered[:1])])
        carry = torch.cat([filtered[:-1] / after[:-1], torch.zeros_like(filtered[:1])])

        def back(variance: Tensor, own: Tensor, ahead: Tensor, carry: Tensor) -> tuple[Tensor, ...]:
            spread = own + carry * carry * (variance - ahead)
            return spread, spread.clone()

        (variance,) = scan(back, filtered[-1], filtered, after, carry, reverse=True)
        return Spread(variance, carry)


def background_of(noise: Tensor, drift: Tensor) -> Background:
    """Make the model of noise and drift, (T, B) each as `Background` has them."""

    def step(variance: Tensor, r: Tensor, q: Tensor) -> tuple[Tensor, Tensor]:
        return variance * r / (variance + r) + q, variance.clone()

    (before,) = scan(step, UNKNOWN * noise[0], noise, drift)
    return Background(noise, drift, before)


def _like(values: Tensor, other: Tensor) -> Tensor:
    """View (T, B) as (T, 1, ..., B), with as many axes as another tensor has."""
    return values.reshape(values.shape[0], *([1] * (other.dim() - 2)), values.shape[1])
