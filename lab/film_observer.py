"""Ask how much a film holds: an observer who knows the channel and the picture, beside the readers.

Run: python -m lab.film_observer --settings hidden faint fast

The observer sees the sensor's raw pixels before they are developed. It knows what each would be
without noise, but for the bit that it reads, and the noise of each pixel. Each film is filmed
without noise three times: as it is, with the bits of even frame pairs turned round, and with those
of odd ones. Half of the difference is what a bit does to each pixel, so that the sum of its squares
over the noise's variance tells how surely the bit can be read, and how much information that is.
"""

import json
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pandas as pd
import tyro
from numpy.typing import NDArray
from tqdm import tqdm

import data_gen.channel.composition as composition
import lab.films.trial as trial
from data_gen.channel.camera import mosaic
from data_gen.pairs import PAIRS
from export.film_graph import FilmGraph
from export.runtime import OWN_TIME_LIMIT_S, Decoder
from lab.films.rates import SETTINGS
from lab.films.trial import FilmReading, Take, film_message
from models import FILM_GRAPH
from reports.engine.backends import one_thread
from reports.score.reliability import binned_information

DRAWS = np.random.default_rng(0).standard_normal(2000)
"""Draws of a standard normal variable, over which the information of a score is averaged."""


@dataclass(frozen=True)
class Config:
    """Compare what both readers know of a film's bits with what there is to know."""

    settings: tuple[str, ...] = ("hidden", "faint", "fast")
    """Names of settings, keys of SETTINGS in lab/films/rates.py."""
    pairs: tuple[str, ...] = tuple(PAIRS)
    """Camera-display pairs."""
    views: tuple[float, ...] = (0.0, 45.0)
    """Angles between the camera and the normal of the display, degrees."""
    states: int = 60
    """Length of each film, in states of the display."""
    out: Path = Path("runs/film_observer.json")
    """File of the results."""


def raw_films(take: Take, seconds: float) -> Iterator[tuple[Any, list[Any], list[Any], Any]]:
    """Film three times without noise: yield frame, raw pixels of each film, and their variance."""
    exposures: list[Any] = []
    developed, encoded = composition.Shot.develop, trial.encode

    def keep(shot: Any, exposure: Any, rng: Any) -> NDArray[np.uint8]:
        camera, view = shot.viewpoint.pair.camera, shot.viewpoint
        raw = mosaic(exposure) if camera.bayer else exposure[:, :, 1]
        iso = view.iso if shot.iso is None else shot.iso
        read = (camera.read_noise_e * iso / camera.full_well_e) ** 2
        variance = view.noise_scale**2 * (raw * iso / camera.full_well_e + read)
        exposures.append((raw.copy(), variance))
        return np.zeros(exposure.shape, np.uint8)

    def turned(first: int) -> Any:
        def other(message: bytes, n_bits: int) -> NDArray[np.uint8]:
            bits = np.array(encoded(message, n_bits))
            if first >= 0:
                bits[first::2] ^= 1
            return bits

        return other

    composition.Shot.develop = keep  # type: ignore[method-assign]
    try:
        films = []
        for first in (-1, 0, 1):
            trial.encode = turned(first)
            films.append(film_message(take).frames)
        for frames in zip(*films, strict=True):
            if frames[0].time_s > seconds:
                return
            shots, exposures[:] = list(exposures), []
            yield frames[0], [raw for raw, _ in shots], shots[0][1]
    finally:
        composition.Shot.develop, trial.encode = developed, encoded  # type: ignore[method-assign]


def observed(take: Take, seconds: float) -> float:
    """Information that the raw pixels hold, in bits a message block and frame pair."""
    layout = take.settings.layout
    number = np.arange(layout.rows * layout.cols, dtype=np.float32).reshape(layout.rows, -1)
    blocks = cv2.resize(number, (layout.width, layout.height), interpolation=cv2.INTER_NEAREST)
    found: dict[int, NDArray[np.float64]] = defaultdict(lambda: np.zeros(number.size))
    hz, shutter = take.settings.state_hz, 1 / max(64.0, take.settings.fps)
    ends = []
    for frame, (plain, *others), variance in raw_films(take, seconds):
        size = plain.shape[1], plain.shape[0]
        where = cv2.warpPerspective(
            blocks, frame.H_captured_from_display, size, flags=cv2.INTER_NEAREST,
            borderValue=-1,
        ).astype(int)  # fmt: skip
        inside = where >= 0
        middle = (frame.display_s + shutter / 2) * hz / 2
        ends.append(middle)
        for parity, other in enumerate(others):
            power = ((plain - other) / 2)[inside] ** 2 / variance[inside]
            pair = 2 * round((middle - 0.5 - parity) / 2) + parity
            found[pair] += np.bincount(where[inside], power, number.size)
    whole = [p for p in found if min(ends) + 0.5 < p and p + 1.5 < max(ends)]
    power = np.concatenate([found[pair][layout.message_mask.ravel()] for pair in whole])
    root = np.sqrt(power)[::7, None]  # every seventh bit
    score = 2 * root**2 + 2 * root * DRAWS
    return float((1 - np.logaddexp(0, -score) / np.log(2)).mean())


def compare(setting: str, pair: str, view: float, states: int) -> dict[str, Any]:
    """Read one film by all methods."""
    settings = SETTINGS[setting]
    take, seconds = Take(settings, pair, view, 0, 0), states / settings.state_hz
    filmed, decoder = film_message(take), Decoder(take.model, 1, OWN_TIME_LIMIT_S)
    readings = {
        "pairs": FilmReading(filmed, decoder),
        "film": FilmReading(filmed, decoder, FilmGraph(FILM_GRAPH, 1)),
    }
    for frame in filmed.frames:
        if frame.time_s > seconds:
            break
        for reading in readings.values():
            reading.push(frame)
    row: dict[str, Any] = {
        "setting": setting,
        "pair": pair,
        "view": view,
        "picture": filmed.picture,
    }
    for method, reading in readings.items():
        reading.finish()
        done = reading.delivery()
        row[method] = binned_information(done.bins, done.bits) if done.bits else float("nan")
    return row | {"observer": observed(take, seconds)}


def main() -> None:
    """Print the means by setting and view, over films that both readers read."""
    config = tyro.cli(Config)
    one_thread()
    cells = [(s, p, v) for s in config.settings for v in config.views for p in config.pairs]
    rows = []
    for setting, pair, view in tqdm(cells):
        rows.append(compare(setting, pair, view, config.states))
        config.out.parent.mkdir(parents=True, exist_ok=True)
        config.out.write_text(json.dumps(rows, indent=1))
    both = pd.DataFrame(rows).dropna()
    columns = ["pairs", "film", "observer"]
    print(both.groupby(["setting", "view"])[columns].agg(["mean", "count"]).round(3).to_string())


if __name__ == "__main__":
    main()
