"""Why a simulated frame pair was misread: its channel, taken apart into gray levels a block.

The channel is run again without noise, so that signal, drift, motion and noise are measured, each
by itself, in the same captured gray levels.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data_gen.channel.composition import Shot
from data_gen.frame_pair import FramePair
from link.geometry import frame_corners, rectify, transform
from link.images import intensity
from link.layout import Layout, block_mean
from link.types import Array

DARK, BRIGHT = 40.0, 225.0
"""Captured gray levels below and above which a block is called dark or bright."""
FAINT = 0.5
"""Captured gray levels below which the signal of a bit is called faint: rounding hides it."""


@dataclass(frozen=True)
class Parts:
    """What changed the blocks of one frame pair.

    Arrays are (rows, cols) means over blocks in captured gray levels of [0, 255].
    """

    level: Array
    """Captured luma of the original frame."""
    signal: Array
    """Amount by which a bit 1 is captured brighter than a bit 0."""
    drift: Array
    """Change between the frames by exposure and backlight, without message and motion."""
    motion: Array
    """Change that the motion between the frames leaves in the block."""
    noise: Array
    """Difference of the two frames' noise, JPEG's included."""
    shift_px: float
    """Motion of the picture's centre between the frames, captured pixels."""

    def uneven_drift(self) -> Array:
        """Return what is left of the drift when a straight line of the level is taken off."""
        design = np.stack([np.ones(self.level.size), self.level.ravel()], axis=1)
        solution = np.linalg.lstsq(design, self.drift.ravel(), rcond=None)[0]
        return np.asarray(self.drift - (design @ solution).reshape(self.drift.shape))


def take_apart(pair: FramePair) -> Parts:
    """Measure what changed the blocks of a simulated frame pair.

    The pair's own shots are exposed again, without noise and with other messages.

    >>> from data_gen.frame_pair import Cell, Source
    >>> from link.layout import make_layout
    >>> source, cell = Source(make_layout(4, 4, 256, 192, 2)), Cell("canon-lg", 45.0, 3)
    >>> parts = take_apart(FramePair(source, cell, 0))
    >>> parts.signal.shape
    (4, 4)

    Args:
        pair: the frame pair; its noise is that of `FramePair.captured`.
    """
    layout = pair.layout
    original, embedded = pair.shots
    H_o, H_e = original.H_captured_from_display, embedded.H_captured_from_display

    def frame(bit: int) -> NDArray[np.uint8]:
        return pair.displayed_with(np.full(layout.n_bits, bit)).embedded

    zeros = _without_noise(embedded, frame(0))
    signal = block_lumas(_without_noise(embedded, frame(1)), H_e, layout)
    signal -= block_lumas(zeros, H_e, layout)
    still = _without_noise(original, pair.displayed.original)
    level = block_lumas(still, H_o, layout)
    captured = pair.captured
    sent = _without_noise(embedded, pair.displayed.embedded)
    noise = block_lumas(captured.embedded, H_e, layout) - block_lumas(sent, H_e, layout)
    noise -= block_lumas(captured.original, H_o, layout) - level
    # the receiver reads the embedded frame where the original was
    motion = block_lumas(zeros, H_o, layout) - block_lumas(zeros, H_e, layout)
    centre = frame_corners(layout.width, layout.height).mean(axis=0, keepdims=True)
    shift = float(np.linalg.norm(transform(H_e, centre) - transform(H_o, centre)))
    return Parts(level, signal, block_lumas(zeros, H_e, layout) - level, motion, noise, shift)


def block_lumas(image: NDArray[np.uint8], H_captured_from_display: Array, layout: Layout) -> Array:
    """Return the mean captured luma of each block, (rows, cols) in [0, 255]."""
    rectified = rectify(image, H_captured_from_display, layout.width, layout.height)
    luma = 255.0 * intensity(rectified).astype(np.float64)
    return np.asarray(block_mean(luma, layout.rows, layout.cols), np.float64)


def _without_noise(shot: Shot, frame: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return a frame as the camera would store it without noise."""
    return shot.develop(shot.expose(frame), None)


def explain(parts: Parts, wrong: NDArray[np.bool_]) -> tuple[str, dict[str, tuple[float, float]]]:
    """Name the largest obstacle in the blocks that were misread.

    Args:
        parts: what changed the blocks of the frame pair.
        wrong: (rows, cols) whether a block was misread, at least one of them; ratex patches count
            as right.

    Returns:
        A sentence, and by quantity its mean size in wrong and in the other blocks, gray levels.
    """
    sizes = {
        "captured level": parts.level,
        "signal of a bit": parts.signal,
        "drift, uneven part": np.abs(parts.uneven_drift()),
        "motion left": np.abs(parts.motion),
        "noise": np.abs(parts.noise),
    }
    found = {
        name: (float(values[wrong].mean()), float(values[~wrong].mean()) if (~wrong).any() else 0.0)
        for name, values in sizes.items()
    }
    count, total = int(wrong.sum()), wrong.size
    them = "it" if count == 1 else "them"
    signal, level = found["signal of a bit"][0], found["captured level"][0]
    rivals: Mapping[str, str] = {
        "motion left": f"motion of {parts.shift_px:.2f} px over texture",
        "drift, uneven part": "drift that differs over the picture",
        "noise": "noise",
    }
    worst = max(rivals, key=lambda name: found[name][0])
    size = found[worst][0]
    if count > total / 2:
        reason = (
            "more than half of the bits are wrong, so the decision is inverted; a bit arrives as "
            f"{signal:.2f} gray levels{_where(level)}"
        )
    elif signal < FAINT:
        reason = f"a bit arrives there as {signal:.2f} gray levels{_where(level)}"
    elif size > signal / 2:
        reason = f"{rivals[worst]} changes {them} by {size:.2f} gray levels, a bit by {signal:.2f}"
    else:
        reason = (
            f"a bit changes {them} by {signal:.2f} gray levels, and neither motion nor drift nor "
            f"noise by half of that (most: {rivals[worst]}, {size:.2f})"
        )
    drift = float(np.median(parts.drift))
    if abs(drift) > signal:
        reason += f"; the whole picture drifts by {drift:+.1f}"
    return f"{count} wrong block{'' if count == 1 else 's'}: {reason}.", found


def _where(level: float) -> str:
    if level < DARK:
        return f", for the picture is dark there (level {level:.0f})"
    if level > BRIGHT:
        return f", near saturation (level {level:.0f})"
    return ""
