"""Pictures of a decoded frame pair and of the response that was recovered from it."""

import io
from collections.abc import Mapping
from pathlib import Path

import cv2
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from link.frames import Captured, Rectified, SoftBits
from link.images import as_rgb, intensity, write_bytes
from link.layout import block_index
from link.ratex import training_pixels
from models.classical.common import tile_mean
from models.classical.oorc import inverse_response

GAIN = 8.0
RIGHT, WRONG, UNKNOWN = (40, 170, 70), (220, 40, 40), (60, 120, 220)
MIN_HEIGHT_PX = 384


def annotate(
    pair: Rectified, soft: SoftBits, truth: NDArray[np.intp] | None = None
) -> NDArray[np.uint8]:
    """Rectified original | amplified difference | decided bits, side by side.

    Returns:
        (H, 3 W, 3) uint8 RGB, at least 384 pixels high.
    """
    original, embedded = (as_rgb(frame) for frame in (pair.original, pair.embedded))
    change = embedded.astype(np.float64) - original
    change = 128 + GAIN * (change - np.median(change))
    difference = np.clip(change, 0, 255).astype(np.uint8)
    panels = [_enlarge(panel, pair.layout.height) for panel in (original, difference)]
    return np.hstack([*panels, bits_panel(pair, soft, truth)])


def bits_panel(
    pair: Rectified, soft: SoftBits, truth: NDArray[np.intp] | None = None
) -> NDArray[np.uint8]:
    """The rectified original under its decided bits: light blocks are 1, dark blocks 0.

    A block's frame is green where the bit is right, red and thick where it is wrong, blue where the
    truth is unknown. Ratex patches are left as they are.

    Returns:
        (H, W, 3) uint8 RGB, at least 384 pixels high.
    """
    layout = pair.layout
    panel = _enlarge(as_rgb(pair.original), layout.height)
    factor = panel.shape[0] // layout.height
    bits = np.full((layout.rows, layout.cols), -1)
    known = bits.copy()
    bits[layout.message_mask] = soft.bits
    if truth is not None:
        known[layout.message_mask] = truth
    rows = block_index(panel.shape[0], layout.rows)[:, None]
    cols = block_index(panel.shape[1], layout.cols)
    of_pixel = bits[rows, cols][..., None]
    mixed = 0.45 * panel + 0.55 * 255 * (of_pixel == 1)
    panel = np.where(of_pixel >= 0, mixed, panel).astype(np.uint8)
    for row, col in np.argwhere(bits >= 0):
        top, bottom, left, right = (factor * edge for edge in layout.cell_box(int(row), int(col)))
        colour = UNKNOWN
        if known[row, col] >= 0:
            colour = RIGHT if known[row, col] == bits[row, col] else WRONG
        thickness = 3 if colour == WRONG else 1
        cv2.rectangle(panel, (left + 2, top + 2), (right - 3, bottom - 3), colour, thickness)
    return panel


def overview(
    displayed: NDArray[np.uint8], captured: Captured, pair: Rectified, soft: SoftBits
) -> NDArray[np.uint8]:
    """Displayed | captured, with the display outlined | decoded: (H, W, 3) uint8 RGB."""
    photo = captured.original.copy()
    outline = captured.corners.round().astype(np.int32)
    cv2.polylines(photo, [outline], True, RIGHT, 2, cv2.LINE_AA)
    panels = [as_rgb(displayed), photo, bits_panel(pair, soft, captured.bits)]
    height = min(panel.shape[0] for panel in panels)
    gap = np.full((height, 12, 3), 255, np.uint8)
    scaled = [
        cv2.resize(
            panel,
            (round(panel.shape[1] * height / panel.shape[0]), height),
            interpolation=cv2.INTER_AREA,
        )
        for panel in panels
    ]
    return np.hstack([scaled[0], gap, scaled[1], gap, scaled[2]])


def plot_inverse_responses(
    path: Path, cases: Mapping[str, tuple[Rectified, Mapping[str, NDArray[np.float64]]]]
) -> None:
    """Plot g, captured -> displayed intensity, as recovered by each method from each frame pair.

    A head gives g up to scale and offset, so each curve is fitted to the ratex tiles (dots) by
    those two numbers alone.

    Args:
        path: of the PNG.
        cases: title -> the frame pair (kappa known), and method -> weights of its Phi features.
    """
    figure = Figure(figsize=(4.2 * len(cases), 3.6))
    axes = figure.subplots(1, len(cases), sharey=True, squeeze=False)
    for ax, (title, (pair, heads)) in zip(axes[0], cases.items(), strict=True):
        pixels = training_pixels(pair.layout, pair.kappa or 0)
        tiles = tile_mean(intensity(pair.original)[pixels.y, pixels.x].astype(np.float64))
        shown = tile_mean(pixels.rho)
        grid = np.linspace(tiles.min(), tiles.max(), 200)
        ax.plot(255 * tiles, shown, "o", ms=3, color="0.6", label="ratex tiles")
        for method, weights in heads.items():
            g = inverse_response(weights)
            slope, offset = np.polyfit(g(tiles), shown, 1)
            ax.plot(255 * grid, slope * g(grid) + offset, label=method)
        ax.set(title=title, xlabel="captured intensity", xlim=(0, 255), ylim=(-10, 265))
    axes[0, 0].set_ylabel("displayed intensity")
    axes[0, 0].legend(frameon=False)
    figure.tight_layout()
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=110)
    write_bytes(path, buffer.getvalue())


def _enlarge(panel: NDArray[np.uint8], height: int) -> NDArray[np.uint8]:
    factor = max(1, -(-MIN_HEIGHT_PX // height))
    enlarged = cv2.resize(panel, None, fx=factor, fy=factor, interpolation=cv2.INTER_NEAREST)
    return np.asarray(enlarged, np.uint8)
