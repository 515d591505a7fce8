"""The page shrinks, warps and rectifies images, and does small algebra, as Python does."""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from web_fixtures import run_node_tests, write_fixture

from export.web.tables import layout_table
from link.errors import InputError
from link.geometry import check_corners, homography_from_corners, in_image, rectify, transform
from link.layout import make_layout
from link.ratex import draw_patches, match_patches
from link.robust import geman_mcclure_weights, reweighted, ridge_solution

RNG = np.random.default_rng(0)
LAYOUT = make_layout(8, 8, 128, 96)
SQUARE = np.array([[20.0, 15.0], [140.0, 12.0], [150.0, 100.0], [18.0, 95.0]])


def photo(height: int, width: int) -> NDArray[np.uint8]:
    """Blurred noise over a slope, with the contrast of a picture."""
    noise = cv2.GaussianBlur(RNG.normal(0, 1, (height, width)), (0, 0), 1.5)
    slope = np.linspace(0, 120, width)
    return np.clip(60 + slope + 120 * noise, 0, 255).astype(np.uint8)


def sound(corners: NDArray[np.float64], outside: float) -> bool:
    try:
        check_corners(corners, (110, 160), outside)
    except InputError:
        return False
    return True


def algebra() -> dict[str, object]:
    A, b = RNG.normal(size=(8, 8)), RNG.normal(size=8)
    rows, right = RNG.normal(size=(40, 3)), RNG.normal(size=40)
    right[:5] += 30
    ridge, pull = 0.3 * np.eye(3), RNG.normal(size=3)
    solution, weights = reweighted(
        solve=lambda w: ridge_solution(rows, right, w, ridge, pull),
        residuals_of=lambda x: np.abs(right - rows @ x),
        scale_of=lambda residuals: 3 * float(np.median(residuals)),
        rounds=6,
        weights=np.ones(40),
        weigh=geman_mcclure_weights,
    )
    return {
        "A": A,
        "b": b,
        "solution": np.linalg.solve(A, b),
        "inverse": np.linalg.inv(A),
        "determinant": float(np.linalg.det(A)),
        "product": A[:3, :3] @ A[3:6, 3:6],
        "robust": {
            **{"A": rows, "b": right, "ridge": ridge, "pull": pull},
            **{"solution": solution, "weights": weights},
        },
    }


def geometry() -> dict[str, object]:
    moved = [SQUARE + np.array([30, 0]) * step for step in range(6)]
    odd = [SQUARE[::-1], SQUARE[[0, 2, 1, 3]], SQUARE / 10, np.full((4, 2), np.nan)]
    cases = [(corners, outside) for corners in (*moved, *odd) for outside in (0.0, 0.25)]
    H = homography_from_corners(SQUARE, 128, 96)
    points = RNG.uniform(-20, 140, (30, 2))
    return {
        "corners": SQUARE,
        "H": H,
        "points": points,
        "there": transform(H, points),
        "inside": in_image(points, (96, 128)),
        "cases": [[np.nan_to_num(c, nan=1e9).tolist(), outside] for c, outside in cases],
        "sound": [sound(np.nan_to_num(c, nan=1e9), outside) for c, outside in cases],
    }


def shrinking() -> list[dict[str, object]]:
    image = photo(90, 128)
    sizes = [(64, 45), (32, 30), (8, 6), (40, 31), (127, 45), (128, 90), (200, 100), (100, 180)]
    return [
        {
            "size": size,
            "bytes": cv2.resize(image, size, interpolation=cv2.INTER_AREA),
            "floats": cv2.resize(image.astype("f4"), size, interpolation=cv2.INTER_AREA),
        }
        for size in sizes
    ] + [{"image": image}]


def rectifying() -> list[dict[str, object]]:
    turned = np.roll(3 * SQUARE + 10, 1, axis=0)
    cases = [  # coarser than the display; finer than twice; turned; partly out of view
        (photo(110, 160), SQUARE, 128, 96),
        (photo(330, 480), 3 * SQUARE, 64, 48),
        (photo(330, 480), 3.8 * SQUARE - 60, 128, 96),
        (photo(330, 480), turned, 96, 128),
    ]
    found = []
    for image, corners, width, height in cases:
        H = homography_from_corners(corners, width, height)
        view = rectify(image, H, width, height)
        found.append({"image": image, "H": H, "rectified": view})
    return found


def patches() -> dict[str, object]:
    frame = np.full((96, 128), 90, np.uint8)
    draw_patches(frame, LAYOUT, 3, embedded=True)
    frame = np.clip(frame + RNG.normal(0, 30, frame.shape), 0, 255).astype(np.uint8)
    match = match_patches(frame, LAYOUT)
    return {
        "layout": layout_table(LAYOUT),
        "frame": frame,
        "captured": match.captured,
        "shown": match.shown,
        "label": match.label,
        "correlation": match.correlation,
    }


def optical_flow() -> dict[str, object]:
    """Points of an image, some of them near its border, and where OpenCV follows them."""
    first = photo(192, 256)
    H = np.array([[1.02, 0.015, -4.0], [-0.01, 0.99, 3.5], [1e-5, 0, 1]])
    second = cv2.warpPerspective(first, H, (256, 192), borderMode=cv2.BORDER_REPLICATE)
    mask = np.zeros_like(first)
    mask[30:120, 20:200] = 255
    few = cv2.goodFeaturesToTrack(first, 50, 0.05, 4, mask=mask)
    many = cv2.goodFeaturesToTrack(first, 300, 0.005, 8)
    edge = np.array([[[0.0, 0.0]], [[255.0, 100.2]], [[40.5, 190.7]], [[300.0, 10.0]]], np.float32)
    points = np.concatenate([many, edge])
    moved, status, _ = cv2.calcOpticalFlowPyrLK(
        first, second, points, points.copy(), winSize=(13, 13), maxLevel=2
    )
    guess = points + np.array([2.0, -3.0], np.float32)
    guessed, guessed_status, _ = cv2.calcOpticalFlowPyrLK(
        *(first, second, points, guess.copy()),
        winSize=(15, 15),
        maxLevel=2,
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )
    return {
        **{"first": first, "second": second, "mask": mask},
        **{"few": few[:, 0], "many": many[:, 0], "points": points[:, 0], "guess": guess[:, 0]},
        **{"moved": moved[:, 0], "status": status[:, 0]},
        **{"guessed": guessed[:, 0], "guessed_status": guessed_status[:, 0]},
    }


def test_images_are_handled_as_in_python(tmp_path: Path) -> None:
    parts = (algebra, geometry, shrinking, rectifying, patches, optical_flow)
    for part in parts:
        write_fixture(tmp_path, part.__name__, part())
    run_node_tests("image", tmp_path)
