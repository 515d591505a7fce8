"""Cluttered surroundings of a display, as linear light, and stills of it in them.

The camera exposes for the display, as `Setup.metering` says, not for the room. Bodies are
rectangles without shadows; depth of field is one blur of all that lies behind the display.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray
from tyro.conf import Fixed, Suppress

from data_gen.channel.composition import Layer, Viewpoint, repeat_channels
from data_gen.channel.display import Emission, Light, fall_to_corners, light_spot, room_light
from data_gen.channel.metering import metered_gain
from data_gen.channel.optics import (
    CAPTURE_WIDTH,
    Pose,
    check_view,
    plane_from_display,
    scene_camera,
    view_angles,
)
from data_gen.film.rooms import DESK_Y, HAZE_ROOM, ROOMS, RoomCanvas, RoomPainter
from data_gen.parameters import Pair
from data_gen.pictures.library import Picture
from link.errors import InputError, ParameterError, at_least, choose, in_range
from link.geometry import transform
from link.images import pixel_limit
from link.layout import Layout
from link.types import Homography

COVERAGE = (0.05, 0.9)
"""Smallest and largest share of the image that the picture covers."""
FIELD_DEG = (45.0, 70.0)
"""Angle of view along the image's longer side: phones' main cameras, webcams (assumed)."""
MIN_DISTANCE, MAX_DISTANCE = 0.7, 30.0
"""Smallest and largest distance of the camera, in longer sides of the picture."""
MAX_CORNER_OUTSIDE = 0.3
"""Largest share of the picture's width by which a corner may lie outside the image."""
STRAY_SIZE = (0.05, 0.2)
"""Smallest and largest standard deviation of a spot of stray light, in widths of the image
(assumed)."""
MIN_IMAGE_SIDE = 64
"""Fewest pixels that the image may have along an axis."""


@dataclass(frozen=True)
class SceneSettings:
    """What may be chosen about a scene; None is drawn at random."""

    size: tuple[int, int] = (1280, 720)
    """Width and height of the image, pixels."""
    coverage: float | None = None
    """Share of the image that the picture covers, 0.05 to 0.9; less where so much does not fit."""
    turn: float | None = None
    """Rotation of the camera about its axis, degrees; 0, 90, 180 or 270 within 5 where drawn."""
    room: str | None = None
    """Light of the room: "dark", "office" or "bright"."""
    window: bool | None = None
    """Whether the screen is larger than the picture, with a plain surround."""
    second_display: bool | None = None
    """Whether another lit display without ratex stands beside; one in five where drawn."""
    pictures: Suppress[Fixed[Sequence[Picture]]] = ()
    """Photographs of the split's own, for posters, windows and the second display."""
    free: float = 0.01
    """Share of the image, 0 to 0.2, that stays free at each side of the picture."""
    outside: float = 0.0
    """Share of the picture's width, 0 to 0.3, by which a corner lies beyond a side of the image
    that is drawn at random; with 0 the whole picture is in view."""
    stray: float = 0.0
    """Brightest light, 0 to 1, that a lamp throws over the image through the lens, as a share of
    what saturates the sensor. It is a spot that stays where it is in the image."""
    margin_px: int = 48
    """Number of pixels drawn beyond each side of the image, for a camera that moves."""

    def check(self) -> None:
        """Raise an `InputError` that names the first setting that is out of its range."""
        if min(self.size) < MIN_IMAGE_SIDE:
            raise ParameterError(
                "size", f"need at least {MIN_IMAGE_SIDE}x{MIN_IMAGE_SIDE} pixels, got {self.size}"
            )
        pixels = math.prod(side + 2 * self.margin_px for side in self.size)
        if pixels > pixel_limit():
            raise ParameterError(
                "size",
                f"{self.size[0]}x{self.size[1]} and its margin have more than "
                f"{pixel_limit() / 1e6:g} megapixels; film fewer",
            )
        in_range(
            self,
            coverage=(*COVERAGE, " of the image"),
            turn=(-360, 360, " degrees"),
            free=(0, 0.2, " of the image"),
            outside=(0, MAX_CORNER_OUTSIDE, " of the picture's width"),
            stray=(0, 1, " of saturation"),
        )
        if self.room is not None:
            choose(ROOMS, self.room, "room")
        at_least(0, margin_px=self.margin_px)


