"""The physical channel in one piece: from what a display shows to the pixels that a camera stores.

The stages, in the order in which light meets them:

1. the display emits light, and its surface adds room light (`Viewpoint.emitted`);
2. perspective, lens blur, and the mixture of what was shown while the shutter was open;
3. the sensor's colour channels collect it (`camera.collect`: crosstalk and white level);
4. the backlight's bands, moire, vignetting and exposure are factors on it (`Shot.display_gains`,
   `Shot.image_gains`);
5. the sensor saturates, and noise, mosaic and image processing follow (`camera.develop`).

A `Viewpoint` holds what all exposures of one camera share, a `Shot` is one of them. Frame pairs,
films and the analysis of errors all expose through `Shot`, so an effect of the channel is added
here once.
"""

from dataclasses import dataclass
from functools import cached_property, reduce
from itertools import zip_longest

import cv2
import numpy as np
from numpy.typing import NDArray

from data_gen.channel.camera import collect, develop
from data_gen.channel.display import Emission, Light
from data_gen.channel.moire import moire_gain
from data_gen.channel.optics import SURROUNDINGS, image_of
from data_gen.channel.shutter import pwm_gain
from data_gen.parameters import Pair
from link.geometry import frame_corners, transform
from link.images import as_rgb
from link.layout import Layout
from link.types import Homography, Image

BLUR_REACH = 4.0
"""Number of standard deviations of the lens blur within which the display still adds light."""


@dataclass(frozen=True, eq=False)
class Layer:
    """A part of the room on one plane, as the sensor collects its light before any gain."""

    light: Light
    """Collected light times cover, (H + 2 margin, W + 2 margin, 3) float32; 1 saturates the
    sensor."""
    cover: Light | None
    """Share of each pixel that the layer hides of those behind it, (H + 2 margin, W + 2 margin)
    float32 in [0, 1]; None for a layer that hides everything."""
    margin: int
    """Number of pixels that are known beyond each side of the image, for a camera that moves."""

    @classmethod
    def collected(cls, light: Light, cover: Light | None, margin: int, pair: Pair) -> "Layer":
        """Blur and collect a layer from linear light times cover, and its cover."""
        if pair.camera.blur_px > 0.1:
            light = cv2.GaussianBlur(light, (0, 0), pair.camera.blur_px)
            cover = None if cover is None else cv2.GaussianBlur(cover, (0, 0), pair.camera.blur_px)
        return cls(collect(light, pair.camera, pair.crosstalk), cover, margin)

    @cached_property
    def box(self) -> tuple[int, int, int, int]:
        """Left, top, right and bottom of the pixels that the layer covers at all."""
        if self.cover is None:
            return 0, 0, self.light.shape[1], self.light.shape[0]
        left, top, width, height = cv2.boundingRect((self.cover > 0).astype(np.uint8))
        return left, top, left + width, top + height

    def lay_over(self, image: Light, motion: Homography | None) -> None:
        """Draw the layer into (H, W, 3), in place, as a camera sees it that may have moved.

        Args:
            image: light of what lies behind.
            motion: homography from the resting camera's pixels to this image's; None for a
                camera at rest.
        """
        left, top, right, bottom = self.box
        H = np.array([[1, 0, left - self.margin], [0, 1, top - self.margin], [0, 0, 1.0]])
        H = H if motion is None else motion @ H
        size = image.shape[1], image.shape[0]
        if self.cover is None:
            cv2.warpPerspective(self.light, H, size, image, borderMode=cv2.BORDER_REFLECT_101)
            return
        points = transform(H, frame_corners(right - left, bottom - top))
        low = np.clip(np.floor(points.min(axis=0)) - 1, 0, size).astype(int)
        high = np.clip(np.ceil(points.max(axis=0)) + 2, 0, size).astype(int)
        if (high <= low).any():
            return
        H = np.array([[1, 0, -low[0]], [0, 1, -low[1]], [0, 0, 1.0]]) @ H
        part = image[low[1] : high[1], low[0] : high[0]]
        inside = np.s_[top:bottom, left:right]
        part *= 1 - cv2.warpPerspective(repeat_channels(self.cover[inside]), H, part.shape[1::-1])
        part += cv2.warpPerspective(self.light[inside], H, part.shape[1::-1])


