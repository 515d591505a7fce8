"""The ideal observer decides bits with the simulation's true channel: a floor for every decoder.

It knows what no receiver does: picture, pose, photometry and noise model of the very frame pair,
so only noise can mislead it. Where bits change nothing but the embedded frame, as the modulation
"on_off" has it, that frame is all it looks at. Where they change both frames, as "antipodal" has
it, it weighs both, whose noise is independent.

It is the floor up to three simplifications. Of all statistics of a block it takes one linear in the
pixels, at the low spatial frequencies where bit and noise of a block lie. Its moments are estimated
from draws of the noise. And blocks are told apart by captures of all zeros and of all ones: where
blur or JPEG mix a block's outermost pixels with a neighbour's, they count as if both had one bit.

With ``change`` it is the floor of decoders that do not know the picture: it sees of a block only
how it changed from the original frame, whose noise is in that too. All else it knows as well.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from data_gen.channel.composition import Shot
from data_gen.channel.display import Light
from data_gen.frame_pair import FramePair
from link.frames import SoftBits
from link.layout import Layout, block_grid
from link.types import Homography

DRAWS = 32
"""Number of draws of the noise for each bit."""
GRAIN_PX = 9
"""Side, in pixels, of the squares over which noise is summed; demosaicing and JPEG correlate less
far."""
COVARIANCE_PX = 33
"""Side, in pixels, of the squares over which covariances are averaged; about half a block."""
SIGNAL_SIGMA_PX = 4.0
"""Gaussian sigma, in pixels, by which the captured difference of the bits is smoothed."""
ROUNDING = 0.02
"""Variance, in gray levels squared, that is added to keep pixels without noise finite."""
ALIGN_PX = 16
"""Number of pixels at whose multiples captures are cut, so that mosaic and JPEG fall as in the
whole image."""


@dataclass(frozen=True)
class OriginalSeen:
    """What is known of the original frame where an observer sees only the change from it."""

    seen: NDArray[np.uint8]
    """The original frame as captured, (H, W, 3) encoded."""
    draws: NDArray[np.uint8]
    """Captures with other noise, (k, n, H, W, 3): of the same frame where k is 1, or of the frames
    that show bit 0 and bit 1 in every block where k is 2."""
    blocks: NDArray[np.int16]
    """Number of each pixel's block, (H, W), -1 for none."""


