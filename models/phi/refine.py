"""Decision-directed refinement: the message blocks become training data of further convex solves.

A block's brightness change is modelled as
    y = m S a + N c + noise,
with m what the block's bit changes, in units of kappa, known columns S and N, and Gaussian a and c
of learned spread. S holds what kappa gray levels become in the capture, and how that bends with
intensity and place. N holds what changes whatever the bit: drift, flicker and fall-off.

Given the bits, or their probabilities, a and c follow from one ridge solve. Given a and c, the bits
follow from a likelihood ratio. In each round all blocks enter the solve with the probabilities of
the round before; each is then decided by the fit to all others, its cavity. Each round also
estimates how large kappa, flicker and noise are in this frame pair; the next round takes that for
their spread.

Here stands what holds for all layouts. `models.phi.refine_ratex` starts from ratex patches and
`models.phi.refine_pilots` from pilots.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from numpy.polynomial.legendre import legfit
from torch import Tensor, nn

from models.blind.blind import slope

MOMENTS = 4
"""Number of Legendre moments of i_o over a tile or block. It is also the degree of the polynomials
in i_o by which the response is described."""
TEXTURES = 5
"""Number of statistics that tell a block's texture: the gradients along x and y, the curvature, the
squared gradient, and the mean weight of its pixels."""
INTENSITY_GRID = np.linspace(0, 1, 65)
"""Intensities in [0, 1] at which curves are evaluated."""
GRAY_LEVELS = 255.0
"""Number of gray levels that make the intensity 1."""
GAIN_BENDS = 5
"""Number of terms by which the gain varies smoothly over the display: x, y, x^2, x y and y^2."""


def typical_response() -> nn.Parameter:
    """Describe the usual slope of a CDTF as (MOMENTS + 1,) Legendre coefficients in i_o."""
    coefficients = legfit(2 * INTENSITY_GRID - 1, slope(INTENSITY_GRID), MOMENTS)
    return nn.Parameter(torch.from_numpy(coefficients).float())


@dataclass(frozen=True)
class Fit:
    """Posterior of the K coefficients of a ridge problem."""

    covariance: Tensor
    """(B, K, K) covariance."""
    mean: Tensor
    """(B, 1, K) mean."""
    weight: Tensor
    """Inverse variances with which the rows entered the solve, each times its bit's probability."""


@dataclass(frozen=True)
class Hypotheses:
    """Predictions of a fit for each block under both labels: index 0 is bit 1, index 1 is bit 0."""

    residual: Tensor
    """Change less its prediction, gray levels."""
    variance: Tensor
    """Variance that the coefficients leave in the prediction, squared gray levels."""
    shared: Tensor
    """Covariance of a block's two predictions, at both places or at one that stands for both."""


class Refiner(nn.Module):
    """Learned numbers of both refiners, and the steps that they share.

    Args:
        rounds: number of times that it solves for all blocks and decides anew.
        rows: whether flicker may vary over the rows of the display.
        spread: relative standard deviation of the signal from block to block, before training.
        surprise: probability of a cause outside the model, before training.
    """

    needs_texture = False
    """Whether its statistics of a block end with those of the texture (`TEXTURES`)."""
    waves: Tensor
    frequency: Tensor

    def __init__(self, rounds: int, rows: bool, spread: float, surprise: float) -> None:
        super().__init__()
        self.rounds = rounds
        # log standard deviation of the bands' mean, and how it falls with their frequency
        self.bands = nn.Parameter(torch.tensor([0.0, -0.4])) if rows else None
        # what a relative change of exposure adds, as Legendre coefficients in i_o: a camera's toe
        # and shoulder make it a hump; the start is the mean of the cameras of data_gen/paper.json
        self.exposure = nn.Parameter(torch.tensor([0.7, 0.25, -0.5, -0.1, 0.0]))
        # observations that learned bands count for, beside this frame pair's
        self.band_trust = logs(8.0)
        self.spread, self.surprise, self.temperature = logs(spread), logs(surprise), logs(1.0)

    def row_gains(self, bands: Tensor) -> Tensor:
        """Scale the waves over the rows of blocks by the standard deviations that ``bands`` says.

        ``bands`` is the parameter of that name, of a refiner that has it.
        """
        return self.waves * (bands[0] + bands[1] * self.frequency).exp()

    def bounded(self, llr: Tensor) -> Tensor:
        """Turn (B, n_bits) LLRs by the model into LLRs that allow for its faults."""
        return with_surprises(self.temperature.exp() * llr, self.surprise)


def cavity_llr(
    fit: Fit, hypotheses: Hypotheses, noise: Tensor, swapped: Callable[[Tensor], Tensor]
) -> Tensor:
    """Compute the LLR of each block's bit from a fit to all other blocks, in closed form.

    Let A be the 2 x 2 covariance of the block's two predictions, as bit 1 and as bit 0, r their
    residuals, and P the diagonal of the weights with which the block entered the fit. The fit
    without the block, its cavity (Minka 2001, expectation propagation), has
        A' = (I - A P)^-1 A,  r' = (I - A P)^-1 r.
    Without it, a block that sways the fit would confirm its own label.

    Args:
        fit: the fit, whose weights have the shape of the prediction's residuals.
        hypotheses: what it says of each block.
        noise: variance of the noise, squared gray levels, in that shape.
        swapped: puts what stands at a block's one place at its other place.

    Returns:
        natural log-likelihood ratios, positive at the place of the bit that is likelier.
    """
    residual, variance, shared = hypotheses.residual, hypotheses.variance, hypotheses.shared
    own = 1 - variance * fit.weight  # I - A P: the diagonal,
    cross = shared * fit.weight  # and less the rest
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


def logs(*values: float) -> nn.Parameter:
    """Make a parameter of the natural logarithms of positive values."""
    return nn.Parameter(torch.tensor(values).log())
