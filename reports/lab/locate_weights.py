"""Fit what `export.locate` weighs: python -m reports.lab.locate_weights.

Candidates on simulated photographs of training pictures (drawn rooms, and displays pasted with flat
clutter onto photographs), and on photographs without a display, which are all wrong. Prints the
weights that export/locate/candidates.py holds, and how far displays and their absence lie apart.
"""

import os
from dataclasses import dataclass

import cv2
import numpy as np
import tyro
from joblib import Parallel, delayed
from numpy.typing import NDArray
from sklearn.linear_model import LogisticRegression
from sklearn.preprocessing import StandardScaler
from tqdm import tqdm

from data_gen.film.scenes import SceneSettings, draw_scene, photograph
from data_gen.pairs import PAIRS, get_pair
from data_gen.pictures.library import Picture, load_pictures
from export.locate.candidates import gather_quadrilaterals
from export.locate.edges import FEATURES
from link.embed import embed
from link.errors import at_least, run_cli
from link.geometry import frame_corners, homography_from_corners, transform
from link.layout import make_layout
from reports.lab.locate import VIEWS, overlap

SIZE = (1280, 720)
PHOTO_SIZES = (SIZE, SIZE[::-1], (1024, 768))
RIGHT, WRONG = 0.965, 0.93
"""Overlap with the truth from which a candidate is right, and up to which it is wrong."""
RIDGE = 0.3
"""scikit-learn's C, on standardised features."""


@dataclass(frozen=True)
class WeightsConfig:
    """What is fitted on."""

    scenes: int = 240
    """Photographs in drawn rooms."""
    collages: int = 300
    """Pasted displays; a fifth as many again without a display."""
    seed: int = 0
    jobs: int = os.cpu_count() or 1


Labelled = tuple[NDArray[np.float64], NDArray[np.float64]]


def labelled(image: NDArray[np.uint8], corners: NDArray[np.float64] | None) -> Labelled:
    """(N, features) and (N,) overlaps with the truth, 0 without a display."""
    quads, features, scale = gather_quadrilaterals(image)
    full = (quads + 0.5) * scale - 0.5
    return features, np.array([0.0 if corners is None else overlap(q, corners) for q in full])


def scene(index: int, seed: int, pictures: list[Picture]) -> Labelled:
    """A display that fills its screen, in a drawn room."""
    cv2.setNumThreads(1)
    rng = np.random.default_rng([seed, index])
    layout = make_layout(ratex=int(rng.choice([0, 5])))
    pair = get_pair(str(rng.choice(list(PAIRS))))
    settings = SceneSettings(size=SIZE, window=False, second_display=False, pictures=pictures)
    drawn = draw_scene(layout, pair, float(rng.choice(VIEWS)), rng, settings)
    picture = pictures[int(rng.integers(len(pictures)))]
    shown = embed(picture.rgb, rng.integers(0, 2, layout.n_bits), layout, 3)
    return labelled(photograph(shown.original, drawn, rng), drawn.corners)


def collage(index: int, seed: int, pictures: list[Picture], with_display: bool) -> Labelled:
    """Flat clutter on a photograph, and a display in a bezel: no optics, but other surroundings."""
    cv2.setNumThreads(1)
    rng = np.random.default_rng([seed, index, 1])
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
    corners = _pose(rng) if with_display else None
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
    return labelled(np.clip(image, 0, 255).astype(np.uint8), corners)


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


def nothing(picture: Picture) -> Labelled:
    """A photograph without a display."""
    cv2.setNumThreads(1)
    return labelled(picture.rgb, None)


def main() -> None:
    """Fit and print."""
    config = tyro.cli(WeightsConfig)
    at_least(1, scenes=config.scenes, collages=config.collages, jobs=config.jobs)
    at_least(0, seed=config.seed)
    layout = make_layout()
    pictures = load_pictures("train", layout.width, layout.height)
    photos = [
        picture
        for size in PHOTO_SIZES
        for picture in load_pictures("train", *size)
        if picture.name.startswith("photo/")
    ]
    seed, empty = config.seed, config.collages // 5
    work = [delayed(scene)(i, seed, pictures) for i in range(config.scenes)]
    work += [delayed(collage)(i, seed, pictures, True) for i in range(config.collages)]
    work += [delayed(collage)(i, seed + 1, pictures, False) for i in range(empty)]
    work += [delayed(nothing)(picture) for picture in photos]
    done = list(tqdm(Parallel(config.jobs, return_as="generator")(work), total=len(work)))
    features, overlaps = (np.concatenate([d[k] for d in done]) for k in (0, 1))
    clear = (overlaps >= RIGHT) | (overlaps <= WRONG)
    scaler = StandardScaler().fit(features[clear])
    model = LogisticRegression(C=RIDGE, max_iter=3000)
    model.fit(scaler.transform(features[clear]), overlaps[clear] >= RIGHT)
    weights = model.coef_[0] / scaler.scale_
    bias = float(model.intercept_[0] - weights @ scaler.mean_)
    print("WEIGHTS", weights.round(2).tolist(), "BIAS", round(bias, 2))
    for name, effect in zip(FEATURES, model.coef_[0], strict=True):
        print(f"{name:20} {effect:6.2f} a standard deviation")
    with_display = config.scenes + config.collages
    for name, some in (
        ("simulated displays", done[:with_display]),
        ("clutter without display", done[with_display : with_display + empty]),
        ("photographs without display", done[with_display + empty :]),
    ):
        odds = [f @ weights + bias for f, _ in some if len(f)]
        best = [float(o.max()) for o in odds]
        levels = np.quantile(1 / (1 + np.exp(-np.array(best))), (0.02, 0.05, 0.5, 0.95, 1))
        print(f"{name}: {len(some)}, best score: 2, 5, 50, 95, 100 %: {levels.round(4).tolist()}")


if __name__ == "__main__":
    run_cli(main)
