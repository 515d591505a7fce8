"""What the film decoder is compared with: windows of film read without its training and rounds.

Both readers fit one linear head to the pilots of a window. Its target is the share of the bit in
each exposure, in [-1/2, 1/2], and its features are
    Phi(i_r, i_t) = [i_r^4 - i_t^4, i_r^3 - i_t^3, i_r^2 - i_t^2, i_r - i_t]
of the reference i_r, which is the mean of the window, and the frame i_t. So calibration and
decision stay one convex problem, as in the paper. The scores of a pair add up over all frames.
"""

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from export.film_graph import FilmWindow
from export.parity import film_tensors
from link.layout import block_mean
from link.types import Array
from models.film.decoder import block_places, mix
from models.paper.oorc import explicit_map
from models.phi.refine import GRAY_LEVELS

RIDGE = 1e-6
"""Weight of the head's squared norm beside the mean squared error, for features as they are."""


@dataclass(frozen=True)
class FilmBaseline:
    """A linear reader of windows of film.

    >>> oorc, linear = FilmBaseline(), FilmBaseline(degree=1, smooth=True)
    """

    degree: int = 4
    """Degree of Phi; the paper's is 4."""
    smooth: bool = False
    """Whether what changes smoothly with place and intensity is taken out of each frame, and each
    block has its own noise over time; otherwise the mean of each frame is taken out, and all blocks
    have the same noise."""

    def prepare(self) -> None:
        """Do nothing: there is nothing to load."""

    def score(self, window: FilmWindow) -> Array:
        """Score the blocks of a window.

        Returns:
            (count, rows, cols) natural log-likelihood ratios, positive for bit 1.
        """
        rows, cols = window.known.shape
        frames = window.frames[:, 0] / np.float32(GRAY_LEVELS)  # (T, h, w)
        reference = frames.mean(0)
        features = torch.stack([self._blocks(reference, frame, rows, cols) for frame in frames])
        x, y = block_places(rows, cols)
        _, seen, known, *timing = film_tensors(window)
        seen, known = seen.flatten(1), known.reshape(1, -1)
        mixture = mix(x, y, seen, *timing)
        shares = mixture.mixed(known.expand(window.count, -1))  # (T, B)
        i = torch.from_numpy(block_mean(reference[None], rows, cols)).reshape(1, -1).float()
        terms = [torch.ones_like(x)]
        if self.smooth:
            terms += [x, y, x * x, x * y, y * y, i, i * i, i**3, i * x, i * y]
        features = _without(features, torch.cat(terms), seen)
        pilots = (known[0] != 0) & (seen > 0)  # (T, B)
        X, target = features[pilots].double(), shares[pilots].double()
        moment = X.T @ X / len(X) + RIDGE * torch.eye(X.shape[1], dtype=torch.float64)
        head = torch.linalg.solve(moment, X.T @ target / max(1, len(X))).float()
        found = (features @ head) * seen
        noise = ((found - shares)[pilots] ** 2).mean()
        if self.smooth:
            power = (found**2).sum(0) / seen.sum(0).clamp_min(1)
            noise = noise * power / power[known[0] != 0].mean()
        sums = mixture.sums(mixture.shares * found.unsqueeze(1))
        scores: Array = (2 * sums / noise.clamp_min(1e-9)).reshape(-1, rows, cols).double().numpy()
        return scores

    def _blocks(self, reference: Array, frame: Array, rows: int, cols: int) -> Tensor:
        """Average Phi over the blocks of a frame: (B, degree)."""
        maps = np.moveaxis(explicit_map(reference, frame, self.degree), -1, 0)
        return torch.from_numpy(block_mean(maps, rows, cols)).flatten(1).T.float()


def _without(features: Tensor, terms: Tensor, seen: Tensor) -> Tensor:
    """Take the least-squares fit of (n, B) terms out of each frame's (T, B, D) features."""
    used = terms.unsqueeze(0) * seen.unsqueeze(1)  # (T, n, B)
    gram = used @ terms.T + RIDGE * torch.eye(len(terms))
    fitted: Tensor = terms.T @ torch.linalg.solve(gram, used @ features)
    return features - fitted
