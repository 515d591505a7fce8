"""Registration of a frame pair to a few hundredths of a pixel, inside the graph.

The frames are aligned by Gauss-Newton steps (Lucas & Kanade 1981). The photometric change is an
unknown of the same least squares, so that drift is not taken for motion:
    i_e - i_o = -s_x d/dx i - s_y d/dy i + c_0 + c_1 i_o + c_2 i_o^2.
One step on a coarse image finds the translation, up to several pixels. A second step finds what
remains, which is affine in (x, y). A tenth of a pixel left between the frames costs more than all
noise.
"""

import torch
from torch import Tensor
from torch.nn.functional import conv2d, pad

from models.onnx_ops import average_squares, inverse, sample_bilinear

RIDGE = 1e-6
"""Ridge of the least squares, in squared intensity per pixel; it keeps flat pictures in place."""
FINE = 2
"""Number of pixels averaged along each axis for the second step."""
COARSE = 2
"""Number of the second step's averages that are averaged again, along each axis, for the first."""


def derivatives(image: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Differentiate images along x and y; beyond the edges the outermost pixels repeat.

    Args:
        image: (B, C, H, W) intensities.

    Returns:
        d/dx and d/dy, each smoothed across its direction, then d2/dx2 and d2/dy2; all per pixel
        and (B, C, H, W).
    """
    smooth, slope = image.new_tensor([1, 2, 1]) / 4, image.new_tensor([-1, 0, 1]) / 2
    here, bend = image.new_tensor([0, 1, 0]), image.new_tensor([1, -2, 1])
    pairs = ((smooth, slope), (slope, smooth), (here, bend), (bend, here))
    kernels = torch.stack([torch.outer(*pair) for pair in pairs]).unsqueeze(1)  # (4, 1, 3, 3)
    B, C, height, width = image.shape
    padded = pad(image, (1, 1, 1, 1), mode="replicate")
    if C == 1:
        maps = conv2d(padded, kernels)
        return maps[:, 0:1], maps[:, 1:2], maps[:, 2:3], maps[:, 3:4]
    maps = conv2d(padded.reshape(B * C, 1, height + 2, width + 2), kernels)
    dx, dy, xx, yy = maps.reshape(B, C, 4, height, width).unbind(2)
    return dx, dy, xx, yy


def register(i_o: Tensor, i_e: Tensor, xx: Tensor, yy: Tensor) -> Tensor:
    """Move the embedded frame onto the original.

    Args:
        i_o: (B, C, H, W) intensities of the original in [0, 1], encoded.
        i_e: (B, C, H, W) intensities of the embedded frame in [0, 1], encoded.
        xx: (B, C, H, W) second derivative of i_o along x, per square pixel.
        yy: (B, C, H, W) second derivative of i_o along y, per square pixel.

    Returns:
        i_e as it would be without the motion, (B, C, H, W).
    """
    s = motion(i_o, i_e)
    column, row, x, y = axes(i_o)
    moved, f_x, f_y = sample_bilinear(
        i_e,
        (column + s[:, 0:1] + s[:, 1:2] * x) + s[:, 2:3] * y,
        (row + s[:, 3:4] + s[:, 5:6] * y) + s[:, 4:5] * x,
    )
    # bilinear interpolation blurs: at fraction f of a pixel it adds f (1 - f) / 2 of the curvature
    return moved - (f_x * (1 - f_x) * xx + f_y * (1 - f_y) * yy) / 2


def motion(i_o: Tensor, i_e: Tensor) -> Tensor:
    """Find the motion of the embedded frame against the original, affine in the position.

    Args:
        i_o: (B, C, H, W) intensities of the original in [0, 1], encoded.
        i_e: (B, C, H, W) intensities of the embedded frame in [0, 1], encoded.

    Returns:
        (B, 6, 1, 1): for the motion along x and then for that along y the coefficients of 1, x and
        y, in pixels, where x and y run from -1 to 1 over the frame.
    """
    o, e = (average_squares(channel_mean(i), FINE) for i in (i_o, i_e))
    column, row, x, y = axes(o)
    coarse = translation(o, e)[:, :, None]  # (B, 2, 1, 1)
    moved, _, _ = sample_bilinear(e, column + coarse[:, 0:1], row + coarse[:, 1:2])
    gx, gy = derivatives((o + moved) / 2)[:2]
    fine = least_squares([gx, gx * x, gx * y, gy, gy * x, gy * y], o, o - moved)
    shift = coarse.new_tensor([[1, 0, 0, 0, 0, 0], [0, 0, 0, 1, 0, 0]])
    return FINE * (fine + (shift.T @ coarse[..., 0])).unsqueeze(-1)


def axes(image: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Give the positions of an image's pixel centres, in pixels and relative to its size.

    Args:
        image: (B, C, H, W), whose size and type the axes have.

    Returns:
        columns (W,) from 0 to W - 1, rows (H, 1) from 0 to H - 1, x (W,) and y (H, 1), which run
        from -1 to 1 over the frame.
    """
    height, width = image.shape[-2:]
    column = torch.arange(width, device=image.device).to(image.dtype)
    row = torch.arange(height, device=image.device).to(image.dtype).unsqueeze(1)
    return column, row, (2 * column + 1) / width - 1, (2 * row + 1) / height - 1


def least_squares(motion: list[Tensor], i_o: Tensor, change: Tensor) -> Tensor:
    """Solve for the motion that explains a change of intensity, beside a photometric change.

    Args:
        motion: gradient terms, each (B, 1, H, W), one for each unknown of the motion.
        i_o: (B, 1, H, W) intensities of the original.
        change: (B, 1, H, W), original minus embedded.

    Returns:
        (B, len(motion), 1) unknowns of the motion, in the pixels of these images.
    """
    # flat: onnxruntime keeps sixteen channels of what a convolution made, and works on all of them
    i = i_o.flatten(2)
    columns = [*(each.flatten(2) for each in motion), torch.ones_like(i), i, i * i]
    # float64: torch and onnxruntime sum in different orders
    A = torch.cat([*columns, change.flatten(2)], dim=1).double()  # (B, terms + 1, H W)
    n = A.shape[1] - 1
    products = A @ A.transpose(1, 2)
    ridge = A.shape[-1] * (RIDGE * torch.eye(n, dtype=A.dtype, device=A.device))
    solution = inverse(products[:, :n, :n] + ridge) @ products[:, :n, n:]
    return solution[:, : len(motion)].to(i_o.dtype)


def translation(i_o: Tensor, i_e: Tensor) -> Tensor:
    """Find the translation of the embedded frame on a coarse image.

    Args:
        i_o: (B, 1, H, W) intensities of the original in [0, 1].
        i_e: (B, 1, H, W) intensities of the embedded frame in [0, 1].

    Returns:
        (B, 2, 1) translation along x and y, in pixels of the images given.
    """
    o, e = (average_squares(i, COARSE) for i in (i_o, i_e))
    dx, dy, _, _ = derivatives(o)
    return COARSE * least_squares([dx, dy], o, o - e)


def channel_mean(maps: Tensor) -> Tensor:
    """Average over channels: (B, C, H, W) -> (B, 1, H, W)."""
    return maps if maps.shape[1] == 1 else maps.mean(1, keepdim=True)