@dataclass(frozen=True, eq=False)
class PaintedRoom:
    """What a camera at rest sees of a room, beyond the edges of its image too."""

    light: Light
    """Light of all but the picture, in whose place the casing or the surround goes on:
    (height + 2 margin, width + 2 margin, 3) float32 linear, frontal white is 1."""
    wall: Light
    """Light of the room, of the same shape, without what stands before the wall."""
    cover: Light
    """Share of each pixel, (height + 2 margin, width + 2 margin) float32, that stands before the
    wall."""
    depth: float
    """Distance of the wall behind the display, in longer sides of the picture."""
    margin: int
    """Number of pixels beyond each side of the image."""

    def layers(self, pair: Pair) -> tuple[Layer, ...]:
        """Return the room as one layer or, for parallax, as the wall and what stands before it."""
        if not pair.setup.sway:
            return (Layer.collected(self.light, None, self.margin, pair),)
        before = self.light - self.wall * (1 - self.cover[:, :, None])
        return (
            Layer.collected(self.wall, None, self.margin, pair),
            Layer.collected(before, self.cover, self.margin, pair),
        )


@dataclass(frozen=True, eq=False)
class Scene:
    """A display in a room and a camera before it."""

    layout: Layout
    """Layout of the displayed picture."""
    pair: Pair
    """Camera and display, with the haze of this room."""
    view_deg: float
    """Nominal angle of observation, degrees."""
    pose: Pose
    """Position of the camera."""
    room: str
    """Name of the room's light, a key of `rooms.ROOMS`."""
    level: float
    """Light of a white sheet in the room relative to the display's frontal white."""
    size: tuple[int, int]
    """Width and height of the image, pixels."""
    H_captured_from_display: Homography
    """Homography from display pixels to pixels of the image."""
    camera: NDArray[np.float64]
    """Projection (3, 4) of the camera, as `optics.scene_camera` gives it."""
    painted: PaintedRoom
    """The room around the picture."""
    stray: float = 0.0
    """Brightest stray light, as a share of what saturates the sensor."""

    @property
    def corners(self) -> NDArray[np.float64]:
        """Corners of the picture, (4, 2) captured pixels, in the order of `link.geometry`."""
        return transform(self.H_captured_from_display, self.layout.corners)

    @property
    def coverage(self) -> float:
        """Share of the image that the picture covers."""
        return _area(self.corners) / (self.size[0] * self.size[1])

    def viewpoint(self, rng: np.random.Generator) -> Viewpoint:
        """Return the scene's camera, ready for shots; ``rng`` draws where lamps are seen."""
        layout, pair = self.layout, self.pair
        camera, (width, height) = pair.camera, self.size
        lamp, stray = rng.uniform(0, 1, 2), None
        if self.stray:
            spot = light_spot(height, width, rng.uniform(0, 1, 2), rng.uniform(*STRAY_SIZE))
            stray = np.asarray(self.stray * spot[:, :, None], np.float32)
        iso = max(1.0, metered_gain(pair, self.view_deg))
        noise_scale = pair.nuisance(self.view_deg).noise_scale
        return Viewpoint(
            layout=layout,
            pair=pair,
            size=self.size,
            theta=view_angles(self.pose, layout.width, layout.height),
            room=room_light(pair.display, layout.height, layout.width, lamp)[:, :, None],
            lens=repeat_channels(
                np.float32(iso) * fall_to_corners(camera.vignetting, height, width)
            ),
            iso=iso,
            noise_scale=noise_scale * width / CAPTURE_WIDTH,  # native pixels pooled in one
            lamp=lamp,
            stray=stray,
            surroundings=self.painted.layers(pair),
        )

    def parallax(self, way: NDArray[np.float64]) -> tuple[Homography, Homography]:
        """Return how the wall and the display's plane move in the image of a camera that moves.

        The camera turns so that the picture's centre stays where it is in the image. What stands
        before the wall counts as being in the display's plane.

        Args:
            way: (3,) the camera's way to the right, down and towards the viewer, in longer sides of
                the picture.

        Returns:
            homographies from the resting camera's pixels to the moved one's, for each layer of a
            room with parallax.
        """
        moved = self.camera.copy()
        moved[:, 3] -= self.camera[:, :3] @ way

        def plane(camera: NDArray[np.float64], depth: float) -> NDArray[np.float64]:
            """Return the (3, 3) map from x and y of a plane behind the display to pixels."""
            return np.column_stack(
                [camera[:, 0], camera[:, 1], camera[:, 3] - depth * camera[:, 2]]
            )

        wall, display = (
            plane(moved, depth) @ np.linalg.inv(plane(self.camera, depth))
            for depth in (self.painted.depth, 0.0)
        )
        middle = transform(plane(self.camera, 0.0), [[0.0, 0.0]])
        back = (middle - transform(display, middle))[0]
        turn = np.array([[1, 0, back[0]], [0, 1, back[1]], [0, 0, 1.0]])
        return turn @ wall, turn @ display


