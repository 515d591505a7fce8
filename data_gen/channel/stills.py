"""Stills of one frame pair: draw what the channel does to it, and capture both frames."""

import numpy as np

from data_gen.channel.composition import Shot, Viewpoint
from data_gen.channel.display import fall_to_corners, room_light
from data_gen.channel.metering import metered_gain
from data_gen.channel.optics import (
    CAPTURE_HEIGHT,
    CAPTURE_WIDTH,
    check_view,
    draw_pose,
    project,
    residual_motion,
    view_angles,
)
from data_gen.parameters import Pair
from link.frames import Captured, Displayed
from link.geometry import transform
from link.layout import Layout


def draw_shots(
    layout: Layout, pair: Pair, view_deg: float, rng: np.random.Generator
) -> tuple[Shot, Shot]:
    """Draw the channel of the original and of the embedded frame.

    Pose, exposure, room light and the transfer function are common to both frames. Between them
    the exposure drifts by a factor exp(Normal(0, drift)), the backlight's phase is drawn anew, and
    the camera moves by `optics.residual_motion`. Every random draw is made whether or not its
    effect is switched off, so that switching one off leaves the others as they were.

    Args:
        layout: layout of the displayed picture.
        pair: camera, display, setup and nuisances.
        view_deg: nominal angle of observation, degrees.
        rng: source of every random draw.

    Raises:
        InputError: ``view_deg`` is out of range.
    """
    check_view(view_deg, "view_deg")
    camera, display = pair.camera, pair.display
    nuisance = pair.nuisance(view_deg)
    pose = draw_pose(view_deg, rng)
    size, H_original = (layout.width, layout.height), np.eye(3)
    if pair.setup.perspective:
        size = CAPTURE_WIDTH, CAPTURE_HEIGHT
        H_original = project(pose, layout.width, layout.height)
    H_moved = residual_motion(nuisance.jitter_px, camera.breathing, size, rng)
    drift = float(np.exp(nuisance.drift * rng.standard_normal()))
    phases = rng.uniform(0, 1, 2)
    lamp = rng.uniform(0, 1, 2)
    iso = max(1.0, metered_gain(pair, view_deg))
    viewpoint = Viewpoint(
        layout=layout,
        pair=pair,
        size=size,
        theta=view_angles(pose, layout.width, layout.height),
        room=room_light(display, layout.height, layout.width, lamp)[:, :, None],
        lamp=lamp,
        lens=fall_to_corners(camera.vignetting, size[1], size[0])[:, :, None],
        iso=iso,
        noise_scale=nuisance.noise_scale,
    )
    original = Shot(viewpoint, H_original, iso, phases[0])
    embedded = Shot(viewpoint, H_moved @ H_original, iso * drift, phases[1])
    return original, embedded


def capture(
    displayed: Displayed, pair: Pair, view_deg: float, rng: np.random.Generator
) -> Captured:
    """Draw a channel and capture one frame pair through it.

    The embedded frame keeps the original's corners: the motion is what registration left.

    >>> from data_gen.pairs import get_pair
    >>> from link.embed import embed
    >>> from link.layout import make_layout
    >>> layout = make_layout()
    >>> picture = np.full((layout.height, layout.width, 3), 128, np.uint8)
    >>> displayed = embed(picture, np.arange(layout.n_bits) % 2, layout, 5)
    >>> captured = capture(displayed, get_pair("canon-lg"), 45.0, np.random.default_rng(0))
    >>> captured.embedded.shape, captured.embedded.dtype
    ((576, 768, 3), dtype('uint8'))

    Args:
        displayed: both frames, uint8, gray or RGB.
        pair: camera, display, setup and nuisances.
        view_deg: nominal angle of observation, degrees, which the capture's ``meta`` repeats.
        rng: source of every random draw.

    Returns:
        RGB frames (CAPTURE_HEIGHT x CAPTURE_WIDTH, or of the display's size without perspective),
        the reported corners, and the true bits.

    Raises:
        InputError: ``view_deg`` is out of range.
    """
    layout = displayed.layout
    shots = draw_shots(layout, pair, view_deg, rng)
    original, embedded = (
        shot.develop(shot.expose(frame), noise_rng)
        for shot, frame, noise_rng in zip(
            shots, (displayed.original, displayed.embedded), rng.spawn(2), strict=True
        )
    )
    corners = transform(shots[0].H_captured_from_display, layout.corners)
    corners += pair.setup.corner_px * rng.standard_normal((4, 2))
    corners = np.clip(corners, -0.5, np.array(original.shape[1::-1]) - 0.5)
    return Captured(
        original=original,
        embedded=embedded,
        layout=layout,
        corners=corners,
        corners_embedded=corners,
        bits=displayed.bits,
        kappa=displayed.kappa,
        meta={"pair": pair.name, "view_deg": view_deg},
    )