@dataclass(frozen=True, eq=False)
class Viewpoint:
    """One camera before one display: what all its exposures have in common."""

    layout: Layout
    """Layout of the displayed picture."""
    pair: Pair
    """Camera, display and how they meet."""
    size: tuple[int, int]
    """Width and height of the stored image, pixels."""
    theta: Light
    """Viewing angle at each display pixel, (height, width), radians from the normal."""
    room: Light
    """Room light from each display pixel, (height, width, 1) float32; frontal white is 1."""
    lens: Light
    """Share of the light that vignetting leaves, (H, W, 1) or (H, W, 3) float32, times any gain
    that all exposures share."""
    iso: float
    """Amplification relative to the ISO of `Camera.full_well_e`, at least 1; it sets the noise."""
    noise_scale: float
    """Standard deviation of the noise relative to that of a single native pixel."""
    lamp: NDArray[np.float64]
    """(2,) position of a lamp's mirror image in the display, as `display.room_light` takes it."""
    stray: Light | None = None
    """Light that a lamp throws over the image through the lens, (H, W, 1) float32; 1 saturates the
    sensor. None for none."""
    surroundings: tuple[Layer, ...] = ()
    """The room around the display, from the farthest layer to the nearest; nothing for an even dark
    of `optics.SURROUNDINGS`, which shares every gain of the display's light."""

    def own_light(self, frame: Image) -> Light:
        """Return the light that leaves the display for the camera, without that of the room.

        Args:
            frame: an `Image`, of the layout's size.

        Returns:
            (height, width, 3) float32, linear; frontal white at the centre is 1.
        """
        return self._emission.light(as_rgb(frame))

    @cached_property
    def _emission(self) -> Emission:
        return Emission.of(self.pair.display, self.theta)


