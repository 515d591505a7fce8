"""What a phone does to the frames of its camera before it stores them.

The effects follow the camera's own processing (`data_gen.channel.camera.develop`), in the order in
which a phone applies them: the lens's distortion, electronic stabilisation, temporal noise
reduction, local tone mapping and sharpening. Each has a switch in `PhoneSettings` and is off by
default. They need nothing but the frames, so that one film can be processed in several ways.
Motion blur alone belongs to the exposure, which `data_gen.film.stream` makes.
"""

from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from data_gen.channel.camera import unsharp_mask
from data_gen.channel.display import Light
from data_gen.film.frame import VideoFrame
from link.errors import in_range
from link.geometry import Lens, frame_corners, homography_from_corners, in_image, transform

TONE_TILES = (8, 8)
"""Number of tiles along x and y, between which local tone mapping interpolates."""
STABILISED_SHARE = 0.03
"""Largest shift by which stabilisation moves a corner of the image, in widths of the image: what a
phone crops for it."""


@dataclass(frozen=True)
class PhoneSettings:
    """What a phone does to its frames beside the codec; every effect is off by default."""

    noise_reduction: float = 0.0
    """Share of the stored frame before that temporal noise reduction mixes into each frame; 0 for
    none."""
    local_tone: float = 0.0
    """Clip limit of the local tone mapping (CLAHE of luma over 8 x 8 tiles), such as 2; 0 for
    none."""
    stabilise_s: float = 0.0
    """Time constant, in seconds, over which stabilisation smooths the hand's motion; 0 for none."""
    stabilise_px: float = 0.3
    """Standard deviation, in pixels along each axis, by which stabilisation misses the smooth
    motion in each frame."""
    sharpen: float = 0.0
    """Amount of the phone's unsharp mask with a sigma of 1 pixel, after the camera's own; 0 for
    none."""
    distortion: float = 0.0
    """Coefficient k of the `Lens`. Below 0 the image bulges like a barrel, and mirrors its edges
    into its corners."""
    motion_blur: bool = False
    """Whether the hand's motion while the shutter is open blurs the frame."""

    def check(self) -> None:
        """Raise a `ParameterError` that names the first setting that is out of its range."""
        in_range(
            self,
            noise_reduction=(0, 0.95, ""),
            local_tone=(0, 100, ""),
            stabilise_s=(0, 10, " seconds"),
            stabilise_px=(0, 10, " pixels"),
            sharpen=(0, 5, ""),
            distortion=(-0.12, 0.12, ""),
        )


