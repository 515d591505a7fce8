"""Pictures of a decoded frame pair and of the response that was recovered from it."""

from collections.abc import Mapping
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from link.frames import Captured, SoftBits
from link.images import as_rgb, intensity
from link.layout import block_index
from link.observation import Observation
from link.overlay import frame_block
from link.ratex import training_pixels
from models.paper.common import tile_mean
from models.paper.oorc import inverse_response
from reports.render.charts import MUTED, colour_of, in_style, new_panels, save_png

GAIN = 8.0
"""Factor by which differences between two frames are enlarged in pictures."""
RIGHT, WRONG, UNKNOWN = (40, 170, 70), (220, 40, 40), (60, 120, 220)
"""Colours, as (R, G, B) of [0, 255], of blocks whose bit is right, wrong, or not known."""
MIN_HEIGHT_PX = 384
"""Smallest height of a picture of a decoded frame pair, pixels."""


def annotate(
    pair: Observation, soft: SoftBits, truth: NDArray[np.intp] | None = None
) -> NDArray[np.uint8]:
    """Set the rectified original, the amplified difference and the decided bits side by side.

    Args:
        pair: the rectified frames.
        soft: scores of the message blocks.
        truth: (n_bits,) true bits, -1 where unknown; None where none is known.

    Returns:
        (H, 3 W, 3) uint8 RGB, encoded, at least 384 pixels high.
    """
    original, embedded = (as_rgb(frame) for frame in (pair.original, pair.embedded))
    change = embedded.astype(np.float64) - original
    change = 128 + GAIN * (change - np.median(change))
    difference = np.clip(change, 0, 255).astype(np.uint8)
    panels = [_enlarge(panel, pair.layout.height) for panel in (original, difference)]
    return np.hstack([*panels, bits_panel(pair, soft, truth)])


def bits_panel(
    pair: Observation, soft: SoftBits, truth: NDArray[np.intp] | None = None
) -> NDArray[np.uint8]:
    """Lay the decided bits over the rectified original: light blocks are 1, dark blocks 0.

    A block's frame is green where the bit is right, red and thick where it is wrong, blue where the
    truth is unknown. Ratex patches are left as they are.

    Args:
        pair: the rectified frames.
        soft: scores of the message blocks.
        truth: (n_bits,) true bits, -1 where unknown; None where none is known.

    Returns:
        (H, W, 3) uint8 RGB, encoded, at least 384 pixels high.
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
        top, bottom, left, right = layout.cell_box(int(row), int(col))
        box = (factor * top, factor * bottom, factor * left, factor * right)
        colour = UNKNOWN
        if known[row, col] >= 0:
            colour = RIGHT if known[row, col] == bits[row, col] else WRONG
        frame_block(panel, box, colour, thickness=3 if colour == WRONG else 1, inset=2)
    return panel


def overview(
    displayed: NDArray[np.uint8], captured: Captured, pair: Observation, soft: SoftBits
) -> NDArray[np.uint8]:
    """Set the displayed, the captured and the decoded picture side by side.

    Args:
        displayed: (H, W, 3) uint8 frame on the display, encoded.
        captured: what the camera stored of it; the display is outlined there.
        pair: the rectified frames.
        soft: scores of the message blocks.

    Returns:
        (H, W, 3) uint8 RGB, encoded.
    """
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


@in_style
def plot_inverse_responses(
    path: Path, cases: Mapping[str, tuple[Observation, Mapping[str, NDArray[np.float64]]]]
) -> None:
    """Draw g, captured to displayed intensity, as each method recovers it from each frame pair.

    A head gives g up to scale and offset, so each curve is fitted to the ratex tiles (dots) by
    those two numbers alone.

    Args:
        path: the PNG file.
        cases: by title of a panel, the frame pair (its kappa is known), and by method the weights
            of its Phi features.
    """
    figure, panels = new_panels(len(cases), columns=len(cases), title=True)
    for panel, (title, (pair, heads)) in zip(panels, cases.items(), strict=True):
        pixels = training_pixels(pair.layout, pair.kappa or 0)
        tiles = tile_mean(intensity(pair.original)[pixels.y, pixels.x].astype(np.float64))
        shown = tile_mean(pixels.rho)
        grid = np.linspace(tiles.min(), tiles.max(), 200)
        panel.plot(255 * tiles, shown, "o", ms=3, color=MUTED, label="ratex tiles")
        for method, weights in heads.items():
            g = inverse_response(weights)
            slope, offset = np.polyfit(g(tiles), shown, 1)
            panel.plot(255 * grid, slope * g(grid) + offset, label=method, color=colour_of(method))
        panel.set(title=title, xlabel="captured intensity", ylabel="displayed intensity")
        panel.set(xlim=(0, 255), ylim=(-10, 265))
        panel.legend(loc="upper left", bbox_to_anchor=(1.0, 1.02))
    save_png(figure, path)


def _enlarge(panel: NDArray[np.uint8], height: int) -> NDArray[np.uint8]:
    factor = max(1, -(-MIN_HEIGHT_PX // height))
    enlarged = cv2.resize(panel, None, fx=factor, fy=factor, interpolation=cv2.INTER_NEAREST)
    return np.asarray(enlarged, np.uint8)
