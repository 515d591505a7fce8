"""Draw what the page about it all shows: pictures of what happens, and a film that it reads."""

from pathlib import Path

import cv2
import numpy as np

from data_gen.pictures.library import load_pictures
from link.code.framing import encode
from link.embed import embed
from link.geometry import frame_corners
from link.images import make_folder, write_image
from link.loop import Loop, LoopStates
from link.presets import PRESETS

PRESET, MESSAGE = "robust", "You have just read a display."
"""Name of the preset that the film shows, and its message."""
PICTURE = 3
"""Number of the displayed picture among those of the split "test"."""
DRAWN_KAPPA = 36
"""Gray levels by which blocks change where people are to see it."""
SIZE_PX, FPS, SECONDS = (480, 270), 30.0, 2.0
"""Width and height of the film in pixels, frames a second, and its length."""
CORNERS = ((84, 22), (402, 39), (393, 241), (75, 250))
"""Corners of the display in the film, in pixels, before the hand moves."""
SWAY_PX, BLUR_PX, NOISE_LEVELS = 2.0, 0.7, 0.5
"""How far the hand moves, how far the lens blurs, and the standard deviation of the noise."""
SHOWN_PX = (320, 240)
"""Width and height, in pixels, of the pictures."""
OUTLINE = (53, 211, 154)
"""Red, green and blue of the line around a display that was found, as in style.css."""


def write_demo(folder: Path) -> None:
    """Write demo.mkv, and about-1.jpg to about-4.jpg."""
    make_folder(folder)
    preset, rng = PRESETS[PRESET], np.random.default_rng(0)
    layout = preset.layout
    picture = load_pictures("test", layout.width, layout.height)[PICTURE].rgb
    bits = encode(MESSAGE.encode(), layout.n_bits)
    states = LoopStates(Loop(layout, preset.kappa, bits, lambda: iter([picture])))
    down, across = np.mgrid[0 : SIZE_PX[1], 0 : SIZE_PX[0]]
    room = np.stack([70 + across / 16 + 12 * np.sin(down / 40 + each) for each in range(3)], axis=2)
    code = cv2.VideoWriter_fourcc(*"VP80")  # type: ignore[attr-defined,unused-ignore]
    film = cv2.VideoWriter(str(folder / "demo.mkv"), cv2.CAP_FFMPEG, code, FPS, SIZE_PX)
    for number in range(round(SECONDS * FPS)):
        time = number / FPS
        sway = SWAY_PX * np.array([np.sin(2.1 * time), np.sin(2.9 * time + 1)])
        seen = (np.array(CORNERS) + sway).astype(np.float32)
        H_captured_from_display = cv2.getPerspectiveTransform(
            frame_corners(layout.width, layout.height).astype(np.float32), seen
        )
        frame = cv2.warpPerspective(
            states[int(time * preset.state_hz) % len(states)],
            H_captured_from_display,
            SIZE_PX,
            dst=room.astype(np.uint8),
            borderMode=cv2.BORDER_TRANSPARENT,
        )
        frame = cv2.GaussianBlur(frame, (0, 0), BLUR_PX)
        frame = frame + rng.normal(0, NOISE_LEVELS, (*frame.shape[:2], 1))
        frame = np.clip(frame.round(), 0, 255).astype(np.uint8)
        film.write(cv2.cvtColor(frame, cv2.COLOR_RGB2BGR))
    film.release()
    blocks = np.full((layout.rows, layout.cols, 1), 128, np.uint8)
    blocks[layout.message_mask, 0] = 255 * bits[0]
    line = seen.round().astype(np.int32)[:, None]
    found = cv2.polylines(frame, [line], True, OUTLINE, 3, cv2.LINE_AA)
    for number, (image, how) in enumerate(
        (
            (picture, cv2.INTER_AREA),
            (embed(picture, bits[0], layout, DRAWN_KAPPA).embedded, cv2.INTER_AREA),
            (found[:, 60:420], cv2.INTER_AREA),  # of the pictures' proportions
            (np.repeat(blocks, 3, axis=2), cv2.INTER_NEAREST),
        ),
        1,
    ):
        shown = np.asarray(cv2.resize(image, SHOWN_PX, interpolation=how), np.uint8)
        write_image(folder / f"about-{number}.jpg", shown)
