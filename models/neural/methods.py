"""The torch decoder as a method: ``phi`` untrained, ``learned`` from a checkpoint."""

from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import ClassVar

import numpy as np
import torch
from numpy.typing import NDArray

from link.errors import InputError
from link.frames import Rectified, SoftBits
from link.layout import Layout
from models.neural.checkpoint import load_checkpoint
from models.neural.decoder import DecoderConfig, PhiDecoder


def as_batch(frame: NDArray[np.uint8]) -> torch.Tensor:
    """(H, W) or (H, W, 3) uint8 -> (1, 3, H, W)."""
    planes = np.repeat(frame[None], 3, axis=0) if frame.ndim == 2 else frame.transpose(2, 0, 1)
    return torch.from_numpy(np.ascontiguousarray(planes)).unsqueeze(0)


def run(module: PhiDecoder, pair: Rectified) -> SoftBits:
    """Decode one frame pair with a module of the same layout."""
    with torch.inference_mode():
        scores, head = module(as_batch(pair.original), as_batch(pair.embedded))
    return SoftBits(scores[0].double().numpy(), head[0].double().numpy())


@lru_cache(maxsize=8)
def _untrained(layout: Layout, config: DecoderConfig) -> PhiDecoder:
    return PhiDecoder(layout, config).eval()


@lru_cache(maxsize=8)
def _trained(folder: Path, layout: Layout) -> PhiDecoder:
    module = load_checkpoint(folder, layout)
    return module.eval()


@dataclass(frozen=True)
class Phi:
    """The torch decoder untrained: OORC's twin."""

    config: DecoderConfig = field(default_factory=DecoderConfig)
    """Of the graph."""
    needs_ratex: ClassVar[bool] = True

    def decode(self, pair: Rectified) -> SoftBits:
        """Score every message block; raises `UnsuitedError` without ratex patches."""
        return run(_untrained(pair.layout, self.config), pair)


@dataclass(frozen=True)
class Learned:
    """The torch decoder with what training shares across frames."""

    checkpoint: Path | None = None
    """Folder with decoder.pt and config.json, such as runs/canon-lg."""
    needs_ratex: ClassVar[bool] = True

    def decode(self, pair: Rectified) -> SoftBits:
        """Score every message block; raises `InputError` without ratex patches or checkpoint."""
        if self.checkpoint is None:
            raise InputError("learned needs a checkpoint: give --run, or train one with train.py")
        return run(_trained(self.checkpoint, pair.layout), pair)
