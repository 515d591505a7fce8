"""The channel: what the display shows -> what the camera stores, for one frame pair."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data_gen.channel.camera import develop, expose, response_curve
from data_gen.channel.display import Light, emitted_light, fall_to_corners, room_light
from data_gen.channel.moire import moire_gain
from data_gen.channel.optics import (
    CAPTURE_HEIGHT,
    CAPTURE_WIDTH,
    check_view,
    draw_pose,
    image_of,
    motion,
    project,
    view_angles,
)
from data_gen.channel.shutter import pwm_gain
from data_gen.parameters import Pair
from link.frames import Captured, Displayed
from link.geometry import frame_corners, transform
from link.images import as_rgb
from link.layout import Layout


@dataclass(frozen=True)
class Shot:
    """The channel of one frame, drawn: from what the display shows to what the file holds."""

    pair: Pair
    theta: Light
    """(height, width) viewing angle at each display pixel, radians from the normal."""
    room: Light
    """(height, width, 1) float32 room light from each display pixel; frontal white is 1."""
    H_captured_from_display: NDArray[np.float64]
    """(3, 3)."""
    gain: Light
    """(H, W, 1) or (H, W, 3) of the capture: amplification, drift, vignetting, banding, moire."""
    iso: float
    """Amplification relative to the ISO of `Camera.full_well_e`, at least 1."""
    noise_scale: float
    """As in `develop`."""
    noise_rng: np.random.Generator
    """Draws the noise of the capture."""

    def expose(self, frame: NDArray[np.uint8]) -> Light:
        """What the sensor collects of a displayed frame, before noise.

        Args:
            frame: (height, width) or (height, width, 3) uint8, encoded, of the layout's size.

        Returns:
            (H, W, 3) float32 in [0, 1] of the capture, linear; 1 is saturation.
        """
        camera, size = self.pair.camera, self.gain.shape[1::-1]
        light = emitted_light(as_rgb(frame), self.pair.display, self.theta)
        light += self.room
        image = image_of(light, self.H_captured_from_display, camera.blur_px, size)
        return expose(image, camera, self.pair.crosstalk, self.gain)

    def develop(self, exposure: Light, rng: np.random.Generator) -> NDArray[np.uint8]:
        """The file's pixels (H, W, 3) uint8 of an exposure, or of a part of one."""
        return develop(exposure, self.pair.camera, rng, self.noise_scale, self.iso)


def draw_shots(
    layout: Layout, pair: Pair, view_deg: float, rng: np.random.Generator
) -> tuple[Shot, Shot]:
    """Draw the channel of the original and of the embedded frame.

    Pose, exposure, room light and CDTF are common to both frames. Between them the exposure drifts
    by a factor exp(Normal(0, drift)), the backlight's phase is drawn anew, and the camera moves by
    `optics.motion`. Every random draw is made whether or not its effect is switched off, so that
    switching one off leaves the others as they were.
    """
    check_view(view_deg)
    camera, display = pair.camera, pair.display
    nuisance = pair.nuisance(view_deg)
    pose = draw_pose(view_deg, rng)
    size, H_original, reduction = (layout.width, layout.height), np.eye(3), 1.0
    if pair.setup.perspective:
        reduction = pair.setup.resolution
        size = round(CAPTURE_WIDTH * reduction), round(CAPTURE_HEIGHT * reduction)
        H_original = reduced(size) @ project(pose, layout.width, layout.height)
    move = motion(reduction * nuisance.jitter_px, camera.breathing, size, rng)
    drift = float(np.exp(nuisance.drift * rng.standard_normal()))
    phases = rng.uniform(0, 1, 2)
    room = room_light(display, layout.height, layout.width, rng)[:, :, None]

    theta = view_angles(pose, layout.width, layout.height)
    iso = max(1.0, metered_gain(pair, view_deg))
    vignetting = fall_to_corners(camera.vignetting, size[1], size[0])

    def shot(
        H: NDArray[np.float64], exposure_gain: float, phase: float, noise_rng: np.random.Generator
    ) -> Shot:
        rows = pwm_gain(display, camera, size[1], phase)[:, None]
        gain = (vignetting * (np.float32(iso * exposure_gain) * rows))[:, :, None]
        if display.grid_contrast > 0:
            gain = gain * moire_gain(pair, layout, H, size)
        return Shot(pair, theta, room, H, gain, iso, reduction * nuisance.noise_scale, noise_rng)

    first, second = rng.spawn(2)
    return shot(H_original, 1.0, phases[0], first), shot(
        move @ H_original, drift, phases[1], second
    )


