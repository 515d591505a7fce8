"""A camera before a scene: from displayed frames to the file's pixels.

Only the display's part of the image goes through what is dear: emitted light, perspective, moire.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from data_gen.channel.camera import collect, develop
from data_gen.channel.composition import metered_gain
from data_gen.channel.display import Light, emitted_light, fall_to_corners, room_light
from data_gen.channel.moire import moire_gain
from data_gen.channel.optics import CAPTURE_WIDTH, image_of
from data_gen.channel.shutter import pwm_gain
from data_gen.film.passer import Passer
from link.geometry import frame_corners, transform
from link.images import as_rgb

if TYPE_CHECKING:
    from data_gen.film.scenes import Scene

REACH = 4.0
"""Standard deviations of the blur that belong to the display's part of the image."""


@dataclass(frozen=True, eq=False)
class Viewpoint:
    """What is common to all frames of one camera before one scene."""

    scene: "Scene"
    room: Light
    """(height, width, 1) float32 room light from each display pixel; frontal white is 1."""
    iso: float
    """Amplification relative to the ISO of `Camera.full_well_e`, at least 1."""
    vignetting: Light
    """(H, W, 3) float32, times ``iso``."""
    surroundings: Light
    """(H + 2 margin, W + 2 margin, 3) float32: what the sensor collects of the canvas, vignetting
    and amplification left aside."""

    @classmethod
    def draw(cls, scene: "Scene", rng: np.random.Generator) -> "Viewpoint":
        """Draw the mirrored lamp, and prepare what does not change."""
        layout, pair = scene.layout, scene.pair
        camera = pair.camera
        room = room_light(pair.display, layout.height, layout.width, rng)[:, :, None]
        iso = max(1.0, metered_gain(pair, scene.view_deg))
        width, height = scene.size
        vignetting = np.float32(iso) * fall_to_corners(camera.vignetting, height, width)
        canvas = scene.canvas
        if camera.blur_px > 0.1:
            canvas = cv2.GaussianBlur(canvas, (0, 0), camera.blur_px)
        surroundings = collect(canvas, camera, pair.crosstalk)
        return cls(scene, room, iso, _thrice(vignetting), surroundings)

    def emitted(self, frame: NDArray[np.uint8]) -> Light:
        """Light that leaves the display for the camera, the room's included.

        Args:
            frame: (height, width) or (height, width, 3) uint8, encoded, of the layout's size.

        Returns:
            (height, width, 3) float32, linear.
        """
        light = emitted_light(as_rgb(frame), self.scene.pair.display, self.scene.theta)
        light += self.room
        return light

    def region(self, H_captured_from_display: NDArray[np.float64]) -> tuple[int, int, int, int]:
        """(left, top, right, bottom) pixels that the display reaches, blur included."""
        layout, (width, height) = self.scene.layout, self.scene.size
        points = transform(H_captured_from_display, frame_corners(layout.width, layout.height))
        reach = 2 + REACH * self.scene.pair.camera.blur_px
        left, top = np.clip(np.floor(points.min(axis=0) - reach), 0, [width, height]).astype(int)
        right, bottom = np.clip(np.ceil(points.max(axis=0) + reach), 0, [width, height]).astype(int)
        return int(left), int(top), int(right), int(bottom)

    def expose(
        self,
        lights: Sequence[Light],
        weights: NDArray[np.float32] | None,
        H_captured_from_display: NDArray[np.float64],
        gain: float = 1.0,
        phase: float = 0.0,
        motion: NDArray[np.float64] | None = None,
        front: tuple[Passer, float, float] | None = None,
    ) -> Light:
        """What the sensor collects, before noise.

        Args:
            lights: S of `emitted`, in the order in which the display shows them.
            weights: (S, h, 1) or (S, h, w) float32, share of each light in the exposure of the rows
                or pixels of `region`; None for the first light alone.
            H_captured_from_display: (3, 3) of this frame.
            gain: exposure relative to the pair's.
            phase: of the backlight when the first row opens, in periods.
            motion: (3, 3) pixels of the scene's image to this frame's; None for no motion.
            front: who stands before the display, in collected light, and the x and y of the
                top-left corner.

        Returns:
            (H, W, 3) float32 in [0, 1], linear; 1 is saturation.
        """
        scene, pair = self.scene, self.scene.pair
        width, height = scene.size
        exposure = self._around(motion)
        left, top, right, bottom = self.region(H_captured_from_display)
        if right > left and bottom > top:
            part = exposure[top:bottom, left:right]
            size = right - left, bottom - top
            H = np.array([[1, 0, -left], [0, 1, -top], [0, 0, 1.0]]) @ H_captured_from_display
            cover = self._project(np.ones(lights[0].shape[:2], np.float32), H, size)
            shown = self._mixed(lights, weights, H, size)
            rows = pwm_gain(pair.display, pair.camera, height, phase)[top:bottom]
            shown = collect(shown, pair.camera, pair.crosstalk, rows[:, None, None])
            if pair.display.grid_contrast > 0:
                shown *= moire_gain(
                    pair, scene.layout, H_captured_from_display, size, (left, top), width
                )
            part *= _thrice(1 - cover)
            part += shown
        if front is not None:
            passer, x, y = front
            passer.over(exposure, x, y)
        exposure *= self.vignetting
        exposure *= np.float32(gain)
        return np.asarray(np.minimum(exposure, 1.0, out=exposure), np.float32)

    def _mixed(
        self,
        lights: Sequence[Light],
        weights: NDArray[np.float32] | None,
        H: NDArray[np.float64],
        size: tuple[int, int],
    ) -> Light:
        """(h, w, 3): each pixel the weighted mean of the images of the lights."""
        if weights is None or len(lights) == 1:
            return self._project(lights[0], H, size)
        mixed = np.zeros((size[1], size[0], 3), np.float32)
        reach = 2 + int(REACH * self.scene.pair.camera.blur_px)
        for light, share in zip(lights, weights, strict=True):
            rows = np.flatnonzero(share.any(axis=1))
            if rows.size:
                first, last = int(rows[0]), int(rows[-1]) + 1
                low, high = max(0, first - reach), min(size[1], last + reach)
                moved = np.array([[1, 0, 0], [0, 1, -low], [0, 0, 1.0]]) @ H
                image = self._project(light, moved, (size[0], high - low))
                image = image[first - low : last - low]
                image *= _thrice(np.broadcast_to(share[first:last], image.shape[:2]))
                mixed[first:last] += image
        return mixed

    def _project(self, light: Light, H: NDArray[np.float64], size: tuple[int, int]) -> Light:
        return image_of(light, H, self.scene.pair.camera.blur_px, size, 0.0)

    def _around(self, motion: NDArray[np.float64] | None) -> Light:
        """(H, W, 3) a fresh copy of the surroundings as the moved camera sees them."""
        margin, (width, height) = self.scene.margin, self.scene.size
        if motion is None:
            return self.surroundings[margin : margin + height, margin : margin + width].copy()
        inward = np.array([[1, 0, -margin], [0, 1, -margin], [0, 0, 1.0]])
        return np.asarray(
            cv2.warpPerspective(
                self.surroundings,
                motion @ inward,
                (width, height),
                flags=cv2.INTER_LINEAR,
                borderMode=cv2.BORDER_REFLECT_101,
            )
        )

    def develop(self, exposure: Light, rng: np.random.Generator) -> NDArray[np.uint8]:
        """The file's pixels (H, W, 3) uint8, encoded RGB; noise as of the pixels pooled."""
        pair, scene = self.scene.pair, self.scene
        pooled = pair.nuisance(scene.view_deg).noise_scale * scene.size[0] / CAPTURE_WIDTH
        return develop(exposure, pair.camera, rng, pooled, self.iso)


def _thrice(plane: Light) -> Light:
    """(H, W) -> (H, W, 3): products of equal shapes take a third of the time."""
    whole = np.ascontiguousarray(plane)
    return np.asarray(cv2.merge([whole, whole, whole]))
