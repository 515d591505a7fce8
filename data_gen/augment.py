"""Augmentation of rectified training pairs: Kornia warps and photometric change, batched torch."""

import kornia.enhance
import kornia.geometry.transform
import torch
from torch import Tensor

CORNER_PX = 0.5
"""Standard deviation of a common shift of both frames: corners are never found exactly."""
SHIFT_PX = 0.15
"""Standard deviation of a further shift of the embedded frame alone."""
TURN = 2e-4
"""Standard deviation of the entries of a small rotation and shear."""
GAMMA = 0.15
"""Standard deviation of the log exponent of a common tone curve."""
DRIFT = 0.02
"""Standard deviation of the log gain of the embedded frame, on top of the channel's drift."""
NOISE = 1.0
"""Standard deviation of added noise, gray levels of [0, 255]."""


def augment(
    original: Tensor, embedded: Tensor, generator: torch.Generator
) -> tuple[Tensor, Tensor]:
    """Vary what the channel kept fixed.

    Args:
        original: (B, 3, H, W) uint8, rectified, encoded.
        embedded: the same shape.
        generator: every random draw comes from here (CPU).

    Returns:
        both frames, (B, 3, H, W) float32 in [0, 255].
    """
    B, device = len(original), original.device

    def normal(*shape: int) -> Tensor:
        return torch.randn(shape, generator=generator).to(device)

    common = _small_homography(CORNER_PX * normal(B, 2), TURN * normal(B, 2, 2))
    motion = _small_homography(SHIFT_PX * normal(B, 2), TURN * normal(B, 2, 2))
    gamma = (GAMMA * normal(B)).exp()
    gain = (DRIFT * normal(B)).exp().reshape(B, 1, 1, 1)
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
        noisy = 255 * toned + NOISE * normal(*toned.shape)
        frames.append(noisy.clamp(0, 255))
    return frames[0], frames[1]


def _small_homography(shift: Tensor, linear: Tensor) -> Tensor:
    """(B, 2) pixels and (B, 2, 2) deviations from the identity -> (B, 3, 3) pixel homographies."""
    H = torch.eye(3, device=shift.device).repeat(len(shift), 1, 1)
    H[:, :2, 2] = shift
    H[:, :2, :2] += linear
    return H
