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
from torch.nn.functional import conv2d, grid_sample, pad

from models.neural.solver import solve_spd

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
    padded = pad(image, (1, 1, 1, 1), mode="replicate").reshape(B * C, 1, height + 2, width + 2)
    maps = conv2d(padded, kernels).reshape(B, C, 4, height, width)
    dx, dy, xx, yy = maps.unbind(2)
    return dx, dy, xx, yy


def register(
    i_o: Tensor,
    i_e: Tensor,
    xx: Tensor,
    yy: Tensor,
    guide: tuple[Tensor, Tensor] | None = None,
) -> Tensor:
    """Move the embedded frame onto the original.

    Args:
        i_o: (B, C, H, W) intensities of the original in [0, 1], encoded.
        i_e: (B, C, H, W) intensities of the embedded frame in [0, 1], encoded.
        xx: (B, C, H, W) second derivative of i_o along x, per square pixel.
        yy: (B, C, H, W) second derivative of i_o along y, per square pixel.
        guide: other intensities of the original and of the embedded frame, (B, C, H, W) each, in
            which the motion is looked for; by default those that are moved.

    Returns:
        i_e as it would be without the motion, (B, C, H, W).
    """
    height, width = i_o.shape[-2:]
    s_x, s_y = motion(*(guide or (i_o, i_e)))
    x, y = axes(height, width, i_o)
    s_x, s_y = (m[:, 0] + m[:, 1] * x + m[:, 2] * y for m in (s_x, s_y))
    # bilinear interpolation blurs: at fraction f of a pixel it adds f (1 - f) / 2 of the curvature
    f_x, f_y = s_x - s_x.floor(), s_y - s_y.floor()
    blur_x, blur_y = f_x * (1 - f_x) / 2, f_y * (1 - f_y) / 2
    return warp(i_e, s_x, s_y) - blur_x.unsqueeze(1) * xx - blur_y.unsqueeze(1) * yy


def motion(i_o: Tensor, i_e: Tensor) -> tuple[Tensor, Tensor]:
    """Find the motion of the embedded frame against the original, affine in the position.

    Args:
        i_o: (B, C, H, W) intensities of the original in [0, 1], encoded.
        i_e: (B, C, H, W) intensities of the embedded frame in [0, 1], encoded.

    Returns:
        s_x and s_y, (B, 3, 1, 1) each: coefficients of 1, x and y, in pixels, where x and y run
        from -1 to 1 over the frame.
    """
    # float64 and averages: torch and onnxruntime sum in different orders
    o, e = (shrink(channel_mean(i), FINE) for i in (i_o, i_e))
    coarse = translation(o, e).float()
    moved = warp(e, coarse[:, :1, None], coarse[:, 1:, None])
    gx, gy = (g.double() for g in derivatives((o + moved) / 2)[:2])
    x, y = (axis.double() for axis in axes(o.shape[2], o.shape[3], o))
    terms = [gx, gx * x, gx * y, gy, gy * x, gy * y]
    m = least_squares(terms, o.double(), (moved - o).double()).float()
    s_x = torch.cat([m[:, :1] + coarse[:, :1], m[:, 1:3]], dim=1)
    s_y = torch.cat([m[:, 3:4] + coarse[:, 1:], m[:, 4:6]], dim=1)
    return FINE * s_x.reshape(-1, 3, 1, 1), FINE * s_y.reshape(-1, 3, 1, 1)


def axes(height: int, width: int, like: Tensor) -> tuple[Tensor, Tensor]:
    """Give the positions of pixel centres, on axes that run from -1 to 1 over the frame.

    Args:
        height: height of the frame, pixels.
        width: width of the frame, pixels.
        like: tensor whose device is used.

    Returns:
        x (1, width) and y (height, 1).
    """
    x = (2 * torch.arange(width, device=like.device) + 1) / width - 1
    y = (2 * torch.arange(height, device=like.device) + 1) / height - 1
    return x.unsqueeze(0), y.unsqueeze(1)


def least_squares(motion: list[Tensor], i_o: Tensor, change: Tensor) -> Tensor:
    """Solve for the motion that explains a change of intensity, beside a photometric change.

    Args:
        motion: gradient terms, each (B, 1, H, W) float64, one for each unknown of the motion.
        i_o: (B, 1, H, W) float64 intensities of the original.
        change: (B, 1, H, W) float64, embedded minus original.

    Returns:
        (B, len(motion)) unknowns of the motion, in the pixels of these images.
    """
    columns = [*motion, torch.ones_like(i_o), i_o, i_o * i_o]
    A = torch.cat(columns, dim=1).flatten(2)  # (B, terms, H W)
    normal = A @ A.transpose(1, 2)
    right = (A @ change.flatten(1).unsqueeze(-1)).squeeze(-1)
    ridge = RIDGE * A.shape[-1] * torch.eye(A.shape[1], dtype=A.dtype, device=A.device)
    return -solve_spd(normal + ridge, right)[:, : len(motion)]


def translation(i_o: Tensor, i_e: Tensor) -> Tensor:
    """Find the translation of the embedded frame on a coarse image.

    Args:
        i_o: (B, 1, H, W) intensities of the original in [0, 1].
        i_e: (B, 1, H, W) intensities of the embedded frame in [0, 1].

    Returns:
        (B, 2) float64 translation along x and y, in pixels of the images given.
    """
    o, e = (shrink(channel_mean(i), COARSE) for i in (i_o, i_e))
    dx, dy = (g.double() for g in derivatives(o)[:2])
    return COARSE * least_squares([dx, dy], o.double(), (e - o).double())


def warp(image: Tensor, s_x: Tensor, s_y: Tensor) -> Tensor:
    """Sample images bilinearly at moved positions; beyond the edges the outermost pixels repeat.

    Args:
        image: (B, C, H, W) intensities.
        s_x: motion along x, in pixels, (B, H, W) or (B, 1, 1).
        s_y: motion along y, in pixels, (B, H, W) or (B, 1, 1).

    Returns:
        (B, C, H, W) with image(x + s_x, y + s_y) at (x, y).
    """
    height, width = image.shape[-2:]
    x, y = axes(height, width, image)
    x, y = x + 2 / width * s_x, y + 2 / height * s_y
    # clamped to the outermost centres: onnxruntime is quickest with zeros beyond the edges
    x, y = x.clamp(1 / width - 1, 1 - 1 / width), y.clamp(1 / height - 1, 1 - 1 / height)
    both = torch.broadcast_tensors(x, y)  # type: ignore[no-untyped-call]
    grid = torch.stack(both, dim=-1)  # (B, H, W, 2)
    return grid_sample(image, grid, padding_mode="zeros", align_corners=False)


def shrink(image: Tensor, k: int) -> Tensor:
    """Average (B, 1, H, W) over squares of k x k pixels: (B, 1, H // k, W // k).

    It is a convolution because onnxruntime's pooling is slow.
    """
    return conv2d(image, image.new_full((1, 1, k, k), 1 / k**2), stride=k)


def channel_mean(maps: Tensor) -> Tensor:
    """Average over channels: (B, C, H, W) -> (B, 1, H, W)."""
    return maps if maps.shape[1] == 1 else maps.mean(1, keepdim=True)