def observe_ideally(pair: FramePair, draws: int = DRAWS, change: bool = False) -> SoftBits:
    """Decide the bits of a simulated frame pair with its true channel.

    >>> from data_gen.frame_pair import Cell, Source
    >>> from link.layout import make_layout
    >>> source = Source(make_layout(4, 4, 256, 192, 2), parameters=(("resolution", 0.5),))
    >>> pair = FramePair(source, Cell("canon-lg", view_deg=0.0, kappa=5), index=0)
    >>> bool((observe_ideally(pair, draws=4).bits == pair.displayed.bits).all())
    True

    Args:
        pair: a frame pair with ratex patches (not ``hidden``).
        draws: number of draws of the noise for each bit, at least 4.
        change: whether to decide from the change between the frames alone.

    Returns:
        Bits, and scores that are natural log-likelihood ratios.
    """
    layout, captured = pair.layout, pair.captured
    places = [
        captured_blocks(layout, shot.H_captured_from_display, captured.embedded.shape)
        for shot in pair.shots
    ]
    shown_at = np.argwhere(places[1] >= 0)
    low, high = shown_at.min(axis=0), shown_at.max(axis=0) + ALIGN_PX
    (top, left), (bottom, right) = (edge // ALIGN_PX * ALIGN_PX for edge in (low, high))
    inside = np.s_[top:bottom, left:right]

    def developed(shot: Shot, frame: NDArray[np.uint8], start: int = 0) -> list[NDArray[np.uint8]]:
        """Captures of a frame, one for each number of a draw from ``start`` on."""
        exposure = shot.expose(frame)[inside]
        numbers = range(start, start + draws)
        rngs = (np.random.default_rng([pair.source.seed, pair.index, number]) for number in numbers)
        return [shot.develop(exposure, rng) for rng in rngs]

    first_shot, second_shot = pair.shots
    blocks, count = [place[inside] for place in places], layout.message_mask.size
    shown = [pair.displayed_with(np.full(layout.n_bits, bit)) for bit in (0, 1)]
    both = np.array([developed(second_shot, displayed.embedded) for displayed in shown])
    in_original = layout.change_of_bits[0] != 0  # whether bits change the original frame, too
    original = None
    if change or in_original:
        frames = [displayed.original for displayed in (shown if in_original else shown[:1])]
        original = OriginalSeen(
            captured.original[inside],
            np.array([developed(first_shot, frame, draws) for frame in frames]),
            blocks[0],
        )
    ratios = log_likelihood_ratios(
        captured.embedded[inside], both, blocks[1], count, original if change else None
    )
    if original is not None and not change:
        ratios += log_likelihood_ratios(original.seen, original.draws, blocks[0], count)
    return SoftBits(ratios[layout.message_mask.ravel()])


def captured_blocks(
    layout: Layout, H_captured_from_display: Homography, shape: tuple[int, ...]
) -> NDArray[np.int16]:
    """Return which block each captured pixel shows.

    Args:
        layout: layout of the displayed picture.
        H_captured_from_display: homography of the capture.
        shape: shape of the captured image; its first two entries are height and width.

    Returns:
        (H, W) int16: row-major number of the block, -1 beside the picture.
    """
    rows, cols = block_grid(layout)
    numbers = rows * layout.cols + cols
    return np.asarray(
        cv2.warpPerspective(
            numbers.astype(np.int16),
            H_captured_from_display,
            shape[1::-1],
            flags=cv2.INTER_NEAREST,
            borderMode=cv2.BORDER_CONSTANT,
            borderValue=-1,
        ),
        np.int16,
    )


def log_likelihood_ratios(
    seen: NDArray[np.uint8],
    draws: NDArray[np.uint8],
    blocks: NDArray[np.int16],
    count: int,
    original: OriginalSeen | None = None,
) -> NDArray[np.float64]:
    """Weigh bit 1 against bit 0 of every block, by a statistic that is taken for Gaussian.

    t is the sum of w x over the block's pixels and channels, w = C^-1 d with d the smoothed
    difference of the bits' means and C the channels' covariance at low spatial frequency. One half
    of the draws gives w; the other gives mean and variance of t, untouched by the choice of w.

    Args:
        seen: captured image, (H, W, 3) uint8, encoded.
        draws: captures of bits 0 and 1 by the same channel, (2, n, H, W, 3) uint8, n at least 4;
            draw i has the same noise for both bits, which so cancels in d.
        blocks: number of each pixel's block, (H, W), -1 for none.
        count: number of blocks.
        original: the original frame, if t is to be reduced by the same sum over it; None where
            only the embedded frame is looked at.

    Returns:
        (count,) natural logarithms of the likelihood ratio; 0 where both bits look alike.
    """
    shaping, probing = draws[:, ::2], draws[:, 1::2]
    mean = shaping.mean(axis=1, dtype=np.float32)
    difference = cv2.GaussianBlur(mean[1] - mean[0], (0, 0), SIGNAL_SIGMA_PX)
    weights = np.linalg.solve(_covariance(shaping, mean), difference[..., None])[..., 0]

    def pool(image: NDArray[np.uint8] | Light, where: NDArray[np.int16]) -> NDArray[np.float64]:
        """Sum weight times image over each block."""
        summed = (weights * image).sum(axis=2).ravel()
        return np.asarray(np.bincount(where.ravel() + 1, summed, count + 1)[1:], np.float64)

    t = np.array([[pool(image, blocks) for image in images] for images in probing])
    signal = t[1].mean(axis=0) - t[0].mean(axis=0)
    variance = t.var(axis=1, ddof=1).mean(axis=0) + ROUNDING * pool(weights, blocks)
    surplus = pool(seen, blocks) - t.mean(axis=(0, 1))
    if original is not None:
        t = np.array(
            [[pool(image, original.blocks) for image in images] for images in original.draws]
        )
        signal -= t[-1].mean(axis=0) - t[0].mean(axis=0)
        variance += t.var(axis=1, ddof=1).mean(axis=0)
        variance += ROUNDING * pool(weights, original.blocks)
        surplus -= pool(original.seen, original.blocks) - t.mean(axis=(0, 1))
    ratios = np.zeros(count)
    np.divide(signal * surplus, variance, out=ratios, where=variance > 0)
    return ratios


def _covariance(draws: NDArray[np.uint8], mean: Light) -> Light:
    """Return the channels' covariance at low spatial frequency, (H, W, 3, 3) float32.

    Args:
        draws: captures of both bits, (2, n, H, W, 3).
        mean: their means by bit, (2, H, W, 3) float32.
    """
    total = np.zeros((*mean.shape[1:], mean.shape[-1]), np.float32)
    for images, expected in zip(draws, mean, strict=True):
        for image in images:
            noise = GRAIN_PX * cv2.blur(image - expected, (GRAIN_PX, GRAIN_PX))
            total += noise[..., :, None] * noise[..., None, :]
    total /= 2 * (draws.shape[1] - 1)
    smooth = cv2.blur(total.reshape(*total.shape[:2], -1), (COVARIANCE_PX, COVARIANCE_PX))
    return np.asarray(
        smooth.reshape(total.shape) + ROUNDING * np.eye(total.shape[-1], dtype=np.float32)
    )
