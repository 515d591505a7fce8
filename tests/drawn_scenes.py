"""Small drawn scenes of a display in a room, for the tests of finding it."""

import cv2
import numpy as np

from data_gen.pictures.library import load_pictures
from link.embed import embed
from link.geometry import homography_from_corners, transform
from link.layout import Layout, make_layout
from link.types import Array, Floats, Image

LAYOUT = make_layout()
PLAIN = make_layout(ratex=0)
WIDTH, HEIGHT = 640, 480
CORNERS = np.array([[150.2, 95.7], [520.4, 120.3], [490.8, 380.1], [130.6, 350.9]])


def content(layout: Layout, picture: int = 0) -> Image:
    rgb = load_pictures("test", layout.width, layout.height)[picture].rgb
    return embed(rgb, np.arange(layout.n_bits) % 2, layout, 3).embedded


def room() -> Floats:
    """A wall, a table, a sheet of paper and a poster."""
    rng = np.random.default_rng(8)
    image = np.full((HEIGHT, WIDTH, 3), (120, 110, 95), np.float32)
    image *= np.linspace(0.8, 1.1, WIDTH, dtype=np.float32)[:, None]
    cv2.rectangle(image, (0, 400), (WIDTH, HEIGHT), (90, 60, 40), -1)
    cv2.fillConvexPoly(image, np.array([[20, 420], [110, 415], [130, 460], [25, 470]]), (210,) * 3)
    cv2.rectangle(image, (570, 40), (630, 130), (150, 60, 50), -1)
    return image + rng.normal(0, 2, image.shape).astype(np.float32)


def scene(shown: Image, corners: Array = CORNERS, bezel: float = 0.025) -> Image:
    """The room with a display in a black bezel; (480, 640, 3) uint8."""
    height, width = shown.shape[:2]
    H = homography_from_corners(corners, width, height)
    margin = bezel * width
    frame = np.array([[0, 0], [width, 0], [width, height], [0, height]]) - 0.5
    frame += margin * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    image = room()
    cv2.fillConvexPoly(
        image, (transform(H, frame) * 16).astype(np.int32), (12,) * 3, cv2.LINE_AA, 4
    )
    # four samples a pixel and axis, averaged
    fine = np.array([[4, 0, 1.5], [0, 4, 1.5], [0, 0, 1]]) @ H
    size = (4 * WIDTH, 4 * HEIGHT)
    light = cv2.warpPerspective(shown.astype(np.float32), fine, size, flags=cv2.INTER_LINEAR)
    mask = cv2.warpPerspective(np.ones((height, width), np.float32), fine, size)
    light, mask = (
        cv2.resize(map_, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA) for map_ in (light, mask)
    )
    image = image * (1 - mask[..., None]) + light
    return np.asarray(np.clip(cv2.GaussianBlur(image, (0, 0), 0.6), 0, 255), np.uint8)


def with_corner_out(corner: int, outside: float = 0.12, turn_deg: float = 12.0) -> Array:
    """Corners of a turned display, one of which lies outside by a share of the width."""
    width, height = 330.0, 250.0
    box = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]]) * [width, height]
    sign = -1 if corner % 2 == 0 else 1  # so that this corner is the outermost of its side
    a = np.radians(sign * turn_deg)
    quad = box @ np.array([[np.cos(a), np.sin(a)], [-np.sin(a), np.cos(a)]])
    quad += [WIDTH / 2, HEIGHT / 2]
    right, shift = corner in (1, 2), outside * width
    edge = WIDTH - 0.5 + shift - quad[:, 0].max() if right else -0.5 - shift - quad[:, 0].min()
    return np.asarray(quad + np.array([edge, 0.0]))
