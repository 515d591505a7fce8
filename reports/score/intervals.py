"""Intervals at 95 % of a share, such as an accuracy, also where errors cluster."""

import numpy as np

Z95 = 1.959963984540054
"""Standard deviations of a normal distribution within which 95 % of it lie."""


def wilson(correct: float, bits: float) -> tuple[float, float]:
    """Wilson score interval at 95 % for ``correct`` successes in ``bits`` independent trials.

    >>> low, high = wilson(9, 10)
    >>> round(low, 3), round(high, 3)
    (0.596, 0.982)

    Returns:
        (low, high) in [0, 1]; (0, 1) where there is no trial.
    """
    if bits == 0:
        return 0.0, 1.0
    p, z2 = correct / bits, Z95**2
    centre = (p + z2 / (2 * bits)) / (1 + z2 / bits)
    half = Z95 / (1 + z2 / bits) * np.sqrt(p * (1 - p) / bits + z2 / (4 * bits**2))
    return max(0.0, float(centre - half)), min(1.0, float(centre + half))


def clustered_interval(
    bits: int, correct: int, bits_squared: int, bits_correct: int, correct_squared: int
) -> tuple[float, float]:
    """Wilson's 95 % interval of an accuracy, where errors cluster by frame pair or window of film.

    The number of bits is divided by the design effect, which is the variance of the accuracy as a
    ratio of sums over the frame pairs, over that of independent bits, and at least 1.

    Args:
        bits: number of bits.
        correct: number of right bits.
        bits_squared: sum over frame pairs of bits^2. Frame pairs may differ in how many bits of
            them are known.
        bits_correct: sum over frame pairs of bits times right bits.
        correct_squared: sum over frame pairs of (right bits)^2.

    Returns:
        (low, high) in [0, 1].

    >>> bits, right = np.array([2920, 5840, 5110]), np.array([2920, 5803, 5086])
    >>> squares = [int(a @ b) for a, b in ((bits, bits), (bits, right), (right, right))]
    >>> [round(end, 4) for end in clustered_interval(bits.sum(), right.sum(), *squares)]
    [0.9924, 0.9975]
    """
    if bits == 0 or correct in (0, bits):
        return wilson(correct, bits)
    p = correct / bits
    squares = correct_squared - 2 * p * bits_correct + p**2 * bits_squared
    effective = bits / max(1.0, squares / (bits * p * (1 - p)))
    return wilson(p * effective, effective)
