"""Rooms: what surrounds a display, as textured rectangles in space, painted from back to front.

Coordinates are those of `optics.Pose`: the picture's plane is z = 0, its longer side 1, x right,
y down, z towards the viewer. Light is linear, with the display's frontal white as 1. What objects
look like, and how many there are, is assumed; nothing of it is fitted.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from data_gen.channel.display import Light
from data_gen.pictures.library import Picture

ROOMS = {"dark": (0.004, 0.03), "office": (0.15, 0.5), "bright": (0.5, 1.5)}
"""Lowest and highest light of a white sheet in each room, relative to the display's white.

That is about 3 to 24, 120 to 400 and 400 to 1200 lux beside a white of 250 cd/m^2, since the sheet
sends lux / pi.
"""
HAZE_ROOM = 0.19
"""Light of a white sheet, relative to the display's white, at the 150 lux for which
data_gen/paper.json states the haze of displays."""
DESK_Y = 0.12
"""Usual distance of the desk below the screen's frame, in longer sides of the picture."""


@dataclass
class RoomCanvas:
    """The image of a room while it is painted."""

    light: Light
    """Linear light, (H, W, 3) float32."""
    camera: NDArray[np.float64]
    """Projection (3, 4) of the camera, as `optics.scene_camera` gives it."""
    cover: Light
    """Share of each pixel, (H, W) float32, that is painted since the cover was last set to 0."""

    def paint(self, texture: Light, origin: ArrayLike, right: ArrayLike, down: ArrayLike) -> None:
        """Cover what is painted with a rectangle in space.

        Args:
            texture: light of the rectangle, (h, w, 3) float32 linear.
            origin: its top-left corner, (3,).
            right: vector from there to its top-right corner, (3,).
            down: vector from there to its bottom-left corner, (3,).
        """
        start, u, v = (np.asarray(p, np.float64) for p in (origin, right, down))
        corners = np.array([start, start + u, start + u + v, start + v])
        seen = np.column_stack([corners, np.ones(4)]) @ self.camera.T
        height, width = self.light.shape[:2]
        left, top, far_x, far_y = 0, 0, width, height
        fine = (1024, 1024)  # texels of the outline: about a pixel each, for sharp edges
        if (seen[:, 2] > 0).all():
            points = seen[:, :2] / seen[:, 2:]
            low = np.clip(np.floor(points.min(axis=0)) - 1, 0, [width, height]).astype(int)
            high = np.clip(np.ceil(points.max(axis=0)) + 2, 0, [width, height]).astype(int)
            (left, top), (far_x, far_y) = low, high
            fine = _extent(points)
            texture = _reduced(texture, fine)
        elif (seen[:, 2] <= 0).all():
            return
        if far_x <= left or far_y <= top:
            return
        size = (int(far_x - left), int(far_y - top))
        inward = np.array([[1, 0, -left], [0, 1, -top], [0, 0, 1.0]])

        def view_of(rows: int, cols: int) -> NDArray[np.float64]:
            """Return the (3, 3) map from a texture of this size to the part that is painted."""
            plane = np.column_stack([u / cols, v / rows, start + 0.5 * (u / cols + v / rows)])
            H = self.camera[:, :3] @ plane
            H[:, 2] += self.camera[:, 3]
            return np.asarray(inward @ H)

        H = view_of(*texture.shape[:2])
        if abs(np.linalg.det(H)) < 1e-12:
            return
        image = cv2.warpPerspective(texture, H, size, borderMode=cv2.BORDER_REPLICATE)
        cover = cv2.warpPerspective(np.ones(fine, np.float32), view_of(*fine), size)
        back = np.linalg.inv(H)
        x, y = np.arange(size[0]), np.arange(size[1])[:, None]
        cover[back[2, 0] * x + back[2, 1] * y + back[2, 2] <= 0] = 0  # behind the camera
        inside = np.s_[top:far_y, left:far_x]
        part = self.light[inside]
        part += cover[:, :, None] * (image - part)
        self.cover[inside] += cover * (1 - self.cover[inside])


def _extent(points: NDArray[np.float64]) -> tuple[int, int]:
    """Return how many rows and columns give a rectangle with (4, 2) corners a texel a pixel."""
    edges = np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1)
    width, height = (int(np.clip(np.ceil(max(edges[i], edges[i + 2])), 1, 4096)) for i in (0, 1))
    return height, width