def draw_scene(
    layout: Layout,
    pair: Pair,
    view_deg: float,
    rng: np.random.Generator,
    settings: SceneSettings,
) -> Scene:
    """Draw a room, a display in it, and where the camera stands.

    The whole picture is in view unless ``settings.outside`` says otherwise.

    Args:
        layout: layout of the picture.
        pair: camera and display; its haze is that of 150 lux and is changed to the room's.
        view_deg: nominal angle of observation, degrees; the camera keeps it within 1.
        rng: source of every random draw.
        settings: what is chosen and not drawn.

    Raises:
        InputError: ``view_deg`` or a setting is out of range, or the pair is without perspective.
    """
    settings.check()
    check_view(view_deg)
    if not pair.setup.perspective:
        raise InputError("a scene needs perspective; do not switch it off")
    pose_rng, room_rng, paint_rng = rng.spawn(3)
    size = settings.size
    pose, camera = aim_camera(layout, view_deg, pose_rng, settings)
    H = camera[:, [0, 1, 3]] @ plane_from_display(layout.width, layout.height)
    H /= H[2, 2]

    drawn = str(room_rng.choice(list(ROOMS)))
    room = settings.room or drawn
    low, high = ROOMS[room]
    level = float(np.exp(room_rng.uniform(np.log(low), np.log(high))))
    tint = (1 + room_rng.uniform(-0.12, 0.12) * np.array([1.0, 0.0, -1.0])).astype(np.float32)
    haze = min(0.5, pair.display.haze * level / HAZE_ROOM)
    lit = replace(pair, display=replace(pair.display, haze=haze))

    margin = settings.margin_px
    shifted = np.array([[1, 0, margin], [0, 1, margin], [0, 0, 1.0]]) @ camera
    shape = (size[1] + 2 * margin, size[0] + 2 * margin, 3)
    canvas = RoomCanvas(np.zeros(shape, np.float32), shifted, np.zeros(shape[:2], np.float32))
    painter = RoomPainter(canvas, paint_rng, settings.pictures, np.float32(level) * tint)
    painted = _paint(painter, layout, lit, view_deg, settings)
    return Scene(
        layout=layout,
        pair=lit,
        view_deg=view_deg,
        pose=pose,
        room=room,
        level=level,
        size=size,
        H_captured_from_display=H,
        camera=camera,
        painted=painted,
        stray=settings.stray,
    )


def aim_camera(
    layout: Layout, view_deg: float, rng: np.random.Generator, settings: SceneSettings
) -> tuple[Pose, NDArray[np.float64]]:
    """Draw a camera that sees the whole picture, or all but ``outside``, as large as is asked for.

    Args:
        layout: layout of the picture.
        view_deg: nominal angle of observation, degrees; the camera keeps it within 1.
        rng: source of every random draw.
        settings: size of the image, coverage and rotation.

    Returns:
        Pose of the camera, and its (3, 4) projection as `optics.scene_camera` gives it.
    """
    turn = rng.choice([0.0, 90.0, 180.0, 270.0], p=[0.55, 0.15, 0.15, 0.15]) + rng.uniform(-5, 5)
    side = rng.uniform(*np.sqrt(COVERAGE))
    wanted = side**2 if settings.coverage is None else settings.coverage
    field = np.radians(rng.uniform(*FIELD_DEG))
    away = rng.uniform(-1, 1, 2)
    pose = Pose(
        view_deg=float(np.clip(view_deg + rng.uniform(-1, 1), -76, 76)),
        pitch_deg=float(rng.uniform(-8, 8)),
        roll_deg=float(turn if settings.turn is None else settings.turn),
        distance=MAX_DISTANCE,
    )
    size = np.array(settings.size)
    focal = max(size) / 2 / np.tan(field / 2)
    plane = plane_from_display(layout.width, layout.height)

    def corners(camera: NDArray[np.float64]) -> NDArray[np.float64]:
        return transform(camera[:, [0, 1, 3]] @ plane, layout.corners)

    def whole(points: NDArray[np.float64]) -> bool:
        return bool(
            (points > settings.free * size).all()
            and (points < (1 - settings.free) * size - 1).all()
        )

    def aimed(distance: float) -> tuple[Pose, NDArray[np.float64], bool]:
        """Aim as far from the picture's centre as was drawn, or as fits; say whether it fits."""
        there = replace(pose, distance=distance)
        middle = (size - 1) / 2
        box = np.ptp(corners(scene_camera(there, focal, settings.size, tuple(middle))), axis=0)
        free = np.maximum(0, (1 - 2 * settings.free) * size - box) / 2
        for share in np.linspace(1, 0, 11):
            camera = scene_camera(there, focal, settings.size, tuple(middle + share * away * free))
            if whole(corners(camera)):
                return there, camera, True
        return there, camera, False

    near, far = MIN_DISTANCE, MAX_DISTANCE
    for _ in range(24):
        distance = float(np.sqrt(near * far))
        _, camera, fits = aimed(distance)
        if not fits or _area(corners(camera)) > wanted * size[0] * size[1]:
            near = distance
        else:
            far = distance
    pose, camera, _ = aimed(far)
    if settings.outside > 0:
        points = corners(camera)
        axis, far_side = int(rng.integers(2)), bool(rng.integers(2))
        beyond = settings.outside * float(np.linalg.norm(points[1] - points[0]))
        shift = np.zeros(2)
        if far_side:
            shift[axis] = size[axis] - 0.5 + beyond - points[:, axis].max()
        else:
            shift[axis] = -0.5 - beyond - points[:, axis].min()
        camera = np.array([[1, 0, shift[0]], [0, 1, shift[1]], [0, 0, 1.0]]) @ camera
    return pose, camera


