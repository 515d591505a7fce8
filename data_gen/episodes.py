"""Training episodes: simulated, rectified frame pairs as tensors."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import torch
from joblib import Parallel, delayed
from numpy.typing import NDArray
from torch import Tensor
from tqdm import tqdm

from data_gen.dataset import Cell, Source, simulate


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


def simulate_episodes(
    source: Source, pairs: Sequence[str], plan: EpisodePlan, jobs: int
) -> EpisodeSet:
    """Simulate episodes in parallel; the draw depends on the source's seed and the plan alone."""
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
    results = Parallel(n_jobs=jobs, return_as="generator")(
        delayed(_rectified)(source, cell, int(index))
        for cell, index in zip(cells, order, strict=True)
    )
    done = list(tqdm(results, total=len(cells), desc="simulate", unit="pair"))
    original, embedded, bits = (
        torch.from_numpy(np.stack(part)) for part in zip(*done, strict=True)
    )
    return EpisodeSet(original.permute(0, 3, 1, 2), embedded.permute(0, 3, 1, 2), bits)


def _rectified(
    source: Source, cell: Cell, index: int
) -> tuple[NDArray[np.uint8], NDArray[np.uint8], NDArray[np.intp]]:
    cv2.setNumThreads(1)
    captured = simulate(source, cell, index)
    pair = captured.rectified()
    assert captured.bits is not None
    return pair.original, pair.embedded, captured.bits
