"""Registration of a frame pair to a few hundredths of a pixel, inside the graph.

Gauss-Newton steps of image alignment (Lucas & Kanade 1981) with the photometric change as an
unknown of the same least squares, so that drift is no motion:
    i_e - i_o = -s_x d/dx i - s_y d/dy i + c_0 + c_1 i_o + c_2 i_o^2.
One step on a coarse image finds the translation, up to several pixels; one more what remains,
affine in (x, y). A tenth of a pixel left between the frames costs more than all noise.
"""

import torch
from torch import Tensor
from torch.nn.functional import avg_pool2d, grid_sample, pad

from models.neural.solver import solve_spd

RIDGE = 1e-6
"""Of the least squares, per pixel, in squared intensity: flat pictures stay where they are."""
COARSE = 4
"""Pixels averaged per axis for the first step."""


def gradients(image: Tensor) -> tuple[Tensor, Tensor]:
    """Central differences d/dx and d/dy of (B, C, H, W), smoothed across; the same shape."""
    p = pad(image, (1, 1, 1, 1), mode="replicate")
    smooth_y = (p[:, :, :-2] + 2 * p[:, :, 1:-1] + p[:, :, 2:]) / 4
    smooth_x = (p[:, :, :, :-2] + 2 * p[:, :, :, 1:-1] + p[:, :, :, 2:]) / 4
    return (
        (smooth_y[:, :, :, 2:] - smooth_y[:, :, :, :-2]) / 2,
        (smooth_x[:, :, 2:] - smooth_x[:, :, :-2]) / 2,
    )


def curvatures(image: Tensor) -> tuple[Tensor, Tensor]:
    """Second differences along x and y of (B, C, H, W); the same shape."""
    p = pad(image, (1, 1, 1, 1), mode="replicate")
    return (
        p[:, :, 1:-1, 2:] + p[:, :, 1:-1, :-2] - 2 * image,
        p[:, :, 2:, 1:-1] + p[:, :, :-2, 1:-1] - 2 * image,
    )


def register(i_o: Tensor, i_e: Tensor) -> Tensor:
    """Move the embedded frame onto the original.

    Args:
        i_o: (B, C, H, W) float in [0, 1], encoded.
        i_e: the same shape.

    Returns:
        i_e as it would be without the motion, the same shape.
    """
    coarse = translation(i_o, i_e).float().reshape(-1, 2, 1, 1)
    height, width = i_o.shape[-2:]
    x = (2 * torch.arange(width, device=i_o.device) / (width - 1) - 1).expand(height, width)
    y = (2 * torch.arange(height, device=i_o.device) / (height - 1) - 1).unsqueeze(1)
    y = y.expand(height, width)
    moved = warp(i_e, coarse[:, 0], coarse[:, 1])
    dx, dy = gradients((i_o + moved) / 2)
    # a quarter of the pixels, in float64: torch and onnxruntime sum in different orders
    o, change, gx, gy = (
        channel_mean(t)[:, 0, ::2, ::2].double() for t in (i_o, moved - i_o, dx, dy)
    )
    u, v = x[::2, ::2].double(), y[::2, ::2].double()
    m = least_squares([gx, gx * u, gx * v, gy, gy * u, gy * v], o, change)
    m = m.float().reshape(-1, 6, 1, 1)
    s_x = coarse[:, 0] + m[:, 0] + m[:, 1] * x + m[:, 2] * y
    s_y = coarse[:, 1] + m[:, 3] + m[:, 4] * x + m[:, 5] * y
    # bilinear interpolation blurs: at fraction f of a pixel it adds f (1 - f) / 2 of the curvature
    blur_x, blur_y = ((s - s.floor()) * (s.ceil() - s) / 2 for s in (s_x, s_y))
    xx, yy = curvatures(i_o)
    return warp(i_e, s_x, s_y) - blur_x.unsqueeze(1) * xx - blur_y.unsqueeze(1) * yy


def least_squares(motion: list[Tensor], i_o: Tensor, change: Tensor) -> Tensor:
    """(B, len(motion)) motion s from its gradient terms; all arguments (B, H, W) float64."""
    columns = [*motion, torch.ones_like(i_o), i_o, i_o * i_o]
    A = torch.stack(columns, dim=1).flatten(2)  # (B, terms, H W)
    normal = A @ A.transpose(1, 2)
    right = (A @ change.flatten(1).unsqueeze(-1)).squeeze(-1)
    ridge = RIDGE * A.shape[-1] * torch.eye(A.shape[1], dtype=A.dtype, device=A.device)
    return -solve_spd(normal + ridge, right)[:, : len(motion)]


def translation(i_o: Tensor, i_e: Tensor) -> Tensor:
    """(B, 2) translation (x, y) of the embedded frame, found on a coarse image, pixels."""
    o, e = (avg_pool2d(channel_mean(i), COARSE, ceil_mode=True) for i in (i_o, i_e))
    dx, dy = (g[:, 0].double() for g in gradients(o))
    return COARSE * least_squares([dx, dy], o[:, 0].double(), (e - o)[:, 0].double())


def warp(image: Tensor, s_x: Tensor, s_y: Tensor) -> Tensor:
    """(B, C, H, W) sampled at (x + s_x, y + s_y), pixels, (B, H, W) or (B, 1, 1); edges repeat."""
    height, width = image.shape[-2:]
    x = torch.arange(width, device=image.device) + s_x
    y = torch.arange(height, device=image.device).unsqueeze(1) + s_y
    x, y = (2 * x + 1) / width - 1, (2 * y + 1) / height - 1
    grid = torch.stack([x + 0 * y, y + 0 * x], dim=-1)  # (B, H, W, 2)
    return grid_sample(image, grid, padding_mode="border", align_corners=False)


def channel_mean(maps: Tensor) -> Tensor:
    """(B, C, H, W) -> (B, 1, H, W)."""
    return maps if maps.shape[1] == 1 else maps.mean(1, keepdim=True)
