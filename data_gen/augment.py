"""Augmentation of rectified training pairs: geometric and photometric change, batched in torch."""

import kornia.enhance
import kornia.geometry.transform
import torch
from torch import Tensor

CORNER_PX = 0.5
"""Standard deviation, in pixels along each axis, of a shift that both frames have in common;
corners are never found exactly."""
SHIFT_PX = 0.15
"""Standard deviation, in pixels along each axis, of a further shift of the embedded frame alone."""
TURN = 2e-4
"""Standard deviation of the four entries by which a small linear map differs from the identity."""
GAMMA = 0.15
"""Standard deviation of the log exponent of a tone curve that both frames have in common."""
GAIN_DRIFT = 0.02
"""Standard deviation of the log gain of the embedded frame, which adds to the channel's drift."""
PIXEL_NOISE = 1.0
"""Standard deviation of the noise added to every pixel, in gray levels of [0, 255]."""


def augment(
    original: Tensor, embedded: Tensor, generator: torch.Generator
) -> tuple[Tensor, Tensor]:
    """Vary frame pairs in what the channel kept fixed.

    Args:
        original: (B, 3, H, W) uint8 original frames, rectified, encoded RGB.
        embedded: (B, 3, H, W) uint8 embedded frames, rectified, encoded RGB.
        generator: source of every random draw, on the CPU.

    Returns:
        both frames, (B, 3, H, W) float32 in [0, 255], encoded RGB.
    """
    B, device = len(original), original.device

    def normal(*shape: int) -> Tensor:
        return torch.randn(shape, generator=generator).to(device)

    common = _small_homography(CORNER_PX * normal(B, 2), TURN * normal(B, 2, 2))
    motion = _small_homography(SHIFT_PX * normal(B, 2), TURN * normal(B, 2, 2))
    gamma = (GAMMA * normal(B)).exp()
    gain = (GAIN_DRIFT * normal(B)).exp().reshape(B, 1, 1, 1)
    frames = []
    for frame, H, factor in (
        (original, common, torch.ones_like(gain)),
        (embedded, motion @ common, gain),
    ):
        warped = kornia.geometry.transform.warp_perspective(
            frame.float() / 255,
            H,
            frame.shape[-2:],
            padding_mode="border",
            align_corners=True,
        )
        toned = factor * kornia.enhance.adjust_gamma(warped.clamp(0, 1), gamma)
        noisy = 255 * toned + PIXEL_NOISE * normal(*toned.shape)
        frames.append(noisy.clamp(0, 255))
    return frames[0], frames[1]


def _small_homography(shift: Tensor, linear: Tensor) -> Tensor:
    """Build (B, 3, 3) affine maps of pixel coordinates, close to the identity.

    They are made of shifts (B, 2), in pixels, and deviations (B, 2, 2) from the identity.
    """
    H = torch.eye(3, device=shift.device).repeat(len(shift), 1, 1)
    H[:, :2, 2] = shift
    H[:, :2, :2] += linear
    return H