class PhoneProcessor:
    """Processes the frames of one film in order.

    Args:
        settings: what is switched on.
        display: width and height of the displayed picture, pixels.
        rng: draws by how much stabilisation misses.

    >>> rgb = np.full((64, 96, 3), 90, np.uint8)
    >>> frame = VideoFrame(rgb, 0, 0.0, 0.0, np.eye(3), {}, True, False)
    >>> settings, rng = PhoneSettings(distortion=-0.1), np.random.default_rng(0)
    >>> seen = PhoneProcessor(settings, (20, 20), rng).process(frame)
    >>> transform(seen.H_captured_from_display, [[-0.5, -0.5]]).round(1).tolist()
    [[4.3, 2.7]]
    """

    def __init__(
        self, settings: PhoneSettings, display: tuple[int, int], rng: np.random.Generator
    ) -> None:
        settings.check()
        self._settings, self._display, self._rng = settings, display, rng
        self._first: NDArray[np.float64] | None = None
        self._smooth = np.zeros((4, 2))
        self._time_s = 0.0
        self._kept: Light | None = None
        self._maps: tuple[NDArray[Any], NDArray[Any]] | None = None
        self._last: VideoFrame | None = None

    def process(self, frame: VideoFrame) -> VideoFrame:
        """Return the frame as the phone passes it on, with the truth about where its display is.

        A frame that repeats the one before is passed on as a repetition.
        """
        if frame.duplicate and self._last is not None:
            last = self._last
            H, visible = last.H_captured_from_display, last.visible
            return replace(frame, rgb=last.rgb, H_captured_from_display=H, visible=visible)
        settings, rgb, H = self._settings, frame.rgb, frame.H_captured_from_display
        size = rgb.shape[1], rgb.shape[0]
        if settings.distortion:
            rgb, H = self._distort(rgb), self._distorted(H, size)
        if settings.stabilise_s > 0:
            motion = self._steady(frame.H_captured_from_display, frame.time_s, size)
            border = cv2.BORDER_REFLECT_101
            moved = cv2.warpPerspective(rgb, motion, size, borderMode=border)
            rgb, H = np.asarray(moved, np.uint8), motion @ H
        if settings.noise_reduction > 0:
            rgb = self._denoise(rgb)
        if settings.local_tone > 0:
            rgb = map_tones_locally(rgb, settings.local_tone)
        if settings.sharpen > 0:
            rgb = unsharp_mask(rgb.astype(np.float32), settings.sharpen)
        H = H / H[2, 2]
        inside = in_image(transform(H, frame_corners(*self._display)), rgb.shape)
        visible = bool(inside.all())
        self._last = replace(frame, rgb=rgb, H_captured_from_display=H, visible=visible)
        return self._last

    def _distort(self, rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Resample (H, W, 3) pixels as the lens bends them."""
        height, width = rgb.shape[:2]
        if self._maps is None:
            x, y = np.meshgrid(np.arange(width), np.arange(height))
            seen = np.column_stack([x.ravel(), y.ravel()]).astype(np.float64)
            source = Lens(self._settings.distortion, (width, height)).undistort(seen)
            maps = source.reshape(height, width, 2).astype(np.float32)  # (H W, 2) -> (H, W, 2)
            where, between = cv2.convertMaps(maps, None, cv2.CV_16SC2)
            self._maps = where, between
        return np.asarray(
            cv2.remap(
                rgb, *self._maps, interpolation=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT_101
            ),
            np.uint8,
        )

    def _distorted(self, H: NDArray[np.float64], size: tuple[int, int]) -> NDArray[np.float64]:
        """Return the (3, 3) homography to where the lens shows the display's four corners."""
        corners = transform(H, frame_corners(*self._display))
        bent = Lens(self._settings.distortion, size).distort(corners)
        return homography_from_corners(bent, *self._display)

    def _steady(
        self, H: NDArray[np.float64], time_s: float, size: tuple[int, int]
    ) -> NDArray[np.float64]:
        """Return the (3, 3) homography from pixels of this frame to those of a steadier one."""
        corners = frame_corners(*size)
        if self._first is None:
            self._first, self._time_s = H, time_s
        moved = transform(H @ np.linalg.inv(self._first), corners)
        share = 1 - np.exp(-(time_s - self._time_s) / self._settings.stabilise_s)
        self._smooth += share * (moved - corners - self._smooth)
        self._time_s = time_s
        limit = STABILISED_SHARE * size[0]
        shift = np.clip(corners + self._smooth - moved, -limit, limit)
        shift += self._settings.stabilise_px * self._rng.standard_normal(2)
        steady = (moved + shift).astype(np.float32)
        return np.asarray(cv2.getPerspectiveTransform(moved.astype(np.float32), steady), np.float64)

    def _denoise(self, rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Mix (H, W, 3) pixels with those kept of the frames before."""
        new = rgb.astype(np.float32)
        if self._kept is not None:
            share = self._settings.noise_reduction
            new = np.asarray(cv2.addWeighted(new, 1 - share, self._kept, share, 0))
        self._kept = new
        return (new + np.float32(0.5)).astype(np.uint8)


def map_tones_locally(rgb: NDArray[np.uint8], clip_limit: float) -> NDArray[np.uint8]:
    """Equalise the contrast of luma tile by tile (CLAHE).

    Args:
        rgb: (H, W, 3) uint8, encoded.
        clip_limit: OpenCV's limit of a histogram's bins; the larger, the more contrast.

    Returns:
        (H, W, 3) uint8, encoded; colours keep their differences from luma.
    """
    planes = cv2.cvtColor(rgb, cv2.COLOR_RGB2YCrCb)
    equalise = cv2.createCLAHE(clipLimit=clip_limit, tileGridSize=TONE_TILES)
    planes[:, :, 0] = equalise.apply(np.ascontiguousarray(planes[:, :, 0]))
    return np.asarray(cv2.cvtColor(planes, cv2.COLOR_YCrCb2RGB), np.uint8)


def blur_by_motion(exposure: Light, shift: NDArray[np.float64]) -> Light:
    """Average an exposure over a straight motion of the whole image.

    Args:
        exposure: (H, W, 3) float32, linear.
        shift: (2,) motion along x and y while the shutter is open, pixels.

    Returns:
        (H, W, 3) float32, linear; the middle of the motion stays in place.
    """
    reach = int(np.ceil(np.abs(shift).max() / 2)) + 1
    kernel = np.zeros((2 * reach + 1, 2 * reach + 1), np.float32)
    steps = 2 * int(np.ceil(4 * np.abs(shift).max())) + 1
    for share in (np.arange(steps) + 0.5) / steps - 0.5:
        x, y = share * shift + reach
        left, top = int(np.floor(x)), int(np.floor(y))
        along, down = np.array([left + 1 - x, x - left]), np.array([top + 1 - y, y - top])
        kernel[top : top + 2, left : left + 2] += np.outer(down, along)
    kernel /= steps
    return np.asarray(
        cv2.filter2D(exposure, -1, kernel, borderType=cv2.BORDER_REFLECT_101), np.float32
    )
