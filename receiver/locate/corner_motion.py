"""How a homography through four corners moves points when the corners move."""

import numpy as np
from numpy.typing import NDArray

from link.geometry import homography_from_points


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
    homographies = [homography_from_points(source, target)]
    for k in range(8):
        other = target.copy()
        other[k // 2, k % 2] += bump
        homographies.append(homography_from_points(source, other))
    mapped = np.stack(homographies) @ np.stack([*points.T, np.ones(len(points))])  # (9, 3, N)
    mapped = mapped[:, :2] / mapped[:, 2:]
    return mapped[0].T, np.asarray((mapped[1:] - mapped[0]).transpose(2, 1, 0) / bump)