def reduced(size: tuple[int, int]) -> NDArray[np.float64]:
    """(3, 3), pixels of the usual capture to those of one of ``size`` (width, height)."""
    a, b = size[0] / CAPTURE_WIDTH, size[1] / CAPTURE_HEIGHT
    return np.array([[a, 0, (a - 1) / 2], [0, b, (b - 1) / 2], [0, 0, 1]])


def film(
    displayed: Displayed,
    shots: tuple[Shot, Shot],
    pair: Pair,
    view_deg: float,
    corner_rng: np.random.Generator,
) -> Captured:
    """Film one frame pair through a channel that is drawn already.

    The embedded frame keeps the original's corners: the motion is what registration left.

    Args:
        displayed: uint8 frames, gray or RGB.
        shots: of the original and of the embedded frame; the noise is drawn from their generators.
        pair: camera and display, for the error of the reported corners.
        view_deg: nominal angle of observation, degrees.
        corner_rng: draws that error.

    Returns:
        `Captured` with RGB frames (of CAPTURE_HEIGHT x CAPTURE_WIDTH, times the setup's resolution;
        of the display's size without perspective), the reported corners, and the true bits.
    """
    layout = displayed.layout
    original, embedded = (
        shot.develop(shot.expose(frame), shot.noise_rng)
        for shot, frame in zip(shots, (displayed.original, displayed.embedded), strict=True)
    )
    corners = transform(
        shots[0].H_captured_from_display, frame_corners(layout.width, layout.height)
    )
    corners += pair.setup.corner_px * corner_rng.standard_normal((4, 2))
    corners = np.clip(corners, -0.5, np.array(original.shape[1::-1]) - 0.5)
    return Captured(
        original=original,
        embedded=embedded,
        layout=layout,
        corners=corners,
        corners_embedded=corners,
        bits=displayed.bits,
        kappa=displayed.kappa,
        ratex_kappa=displayed.ratex_kappa,
        meta={"pair": pair.name, "view_deg": view_deg},
    )


def capture(
    displayed: Displayed, pair: Pair, view_deg: float, rng: np.random.Generator
) -> Captured:
    """Draw a channel and film one frame pair through it; see `draw_shots` and `film`.

    Args:
        displayed: uint8 frames, gray or RGB.
        pair: camera, display, setup and nuisances.
        view_deg: nominal angle of observation, degrees.
        rng: every random draw comes from here.

    Raises:
        InputError: ``view_deg`` is out of range.
    """
    shots = draw_shots(displayed.layout, pair, view_deg, rng)
    return film(displayed, shots, pair, view_deg, rng)


def metered_gain(pair: Pair, view_deg: float) -> float:
    """How much longer the camera exposes, or amplifies, than at the frontal view.

    With metering 1 white stays as bright, green and with the leak and the room's haze in it.
    """
    theta, display = np.radians(view_deg), pair.display
    white = np.cos(theta) ** display.falloff[1] + display.leak * np.sin(theta) ** 2
    brightness = (white + display.haze) / (1 + display.haze)
    return float(brightness**-pair.setup.metering)


def cdtf(pair: Pair, view_deg: float) -> NDArray[np.float64]:
    """The camera-display transfer function at the picture's centre, in a dark room.

    Returns:
        (256, 3) captured R, G, B in gray levels of [0, 255], unrounded, of grays 0 to 255.
    """
    grays = np.repeat(np.arange(256, dtype=np.uint8), 3).reshape(256, 1, 1, 3)
    theta = np.full((1, 1), np.radians(view_deg))
    light = emitted_light(grays, pair.display, theta)[:, 0]  # (256, 1, 1, 3) -> (256, 1, 3)
    exposure = expose(light, pair.camera, pair.crosstalk, metered_gain(pair, view_deg))
    raw = exposure[:, 0] @ np.array(pair.camera.color_matrix).T
    table = response_curve(pair.camera.tone_curve, pair.camera.encoding)
    curve = np.interp(np.clip(raw, 0, 1), np.linspace(0, 1, len(table)), table)
    return np.asarray(curve, np.float64)
