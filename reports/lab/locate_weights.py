"""Fit what `export.locate` weighs: python -m reports.lab.locate_weights.

Candidates are gathered on simulated photographs of training pictures (drawn rooms, and displays
pasted with flat clutter onto photographs), and on photographs without a display, where all of them
are wrong. Prints the weights that export/locate/candidates.py holds, and how far displays and their
absence lie apart.
"""

import os
from dataclasses import dataclass

import cv2
import numpy as np
import tyro
from numpy.typing import NDArray
from sklearn.linear_model import LogisticRegression
from sklearn.preprocessing import StandardScaler

from data_gen.film.scenes import SceneSettings, draw_scene, photograph
from data_gen.pairs import PAIRS, get_pair
from data_gen.pictures.library import Picture
from export.locate.candidates import gather_quadrilaterals
from export.locate.edges import FEATURES
from link.cli import read_flags, run_cli
from link.embed import embed
from link.errors import at_least
from link.geometry import frame_corners, homography_from_corners, transform
from link.layout import make_layout
from reports.engine.backends import Backend, one_thread
from reports.engine.stored import all_results
from reports.lab.locate import VIEWS, overlap, split_pictures

SIZE = (1280, 720)
"""Width and height of a simulated photograph, pixels."""
PHOTO_SIZES = (SIZE, SIZE[::-1], (1024, 768))
"""Widths and heights to which photographs without a display are cut, pixels."""
RIGHT_OVERLAP, WRONG_OVERLAP = 0.965, 0.93
"""Overlap with the truth from which a candidate is right, and up to which it is wrong."""
COLLAGES_PER_CLUTTER = 5
"""Number of pasted displays for each photograph that is made the same way without a display."""
INVERSE_RIDGE = 0.3
"""Inverse strength of the ridge penalty (scikit-learn's C), on standardised features."""


@dataclass(frozen=True)
class WeightsConfig:
    """Photographs on which the weights are fitted."""

    scenes: int = 240
    """Number of photographs in drawn rooms."""
    collages: int = 300
    """Number of pasted displays, at least 5; there are a fifth as many collages again without a
    display."""
    seed: int = 0
    """Seed of the photographs."""
    jobs: int = os.cpu_count() or 1
    """Number of processes."""


@dataclass(frozen=True)
class Collage:
    """Flat clutter on a photograph, with or without a display."""

    index: int
    """Number of the collage."""
    seed: int
    """Seed of all draws."""
    with_display: bool
    """Whether a display is pasted."""


Labelled = tuple[NDArray[np.float64], NDArray[np.float64]]
"""(N, features) of candidates, and their (N,) overlaps with the truth, 0 without a display."""


def label_candidates(image: NDArray[np.uint8], corners: NDArray[np.float64] | None) -> Labelled:
    """Gather the candidates of an image, and hold them against the true (4, 2) corners, if any."""
    quads, features, scale = gather_quadrilaterals(image)
    full = (quads + 0.5) * scale - 0.5
    return features, np.array([0.0 if corners is None else overlap(q, corners) for q in full])


def training_pictures() -> list[Picture]:
    """Load the training pictures at the size of the layout, once a process."""
    layout = make_layout()
    return split_pictures("train", layout.width, layout.height)


def label_scene(task: tuple[int, int]) -> Labelled:
    """Label the candidates of a photograph in a drawn room, whose display fills its screen.

    Args:
        task: seed and number of the photograph.
    """
    one_thread()
    rng, pictures = np.random.default_rng(task), training_pictures()
    layout = make_layout(ratex=int(rng.choice([0, 5])))
    pair = get_pair(str(rng.choice(list(PAIRS))))
    settings = SceneSettings(size=SIZE, window=False, second_display=False, pictures=pictures)
    drawn = draw_scene(layout, pair, float(rng.choice(VIEWS)), rng, settings)
    picture = pictures[int(rng.integers(len(pictures)))]
    shown = embed(picture.rgb, rng.integers(0, 2, layout.n_bits), layout, 3)
    return label_candidates(photograph(shown.original, drawn, rng), drawn.corners)


