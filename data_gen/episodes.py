"""Training episodes: simulated, rectified frame pairs as tensors."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
import torch
from joblib import Parallel, delayed
from numpy.typing import NDArray
from torch import Tensor
from tqdm import tqdm, trange

from data_gen.augment import augment
from data_gen.effects import EFFECTS
from data_gen.frame_pair import Cell, FramePair, Source
from link.errors import choose


@dataclass(frozen=True)
class EpisodePlan:
    """What the episodes are drawn from."""

    count: int
    kappas: tuple[int, ...]
    max_view: float
    """Views are uniform in [0, max_view] degrees."""


@dataclass(frozen=True)
class EpisodeSet:
    """N rectified frame pairs and their messages."""

    original: Tensor
    """(N, 3, H, W) uint8, encoded RGB."""
    embedded: Tensor
    """The same shape."""
    bits: Tensor
    """(N, n_bits) int64, 0 or 1."""


BATCH = 8
"""Frame pairs augmented at a time."""
VARIED = {
    "drift": (0.005, 0.1),
    "jitter_px": (0.05, 0.8),
    "noise_scale": (0.2, 1.2),
    "metering": (0.0, 1.0),
    "pwm_duty": (0.7, 1.0),
}
"""Each episode draws these anew, wider than the fitted values: other cameras differ."""
JPEG_QUALITY = (70, 97)


def simulate_episodes(
    source: Source, pairs: Sequence[str], plan: EpisodePlan, jobs: int
) -> EpisodeSet:
    """Simulate episodes in parallel; the draw depends on the source's seed and the plan alone.

    What the source sets or switches off is kept; the rest of `VARIED` is drawn uniformly.
    """
    rng = np.random.default_rng([source.seed, plan.count])
    cells = [
        Cell(
            pair=pairs[index % len(pairs)],
            view_deg=round(float(rng.uniform(0, plan.max_view)), 3),
            kappa=int(rng.choice(plan.kappas)),
        )
        for index in range(plan.count)
    ]
    order = rng.permutation(plan.count)
    absent = {name for effect in source.without for name in choose(EFFECTS, effect, "effect")}
    if "pwm_depth" in absent:
        absent.add("pwm_duty")
    sources = []
    for _ in cells:
        drawn = {name: float(rng.uniform(*bounds)) for name, bounds in VARIED.items()}
        drawn["jpeg_quality"] = int(rng.integers(*JPEG_QUALITY, endpoint=True))
        kept = {name: value for name, value in drawn.items() if name not in absent}
        kept |= dict(source.parameters)
        sources.append(replace(source, parameters=tuple(kept.items())))
    results = Parallel(n_jobs=jobs, return_as="generator")(
        delayed(_rectified)(varied, cell, int(index))
        for varied, cell, index in zip(sources, cells, order, strict=True)
    )
    done = list(tqdm(results, total=len(cells), desc="simulate", unit="pair"))
    original, embedded, bits = (
        torch.from_numpy(np.stack(part)) for part in zip(*done, strict=True)
    )
    return EpisodeSet(original.permute(0, 3, 1, 2), embedded.permute(0, 3, 1, 2), bits)


def augmented(
    episodes: EpisodeSet, device: str, generator: torch.Generator
) -> Iterator[tuple[Tensor, Tensor]]:
    """Both frames of all episodes, varied by `augment` anew, in batches on ``device``, in order."""
    for start in trange(0, len(episodes.bits), BATCH, desc="augment", unit="batch", leave=False):
        batch = slice(start, start + BATCH)
        original, embedded = episodes.original[batch], episodes.embedded[batch]
        yield augment(original.to(device), embedded.to(device), generator)


def _rectified(
    source: Source, cell: Cell, index: int
) -> tuple[NDArray[np.uint8], NDArray[np.uint8], NDArray[np.intp]]:
    cv2.setNumThreads(1)
    pair = FramePair(source, cell, index)
    return pair.rectified.original, pair.rectified.embedded, pair.displayed.bits
