"""The torch decoder as a method: ``phi`` untrained, ``learned`` from a checkpoint."""

from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

import torch

from link.frames import SoftBits
from link.images import as_batch
from link.layout import Layout
from link.observation import Observation
from models import shipped_checkpoint
from models.film.methods import LinearFilm
from models.phi.checkpoint import load_checkpoint
from models.phi.config import DecoderConfig
from models.phi.decoder import PhiDecoder


def decode_with(module: PhiDecoder, pair: Observation) -> SoftBits:
    """Decode one frame pair with a module that was built for the pair's layout."""
    with torch.inference_mode():
        frames = (torch.from_numpy(as_batch(frame)) for frame in (pair.original, pair.embedded))
        scores, head = module(*frames)
    return SoftBits(scores[0].double().numpy(), head[0].double().numpy())


@lru_cache(maxsize=8)
def _untrained(layout: Layout, config: DecoderConfig) -> PhiDecoder:
    return PhiDecoder(layout, config).eval()


@lru_cache(maxsize=8)
def _trained(folder: Path, layout: Layout) -> PhiDecoder:
    return load_checkpoint(folder, layout).eval()


@dataclass(frozen=True)
class Phi:
    """The torch decoder untrained, which is the twin of `models.paper.oorc.OORC`."""

    config: DecoderConfig = field(default_factory=DecoderConfig)
    """Configuration of the decoder's graph."""

    def decode(self, observation: Observation) -> SoftBits:
        """Score every message block of a frame pair, or of all pairs of a window of film.

        Raises:
            UnsuitedError: the layout has neither ratex patches nor pilots; or it is a film, and the
                layout has no pilots.
        """
        if not observation.is_pair:
            return LinearFilm(self.config.degree, smooth=False).decode(observation)
        return decode_with(_untrained(observation.layout, self.config), observation)


@dataclass(frozen=True)
class Learned:
    """The torch decoder with the parameters that training shares across frame pairs."""

    checkpoint: Path | None = None
    """Folder with decoder.pt and config.json, such as runs/canon-lg; by default the shipped one for
    the frame pair's layout."""

    def decode(self, pair: Observation) -> SoftBits:
        """Score every message block of a frame pair, in natural log-likelihood ratios.

        Raises:
            InputError: a file of the checkpoint is missing or damaged.
            UnsuitedError: the layout has neither ratex patches nor pilots.
        """
        folder = self.checkpoint or shipped_checkpoint(pair.layout)
        return decode_with(_trained(folder, pair.layout), pair)
