"""The torch decoder as a method: ``phi`` untrained, ``learned`` from a checkpoint."""

from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import ClassVar

import torch

from link.errors import InputError
from link.frames import Rectified, SoftBits
from link.images import as_batch
from link.layout import Layout
from models.neural.checkpoint import load_checkpoint
from models.neural.decoder import DecoderConfig, PhiDecoder


def run(module: PhiDecoder, pair: Rectified) -> SoftBits:
    """Decode one frame pair with a module of the same layout."""
    with torch.inference_mode():
        frames = (torch.from_numpy(as_batch(frame)) for frame in (pair.original, pair.embedded))
        scores, head = module(*frames)
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
    def decode(self, pair: Rectified) -> SoftBits:
        """Score every message block; raises `UnsuitedError` without ratex patches."""
        return run(_untrained(pair.layout, self.config), pair)


@dataclass(frozen=True)
class Learned:
    """The torch decoder with what training shares across frames."""

    checkpoint: Path | None = None
    """Folder with decoder.pt and config.json, such as runs/canon-lg."""
    def decode(self, pair: Rectified) -> SoftBits:
        """Score every message block; raises `InputError` without ratex patches or checkpoint."""
        if self.checkpoint is None:
            raise InputError("learned needs a checkpoint: give --run, or train one with train.py")
        return run(_trained(self.checkpoint, pair.layout), pair)
