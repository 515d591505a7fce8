"""Move the corners of a display, one after the other, while its pilots toggle more surely.

Where the toggling is weak, no part of the display stands out of the noise by itself
(`export.pilots.search.parts`), and all pilots together still do. From corners that are off by a
block or two, the sum over all pilots leads to where they lie.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from export.pilots.motion import without_slope
from export.pilots.signal import pilot_centres, signed_phases
from link.geometry import (
    frame_corners,
    homography_from_corners,
    resized_homography,
    transform,
)
from link.layout import Layout
from link.types import Array

STEPS_BLOCKS = (2.0, 1.0, 0.5, 0.25)
"""Lengths of the moves that are tried, in blocks, one after the other."""
MOVES = np.array([[1, 0], [-1, 0], [0, 1], [0, -1]], np.float64)
"""Directions of the moves."""
GROUPS = ([0], [1], [2], [3], [0, 1, 2, 3], [0, 1], [1, 2], [2, 3], [3, 0])
"""Corners that move together, by their number: each alone, the whole display, and its sides."""
LEAST_GAIN = 1e-4
"""Smallest rise of the pilots' share of the power, in [0, 1], for which corners move."""


def climb_to_pilots(change: NDArray[np.complex64], layout: Layout) -> Array:
    """Find corners at which the pilots of a display toggle most surely.

    What is raised is the share of the power of all pilots that has their signs,
    |sum of s_p X_p|^2 / (P sum of |X_p|^2) with the complex amplitudes X_p at P pilots, whose
    phases may slope across the display as `export.pilots.signal.PHASE_SLOPES` says.

    Args:
        change: (h, w) amplitude at one frequency of the rectified display, each pixel divided by
            its usual deviation; of any phase.
        layout: layout of the display, with pilots.

    Returns:
        (3, 3) H_old_from_new in layout pixels: where a point of the display, as it should have been
        rectified, lies in the image as it was.
    """
    height, width = change.shape
    block = np.array([width / layout.cols, height / layout.rows])
    spans = [max(1, round(float(side))) for side in block]
    maps = [
        cv2.blur(without_slope(part, block), spans, borderType=cv2.BORDER_CONSTANT)
        for part in (change.real, change.imag)
    ]
    phases = signed_phases(layout)
    centres = pilot_centres(layout) * [width, height] - 0.5

    def share(corners: Array) -> float:
        H_old_from_new = homography_from_corners(corners, width, height)
        points = transform(H_old_from_new, centres).astype(np.float32)
        real, imaginary = (
            cv2.remap(part, points[:, :1], points[:, 1:], cv2.INTER_LINEAR)[:, 0] for part in maps
        )
        power = float((real**2 + imaginary**2).sum()) * layout.pilots
        along = np.abs(phases @ (real + 1j * imaginary)).max()
        return float(along) ** 2 / (power + 1e-12)

    corners = frame_corners(width, height)
    best = share(corners)
    for step in STEPS_BLOCKS:
        improved = True
        while improved:
            improved = False
            for group in GROUPS:
                for move in MOVES * step * block:
                    tried = corners.copy()
                    tried[group] += move
                    found = share(tried)
                    if found > best + LEAST_GAIN:
                        corners, best, improved = tried, found, True
    H_old_from_new = homography_from_corners(corners, width, height)
    H_layout_from_map = resized_homography(layout.width / width, layout.height / height)
    return H_layout_from_map @ H_old_from_new @ np.linalg.inv(H_layout_from_map)
