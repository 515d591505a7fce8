"""Methods that read windows of film in torch: the film decoder, and a linear head untrained."""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
import torch

from link.frames import SoftBits
from link.observation import Observation
from models import FILM_GRAPH
from models.film.decoder import FilmDecoder
from models.film.window import film_inputs, gray_frames
from models.paper.window import block_features, decode_window, smooth_terms
from models.phi.checkpoint import load_weights, read_config
from models.phi.phi import PhiPolynomial
from models.phi.refine import GRAY_LEVELS


def load_film_decoder(folder: Path = FILM_GRAPH.parent) -> FilmDecoder:
    """Rebuild the film decoder saved in a folder.

    Raises:
        InputError: a file is missing or damaged.
    """
    module = FilmDecoder()
    load_weights(folder, read_config(folder), module)
    return module.eval()


_trained = lru_cache(maxsize=8)(load_film_decoder)


def decode_film_with(module: FilmDecoder, observation: Observation) -> SoftBits:
    """Decode a window of film with a module.

    Raises:
        UnsuitedError: the layout is none that the film decoder reads.
    """
    inputs = [torch.from_numpy(values) for values in film_inputs(observation).values()]
    with torch.inference_mode():
        scores = module(*inputs).double().numpy()
    return SoftBits(scores[:, observation.layout.message_mask].reshape(-1))


@dataclass(frozen=True)
class Film:
    """The trained film decoder (`models.film.decoder`)."""

    checkpoint: Path | None = None
    """Folder with decoder.pt and config.json; by default the shipped one."""

    def decode(self, observation: Observation) -> SoftBits:
        """Score the message blocks of all frame pairs, in natural log-likelihood ratios.

        Raises:
            InputError: a file of the checkpoint is missing or damaged.
            UnsuitedError: the layout is none that the film decoder reads.
        """
        return decode_film_with(_trained(self.checkpoint or FILM_GRAPH.parent), observation)


@dataclass(frozen=True)
class LinearFilm:
    """A linear head on Phi, fitted to the pilots of each window: the film decoder untrained.

    With ``smooth``, what changes smoothly with place and tone is taken out of each frame, and each
    block has its own noise over time. Otherwise the mean of each frame is taken out, all blocks
    have the same noise, and a degree of 4 makes it the twin of `models.paper.oorc.OORC` on films.
    """

    degree: int = 1
    """Degree of Phi."""
    smooth: bool = True
    """Whether smooth changes are taken out, and each block has its own noise."""

    def decode(self, observation: Observation) -> SoftBits:
        """Score the message blocks of all frame pairs, in natural log-likelihood ratios.

        Raises:
            UnsuitedError: the layout has no pilots.
        """
        layout = observation.layout
        frames = gray_frames(observation) / np.float32(GRAY_LEVELS)  # (T, h, w)
        reference = frames.mean(0, keepdims=True)
        maps = PhiPolynomial(self.degree)(torch.from_numpy(reference), torch.from_numpy(frames))
        features = block_features(torch.stack(maps, 1).numpy(), layout.rows, layout.cols)
        tone = block_features(reference[:, None], layout.rows, layout.cols)[0]
        terms = smooth_terms(tone.reshape(layout.rows, layout.cols))  # (B, 1) -> (rows, cols)
        return decode_window(
            observation, features, terms if self.smooth else terms[:1], self.smooth
        )
