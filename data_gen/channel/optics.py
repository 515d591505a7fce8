"""The optics: where the camera stands, and perspective, motion and blur of what it sees."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from data_gen.channel.display import Light
from link.errors import ParameterError
from link.types import Homography

CAPTURE_WIDTH, CAPTURE_HEIGHT = 768, 576
"""Width and height of the simulated capture in pixels, to which the sensor's image is reduced."""
FILL = 0.70
"""Share of the capture that the frontal picture covers, along the axis that it fills more."""
SURROUNDINGS = 0.01
"""Linear light of what surrounds the picture, relative to frontal white: a dark room."""
MAX_VIEW_DEG = 75.0
"""Largest angle of observation, degrees from the display's normal, that is simulated."""
DISTANCES = (2.0, 3.0)
"""Distances of the nearest and the farthest camera, in longer sides of the picture."""


def check_view(view_deg: float, name: str = "view_deg") -> float:
    """Return the angle of observation if it can be simulated.

    Args:
        view_deg: degrees from the display's normal.
        name: parameter or command-line flag that the error names.

    Raises:
        ParameterError: the angle does not lie within ±75 degrees.
    """
    if not abs(view_deg) <= MAX_VIEW_DEG:
        raise ParameterError(
            name, f"need an angle within ±{MAX_VIEW_DEG:g} degrees, got {view_deg:g}"
        )
    return view_deg


@dataclass(frozen=True)
class Pose:
    """Position of a camera that looks at the picture's centre, from ``view_deg`` to its right."""

    view_deg: float
    """Horizontal angle from the display's normal, degrees."""
    pitch_deg: float
    """Vertical angle from the normal, degrees."""
    roll_deg: float
    """Rotation about the optical axis, degrees."""
    distance: float
    """Distance to the picture's centre, in longer sides of the picture."""

    @property
    def position(self) -> NDArray[np.float64]:
        """Centre of the camera, (3,), in the coordinates of the picture's plane.

        The picture lies at z = 0 about the origin and its longer side is 1; x points right, y down
        and z towards the viewer.
        """
        yaw, pitch = np.radians([self.view_deg, self.pitch_deg])
        towards = [np.sin(yaw) * np.cos(pitch), -np.sin(pitch), np.cos(yaw) * np.cos(pitch)]
        return np.asarray(self.distance * np.array(towards))


def draw_pose(view_deg: float, rng: np.random.Generator) -> Pose:
    """Draw a hand-placed camera.

    It stands within 1 degree of the nominal view, within 2 degrees of level and upright, and 2 to
    3 longer sides of the picture away.
    """
    return Pose(
        view_deg=view_deg + rng.uniform(-1, 1),
        pitch_deg=rng.uniform(-2, 2),
        roll_deg=rng.uniform(-2, 2),
        distance=rng.uniform(*DISTANCES),
    )


def view_angles(pose: Pose, width: int, height: int) -> Light:
    """Return the angle between the display's normal and each pixel's ray to the camera.

    Args:
        pose: where the camera stands.
        width: width of the picture, pixels.
        height: height of the picture, pixels.

    Returns:
        (height, width) float32, radians.
    """
    side = max(width, height)
    x = ((np.arange(width) - (width - 1) / 2) / side).astype(np.float32)
    y = ((np.arange(height) - (height - 1) / 2) / side).astype(np.float32)
    camera_x, camera_y, camera_z = pose.position
    squared = (camera_x - x) ** 2 + ((camera_y - y) ** 2)[:, None] + camera_z**2
    return np.asarray(np.arccos(camera_z / np.sqrt(squared)), np.float32)


def camera_axes(pose: Pose) -> NDArray[np.float64]:
    """Return right, down and forward, the rows of (3, 3), of a camera aimed at the centre."""
    center = pose.position
    forward = -center / np.linalg.norm(center)
    right = np.cross(forward, np.array([0.0, 1.0, 0.0]))
    right /= np.linalg.norm(right)
    down = np.cross(right, forward)
    roll = np.radians(pose.roll_deg)
    return np.array(
        [
            np.cos(roll) * right + np.sin(roll) * down,
            -np.sin(roll) * right + np.cos(roll) * down,
            forward,
        ]
    )


def plane_from_display(width: int, height: int) -> NDArray[np.float64]:
    """Return the (3, 3) map from display pixels to x and y of `Pose.position`."""
    side = max(width, height)
    return np.array(
        [
            [1 / side, 0, -(width - 1) / 2 / side],
            [0, 1 / side, -(height - 1) / 2 / side],
            [0, 0, 1],
        ]
    )


def pinhole_matrix(focal: float, size: tuple[int, int]) -> NDArray[np.float64]:
    """Return the (3, 3) camera matrix K of a focal length and a (width, height), all in pixels."""
    return np.array([[focal, 0, (size[0] - 1) / 2], [0, focal, (size[1] - 1) / 2], [0, 0, 1]])


