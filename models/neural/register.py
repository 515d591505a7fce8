"""Registration of a frame pair to a few hundredths of a pixel, inside the graph.

One Gauss-Newton step of affine image alignment (Lucas & Kanade 1981), good to about a pixel, with
the photometric change as an unknown of the same least squares, so that drift is no motion:
    i_e - i_o = s_x d/dx i + s_y d/dy i + c_0 + c_1 i_o + c_2 i_o^2,   s = affine in (x, y).
A tenth of a pixel of motion left between the frames costs more than all noise.
"""

import torch
from torch import Tensor
from torch.nn.functional import pad

from models.neural.solver import solve_spd

RIDGE = 1e-6
"""Of the least squares, per pixel, in squared intensity: flat pictures stay where they are."""


def gradients(image: Tensor) -> tuple[Tensor, Tensor]:
    """Central differences d/dx and d/dy of (B, C, H, W), smoothed across; the same shape."""
    p = pad(image, (1, 1, 1, 1), mode="replicate")
    smooth_y = (p[:, :, :-2] + 2 * p[:, :, 1:-1] + p[:, :, 2:]) / 4
    smooth_x = (p[:, :, :, :-2] + 2 * p[:, :, :, 1:-1] + p[:, :, :, 2:]) / 4
    return (
        (smooth_y[:, :, :, 2:] - smooth_y[:, :, :, :-2]) / 2,
        (smooth_x[:, :, 2:] - smooth_x[:, :, :-2]) / 2,
    )


def register(i_o: Tensor, i_e: Tensor) -> Tensor:
    """Move the embedded frame onto the original, to first order in the motion.

    Args:
        i_o: (B, C, H, W) float in [0, 1], encoded.
        i_e: the same shape.

    Returns:
        i_e as it would be without the motion, the same shape.
    """
    dx, dy = gradients((i_o + i_e) / 2)
    height, width = i_o.shape[-2:]
    x = (2 * torch.arange(width, device=i_o.device) / (width - 1) - 1).expand(height, width)
    y = (2 * torch.arange(height, device=i_o.device) / (height - 1) - 1).unsqueeze(1)
    y = y.expand(height, width)
    # a quarter of the pixels, in float64: torch and onnxruntime sum in different orders
    o, change, gx, gy = (t.mean(1)[:, ::2, ::2].double() for t in (i_o, i_e - i_o, dx, dy))
    u, v = x[::2, ::2].double(), y[::2, ::2].double()
    columns = [gx, gx * u, gx * v, gy, gy * u, gy * v, torch.ones_like(o), o, o * o]
    A = torch.stack(columns, dim=1).flatten(2)  # (B, 9, H W / 4)
    normal = A @ A.transpose(1, 2)
    right = (A @ change.flatten(1).unsqueeze(-1)).squeeze(-1)
    ridge = RIDGE * A.shape[-1] * torch.eye(9, dtype=normal.dtype, device=normal.device)
    m = solve_spd(normal + ridge, right).float()[:, :6].reshape(-1, 6, 1, 1, 1)
    s_x, s_y = m[:, 0] + m[:, 1] * x + m[:, 2] * y, m[:, 3] + m[:, 4] * x + m[:, 5] * y
    return i_e - s_x * dx - s_y * dy
