"""How a homography through four corners moves points when the corners move."""

import cv2
import numpy as np
from numpy.typing import NDArray

UNIT_SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
"""Corners of a display whose sides are 1."""


def four_point_homography(
    source: NDArray[np.float64], target: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Find the (3, 3) homography that maps four points, ``source`` (4, 2), to ``target`` (4, 2)."""
    return np.asarray(
        cv2.getPerspectiveTransform(source.astype(np.float32), target.astype(np.float32)),
        np.float64,
    )


def points_by_corners(
    source: NDArray[np.float64], target: NDArray[np.float64], points: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Map points by the homography of four corners to four, and say how the latter move them.

    Args:
        source: (4, 2) corners.
        target: (4, 2) corners.
        points: (N, 2) in the frame of ``source``.

    Returns:
        (N, 2) mapped points, and (N, 2, 8) their derivatives by x and y of the target's corners.
    """
    bump = 1e-2 * float(np.abs(target - target.mean(axis=0)).max())
    homographies = [four_point_homography(source, target)]
    for k in range(8):
        other = target.copy()
        other[k // 2, k % 2] += bump
        homographies.append(four_point_homography(source, other))
    mapped = np.stack(homographies) @ np.stack([*points.T, np.ones(len(points))])  # (9, 3, N)
    mapped = mapped[:, :2] / mapped[:, 2:]
    return mapped[0].T, np.asarray((mapped[1:] - mapped[0]).transpose(2, 1, 0) / bump)
