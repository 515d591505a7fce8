"""The channel: what the display shows -> what the camera stores, for one frame pair."""

import numpy as np

from data_gen.camera import expose
from data_gen.display import emitted_light
from data_gen.optics import check_view, draw_pose, image_of, jitter, project, view_angles
from data_gen.pairs import Pair
from link.frames import Captured, Displayed
from link.geometry import frame_corners, transform
from link.images import as_rgb

METERING = 0.5
"""Share (in log light) of the fall-off by angle that the camera's exposure makes up for: 0 keeps
the frontal settings, 1 keeps white equally bright. Assumed half-way, since the paper tells neither;
[0, 1]."""


def capture(
    displayed: Displayed, pair: Pair, view_deg: float, rng: np.random.Generator
) -> Captured:
    """Film one frame pair.

    Pose, exposure and CDTF are common to both frames; between them the exposure drifts by a factor
    exp(Normal(0, pair.drift)) and the camera moves by `optics.jitter`. The embedded frame keeps the
    original's corners: the motion is what registration left.

    Args:
        displayed: uint8 frames, gray or RGB.
        pair: camera, display and their nuisances.
        view_deg: nominal angle of observation, degrees.
        rng: every random draw comes from here.

    Returns:
        `Captured` with RGB frames of CAPTURE_HEIGHT x CAPTURE_WIDTH, the true corners and bits.

    Raises:
        InputError: ``view_deg`` is out of range.
    """
    check_view(view_deg)
    layout = displayed.layout
    pose = draw_pose(view_deg, rng)
    theta = view_angles(pose, layout.width, layout.height)
    H_captured_from_display = project(pose, layout.width, layout.height)
    e_green = np.cos(np.radians(view_deg)) ** pair.display.falloff[1]
    gain = float(e_green**-METERING)
    drift = float(np.exp(pair.drift * rng.standard_normal()))
    motion = jitter(pair.jitter_px, rng)
    frames = []
    for frame, exposure, H in (
        (displayed.original, gain, H_captured_from_display),
        (displayed.embedded, gain * drift, motion @ H_captured_from_display),
    ):
        light = emitted_light(as_rgb(frame), pair.display, theta)
        image = image_of(light, H, pair.camera.blur_px)
        frames.append(expose(image, pair.camera, pair.crosstalk, exposure, rng))
    corners = transform(H_captured_from_display, frame_corners(layout.width, layout.height))
    return Captured(
        original=frames[0],
        embedded=frames[1],
        layout=layout,
        corners=corners,
        corners_embedded=corners,
        bits=displayed.bits,
        kappa=displayed.kappa,
        meta={"pair": pair.name, "view_deg": view_deg},
    )
