"""Small films of displays that show pilots, for the tests of finding and reading them."""

import cv2
import numpy as np
from numpy.typing import NDArray

from link.code.framing import encode
from link.frames import SoftBits
from link.geometry import Lens, frame_corners, homography_from_corners, transform
from link.layout import Layout, block_mean, make_layout
from link.pilots import pilot_signs
from link.presets import PRESETS
from link.types import Array, Floats, Image
from receiver.pilots.search.all_blocks import block_maps

FINE = make_layout(24, 32, modulation="antipodal", pilots="auto")
OTHER = make_layout(16, 16, modulation="antipodal", pilots="auto")
CORNERS = np.array([[120.0, 70.0], [520.0, 90.0], [510.0, 390.0], [130.0, 360.0]])


class BlockMeans:
    """Stands in for a decoder: a block's score is how far its mean level rises, times a factor."""

    def __init__(self, layout: Layout) -> None:
        self.layout = layout
        self.pairs = 0

    def prepare(self) -> None:
        """There is nothing to load."""

    def decode(self, original: Image, embedded: Image) -> SoftBits:
        self.pairs += 1
        change = embedded.astype(np.float32) - original
        if change.ndim == 3:
            change = change.mean(axis=2)
        blocks = block_mean(change, self.layout.rows, self.layout.cols)
        return SoftBits(2.0 * blocks[self.layout.message_mask].astype(np.float64))


def texture(shape: tuple[int, int], seed: int, sigma: float = 4.0) -> Floats:
    noise = np.random.default_rng(seed).standard_normal(shape).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), sigma)
    return np.asarray(smooth / smooth.std(), np.float32)