def _reduced(texture: Light, most: tuple[int, int]) -> Light:
    """Average a texture to at most so many rows and columns."""
    rows, cols = texture.shape[:2]
    size = min(cols, most[1]), min(rows, most[0])
    return np.asarray(cv2.resize(texture, size, interpolation=cv2.INTER_AREA))


def linear_light(rgb: NDArray[np.uint8]) -> Light:
    """Decode (H, W, 3) uint8 to float32 linear light in [0, 1], by a power of 2.2."""
    table = (np.arange(256, dtype=np.float32) / 255) ** np.float32(2.2)
    return np.asarray(table[rgb], np.float32)


@dataclass(frozen=True)
class RoomPainter:
    """Paints objects that one generator draws, in the light of one room."""

    canvas: RoomCanvas
    """The image to paint on."""
    rng: np.random.Generator
    """Source of every random draw."""
    pictures: Sequence[Picture]
    """Photographs of one split; may be empty."""
    white: Light
    """Light of a white sheet in the room, (3,)."""

    def flat(self, rows: int, cols: int, colour: Light, rough: float = 0.03) -> Light:
        """Make a surface of one reflectance (3,), unevenly lit and a little rough."""
        rng = self.rng
        coarse = rng.uniform(0.75, 1.1, (2, 2)).astype(np.float32)
        shade = cv2.resize(coarse, (cols, rows), interpolation=cv2.INTER_LINEAR)
        grain = rng.normal(1, rough, (rows, cols)).astype(np.float32)
        return np.asarray((shade * grain)[:, :, None] * (colour * self.white), np.float32)

    def colour(self, low: float = 0.05, high: float = 0.8, saturation: float = 0.5) -> Light:
        """Draw a reflectance, (3,) float32."""
        level = self.rng.uniform(low, high)
        tint = 1 + saturation * self.rng.uniform(-1, 1, 3)
        return np.asarray(np.clip(level * tint, 0.01, 0.95), np.float32)

    def photo(self) -> Light | None:
        """Draw one of the pictures as linear light; None where there is none."""
        if not self.pictures:
            return None
        return linear_light(self.pictures[int(self.rng.integers(len(self.pictures)))].rgb)

    def backdrop(self) -> None:
        """Fill the image with an even gradient, which stays where nothing else is painted."""
        rows, cols = self.canvas.light.shape[:2]
        ends = self.rng.uniform(0.15, 0.6, (3, 3, 1)) * self.rng.uniform(0.85, 1.15, (1, 1, 3))
        field = cv2.resize(ends.astype(np.float32), (cols, rows), interpolation=cv2.INTER_LINEAR)
        self.canvas.light[:] = field * self.white

    def wall(self, depth: float) -> None:
        """Paint the wall behind the display, with posters, windows, shelves and boards on it."""
        rng, paint = self.rng, self.canvas.paint
        colour = self.colour(0.2, 0.8, 0.2)
        texture = self.flat(120, 240, colour)
        photo = self.photo()
        if photo is not None and rng.random() < 0.3:  # wallpaper or bare brick
            tile = cv2.resize(photo, (240, 120), interpolation=cv2.INTER_AREA).mean(axis=2)
            texture *= (0.6 + 0.4 * tile / max(1e-3, float(tile.mean())))[:, :, None]
        paint(texture, (-7, -3.5, -depth), (14, 0, 0), (0, 7, 0))
        things = (self.poster, self.poster, self.window, self.shelf, self.board)
        for _ in range(rng.integers(2, 9)):
            thing = things[rng.integers(len(things))]
            width, height = rng.uniform(0.25, 1.3), rng.uniform(0.25, 1.0)
            angle = rng.uniform(0, 2 * np.pi)
            reach = rng.uniform(0.6, 1.8)
            x, y = 1.3 * reach * np.cos(angle), 0.8 * reach * np.sin(angle) - 0.3
            corner = (x - width / 2, y - height / 2, -depth + 0.005)
            paint(thing(), corner, (width, 0, 0), (0, height, 0))

    def poster(self) -> Light:
        """Draw a framed photograph, or coloured paper."""
        photo = self.photo()
        inner = self.flat(96, 128, self.colour())
        if photo is not None:
            shown = cv2.resize(photo, (128, 96), interpolation=cv2.INTER_AREA)
            inner = np.asarray(np.maximum(0.03, shown) * 0.85 * self.white, np.float32)
        edge = int(self.rng.integers(0, 12))
        colour = (0.85 if self.rng.random() < 0.5 else 0.04) * self.white
        return np.asarray(
            cv2.copyMakeBorder(
                inner, edge, edge, edge, edge, cv2.BORDER_CONSTANT, value=colour.tolist()
            )
        )

    def window(self) -> Light:
        """Draw a bright rectangle: sky, or a lit panel, behind a cross."""
        rng = self.rng
        bright = max(0.02, float(self.white.mean())) * rng.uniform(1.5, 6)
        sky = np.linspace(1.2, 0.7, 96, dtype=np.float32)[:, None, None]
        pane = sky * np.ones((1, 128, 1), np.float32) * rng.uniform(0.85, 1.1, 3).astype(np.float32)
        photo = self.photo()
        if photo is not None and rng.random() < 0.5:
            pane *= 0.3 + cv2.resize(photo, (128, 96), interpolation=cv2.INTER_AREA)
        pane *= np.float32(bright)
        frame = self.white * np.float32(rng.choice([0.05, 0.3, 0.8]))
        for column in np.linspace(0, 124, rng.integers(2, 5)).astype(int):
            pane[:, column : column + 4] = frame
        pane[:4] = pane[-4:] = frame
        return np.asarray(pane, np.float32)

    def shelf(self) -> Light:
        """Draw a shelf with rows of books."""
        rng = self.rng
        image = self.flat(120, 160, self.colour(0.05, 0.5, 0.3))
        for row in range(0, 120, 40):
            x = 2
            while x < 154:
                width, high = int(rng.integers(3, 12)), int(rng.integers(22, 36))
                if rng.random() < 0.85:
                    image[row + 37 - high : row + 37, x : x + width] = self.flat(
                        high, min(width, 160 - x), self.colour(0.03, 0.7, 0.9)
                    )
                x += width + 1
        return image

    def board(self) -> Light:
        """Draw a white board with strokes."""
        rng = self.rng
        image = self.flat(120, 180, np.full(3, 0.85, np.float32), 0.005)
        for _ in range(rng.integers(2, 12)):
            colour = (self.colour(0.02, 0.3, 1.0) * self.white).tolist()
            points = rng.integers((5, 5), (175, 115), (2, 2))
            cv2.line(image, points[0].tolist(), points[1].tolist(), colour, int(rng.integers(1, 3)))
        image[:3] = image[-3:] = 0.3 * self.white
        image[:, :3] = image[:, -3:] = 0.3 * self.white
        return image

    def desk(self, y: float, depth: float) -> None:
        """Paint a desk below the display, with keyboard, papers and boxes on it."""
        rng, paint = self.rng, self.canvas.paint
        near, half = rng.uniform(0.8, 1.4), rng.uniform(1.2, 3.5)
        grain = rng.normal(1, 0.08, (120, 1)).astype(np.float32)
        wood = self.flat(120, 240, self.colour(0.06, 0.6, 0.35)) * grain[:, :, None]
        paint(wood, (-half, y, -depth), (2 * half, 0, 0), (0, 0, depth + near))
        paint(
            self.flat(20, 60, self.colour(0.05, 0.3, 0.3)),
            (-half, y, near),
            (2 * half, 0, 0),
            (0, 0.08, 0),
        )
        for _ in range(rng.integers(0, 4)):
            self._sheet(y - 0.002, near)
        if rng.random() < 0.7:
            self._keyboard(y - 0.01)
        boxes = rng.uniform((-1.4, -0.3), (1.4, 0.5), (int(rng.integers(0, 5)), 2))
        for x, z in boxes[np.argsort(boxes[:, 1])]:
            if abs(x) > 0.62:
                self._box(x, y, z)

    def _sheet(self, y: float, near: float) -> None:
        """Paint a printed page that lies on the desk."""
        rng = self.rng
        page = self.flat(80, 60, np.full(3, 0.8, np.float32), 0.01)
        for row in range(8, 72, 5):
            page[row : row + 2, 6 : int(rng.integers(20, 55))] *= 0.4
        angle, x, z = rng.uniform(-0.6, 0.6), rng.uniform(-1, 1), rng.uniform(0.15, near)
        right = np.array([np.cos(angle), 0, np.sin(angle)])
        down = np.array([-np.sin(angle), 0, np.cos(angle)])
        self.canvas.paint(page, (x, y, z), 0.3 * right, 0.4 * down)

    def _keyboard(self, y: float) -> None:
        """Paint a keyboard that lies on the desk."""
        rng = self.rng
        light = rng.random() < 0.5
        board = self.flat(50, 150, np.full(3, 0.6 if light else 0.03, np.float32))
        key = self.white * np.float32(0.8 if light else 0.07)
        for top in range(4, 44, 8):
            for left in range(4, 144, 8):
                board[top : top + 6, left : left + 6] = key
        x, z, width = rng.uniform(-0.5, 0.1), rng.uniform(0.25, 0.5), rng.uniform(0.5, 0.9)
        self.canvas.paint(board, (x, y, z), (width, 0, 0), (0, 0, width / 3))

    def _box(self, x: float, y: float, z: float) -> None:
        """Paint a box: its front, its top and the side that the camera sees."""
        rng, paint = self.rng, self.canvas.paint
        width, height, depth = rng.uniform((0.08, 0.08, 0.05), (0.35, 0.4, 0.25))
        colour = self.colour(0.03, 0.8, 0.8)
        front, side, top = (self.flat(24, 24, s * colour) for s in (1.0, 0.6, 1.1))
        if rng.random() < 0.4:
            front = cv2.resize(self.poster(), (64, 64), interpolation=cv2.INTER_AREA)
        camera_x = -np.linalg.solve(self.canvas.camera[:, :3], self.canvas.camera[:, 3])[0]
        edge = x if camera_x < x else x + width
        paint(top, (x, y - height, z - depth), (width, 0, 0), (0, 0, depth))
        paint(side, (edge, y - height, z - depth), (0, 0, depth), (0, height, 0))
        paint(front, (x, y - height, z), (width, 0, 0), (0, height, 0))

    def frame(self, box: NDArray[np.float64], thick: NDArray[np.float64], colour: Light) -> None:
        """Paint the casing of a screen: its front, with sheen, at z = 0.

        Args:
            box: left, top, right and bottom of the screen, (4,).
            thick: thickness of the frame at the same sides, (4,).
            colour: reflectance, (3,).
        """
        rng = self.rng
        left, top = box[:2] - thick[:2]
        right, bottom = box[2:] + thick[2:]
        face = self.flat(90, 120, colour, 0.01)
        sheen = np.exp(-(((np.arange(120) / 120 - rng.random()) / 0.15) ** 2)).astype(np.float32)
        face += (rng.uniform(0, 0.06) * sheen)[None, :, None] * self.white
        self.canvas.paint(face, (left, top, 0), (right - left, 0, 0), (0, bottom - top, 0))

    def stand(self, top: float, y: float, colour: Light) -> None:
        """Paint a foot between the frame's lower edge and the desk."""
        neck = self.flat(20, 20, 0.7 * colour)
        self.canvas.paint(neck, (-0.08, top, -0.05), (0.16, 0, 0), (0, y - top, 0))
        base = self.flat(20, 40, 0.8 * colour)
        self.canvas.paint(base, (-0.2, y - 0.01, -0.12), (0.4, 0, 0), (0, 0, 0.24))

    def other_display(self, side: float, top: float, view_loss: float) -> None:
        """Paint a second display beside the first, at an angle, with a photograph on it."""
        rng, paint = self.rng, self.canvas.paint
        shown = self.photo()
        if shown is None:
            shown = linear_light(rng.integers(0, 256, (6, 8, 3), dtype=np.uint8))
            shown = cv2.resize(shown, (160, 120), interpolation=cv2.INTER_NEAREST)
        width, turn = rng.uniform(0.6, 1.0), rng.uniform(0, 0.7)
        height = width * rng.choice([0.5625, 0.75])
        sign = 1.0 if side > 0 else -1.0
        along = np.array([np.cos(turn), 0, sign * np.sin(turn)])
        start = np.array([side if sign > 0 else side - along[0] * width, top, 0.0])
        if sign < 0:
            start[2] = width * np.sin(turn)
        thick = rng.uniform(0.015, 0.05)
        casing = self.flat(30, 40, self.colour(0.02, 0.6, 0.1))
        down = np.array([0.0, 1.0, 0.0])
        outer = start - thick * (along + down)
        paint(casing, outer, (width + 2 * thick) * along, (height + 2 * thick) * down)
        lit = np.asarray(view_loss * (shown + 0.003), np.float32)
        paint(lit, start, width * along, height * down)
