"""Training episodes: simulated, rectified frame pairs as tensors."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from tqdm import tqdm, trange

from data_gen.augment import augment
from data_gen.channel.optics import check_view
from data_gen.frame_pair import Cell, FramePair, Source
from data_gen.processes import reusable_processes
from link.embed import check_kappa
from link.errors import ParameterError, each_once
from link.types import Image


@dataclass(frozen=True)
class EpisodePlan:
    """Pictures, pairs and settings from which the episodes are drawn.

    A `link.errors.ParameterError` says which of kappas and largest view is out of its range.

    >>> EpisodePlan(240, kappas=(3,), max_view=-1.0)
    Traceback (most recent call last):
    ...
    link.errors.ParameterError: max_view: need at least 0 degrees, got -1
    """

    count: int
    """Number of episodes."""
    kappas: tuple[int, ...]
    """Values of κ, in gray levels, of which each episode draws one."""
    max_view: float
    """Largest view, in degrees; the episodes' views are uniform from 0 to this."""

    def __post_init__(self) -> None:
        each_once(kappas=self.kappas)
        for kappa in self.kappas:
            check_kappa(kappa, "kappas")
        if check_view(self.max_view, "max_view") < 0:
            raise ParameterError("max_view", f"need at least 0 degrees, got {self.max_view:g}")


@dataclass(frozen=True)
class EpisodeSet:
    """N rectified frame pairs and their messages."""

    original: Tensor
    """(N, 3, H, W) uint8 original frames, encoded RGB."""
    embedded: Tensor
    """(N, 3, H, W) uint8 embedded frames, encoded RGB."""
    bits: Tensor
    """(N, n_bits) int64 message bits, 0 or 1."""

    @classmethod
    def stacked(cls, pairs: Iterable[tuple[Image, Image, NDArray[np.intp]]]) -> "EpisodeSet":
        """Stack frame pairs: (H, W, 3) original and embedded frames, and (n_bits,) bits."""
        original, embedded, bits = (
            torch.from_numpy(np.stack(part)) for part in zip(*pairs, strict=True)
        )
        return cls(original.permute(0, 3, 1, 2), embedded.permute(0, 3, 1, 2), bits)


BATCH = 8
"""Number of frame pairs that are augmented at a time."""
VARIED = {
    "drift": (0.005, 0.1),
    "jitter_px": (0.05, 0.8),
    "noise_scale": (0.2, 1.2),
    "metering": (0.0, 1.0),
    "pwm_duty": (0.7, 1.0),
}
"""Parameters of the channel that each episode draws anew, with their least and largest value. The
ranges are wider than the fitted values, because other cameras differ."""
JPEG_QUALITY = (70, 97)
"""Least and largest JPEG quality, of which each episode draws one."""


def simulate_episodes(
    source: Source, pairs: Sequence[str], plan: EpisodePlan, jobs: int
) -> EpisodeSet:
    """Simulate episodes in parallel; what is drawn depends on the source's seed and the plan alone.

    The parameters of `VARIED` are drawn uniformly, but for those that the source sets.

    Args:
        source: pictures, seed and layout, and what of the channel is set.
        pairs: names of camera-display pairs, which are dealt out in turn.
        plan: number of episodes, and what their views and kappas are drawn from.
        jobs: number of processes that simulate.
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
    sources = []
    for _ in cells:
        drawn: dict[str, Any] = {name: float(rng.uniform(*ends)) for name, ends in VARIED.items()}
        drawn["jpeg_quality"] = int(rng.integers(*JPEG_QUALITY, endpoint=True))
        sources.append(replace(source, parameters=(*drawn.items(), *source.parameters)))
    in_parallel = map if jobs == 1 else reusable_processes(jobs).map
    results = in_parallel(_rectified, sources, cells, order.tolist())
    return EpisodeSet.stacked(tqdm(results, total=len(cells), desc="simulate", unit="pair"))


@torch.no_grad()
def augmented_features(
    episodes: EpisodeSet,
    features_of: Callable[[Tensor, Tensor], tuple[Tensor, Tensor]],
    device: str,
    generator: torch.Generator,
) -> tuple[Tensor, Tensor]:
    """Augment every episode anew and keep only its features, so that frames need no memory.

    Args:
        episodes: N frame pairs.
        features_of: turns (B, 3, H, W) original and embedded frames, float32 in [0, 255], into two
            tensors whose first size is B.
        device: where frames are augmented and features computed, such as "cpu".
        generator: source of every random draw, on the CPU.

    Returns:
        both tensors of features for all N episodes, in order.
    """
    parts = []
    for start in trange(0, len(episodes.bits), BATCH, desc="augment", unit="batch", leave=False):
        batch = slice(start, start + BATCH)
        original, embedded = episodes.original[batch], episodes.embedded[batch]
        parts.append(features_of(*augment(original.to(device), embedded.to(device), generator)))
    first, second = (torch.cat(part) for part in zip(*parts, strict=True))
    return first, second


def _rectified(source: Source, cell: Cell, index: int) -> tuple[Image, Image, NDArray[np.intp]]:
    """Simulate one frame pair; give its rectified frames and its message."""
    cv2.setNumThreads(1)
    pair = FramePair(source, cell, index)
    return pair.rectified.original, pair.rectified.embedded, pair.displayed.bits