def project(pose: Pose, width: int, height: int) -> NDArray[np.float64]:
    """Return how a pinhole camera sees the display; it keeps its zoom at every view.

    Args:
        pose: where the camera stands.
        width: width of the picture, pixels.
        height: height of the picture, pixels.

    Returns:
        ``H_captured_from_display``, (3, 3), to the usual CAPTURE_WIDTH x CAPTURE_HEIGHT pixels.
    """
    axes, side = camera_axes(pose), max(width, height)
    focal = FILL * pose.distance * min(CAPTURE_WIDTH * side / width, CAPTURE_HEIGHT * side / height)
    K = pinhole_matrix(focal, (CAPTURE_WIDTH, CAPTURE_HEIGHT))
    extrinsics = np.column_stack([axes[:, 0], axes[:, 1], -axes @ pose.position])
    H = K @ extrinsics @ plane_from_display(width, height)
    return np.asarray(H / H[2, 2])


def scene_camera(
    pose: Pose, focal: float, size: tuple[int, int], centre: tuple[float, float]
) -> NDArray[np.float64]:
    """Return the projection of a camera that sees the picture's centre at a point of its image.

    The camera stands as ``pose`` says and turns until the picture's centre falls on ``centre``.

    Args:
        pose: position and roll of the camera.
        focal: focal length in captured pixels.
        size: (width, height) of the capture.
        centre: (x, y) captured pixels.

    Returns:
        (3, 4) projection of homogeneous points in the coordinates of `Pose.position` to captured
        pixels, with a positive third coordinate for points before the camera.
    """
    K, axes = pinhole_matrix(focal, size), camera_axes(pose)
    towards = np.linalg.solve(K, np.array([*centre, 1.0]))
    towards /= np.linalg.norm(towards)
    turn, _ = cv2.Rodrigues(
        np.cross([0.0, 0.0, 1.0], towards)
        * np.arccos(towards[2])
        / max(1e-12, float(np.hypot(towards[0], towards[1])))
    )
    return np.asarray(K @ turn @ np.column_stack([axes, -axes @ pose.position]))


def residual_motion(
    jitter_px: float, breathing: float, size: tuple[int, int], rng: np.random.Generator
) -> Homography:
    """Draw the motion that registration leaves between two frames.

    It consists of a shift, a rotation and a change of distance that move the corner of the image by
    the same order, and a change of scale by focusing.

    Args:
        jitter_px: standard deviation of the shift along each axis, captured pixels.
        breathing: standard deviation of the relative change of scale by focusing.
        size: (width, height) of the capture, pixels.
        rng: source of the draw.

    Returns:
        homography from captured pixels to captured pixels.
    """
    dx, dy, turn, zoom = jitter_px * rng.standard_normal(4)
    width, height = size
    radius = np.hypot(width, height) / 2
    a, b = 1 + zoom / radius + breathing * rng.standard_normal(), turn / radius
    x, y = (width - 1) / 2, (height - 1) / 2
    return np.array([[a, -b, x - a * x + b * y + dx], [b, a, y - b * x - a * y + dy], [0, 0, 1.0]])


def image_of(
    light: Light,
    H_captured_from_display: Homography,
    blur_px: float,
    size: tuple[int, int],
    surroundings: float = SURROUNDINGS,
) -> Light:
    """Project emitted light into the captured image and blur it.

    Where the camera sees the display smaller than it is, the light is low-passed first, as pixels
    that integrate over their area do.

    Args:
        light: (H, W, 3) or (H, W) float32, linear, display pixels.
        H_captured_from_display: homography.
        blur_px: Gaussian sigma of lens and anti-alias filter, captured pixels.
        size: (width, height) of the capture.
        surroundings: linear light beside the display.

    Returns:
        (height, width, 3) float32, linear.
    """
    height, width = light.shape[:2]
    H = H_captured_from_display
    middle = np.array(
        [[width / 2, height / 2], [width / 2 + 1, height / 2], [width / 2, height / 2 + 1]]
    )
    here, right, down = cv2.perspectiveTransform(middle[None], H)[0]
    sigmas = [
        0.5 * np.sqrt(max(0.0, 1 / float(np.linalg.norm(step - here)) ** 2 - 1))
        for step in (right, down)
    ]
    if max(sigmas) > 0.1:
        light = cv2.GaussianBlur(
            light, (0, 0), sigmaX=max(sigmas[0], 0.05), sigmaY=max(sigmas[1], 0.05)
        )
    image = cv2.warpPerspective(
        light,
        H,
        size,
        flags=cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=(surroundings,) * 3,
    )
    return np.asarray(
        cv2.GaussianBlur(image, (0, 0), blur_px) if blur_px > 0.1 else image, np.float32
    )
