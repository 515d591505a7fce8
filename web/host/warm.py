"""Draw the short film that the page's receiver reads before the first frame of a camera.

Browsers compile code while it runs: the first frames take many times as long as later ones, and a
camera does not wait. So the receiver runs on small frames first (web/port/receiver/warm.js), in
which it finds, follows and decodes a display.
"""

from dataclasses import replace
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from link.embed import embed
from link.geometry import homography_from_corners
from link.layout import Layout

SIZE_PX = (480, 270)
"""Width and height, in pixels, of a frame."""
CORNERS = ((74, 22), (398, 28), (403, 248), (68, 244))
"""Corners of the display in a frame, in pixels."""
KAPPA = 6
"""Gray levels by which blocks change."""
DISPLAY_LEVELS, DISPLAY_SQUARE_PX = (100, 140), 12
"""Range of the gray levels of the squares that make up the displayed picture, and their side."""
ROOM_LEVELS, ROOM_SQUARE_PX = (40, 60), 32
"""Range of the gray levels of the squares that make up the room around the display, and their
side."""


class WarmFilm(NamedTuple):
    """A display in a room, in its two states."""

    layout: Layout
    """Layout of the display: half as many pixels along each axis as its preset has, to save
    time."""
    states: NDArray[np.uint8]
    """(2, H, W) gray levels: the original and the embedded frame."""


def draw_warm_film(layout: Layout) -> WarmFilm:
    """Draw both states of a display that shows squares of gray and bits drawn at random.

    Args:
        layout: what the preset shows.
    """
    half = replace(layout, width=layout.width // 2, height=layout.height // 2)
    rng = np.random.default_rng(0)
    picture = squares(rng, half.width, half.height, DISPLAY_LEVELS, DISPLAY_SQUARE_PX)
    room = squares(rng, *SIZE_PX, ROOM_LEVELS, ROOM_SQUARE_PX)
    shown = embed(picture, rng.integers(0, 2, half.n_bits), half, KAPPA)
    H_captured_from_display = homography_from_corners(CORNERS, half.width, half.height)
    states = [
        cv2.warpPerspective(
            state,
            H_captured_from_display,
            SIZE_PX,
            dst=room.copy(),
            flags=cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_TRANSPARENT,
        )
        for state in (shown.original, shown.embedded)
    ]
    return WarmFilm(half, np.asarray(states, np.uint8))


def squares(
    rng: np.random.Generator, width: int, height: int, levels: tuple[int, int], side: int
) -> NDArray[np.uint8]:
    """Draw a (height, width) image of squares whose gray levels are random in a range."""
    across, down = -(-width // side), -(-height // side)
    drawn = rng.integers(*levels, (down, across), dtype=np.uint8, endpoint=True)
    return np.kron(drawn, np.ones((side, side), np.uint8))[:height, :width]
