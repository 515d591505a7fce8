"""One step of training the film decoder, on windows of film whose bits are known."""

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.functional import binary_cross_entropy_with_logits

from link.observation import Observation
from models.film.decoder import FilmDecoder
from models.film.window import film_inputs

Window = tuple[Observation, NDArray[np.integer]]
"""A window of film, and the (P, n_bits) bits of its frame pairs, 0 or 1."""
LARGEST_GRADIENT = 1.0
"""Norm to which a larger gradient is shortened: one film whose reference is off would otherwise
move all constants."""


def film_loss(module: FilmDecoder, window: Observation, bits: NDArray[np.integer]) -> Tensor:
    """Compute the mean cross-entropy of the bits of a window's inner pairs, in nats.

    The pairs at both ends are seen in part, and do not count where there are others.

    Args:
        module: the decoder.
        window: frames of the window.
        bits: (P, n_bits) bits of its frame pairs, 0 or 1.
    """
    inputs = [torch.from_numpy(values) for values in film_inputs(window).values()]
    scores = module(*inputs)[:, window.layout.message_mask]
    inner = slice(1, -1) if len(bits) > 3 else slice(None)
    sent = torch.from_numpy(np.asarray(bits, np.float32))
    return binary_cross_entropy_with_logits(scores[inner], sent[inner])


def film_step(
    module: FilmDecoder, optimiser: torch.optim.Optimizer, batch: Sequence[Window]
) -> float:
    """Move the constants that all films share towards fewer wrong bits.

    Args:
        module: the decoder, whose parameters are changed.
        optimiser: the optimiser of these parameters.
        batch: windows.

    Returns:
        the mean loss of the batch before the step, in nats.

    Raises:
        FloatingPointError: the loss is not finite; nothing was changed.
    """
    optimiser.zero_grad()
    total = 0.0
    for window, bits in batch:
        loss = film_loss(module, window, bits) / len(batch)
        if not torch.isfinite(loss):
            raise FloatingPointError("the loss is not finite")
        loss.backward()  # type: ignore[no-untyped-call]
        total += loss.item()
    torch.nn.utils.clip_grad_norm_(module.parameters(), LARGEST_GRADIENT)
    optimiser.step()
    return total
