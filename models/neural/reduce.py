"""Frame -> intensities: colours weighted and pixels averaged in whole numbers, exact and quick."""

import torch
from torch import Tensor, nn
from torch.nn.functional import conv2d

PARTS = 100
"""Weights are hundredths where they can be: then onnxruntime adds uint8 pixels as they are."""


@torch.library.custom_op("camera_display::sum_pixels", mutates_args=())
def exported_sum(frame: Tensor, weights: Tensor, stride: int) -> Tensor:
    """Becomes ONNX's ConvInteger on export (`export.to_onnx`): no float copy of the frame."""
    return conv2d(frame.float(), weights.float(), stride=stride)


@exported_sum.register_fake
def _(frame: Tensor, weights: Tensor, stride: int) -> Tensor:
    return conv2d(frame.float(), weights.float(), stride=stride)


class Reduce(nn.Module):
    """Weighted sums of R, G, B, averaged over ``k`` x ``k`` pixels, in [0, 1].

    Args:
        weights: of R, G, B, for each of C intensities; each sums to 1.
        k: pixels an axis.
    """

    weights: Tensor

    def __init__(self, weights: tuple[tuple[float, float, float], ...], k: int) -> None:
        super().__init__()
        self.k = k
        parts = (PARTS * torch.tensor(weights, dtype=torch.float64)).float()
        kernel = parts.reshape(-1, 3, 1, 1).expand(-1, 3, k, k).contiguous()
        self.whole = bool(torch.equal(kernel, kernel.round()))
        self.register_buffer("weights", kernel, persistent=False)

    def forward(self, frame: Tensor) -> Tensor:
        """(B, 3, H, W) uint8, or float in [0, 255], encoded -> (B, C, H // k, W // k) float32."""
        if torch.compiler.is_exporting() and self.whole:
            total: Tensor = exported_sum(frame, self.weights.to(torch.uint8), self.k)
        else:
            total = conv2d(frame.float(), self.weights, stride=self.k)
        return total / (255 * PARTS * self.k**2)
