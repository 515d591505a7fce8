"""Draw what comes with the pages: pictures to send, a film to read, and what people see of both."""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from link.code.framing import encode
from link.embed import embed
from link.geometry import homography_from_corners
from link.images import fit_picture, make_folder, write_image
from link.loop import Loop, LoopStates
from link.presets import PRESETS, Preset
from sender.hiding import Hiding, Onlooker
from sender.player import write_player

PRESET, MESSAGE = PRESETS["robust"], "You have just read a display. Now send something yourself."
"""Preset of the film, and its message."""
HILLS = {
    "morning": ((127, 163, 199), (242, 217, 192), (255, 243, 214), (138, 160, 106)),
    "noon": ((79, 143, 208), (207, 228, 242), (255, 248, 200), (111, 174, 92)),
    "evening": ((107, 95, 158), (240, 168, 120), (255, 217, 160), (123, 106, 114)),
}
"""Red, green and blue of the sky, of the horizon, the sun and the hills, by the name of the
picture."""
DRAWN_KAPPA = 36
"""Gray levels by which blocks change where people are to see it."""
SIZE_PX, FPS, FRAMES = (480, 270), 30, 48
"""Width and height of the film in pixels, frames a second, and their number."""
CORNERS = np.array([(84, 22), (402, 39), (393, 241), (75, 250)])
"""Corners of the display in the film, in pixels, before the hand moves."""
ROOM, OUTLINE = (60, 62, 68), (53, 211, 154)
"""Red, green and blue of what surrounds the display, and of the line around one that was found."""
SHOWN_PX = (320, 240)
"""Width and height, in pixels, of the pictures."""
BESIDE = ("robust", "hidden")
"""Presets that are shown beside each other, so that people see how much each of them flickers."""


def draw_hills(*colours: tuple[int, int, int]) -> NDArray[np.uint8]:
    """Draw hills under a sun, (600, 800, 3) uint8, encoded RGB, in colours as in `HILLS`."""
    sky, horizon, sun, hill = np.array(colours, np.float64)
    y, x = np.mgrid[0:1:600j, 0 : 4 / 3 : 800j]
    drawn = sky + y[:, :, None] * (horizon - sky)
    drawn[np.hypot(x - 0.93, y - 0.32) < 0.09] = sun
    for row in range(4):
        top = np.sin((5 + row) * x + 2 * row) + np.sin(16 * x + 5 * row) / 4
        drawn[y > 0.55 + 0.11 * row - 0.05 * top] = horizon + (0.4 + 0.2 * row) * (hill - horizon)
    grain = np.random.default_rng(0).normal(0, 1, (*y.shape, 1))
    for size in (2, 8, 32):  # of clouds, and of grass
        drawn += 13 * size * cv2.GaussianBlur(grain, (0, 0), size)[:, :, None]
    return np.asarray(drawn.round().clip(0, 255), np.uint8)


def write_demo(folder: Path) -> None:
    """Write demo.mkv, about-1.jpg to about-4.jpg, players and the pictures of `HILLS`."""
    make_folder(folder)
    layout, rng = PRESET.layout, np.random.default_rng(0)
    for name, colours in HILLS.items():
        write_image(folder / f"{name}.jpg", draw_hills(*colours))
    picture = fit_picture(draw_hills(*HILLS["noon"]), layout.width, layout.height)
    bits = encode(MESSAGE.encode(), layout.n_bits)
    states = LoopStates(Loop(layout, PRESET.kappa, bits, lambda: iter([picture])))
    code = cv2.VideoWriter_fourcc(*"VP80")  # type: ignore[attr-defined,unused-ignore]
    film = cv2.VideoWriter(str(folder / "demo.mkv"), cv2.CAP_FFMPEG, code, FPS, SIZE_PX)
    for number in range(FRAMES):
        corners = CORNERS + 2 * np.sin([number / 14, number / 10 + 1])  # a hand is never still
        H_captured_from_display = homography_from_corners(corners, layout.width, layout.height)
        state = states[int(number * PRESET.state_hz / FPS) % len(states)]
        frame = cv2.warpPerspective(state, H_captured_from_display, SIZE_PX, borderValue=ROOM)
        noisy = cv2.GaussianBlur(frame, (0, 0), 0.7) + rng.normal(0, 0.5, (*frame.shape[:2], 1))
        frame = np.clip(noisy.round(), 0, 255).astype(np.uint8)
        film.write(frame[:, :, ::-1])
    film.release()
    line = corners.round().astype(np.int32)[:, None]
    found = cv2.polylines(frame, [line], True, OUTLINE, 3, cv2.LINE_AA)
    blocks = np.full((layout.rows, layout.cols, 3), 128, np.uint8)
    blocks[layout.message_mask] = 255 * bits[0][:, None]
    drawn = embed(picture, bits[0], layout, DRAWN_KAPPA).embedded
    shown = (picture, drawn, found[:, 60:420], np.kron(blocks, np.ones((16, 16, 1), np.uint8)))
    for number, image in enumerate(shown, 1):
        small = cv2.resize(image, SHOWN_PX, interpolation=cv2.INTER_AREA)
        write_image(folder / f"about-{number}.jpg", np.asarray(small, np.uint8))
    for name in BESIDE:
        write_look(folder / f"look-{name}.html", PRESETS[name], cv2.medianBlur(picture, 21))


def write_look(path: Path, preset: Preset, picture: NDArray[np.uint8]) -> None:
    """Write a player that shows what a preset looks like, at its own rate."""
    layout = preset.layout
    bits, even = encode(MESSAGE.encode(), layout.n_bits), preset.even
    loop = Loop(
        layout, preset.kappa, bits, lambda: iter([picture]), display_size=SHOWN_PX, even=even
    )
    onlooker = Onlooker(distance=preset.distance_m)
    hiding = Hiding(loop.shown_layout, preset.state_hz, onlooker, even)
    write_player(path, loop, preset.state_hz, hiding.flickers(preset.kappa))
