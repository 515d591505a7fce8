"""Reduction of frames to intensities: colours weighted, pixels averaged, all in whole numbers."""

from collections.abc import Sequence

import torch
from torch import Tensor, nn

from models.onnx_ops import sum_pixels

WEIGHT_PARTS = 100
"""Number of equal parts in which colour weights are counted: whole numbers are added up quickest
(`models.onnx_ops.sum_pixels`)."""


class Reduce(nn.Module):
    """Weighted sums of R, G and B, averaged over squares of ``k`` x ``k`` pixels.

    Args:
        weights: weights of R, G and B for each of C intensities, at least 0; they sum to 1.
        k: side of the square over which pixels are averaged, in pixels.
    """

    weights: Tensor

    def __init__(self, weights: Sequence[Sequence[float]], k: int) -> None:
        super().__init__()
        self.k = k
        parts = (WEIGHT_PARTS * torch.tensor(weights, dtype=torch.float64)).float()
        kernel = parts.reshape(-1, 3, 1, 1).expand(-1, 3, k, k).contiguous()
        self.whole = bool(torch.equal(kernel, kernel.round()))
        self.register_buffer("weights", kernel, persistent=False)

    def forward(self, frame: Tensor) -> Tensor:
        """Reduce a batch of frames.

        Args:
            frame: (B, 3, H, W) uint8, or float in [0, 255]; encoded RGB.

        Returns:
            (B, C, H // k, W // k) float32 in [0, 1], encoded.
        """
        total = sum_pixels(frame, self.weights, self.k, self.whole)
        return total / (255 * WEIGHT_PARTS * self.k**2)
