"""Patterns: what many blocks of a film do together, beyond the terms that a model knows.

Moire that moves with the hand, flicker over the rows, and motion of the picture change blocks by a
pattern over the display, whose strength goes up and down from frame to frame. A few such patterns
often hold a good part of what a model leaves over. With z_b the T values of a block over the frames
of a window, in standard deviations,
    z_b = V u_b + noise,  u_b ~ N(0, I),  noise ~ N(0, v I),
where the columns of V are the strengths of K patterns and u_b is how much of each the block has.
That is probabilistic principal component analysis (Tipping & Bishop 1999). The frames of a block
are then weighed by the inverse of the covariance V V' + v I, so that what patterns hold counts
less, and nothing needs to be subtracted.
"""

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from models.onnx_ops import inverse_of_one

COUNT = 6
"""Number of patterns."""
STEPS = 8
"""Number of steps of expectation maximisation by which patterns are fitted."""
START = 0.3
"""Strength of the patterns before the first step, in standard deviations: half waves over time."""
LEAST_REST = 0.05
"""Smallest share of the power that is left to the noise."""


@dataclass(frozen=True)
class Patterns:
    """Patterns of a window of T frames."""

    V: Tensor
    """(T, K) strength of each pattern in each frame, in standard deviations."""
    rest: Tensor
    """() the variance v that the noise has beside the patterns; 1 is the power of all."""
    removal: Tensor
    """(K, K) inverse of V' V + v I."""

    def weigh(self, values: Tensor) -> Tensor:
        """Multiply the frames of each block by the inverse of their covariance.

        Args:
            values: (T, B) values, in standard deviations.

        Returns:
            (T, B) weighted values.
        """
        return (values - self.V @ (self.removal @ (self.V.t() @ values))) / self.rest

    def energy(
        self,
        energy: Tensor,
        shares: Tensor,
        strengths: Tensor,
        add_up: Callable[[Tensor], Tensor],
    ) -> Tensor:
        """Give the weighted energy that each frame pair has in each block.

        Args:
            energy: (P, B) energy of each pair without patterns.
            shares: (T, slots, B) shares of states.
            strengths: (T, K, B) the patterns as they weigh what blocks show in each frame.
            add_up: adds up what the slots of each pair hold: (T, slots, B) to (P, B).

        Returns:
            (P, B) s' C s for the shares s of each pair and the inverse covariance C of `weigh`.
        """
        parts = torch.stack([add_up(shares * each.unsqueeze(1)) for each in strengths.unbind(1)])
        inside = (self.removal @ parts.flatten(1)).reshape(parts.shape)  # (K, P B) -> (K, P, B)
        return (energy - (parts * inside).sum(0)) / self.rest


def find_patterns(z: Tensor) -> Patterns:
    """Fit patterns to what a model leaves over.

    Even noise without patterns has more than its mean power in some directions: up to
    (1 + sqrt(T / B))^2 of it, for B blocks (Marchenko & Pastur 1967). That excess is taken off.

    Args:
        z: (T, B) residuals, in standard deviations of their block and frame.
    """
    S = z @ z.t()
    S = S / S.diagonal().mean().clamp_min(1e-6)
    frames, blocks = (torch.ones_like(each).sum() for each in (z[:, 0], z[0]))  # T, B
    by_chance = 2 * (frames / blocks).sqrt() + frames / blocks
    time = (torch.arange(z.shape[0]) + 0.5) / z.shape[0]
    V = START * torch.cos(torch.pi * torch.arange(1, COUNT + 1) * time.unsqueeze(1))
    rest, unit = torch.ones(()), torch.eye(COUNT)
    for _ in range(STEPS):
        inner = inverse_of_one(V.t() @ V + rest * unit)
        SV = S @ V - by_chance * rest * V
        V = SV @ inverse_of_one(rest * unit + inner @ (V.t() @ SV))
        rest = (1 - (V * V).sum(1).mean()).clamp_min(LEAST_REST)
    return Patterns(V, rest, inverse_of_one(V.t() @ V + rest * unit))