def _area(points: NDArray[np.float64]) -> float:
    return float(cv2.contourArea(points.astype(np.float32)))


def _paint(
    painter: RoomPainter, layout: Layout, pair: Pair, view_deg: float, settings: SceneSettings
) -> PaintedRoom:
    """Paint the room, the casing, and the screen beside the picture."""
    rng = painter.rng
    side = max(layout.width, layout.height)
    half = np.array([layout.width, layout.height]) / side / 2
    windowed, grow = rng.random() < 0.3, rng.uniform(0.02, 0.25, 4)
    white_surround, gray = rng.random() < 0.5, int(rng.integers(5, 60))
    if settings.window is not None:
        windowed = settings.window
    box = np.concatenate([-half, half])
    if windowed:
        box += grow * np.array([-1, -1, 1, 1])
    thick = rng.uniform(0.01, 0.07) * rng.uniform(0.8, 1.4, 4)
    thick[3] *= rng.choice([1.0, 2.5])  # a chin
    colour = np.full(3, rng.choice([0.02, 0.04, 0.2, 0.45, 0.8]), np.float32)
    on_desk, depth = rng.random() < 0.65, float(rng.uniform(0.02, 1.2))
    second, beside = rng.random() < 0.2, rng.uniform(0.05, 0.3)
    side_of = rng.choice([-1.0, 1.0])
    if settings.second_display is not None:
        second = settings.second_display

    canvas = painter.canvas
    painter.backdrop()
    painter.wall(depth)
    canvas.cover[:] = 0
    wall = canvas.light.copy()
    foot = float(box[3] + thick[3])
    desk_y = foot + DESK_Y * float(rng.uniform(0.3, 1.5))
    if on_desk:
        painter.desk(desk_y, depth)
    blur = rng.uniform(0.3, 1.8) * settings.size[0] / 1280
    for plane in (wall, canvas.light, canvas.cover):
        plane[:] = cv2.GaussianBlur(plane, (0, 0), blur)
    loss = np.cos(np.radians(view_deg)) ** pair.display.falloff[1]
    if second:
        edge = box[2] + thick[2] if side_of > 0 else -(thick[0] - box[0])
        painter.other_display(float(edge + side_of * beside), float(box[1]), float(loss))
    if on_desk:
        painter.stand(foot - 0.01, desk_y, colour)
    painter.frame(box, thick, colour)
    if windowed:
        level = np.full((1, 1, 3), 250 if white_surround else gray, np.uint8)
        emitted = Emission.of(pair.display, np.full((1, 1), np.radians(view_deg))).light(level)
        lit = np.asarray(emitted + pair.display.haze, np.float32)
        width, height = box[2:] - box[:2]
        canvas.paint(lit, (*box[:2], 0), (width, 0, 0), (0, height, 0))
    return PaintedRoom(canvas.light, wall, canvas.cover, depth, settings.margin_px)