def label_collage(task: Collage) -> Labelled:
    """Label the candidates of a collage, which has no optics, but other surroundings than rooms."""
    one_thread()
    rng, pictures = np.random.default_rng([task.seed, task.index, 1]), training_pictures()
    width, height = SIZE
    backdrop = pictures[int(rng.integers(len(pictures)))].rgb
    image = cv2.resize(backdrop, SIZE).astype(np.float32)
    if rng.random() < 0.6:  # a wall, with a little texture
        image = image * rng.uniform(0.05, 0.4) + rng.uniform(10, 170, 3).astype(np.float32)
    for _ in range(int(rng.integers(2, 12))):
        turn = rng.uniform(0, 360) if rng.random() < 0.4 else rng.normal(0, 5)
        box = cv2.boxPoints((rng.uniform(0, 1, 2) * SIZE, rng.uniform(40, 380, 2), turn))
        _fill(image, box + rng.normal(0, 12, (4, 2)), rng.uniform(5, 235, 3))
    light = float(rng.choice([0.15, 0.5, 1.0, 1.3]))
    image = np.clip(image * light, 0, 255)
    corners = _pose(rng) if task.with_display else None
    if corners is not None:
        layout = make_layout(ratex=int(rng.choice([0, 5])))
        picture = pictures[int(rng.integers(len(pictures)))].rgb
        bits = rng.integers(0, 2, layout.n_bits)
        frame = embed(picture, bits, layout, 3).original.astype(np.float32)
        H = homography_from_corners(corners, layout.width, layout.height)
        margin = rng.uniform(0.008, 0.06) * layout.height
        bezel = frame_corners(layout.width, layout.height)
        bezel = bezel + margin * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
        level = float(rng.choice([3, 10, 25, 60, 200], p=[0.3, 0.35, 0.2, 0.1, 0.05]))
        _fill(image, transform(H, bezel), level * light**0.3 + rng.uniform(0, 8, 3))
        double = np.array([[2, 0, 0.5], [0, 2, 0.5], [0, 0, 1.0]]) @ H
        twice = (2 * width, 2 * height)
        mask = cv2.warpPerspective(np.ones(frame.shape[:2], np.float32), double, twice)
        shown = cv2.warpPerspective(frame * rng.uniform(0.55, 1.15), double, twice)
        mask, shown = (cv2.resize(m, SIZE, interpolation=cv2.INTER_AREA) for m in (mask, shown))
        image = image * (1 - mask[..., None]) + shown
        if rng.random() < 0.35:  # glare
            y, x = np.mgrid[:height, :width]
            at = corners.mean(axis=0) + rng.normal(0, 0.25, 2) * np.ptp(corners, axis=0)
            spread = rng.uniform(0.05, 0.2) * np.sqrt(cv2.contourArea(corners.astype(np.float32)))
            far = ((x - at[0]) ** 2 + (y - at[1]) ** 2) / (2 * spread**2)
            image += (rng.uniform(60, 220) * np.exp(-far))[..., None]
    image = cv2.GaussianBlur(image, (0, 0), rng.uniform(0.4, 1.2))
    image = image + rng.normal(0, rng.uniform(0.5, 5), image.shape)
    return label_candidates(np.clip(image, 0, 255).astype(np.uint8), corners)


def _fill(
    image: NDArray[np.float32], corners: NDArray[np.float64], colour: NDArray[np.float64]
) -> None:
    points = np.round(np.asarray(corners) * 16).astype(np.int32)
    cv2.fillConvexPoly(image, points, [float(c) for c in colour], cv2.LINE_AA, 4)


