"""The channel: what the display shows -> what the camera stores, for one frame pair."""

import numpy as np
from numpy.typing import NDArray

from data_gen.camera import develop, expose, response_curve
from data_gen.display import emitted_light, fall_to_corners, room_light
from data_gen.moire import moire_gain
from data_gen.optics import (
    CAPTURE_HEIGHT,
    CAPTURE_WIDTH,
    check_view,
    draw_pose,
    image_of,
    motion,
    project,
    view_angles,
)
from data_gen.parameters import Pair
from data_gen.shutter import pwm_gain
from link.frames import Captured, Displayed
from link.geometry import frame_corners, transform
from link.images import as_rgb


def capture(
    displayed: Displayed, pair: Pair, view_deg: float, rng: np.random.Generator
) -> Captured:
    """Film one frame pair.

    Pose, exposure, room light and CDTF are common to both frames. Between them the exposure drifts
    by a factor exp(Normal(0, drift)), the backlight's phase is drawn anew, and the camera moves by
    `optics.motion`. The embedded frame keeps the original's corners: the motion is what
    registration left. Every random draw is made whether or not its effect is switched off, so that
    switching one off leaves the others as they were.

    Args:
        displayed: uint8 frames, gray or RGB.
        pair: camera, display, setup and nuisances.
        view_deg: nominal angle of observation, degrees.
        rng: every random draw comes from here.

    Returns:
        `Captured` with RGB frames (of CAPTURE_HEIGHT x CAPTURE_WIDTH; of the display's size without
        perspective), the reported corners, and the true bits.

    Raises:
        InputError: ``view_deg`` is out of range.
    """
    check_view(view_deg)
    layout, camera, display = displayed.layout, pair.camera, pair.display
    nuisance = pair.nuisance(view_deg)
    pose = draw_pose(view_deg, rng)
    size = (
        (CAPTURE_WIDTH, CAPTURE_HEIGHT) if pair.setup.perspective else (layout.width, layout.height)
    )
    H_original = project(pose, layout.width, layout.height) if pair.setup.perspective else np.eye(3)
    move = motion(nuisance.jitter_px, camera.breathing, size, rng)
    drift = float(np.exp(nuisance.drift * rng.standard_normal()))
    phases = rng.uniform(0, 1, 2)
    room = room_light(display, layout.height, layout.width, rng)[:, :, None]
    corner_error = pair.setup.corner_px * rng.standard_normal((4, 2))
    noise_rngs = rng.spawn(2)

    theta = view_angles(pose, layout.width, layout.height)
    light = emitted_light(
        np.stack([as_rgb(displayed.original), as_rgb(displayed.embedded)]), display, theta
    )
    light += room
    iso = max(1.0, metered_gain(pair, view_deg))
    vignetting = fall_to_corners(camera.vignetting, size[1], size[0])
    frames = []
    for frame_light, H, exposure_gain, phase, noise_rng in zip(
        light, (H_original, move @ H_original), (1.0, drift), phases, noise_rngs, strict=True
    ):
        rows = pwm_gain(display, camera, size[1], phase)[:, None]
        gain = (vignetting * (np.float32(iso * exposure_gain) * rows))[:, :, None]
        if display.grid_contrast > 0:
            gain = gain * moire_gain(pair, layout, H, size)
        image = image_of(frame_light, H, camera.blur_px, size)
        exposure = expose(image, camera, pair.crosstalk, gain)
        frames.append(develop(exposure, camera, noise_rng, nuisance.noise_scale, iso))
    corners = transform(H_original, frame_corners(layout.width, layout.height)) + corner_error
    corners = np.clip(corners, -0.5, np.array(size) - 0.5)
    return Captured(
        original=frames[0],
        embedded=frames[1],
        layout=layout,
        corners=corners,
        corners_embedded=corners,
        bits=displayed.bits,
        kappa=displayed.kappa,
        ratex_kappa=displayed.ratex_kappa,
        meta={"pair": pair.name, "view_deg": view_deg},
    )


def metered_gain(pair: Pair, view_deg: float) -> float:
    """How much longer the camera exposes, or amplifies, than at the frontal view."""
    e_green = np.cos(np.radians(view_deg)) ** pair.display.falloff[1]
    return float(e_green**-pair.setup.metering)


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
