"""Ripples: what moire and flicker leave in the blocks' residuals, estimated from the blocks around.

Moire is a wave over the picture. It moves with the hand, so that it does not cancel between the two
frames: on fine grids it changes blocks by more than their bits do. A wave reaches over many blocks
while the bits of a message have no order, so it stands out in the spectrum of what the linear model
leaves over. The residuals are cut into overlapping windows, since perspective bends the wave, and
each window's spectrum is cleaned by spectral subtraction (Boll 1979).

A block's own residual must not explain itself, or else a wrongly decided block would confirm its
decision. The estimate is linear once the gains of the spectrum are known, so the share that a block
has in its own estimate is known too, and is taken out.
"""

import numpy as np
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn.functional import conv2d, conv_transpose2d, pad

from models.onnx_ops import table

WINDOW = 16
"""Number of blocks along each side of a window; windows overlap by half of it."""
OVER = 4.0
"""Power of a frequency, relative to the mean power of its window's frequencies, up to which it
counts as noise; without waves the powers are about exponentially distributed with mean 1, so that
one in fifty is larger."""
MOST = 3.0
"""Largest residual that counts, in standard deviations, because edges of the picture leave larger
ones that are no waves."""
MOST_OWN = 0.9
"""Largest share of a block in its own estimate that is taken out by division."""
LEAST_POWER = 1e-3
"""Power, in squared standard deviations of a block, that is added to a window's mean power, so that
frames without any change stay finite."""


class Ripple(nn.Module):
    """Estimates the wave at each block of a grid from the residuals of all other blocks.

    It has no learned parameters.

    Args:
        rows: number of rows of blocks, at least `WINDOW`.
        cols: number of columns of blocks, at least `WINDOW`.

    A wave of amplitude 2 over noise of standard deviation 1:

    >>> import torch
    >>> wave = 2 * torch.cos(torch.arange(32.0) * 1.3).expand(1, 1, 32, 32)
    >>> noise = torch.randn((1, 1, 32, 32), generator=torch.Generator().manual_seed(0))
    >>> left = wave - Ripple(32, 32)(wave + noise)
    >>> bool(left.std() < 0.5 * wave.std())
    True
    """

    def __init__(self, rows: int, cols: int) -> None:
        super().__init__()
        self.rows, self.cols = rows, cols
        phases, freedoms = _wave_phases()
        self.phases, self.freedoms = table(phases), table(freedoms)
        angle = 2 * np.pi * np.arange(WINDOW) / WINDOW
        circle = np.stack([np.cos(angle), np.sin(angle)])
        self.circle = table(np.where(np.abs(circle) < 1e-9, 0.0, circle))  # exactly 0 where it is
        taper = _taper()
        self.taper, self.squares = table(taper), table((taper[None, None] ** 2).astype(np.float32))

    @staticmethod
    def fits(rows: int, cols: int) -> bool:
        """Return whether a grid of blocks is large enough for a window."""
        return min(rows, cols) >= WINDOW

    def waves(self) -> Tensor:
        """Make the (2 F, 1, WINDOW, WINDOW) waves of a window, orthonormal, times its taper.

        A cosine and a sine of each of the F frequencies are looked up by their phases: files of
        graphs that held them would be twice as large.
        """
        scale = (self.freedoms.double().sqrt() / WINDOW)[:, :, None, None]
        # (2, F, WINDOW, WINDOW) -> (F, 2, WINDOW, WINDOW) -> (2 F, 1, WINDOW, WINDOW)
        both = self.circle[:, self.phases.long()].transpose(0, 1) * scale * self.taper
        return both.reshape(-1, 1, WINDOW, WINDOW).float()

    def forward(self, residual: Tensor) -> Tensor:
        """Estimate the wave at each block.

        Args:
            residual: (B, 1, rows, cols) float32 residuals in standard deviations.

        Returns:
            (B, 1, rows, cols) float32, what the other blocks say of the wave at each block, in
            standard deviations.
        """
        step, waves = WINDOW // 2, self.waves()
        residual = residual.clamp(-MOST, MOST)
        below, beside = -self.rows % step, -self.cols % step
        padded = pad(residual, (step, step + beside, step, step + below))
        spectrum = conv2d(padded, waves, stride=step)  # (B, 2 F, windows down, windows along)
        B, _, down, along = spectrum.shape
        spectrum = spectrum.reshape(B, -1, 2, down * along)
        squares = (spectrum * spectrum).sum(2)  # (B, F, windows)
        mean = squares.sum(1, keepdim=True) / WINDOW**2 + LEAST_POWER
        power = squares / (self.freedoms * mean) + LEAST_POWER
        gain = (1 - OVER / power).relu()
        kept = (spectrum * gain.unsqueeze(2)).reshape(B, -1, down, along)
        share = (gain * self.freedoms).sum(1).reshape(B, 1, down, along) / WINDOW**2
        wave, own = (
            conv_transpose2d(each, kernel, stride=step)[
                :, :, step : step + self.rows, step : step + self.cols
            ]
            for each, kernel in ((kept, waves), (share, self.squares))
        )
        own = own.clamp_max(MOST_OWN)
        return (wave - own * residual) / (1 - own)


def _taper() -> NDArray[np.float64]:
    """Make the (WINDOW, WINDOW) taper; the squares of overlapping windows' tapers add up to 1."""
    side = np.sin(np.pi * (np.arange(WINDOW) + 0.5) / WINDOW)
    return np.outer(side, side)


def _wave_phases() -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    """List the F frequencies of a window that are not the negative of another one.

    Returns:
        phases: (F, WINDOW, WINDOW), the phase of each at each block, in WINDOW-ths of a turn.
        freedoms: (F, 1), how many of its cosine and its sine are not zero: 1 where the sine
            vanishes.
    """
    n, half = np.arange(WINDOW), WINDOW // 2
    alone = (0, half)  # along an axis: a frequency that is its own negative
    phases, freedoms = [], []
    for down in range(WINDOW):
        for along in range(half + 1):
            if along in alone and down > half:
                continue  # the negative of another frequency
            phases.append((down * n[:, None] + along * n) % WINDOW)
            freedoms.append([1 if along in alone and down in alone else 2])
    return np.stack(phases).astype(np.uint8), np.array(freedoms, np.float32)
