"""Small motions of a display, as the eight numbers of a homography of a display from -1 to 1.

Where a display that changes lies a little off, each pixel is off by the motion there times the
slope of the change (Lucas & Kanade 1981). Each of the eight numbers moves a point by powers of its
place. So the least squares that find them need only moments: sums of a few maps times powers of x
and y.
"""

from collections.abc import Sequence

import numpy as np

from link.types import Array

UNIT_CORNERS = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
"""Corners of a display from -1 to 1."""
POWERS = 5
"""Number of powers of a place, from 0 on, that the products of two motions need."""
MOTIONS = (
    ((0, 1, 1, 0),),
    ((0, 1, 0, 1),),
    ((0, 1, 0, 0),),
    ((1, 1, 1, 0),),
    ((1, 1, 0, 1),),
    ((1, 1, 0, 0),),
    ((0, -1, 2, 0), (1, -1, 1, 1)),
    ((0, -1, 1, 1), (1, -1, 0, 2)),
)
"""How each of the eight numbers of a homography moves a point (x, y) of a display from -1 to 1, to
first order: along which axis, 0 for x and 1 for y, with which sign, and with which powers of x and
of y. The last two move it along both axes."""


def motion_equations(squares: Sequence[Array], products: Sequence[Array]) -> tuple[Array, Array]:
    """Write the normal equations of the eight numbers.

    Args:
        squares: moments of three maps: the squared slope along x, the product of both slopes, and
            the squared slope along y. A slope is the change of a pixel where the display moves
            by 1. Moments are (`POWERS`, `POWERS`): sums times powers of y, by rows, and of x.
        products: moments of two maps: the slope along x, and that along y, times the change that is
            to be explained.

    Returns:
        the (8, 8) matrix and the (8,) right-hand side.
    """
    matrix, right = np.zeros((8, 8)), np.zeros(8)
    for i, changes in enumerate(MOTIONS):
        for axis, sign, x, y in changes:
            right[i] += sign * products[axis][y, x]
            for j, others in enumerate(MOTIONS):
                for other, other_sign, more_x, more_y in others:
                    both = squares[axis + other][y + more_y, x + more_x]
                    matrix[i, j] += sign * other_sign * both
    return matrix, right


def unit_homography(numbers: Array) -> Array:
    """Make the (3, 3) homography that moves each point by the eight numbers.

    >>> unit_homography(np.zeros(8)).tolist()
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    """
    return np.asarray(np.eye(3) + np.append(numbers, 0.0).reshape(3, 3))  # (9,) -> (3, 3)


def pixels_from_unit(width: int, height: int) -> Array:
    """Find the (3, 3) homography from a display from -1 to 1 to its pixels, whole at centres.

    >>> pixels_from_unit(8, 6) @ [1, 1, 1]
    array([7.5, 5.5, 1. ])
    """
    x, y = width / 2, height / 2
    return np.array([[x, 0, x - 0.5], [0, y, y - 0.5], [0, 0, 1]])