def _pose(rng: np.random.Generator) -> NDArray[np.float64]:
    """(4, 2) corners of a display at any turn, up to 55 degrees from the side."""
    size = np.array(SIZE, np.float64)
    aspect, focal = rng.choice([4 / 3, 16 / 9, 16 / 10, 9 / 16]), rng.uniform(0.8, 1.6) * size[0]
    box = np.array([[-aspect, -1, 0], [aspect, -1, 0], [aspect, 1, 0], [-aspect, 1, 0]]) / 2
    azimuth, tilt = rng.uniform(0, 2 * np.pi), np.radians(rng.uniform(0, 55))
    roll = np.radians(rng.choice([0, 90, 180, 270]) + rng.normal(0, 8))
    lean = cv2.Rodrigues(tilt * np.array([np.cos(azimuth), np.sin(azimuth), 0]))[0]
    box = box @ (lean @ cv2.Rodrigues(np.array([0, 0, roll]))[0]).T
    cover = np.exp(rng.uniform(np.log(0.05), np.log(0.6)))
    distance = 3.0
    for _ in range(60):
        seen = box + np.array([0, 0, max(distance, 1.2 * np.abs(box[:, 2]).max() + 0.05)])
        corners = focal * seen[:, :2] / seen[:, 2:]
        area = cv2.contourArea(corners.astype(np.float32)) / size.prod()
        room = size - np.ptp(corners, axis=0) - 8
        if (room < 0).any():
            cover *= 0.93
        elif abs(area / cover - 1) < 0.02:
            break
        distance *= np.sqrt(area / cover)
    room = np.maximum(room, 0)
    return np.asarray(corners - corners.min(axis=0) + 4 + rng.uniform(0, 1, 2) * room)


def label_bare(task: tuple[int, int, int]) -> Labelled:
    """Label the candidates of a photograph without a display.

    Args:
        task: width and height in pixels, and number of the picture.
    """
    one_thread()
    width, height, number = task
    return label_candidates(split_pictures("train", width, height)[number].rgb, None)


def main() -> None:
    """Fit and print."""
    config = read_flags(lambda: tyro.cli(WeightsConfig))
    at_least(1, scenes=config.scenes, jobs=config.jobs)
    at_least(COLLAGES_PER_CLUTTER, collages=config.collages)
    at_least(0, seed=config.seed)
    bare = [
        (*size, number)
        for size in PHOTO_SIZES
        for number, picture in enumerate(split_pictures("train", *size))
        if picture.name.startswith("photo/")
    ]
    seed, jobs = config.seed, config.jobs
    scenes = [(seed, index) for index in range(config.scenes)]
    collages = [Collage(index, seed, True) for index in range(config.collages)]
    clutter = [
        Collage(index, seed + 1, False) for index in range(config.collages // COLLAGES_PER_CLUTTER)
    ]
    with_display = all_results(label_scene, scenes, Backend(jobs), "rooms")
    with_display += all_results(label_collage, collages, Backend(jobs), "collages")
    without = all_results(label_collage, clutter, Backend(jobs), "clutter")
    photographed = all_results(label_bare, bare, Backend(jobs), "photographs")
    labelled = [*with_display, *without, *photographed]
    features, overlaps = (np.concatenate([some[part] for some in labelled]) for part in (0, 1))
    clear = (overlaps >= RIGHT_OVERLAP) | (overlaps <= WRONG_OVERLAP)
    scaler = StandardScaler().fit(features[clear])
    model = LogisticRegression(C=INVERSE_RIDGE, max_iter=3000)
    model.fit(scaler.transform(features[clear]), overlaps[clear] >= RIGHT_OVERLAP)
    weights = model.coef_[0] / scaler.scale_
    bias = float(model.intercept_[0] - weights @ scaler.mean_)
    print("WEIGHTS", weights.round(2).tolist(), "BIAS", round(bias, 2))
    for name, effect in zip(FEATURES, model.coef_[0], strict=True):
        print(f"{name:20} {effect:6.2f} a standard deviation")
    for name, some in (
        ("simulated displays", with_display),
        ("clutter without display", without),
        ("photographs without display", photographed),
    ):
        odds = [f @ weights + bias for f, _ in some if len(f)]
        best = [float(o.max()) for o in odds]
        levels = np.quantile(1 / (1 + np.exp(-np.array(best))), (0.02, 0.05, 0.5, 0.95, 1))
        print(f"{name}: {len(some)}, best score: 2, 5, 50, 95, 100 %: {levels.round(4).tolist()}")


if __name__ == "__main__":
    run_cli(main)
