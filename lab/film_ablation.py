"""What each part of the film decoder is worth: python -m lab.film_ablation.

Receivers film test pictures, as `lab.train_film` does with training pictures, and keep windows.
Each window is then scored by the decoder that ships, and by the same with one part left out.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import pandas as pd
import torch
import tyro

from data_gen.pairs import PAIRS
from lab.films.rates import SETTINGS
from lab.films.trial import Take
from lab.study import Workshop
from lab.train_film import Recording, load_window, record
from link.cli import read_flags, run_cli
from link.files.lock import locked
from models import FILM_GRAPH
from models.neural import film
from models.neural.checkpoint import load_weights, read_config
from models.neural.film import FilmDecoder
from models.neural.patterns import Patterns
from reports.engine.backends import Backend, one_thread
from reports.score.reliability import (
    binned_information,
    calibration_error,
    confidence_bins,
    merge_bins,
)

Inputs = list[torch.Tensor]


@dataclass(frozen=True)
class AblationConfig:
    """Film, and leave out one part after the other."""

    settings: tuple[str, ...] = (
        "hidden", "hidden, 30 fps", "slow camera", "fast",
    )  # fmt: skip
    """Names of settings, keys of SETTINGS in lab/films/rates.py."""
    runs: int = 1
    """Number of films for each setting, pair and view."""
    seed: int = 1
    """Seed of every random draw."""
    jobs: int = 2
    """Number of processes that film."""
    out: Path = Path("runs/film_ablation")
    """Folder of the windows."""


def no_patterns(z: torch.Tensor) -> Patterns:
    """Give patterns that change no weight."""
    none = torch.zeros(len(z), 1)
    return Patterns(none, torch.ones(()), torch.zeros(1, 1))


def as_it_is(module: FilmDecoder, inputs: Inputs) -> torch.Tensor:
    """Score a window."""
    scores: torch.Tensor = module(*inputs)
    return scores


def with_constant(name: str, value: Any) -> Callable[[FilmDecoder, Inputs], torch.Tensor]:
    """Score with another value of a constant of the module `models.neural.film`."""

    def score(module: FilmDecoder, inputs: Inputs) -> torch.Tensor:
        with patch.object(film, name, value):
            return as_it_is(module, inputs)

    return score


def with_parameter(name: str, value: float) -> Callable[[FilmDecoder, Inputs], torch.Tensor]:
    """Score with another value of a learned number."""

    def score(module: FilmDecoder, inputs: Inputs) -> torch.Tensor:
        number = getattr(module, name)
        learned = number.clone()
        number.fill_(value)
        scores = as_it_is(module, inputs)
        number.copy_(learned)
        return scores

    return score


def untrained(_: FilmDecoder, inputs: Inputs) -> torch.Tensor:
    """Score by the constants that are written in the code."""
    return as_it_is(FilmDecoder(), inputs)


def short_reference(module: FilmDecoder, inputs: Inputs) -> torch.Tensor:
    """Score frames by eight; a pair has the sum of its scores, as its frames may be parted."""
    frames, seen, known, times, *rest = inputs
    parts = [slice(at, at + 8) for at in range(0, len(frames), 8)]
    parts = [part for part in parts if len(frames[part]) >= 4]
    return sum(
        (as_it_is(module, [frames[p], seen[p], known, times[p], *rest]) for p in parts),
        torch.zeros(()),
    )


def pure_frames(module: FilmDecoder, inputs: Inputs) -> torch.Tensor:
    """Score without the places of frames that mix states, as frame pairs leave them out."""
    frames, seen, known, times, clock, pairs, order = inputs
    x, y = film.block_places(*known.shape)
    mixture = film.mix(x, y, seen.flatten(1), times, clock, pairs, torch.ones_like(order))
    pure = (mixture.shares.abs().amax(1) >= 0.97 / 2).float().reshape(seen.shape)
    return as_it_is(module, [frames, seen * pure, known, times, clock, pairs, order])


VARIANTS = {
    "as it ships": as_it_is,
    "untrained": untrained,
    "pilots only, no rounds": with_constant("ROUNDS", 0),
    "one round": with_constant("ROUNDS", 1),
    "six rounds": with_constant("ROUNDS", 6),
    "no patterns": with_constant("find_patterns", no_patterns),
    "variance as measured at first": with_constant("LEAST_NOISE", 1.0),
    "pixels count alike": with_parameter("texture", 12.0),
    "blocks have typical noise": with_parameter("block_trust", 20.0),
    "reference of 8 frames": short_reference,
    "no mixed frames": pure_frames,
}


def main() -> None:
    """Film, score, print."""
    config = read_flags(lambda: tyro.cli(AblationConfig))
    one_thread()
    folder = config.out / "windows"
    with locked(config.out):
        folder.mkdir(parents=True, exist_ok=True)
        items = {}
        for setting in config.settings:
            film_settings = SETTINGS[setting]
            seconds = 1.4 * max(1.0, 60 / film_settings.fps)
            for run in range(config.runs):
                for view in (0.0, 45.0):
                    for pair in PAIRS:
                        take = Take(film_settings, pair, view, run, config.seed, split="test")
                        items[f"{setting} | {take.name}"] = Recording(take, seconds, folder)
        models = sorted({item.take.model for item in items.values()})
        found = Workshop(config.out, Backend(config.jobs)).each(record, items, models)
        module = FilmDecoder()
        load_weights(FILM_GRAPH.parent, read_config(FILM_GRAPH.parent), module)
        rows = []
        for key, names in found.items():
            setting = key.split(" | ")[0]
            for name in names:
                inputs, bits, mask = load_window(folder / name)
                inner = slice(1, -1) if len(bits) > 3 else slice(None)
                truth = bits[inner].numpy().astype(bool)
                for variant, score in VARIANTS.items():
                    with torch.no_grad():
                        scores = score(module, inputs)[:, mask][inner].double().numpy()
                    bins = confidence_bins(scores.ravel(), truth.ravel())
                    wrong = float(((scores > 0) != truth).mean())
                    rows.append((setting, key, variant, bins, truth.size, wrong))
        table = pd.DataFrame(rows, columns=["setting", "film", "variant", "bins", "bits", "wrong"])
        for setting, mine in table.groupby("setting", sort=False):
            print(f"\n{setting}: {mine['film'].nunique()} films")
            knew = {}
            for variant, those in mine.groupby("variant", sort=False):
                by_film = those.groupby("film")[["bins", "bits"]].apply(
                    lambda each: binned_information(merge_bins(each["bins"]), each["bits"].sum())
                )
                knew[variant] = by_film
                merged = merge_bins(those["bins"])
                wrong = np.average(those["wrong"], weights=those["bits"])
                ratio = by_film.mean() / knew["as it ships"].mean()
                print(
                    f"{variant:32} {by_film.mean():.3f} {ratio:.3f} wrong {100 * wrong:.2f} % "
                    f"calibration {calibration_error(merged):.3f}"
                )


if __name__ == "__main__":
    run_cli(main)
