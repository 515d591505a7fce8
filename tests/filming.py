"""What the tests of the channel share: a small scene, a plain camera, pairs with few effects."""

from dataclasses import replace

import cv2
import numpy as np

from data_gen.channel.composition import Shot
from data_gen.channel.stills import capture
from data_gen.effects import EFFECTS, FILM_EFFECTS, switch_off
from data_gen.film.frame import VideoFrame
from data_gen.film.scenes import Scene, SceneSettings
from data_gen.pairs import PAIRS, get_pair
from data_gen.parameters import IDENTITY, Camera, Pair
from link.embed import embed
from link.frames import Captured, Displayed
from link.geometry import frame_corners, transform
from link.layout import Layout, make_layout
from link.types import Array, Floats, Homography, Image

CAMERAS = {name.split("-")[0]: pair.camera for name, pair in PAIRS.items()}
"""The cameras of the paper by the first part of a pair's name."""
DISPLAYS = {name.split("-")[1]: pair.display for name, pair in PAIRS.items()}
"""The displays of the paper by the second part of a pair's name."""
SMALL = make_layout(4, 4, 128, 96, 2)
ROOM = SceneSettings(
    size=(160, 96),
    coverage=0.3,
    turn=0.0,
    room="dark",
    window=False,
    second_display=False,
    margin_px=8,
)
"""A small dark room with one upright display, for films."""
PLAIN = replace(
    CAMERAS["canon"],
    name="plain",
    full_well_e=500.0,
    read_noise_e=0.0,
    white_level=1.0,
    color_matrix=IDENTITY,
    tone_curve=EFFECTS["transfer"]["tone_curve"],
    encoding="linear",
    bayer=False,
    sharpening=0.0,
    jpeg_quality=0,
)
"""A camera whose file holds 255 x exposure, rounded."""


def smooth_picture(layout: Layout, seed: int = 4) -> Image:
    coarse = np.random.default_rng(seed).uniform(0, 255, (7, 9, 3)).astype(np.float32)
    return np.asarray(cv2.resize(coarse, (layout.width, layout.height)).round(), np.uint8)


def scene(layout: Layout = SMALL) -> Displayed:
    """A smooth colour picture with a message and ratex patches."""
    bits = np.arange(layout.n_bits) % 2
    return embed(smooth_picture(layout), bits, layout, 5)


def even_scene(level: int, layout: Layout = SMALL) -> Displayed:
    """Two equal frames of one gray level."""
    frame = np.full((layout.height, layout.width, 3), level, np.uint8)
    return Displayed(frame, frame, np.zeros(layout.n_bits, np.intp), layout, 5)


def only(name: str, *effects: str) -> Pair:
    """The pair with all effects off but these, in stills and films."""
    known = EFFECTS | FILM_EFFECTS
    return switch_off(get_pair(name), [effect for effect in known if effect not in effects])


def film(pair: Pair, displayed: Displayed, view_deg: float = 0.0, seed: int = 0) -> Captured:
    return capture(displayed, pair, view_deg, np.random.default_rng(seed))


def even_light(*rgb: float) -> Floats:
    """(96, 128, 3): one colour, or one gray."""
    return np.full((96, 128, 3), rgb if len(rgb) == 3 else rgb[0], np.float32)


def levels(frame: Image) -> Array:
    return frame.astype(np.float64)


def develop_plainly(camera: Camera) -> Camera:
    """The camera without what mixes pixels: mosaic, sharpening, JPEG."""
    return replace(camera, bayer=False, sharpening=0.0, jpeg_quality=0)


def seen_centre(frame: VideoFrame) -> Array:
    """Centre of what is bright."""
    found = cv2.moments((frame.rgb[:, :, 1] > 127).astype(np.uint8))
    return np.array([found["m10"] / found["m00"], found["m01"] / found["m00"]])


def true_centre(frame: VideoFrame) -> Array:
    """Centre of where the display is."""
    corners = transform(frame.H_captured_from_display, frame_corners(SMALL.width, SMALL.height))
    shape = cv2.moments(corners.astype(np.float32)[:, None])
    return np.array([shape["m10"] / shape["m00"], shape["m01"] / shape["m00"]])


def photograph(
    frame: Image,
    made: Scene,
    rng: np.random.Generator,
    H_captured_from_display: Homography | None = None,
) -> Image:
    """One still of a displayed frame; its reflection, drift, backlight and noise are drawn."""
    viewpoint = made.viewpoint(rng)
    drift = float(np.exp(made.pair.nuisance(made.view_deg).drift * rng.standard_normal()))
    moved = H_captured_from_display
    H = made.H_captured_from_display if moved is None else moved
    shot = Shot(viewpoint, H, drift, float(rng.random()))
    return shot.develop(shot.expose(frame), rng)
