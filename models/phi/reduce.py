"""Reduction of frames to intensities: colours weighted, pixels averaged, all in whole numbers."""

from collections.abc import Sequence

import torch
from torch import Tensor, nn
from torch.nn.functional import conv2d

WEIGHT_PARTS = 100
"""Number of equal parts in which colour weights are counted. Weights of whole hundredths let
onnxruntime add uint8 pixels as they are, without a float copy of the frame."""


@torch.library.custom_op("camera_display::sum_pixels", mutates_args=())
def exported_sum(frame: Tensor, weights: Tensor, stride: int) -> Tensor:
    """Sum weighted pixels; on export `export.to_onnx` makes ONNX's ConvInteger of this."""
    return conv2d(frame.float(), weights.float(), stride=stride)


@exported_sum.register_fake
def _(frame: Tensor, weights: Tensor, stride: int) -> Tensor:
    return conv2d(frame.float(), weights.float(), stride=stride)


class Reduce(nn.Module):
    """Weighted sums of R, G and B, averaged over squares of ``k`` x ``k`` pixels.

    Negative weights are made up for by an offset, so that no intensity falls below 0.

    Args:
        weights: weights of R, G and B for each of C intensities; their absolute values sum to 1.
        k: side of the square over which pixels are averaged, in pixels.
    """

    weights: Tensor
    offset: Tensor

    def __init__(self, weights: Sequence[Sequence[float]], k: int) -> None:
        super().__init__()
        self.k, self.n_intensities = k, len(weights)
        parts = (WEIGHT_PARTS * torch.tensor(weights, dtype=torch.float64)).float()
        self.signed = bool((parts < 0).any())
        if self.signed:  # onnxruntime adds up signed weights with saturation on some processors
            parts = torch.cat([parts.clamp_min(0), (-parts).clamp_min(0)])
        kernel = parts.reshape(-1, 3, 1, 1).expand(-1, 3, k, k).contiguous()
        self.whole = bool(torch.equal(kernel, kernel.round()))
        self.register_buffer("weights", kernel, persistent=False)
        offset = parts[self.n_intensities :].sum(1) / WEIGHT_PARTS
        self.register_buffer("offset", offset.reshape(-1, 1, 1), persistent=False)

    def forward(self, frame: Tensor) -> Tensor:
        """Reduce a batch of frames.

        Args:
            frame: (B, 3, H, W) uint8, or float in [0, 255]; encoded RGB.

        Returns:
            (B, C, H // k, W // k) float32 in [0, 1], encoded.
        """
        if torch.compiler.is_exporting() and self.whole:
            total: Tensor = exported_sum(frame, self.weights.to(torch.uint8), self.k)
        else:
            total = conv2d(frame.float(), self.weights, stride=self.k)
        if self.signed:
            total = total[:, : self.n_intensities] - total[:, self.n_intensities :]
        intensity = total / (255 * WEIGHT_PARTS * self.k**2)
        return intensity + self.offset if self.signed else intensity