def filmed(
    layout: Layout,
    frames: int,
    seed: int,
    hold: float = 2,
    kappa: float = 8.0,
    dark: bool = False,
    night: bool = False,
    message: NDArray[np.integer] | None = None,
    pan: float = 0.0,
    parallax: float = 0.0,
) -> tuple[list[Image], Array]:
    """Frames of 640 x 480 of a display before a wall, a hand that moves a little, and its corners.

    The display's edges cannot be seen where it is ``dark`` around. At ``night`` wall and picture
    have a few gray levels, and bright signs on both have the only clear edges. Each state is shown
    for ``hold`` frames. The blocks of a pair show the next row of ``message``, (rows, n_bits), or
    random bits. From one pair to the next the picture moves right by ``pan`` pixels. The wall moves
    by the share ``parallax`` less than the display, as before a camera that moves sideways, and has
    most of the clear points.
    """
    rng = np.random.default_rng(seed)
    wall = 60 + (40 * texture((480, 640), seed, 2) if parallax else 8 * texture((480, 640), seed))
    picture = 150 + 20 * texture((layout.height, layout.width), seed + 1)
    if dark:
        wall[:] = float(picture.mean())
    if night:
        wall += 50
        for x in range(60, 440, 40):
            picture[60:90, x : x + 20] = picture[200:215, x : x + 30] = 1700
        for y in range(60, 460, 40):
            wall[y : y + 20, 560:600] = 2000
    H = homography_from_corners(CORNERS, layout.width, layout.height)
    images, corners = [], np.zeros((0, 4, 2))
    for number in range(frames):
        state = int(number // hold)
        bits = np.random.default_rng([seed, state // 2]).choice(
            [-1.0, 1.0], layout.rows * layout.cols
        )
        if message is not None:
            row = message[state // 2 % len(message)]
            bits[layout.message_mask.reshape(-1)] = 2.0 * row - 1
        bits[layout.pilot_blocks] = pilot_signs(layout)
        sign = 0.5 if layout.code.states_of(state // 2)[1] == state else -0.5
        change = cv2.resize(
            bits.reshape(layout.rows, layout.cols), (layout.width, layout.height), interpolation=0
        )
        moved = np.roll(picture, round(pan * (state // 2)), axis=1)
        shown = np.asarray(moved + sign * kappa * change, np.float32)
        motion = np.eye(3)
        motion[:2, 2] = (9 if parallax else 3) * np.sin([number / 7, number / 9])
        view = cv2.warpPerspective(shown, motion @ H, (640, 480))
        mask = cv2.warpPerspective(np.ones_like(shown), motion @ H, (640, 480))
        behind = np.eye(3)
        behind[:2, 2] = (1 - parallax) * motion[:2, 2]
        room = cv2.warpPerspective(wall, behind, (640, 480), borderMode=cv2.BORDER_REPLICATE)
        image = mask * view + (1 - mask) * room
        if night:
            image *= 0.06
        image += rng.standard_normal((480, 640), np.float32)
        images.append(np.clip(image + 0.5, 0, 255).astype(np.uint8))
        corners = np.concatenate([corners, transform(motion, CORNERS)[None]])
    return images, corners


def leaving(images: list[Image], corners: Array) -> tuple[list[Image], Array]:
    """Turn a film of `filmed` by 10 degrees, and cut off its top to beyond one of the corners."""
    turn = cv2.getRotationMatrix2D((320, 240), -10, 1)
    turn[1, 2] -= 92
    turned = [cv2.warpAffine(each, turn, (640, 480), borderMode=1) for each in images]
    H_after_from_before = np.vstack([turn, [0, 0, 1]])
    return turned, np.array([transform(H_after_from_before, each) for each in corners])


def without_a_side(images: list[Image], corners: Array, share: float) -> tuple[list[Image], Array]:
    """Move a film of `filmed` to the left until a share of the display's width is out of view."""
    left, right = corners[0, [0, 3], 0].mean(), corners[0, [1, 2], 0].mean()
    shift = np.array([[1, 0, -(left + share * (right - left))], [0, 1, 0]])
    moved = [cv2.warpAffine(each, shift, (640, 480), borderMode=1) for each in images]
    return moved, corners + shift[:, 2]


TEXT = b"no marks"
"""The message of `robust_film`."""


def robust_film(frames: int) -> tuple[list[Image], Array]:
    """Frames of the preset robust, whose states are shown for two frames each, and corners."""
    layout = PRESETS["robust"].layout
    return filmed(layout, frames, seed=3, message=encode(TEXT, layout.n_bits))


def pilots_alone(layout: Layout, size: tuple[int, int]) -> Floats:
    """How pilots change, drawn at a size: 1 or -1 in their blocks, and 0 in others."""
    blocks = np.zeros(layout.rows * layout.cols, np.float32)
    blocks[layout.pilot_blocks] = pilot_signs(layout)
    grid = blocks.reshape(layout.rows, layout.cols)
    return cv2.resize(grid, size, interpolation=cv2.INTER_NEAREST)


def beside_print(images: list[Image], corners: Array, shown: Image) -> list[Image]:
    """Frames of `filmed`, 1200 x 480, of a wall that goes on to the right, where a print hangs."""
    height, width = shown.shape
    wide = []
    for image, there in zip(images, corners, strict=True):
        view = np.full((480, 1200), 60, np.uint8)
        view[:, :640] = image
        place = frame_corners(width, height) + [[670, 50]] + (there - CORNERS)
        H = homography_from_corners(place, width, height)
        cv2.warpPerspective(shown, H, (1200, 480), view, borderMode=cv2.BORDER_TRANSPARENT)
        wide.append(view)
    return wide


def panned_to(images: list[Image], frames: int) -> list[Image]:
    """Frames of a camera that turns within ``frames`` frames from a wall to what images show."""
    height, width = images[0].shape
    wall = np.clip(60 + 20 * texture((height, width), 77), 0, 255).astype(np.uint8)
    panned = []
    for number, image in enumerate(images):
        left = round(width * min(1.0, number / frames))
        panned.append(np.concatenate([wall, image], axis=1)[:, left : left + width])
    return panned


def moving_picture(shift: int) -> Image:
    """A frame, 640 x 640, of a camera at rest before a picture that has moved by some pixels.

    The picture has more points than the room, of which two strips are seen.
    """
    rng = np.random.default_rng(0)
    room, picture = (
        cv2.resize(rng.integers(0, 256, (side, side), np.uint8), (8 * side,) * 2)
        for side in (80, 60)
    )
    frame = np.full((640, 640), 90, np.uint8)
    frame[:60], frame[-60:] = room[:60], room[-60:]
    frame[80:560, 80:560] = np.roll(picture, shift, axis=1)
    return np.asarray(cv2.GaussianBlur(frame, (0, 0), 1.5), np.uint8)


BENT_SIZE = 1280, 720
BENT_CORNERS = np.array([[200.0, 60.0], [1130.0, 90.0], [1090.0, 660.0], [170.0, 640.0]])


def block_views(
    layout: Layout,
    off: Array,
    frames: int,
    frames_a_period: int,
    slope: float = 0.0,
    noise: float = 3.0,
    toggling: float = 3.0,
    k: float = 0.0,
) -> Floats:
    """Maps of `block_maps` of a display whose corners lie ``off`` by some layout pixels in them.

    Its phase slopes from top to bottom by ``slope`` radians. Each period shows another message.
    A lens of coefficient ``k`` shows the corners at BENT_CORNERS of an image of BENT_SIZE.
    """
    rng, maps = np.random.default_rng(5), block_maps(layout)
    size, lens = (layout.width, layout.height), Lens(k, BENT_SIZE)
    x, y = np.meshgrid(*map(np.arange, maps.size))
    pixels = transform(maps.to_layout(), np.column_stack([x.ravel(), y.ravel()]))
    H_captured_from_view = homography_from_corners(BENT_CORNERS, *size) @ np.linalg.inv(
        homography_from_corners(frame_corners(*size) + off, *size)
    )
    straight = lens.undistort(transform(H_captured_from_view, pixels))
    shown = transform(np.linalg.inv(lens.homography(BENT_CORNERS, *size)), straight)
    there = shown.astype(np.float32).reshape(*maps.size[::-1], 2)  # (h w, 2) -> (h, w, 2)
    states = []
    for _ in range(frames // frames_a_period + 2):
        bits = rng.choice([-1.0, 1.0], layout.rows * layout.cols)
        bits[layout.pilot_blocks] = pilot_signs(layout)
        grid = bits.reshape(layout.rows, layout.cols)
        drawn = cv2.resize(grid, (layout.width, layout.height), interpolation=cv2.INTER_NEAREST)
        states.append(cv2.remap(drawn, there, None, cv2.INTER_LINEAR))
    (_, height), (_, top) = maps.inner, maps.margin
    y = (np.arange(maps.size[1]) - top + 0.5) / height - 0.5
    views = []
    for number in range(frames):
        period = (number + 0.25) / frames_a_period - slope * y / (2 * np.pi) + 1  # (h,)
        shown = np.zeros(maps.size[::-1])
        for state, drawn in enumerate(states):
            rows = np.floor(period) == state
            shown[rows] = np.where(period % 1 < 0.5, -0.5, 0.5)[rows, None] * drawn[rows]
        views.append(120 + toggling * shown + rng.normal(0, noise, shown.shape))
    return np.array(views, np.float32)