@dataclass(frozen=True, eq=False)
class Shot:
    """One exposure of a viewpoint: its geometry, and how long and when the shutter was open.

    A shot draws nothing at random, so it can expose any number of frames.
    """

    viewpoint: Viewpoint
    """The camera and the display."""
    H_captured_from_display: Homography
    """Homography from display pixels to pixels of the stored image."""
    exposure: float = 1.0
    """Exposure relative to that of `Viewpoint.lens`."""
    phase: float | None = 0.0
    """Phase of the backlight, in periods, when the first row opens; None where its pulses are in
    the display's light already."""
    motions: tuple[Homography, ...] = ()
    """Homographies from the resting camera's pixels to this image's, by which each layer of the
    surroundings moves; nothing for no motion."""
    iso: float | None = None
    """Amplification of this exposure; None for that of the viewpoint."""

    @cached_property
    def region(self) -> tuple[int, int, int, int]:
        """Left, top, right and bottom of the pixels that are exposed as the display's.

        They are all pixels where the viewpoint has no surroundings, else those that the display
        reaches, blur included. The region is empty where the display lies outside the image.
        """
        view, (width, height) = self.viewpoint, self.viewpoint.size
        if not view.surroundings:
            return 0, 0, width, height
        points = transform(self.H_captured_from_display, view.layout.corners)
        reach = 2 + BLUR_REACH * view.pair.camera.blur_px
        left, top = np.clip(np.floor(points.min(axis=0) - reach), 0, [width, height]).astype(int)
        right, bottom = np.clip(np.ceil(points.max(axis=0) + reach), 0, [width, height]).astype(int)
        return int(left), int(top), int(right), int(bottom)

    @cached_property
    def image_gains(self) -> tuple[Light, ...]:
        """Factors on all light that reaches the sensor: vignetting and exposure.

        Each is broadcastable to (H, W, 3).
        """
        return self.viewpoint.lens, np.asarray(self.exposure, np.float32)

    @cached_property
    def display_gains(self) -> tuple[Light, ...]:
        """Factors on the display's light alone: backlight and moire.

        Each is broadcastable to (h, w, 3) of the region.
        """
        view, pair = self.viewpoint, self.viewpoint.pair
        width, height = view.size
        left, top, right, bottom = self.region
        display: list[Light] = []
        if self.phase is not None:
            rows = pwm_gain(pair.display, pair.camera, height, self.phase)[top:bottom]
            display = [rows[:, None, None]]
        size = right - left, bottom - top
        if pair.display.grid_contrast > 0 and min(size) > 0:
            H = self.H_captured_from_display
            display.append(moire_gain(pair, view.layout, H, size, (left, top), width))
        return tuple(display)

    def expose(self, frame: Image) -> Light:
        """Return what the sensor collects of a displayed frame, before noise.

        Args:
            frame: an `Image`, of the layout's size.

        Returns:
            (H, W, 3) float32 in [0, 1], linear; 1 is saturation.
        """
        light = self.viewpoint.own_light(frame)
        light += self.viewpoint.room
        return self.expose_light(light)

    def expose_light(self, light: Light) -> Light:
        """Return what the sensor collects of light that leaves the display, before noise.

        Args:
            light: (height, width, 3) float32, as `Viewpoint.emitted` gives it, or a mean of several
                such lights over the exposure.

        Returns:
            (H, W, 3) float32 in [0, 1], linear; 1 is saturation.
        """
        view = self.viewpoint
        if not view.surroundings:
            display = self._project(light)
            exposure = collect(display, view.pair.camera, view.pair.crosstalk, self._whole_gain)
        else:
            exposure = np.empty((view.size[1], view.size[0], 3), np.float32)
            for layer, motion in zip_longest(view.surroundings, self.motions):
                layer.lay_over(exposure, motion)
            left, top, right, bottom = self.region
            if right > left and bottom > top:
                self._lay_display(exposure[top:bottom, left:right], light)
            if view.stray is not None:
                exposure += view.stray
            for gain in self.image_gains:
                exposure *= gain
        return np.asarray(np.minimum(exposure, 1.0, out=exposure), np.float32)

    def develop(self, exposure: Light, rng: np.random.Generator | None) -> NDArray[np.uint8]:
        """Return the stored pixels, (H, W, 3) uint8, of an exposure or of a part of one.

        Args:
            exposure: (H, W, 3) float32 in [0, 1], as `expose` gives it.
            rng: source of the noise; None for a capture without noise.
        """
        view = self.viewpoint
        noise_scale = 0.0 if rng is None else view.noise_scale
        iso = view.iso if self.iso is None else self.iso
        return develop(exposure, view.pair.camera, rng, noise_scale, iso)

    @cached_property
    def _whole_gain(self) -> Light:
        """Product of all gains where the dark beside the display shares those of its light.

        They are multiplied from the smallest array to the largest.
        """
        return reduce(np.multiply, sorted((*self.image_gains, *self.display_gains), key=np.size))

    def _lay_display(self, part: Light, light: Light) -> None:
        """Put the display into its region of the surroundings, in place."""
        camera, crosstalk = self.viewpoint.pair.camera, self.viewpoint.pair.crosstalk
        cover = self._project(np.ones(light.shape[:2], np.float32))
        shown = collect(self._project(light), camera, crosstalk)
        for gain in self.display_gains:
            shown *= gain
        part *= repeat_channels(1 - cover)
        part += shown

    def _project(self, light: Light) -> Light:
        """Return the blurred image of the display's light in the pixels of the region."""
        view, (left, top, right, bottom) = self.viewpoint, self.region
        to_region = np.array([[1, 0, -left], [0, 1, -top], [0, 0, 1.0]])
        H = to_region @ self.H_captured_from_display
        beside = 0.0 if view.surroundings else SURROUNDINGS
        return image_of(light, H, view.pair.camera.blur_px, (right - left, bottom - top), beside)


def repeat_channels(plane: Light) -> Light:
    """Copy (H, W) into (H, W, 3): numpy multiplies arrays of equal shape three times as fast."""
    whole = np.ascontiguousarray(plane)
    return np.asarray(cv2.merge([whole, whole, whole]))
