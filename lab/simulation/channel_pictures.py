"""The simulated channel in pictures: transfer functions, histograms, one message, all pairs."""

import cv2
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from data_gen.channel.transfer import cdtf
from data_gen.film.scenes import SceneSettings
from data_gen.film.stream import VideoSettings, film
from data_gen.frame_pair import Cell, FramePair, Source, shuffled_pictures
from data_gen.pairs import CAMERAS, DISPLAYS, PAIRS
from data_gen.today import TODAY
from lab.study import Picture
from link.images import LUMA, intensity
from models import make_decoder
from reports.engine.methods import Method
from reports.engine.protocols import apply_protocol
from reports.render.charts import in_style

ASTRONAUT = "photo/astronaut/0"
"""The picture that is shown; its licence lets captures of it be published here."""
ANGLES = (0.0, 30.0, 45.0, 60.0)
"""Angles of observation at which transfer functions and histograms are drawn, degrees."""


def draw_channel(source: Source) -> dict[str, Picture]:
    """Draw all pictures, by the name of their file.

    Args:
        source: pictures and seed; the test split's first pictures hold the one that is shown.
    """
    return {
        "channel_displays.png": transfer_figure(),
        "channel_angles.png": angle_figure(source),
        "channel_decisions.png": decision_figure(source),
        "channel_sheet.jpg": contact_sheet(source),
        "channel_today.jpg": today_sheet(source),
    }


@in_style
def transfer_figure() -> Figure:
    """Draw the camera-display transfer functions (CDTFs) of three displays by each camera."""
    figure = Figure(figsize=(11, 3.4))
    panels = figure.subplots(1, len(CAMERAS), sharey=True)
    for panel, camera in zip(panels, CAMERAS, strict=True):
        for number, display in enumerate(DISPLAYS):
            pair, colour = PAIRS[f"{camera}-{display}"], f"C{number}"
            panel.plot(cdtf(pair, 0.0) @ LUMA, color=colour, label=display)
            panel.plot(cdtf(pair, 45.0) @ LUMA, "--", color=colour)
        panel.set_title(CAMERAS[camera].name)
        panel.set_xlabel("displayed gray level")
    panels[0].set_ylabel("captured gray level")
    panels[0].legend(title="– 0°, – – 45°")
    figure.tight_layout()
    return figure


@in_style
def angle_figure(source: Source) -> Figure:
    """Draw the CDTF of nikon-samsung and the histogram of one of its captures at each angle."""
    figure = Figure(figsize=(12, 5))
    panels = figure.subplots(2, len(ANGLES), sharex="row", sharey="row")
    for column, view in zip(panels.T, ANGLES, strict=True):
        column[0].plot(cdtf(PAIRS["nikon-samsung"], view) @ LUMA, color="C3")
        column[0].set_title(f"nikon-samsung, {view:g}°")
        column[0].set_ylim(0, 255)
        column[0].set_xlabel("displayed gray level")
        rectified = astronaut_pair(source, Cell("nikon-samsung", view, 5)).rectified
        levels = 255 * intensity(rectified.original)
        column[1].hist(levels.ravel(), bins=64, range=(0, 256), density=True, color="0.4")
        column[1].set_xlabel("captured gray level")
    panels[0, 0].set_ylabel("captured gray level")
    panels[1, 0].set_ylabel("share of pixels")
    figure.tight_layout()
    return figure


@in_style
def decision_figure(source: Source) -> Figure:
    """Draw the frames' difference, its threshold, and the bits: the paper's example figure."""
    pair = astronaut_pair(source, Cell("canon-samsung", 45.0, 5))
    seen, truth, layout = pair.rectified, pair.displayed.bits, pair.layout
    difference = 255 * (intensity(seen.embedded) - intensity(seen.original))
    naive = apply_protocol("paper", [Method("naive")])[0].build()
    panels: list[tuple[str, NDArray[np.generic]]] = [
        ("captured", seen.original),
        ("embedded − original, ±10 levels", np.clip(0.5 + difference / 20, 0, 1)),
        ("pixels above 2.5 levels", (difference > 2.5).astype(float)),
    ]
    for name, decoder in (("naive", naive), ("oorc", make_decoder("oorc"))):
        bits = decoder.decode(seen).bits
        grid = np.full((layout.rows, layout.cols), 0.5)
        grid[layout.message_mask] = bits
        wrong = int((bits != truth).sum())
        panels.append((f"{name}: {wrong} of {bits.size} bits wrong", grid))
    figure = Figure(figsize=(15, 2.9))
    axes = figure.subplots(1, len(panels))
    for axis, (title, image) in zip(axes, panels, strict=True):
        axis.imshow(
            image, cmap="gray", vmin=0, vmax=1 if image.dtype != np.uint8 else 255,
            extent=(0, layout.width, layout.height, 0), interpolation="nearest",
        )  # fmt: skip
        axis.set_title(title, fontsize=10)
        axis.axis("off")
    figure.tight_layout()
    return figure


def contact_sheet(source: Source) -> NDArray[np.uint8]:
    """Return captures of the nine pairs side by side, (H, W, 3) uint8 RGB.

    Cameras are across; the displays at 0 degrees are above the displays at 45 degrees.
    """
    rows = []
    for view in (0.0, 45.0):
        for display in DISPLAYS:
            tiles = []
            for camera in CAMERAS:
                captured = astronaut_pair(source, Cell(f"{camera}-{display}", view, 5)).captured
                tile = cv2.resize(
                    captured.original, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA
                )
                write_label(tile, f"{camera}-{display} {view:g} deg")
                tiles.append(tile)
            rows.append(np.hstack(tiles))
    return np.asarray(np.vstack(rows), np.uint8)


def today_sheet(source: Source) -> NDArray[np.uint8]:
    """Return a frame of a film by each pair of today, (H, W, 3) uint8 RGB.

    Left at 0 degrees in a room; right at 45 degrees before a bright window.
    """
    pictures = shuffled_pictures(source)
    shown = next(picture.rgb for picture in pictures if picture.name == ASTRONAUT)
    rows = []
    for number, name in enumerate(TODAY):
        tiles = []
        for view, backlit in ((0.0, False), (45.0, True)):
            scene = SceneSettings(
                coverage=0.3, turn=0.0, room="office", backlit=backlit, pictures=pictures
            )
            rng = np.random.default_rng([source.seed, number])
            settings = VideoSettings(scene, seconds=0.01)
            frame = next(film([shown], source.layout, TODAY[name], view, settings, rng))
            tile = cv2.resize(frame.rgb, (480, 270), interpolation=cv2.INTER_AREA)
            write_label(tile, f"{name} {view:g} deg")
            tiles.append(tile)
        rows.append(np.hstack(tiles))
    return np.asarray(np.vstack(rows), np.uint8)


def write_label(tile: NDArray[np.uint8], text: str) -> None:
    """Write white text into the upper left corner of (H, W, 3) uint8 RGB, in place."""
    font = cv2.FONT_HERSHEY_SIMPLEX
    cv2.putText(tile, text, (8, 16), font, 0.45, (255, 255, 255), 1, cv2.LINE_AA)


def astronaut_pair(source: Source, cell: Cell) -> FramePair:
    """Return the first frame pair of a cell that shows the picture `ASTRONAUT`."""
    pairs = (FramePair(source, cell, index) for index in range(20))
    return next(pair for pair in pairs if pair.picture.name == ASTRONAUT)
