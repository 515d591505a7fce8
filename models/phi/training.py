"""What every training of the decoder does: its initial values, and one step on a batch of pairs."""

from dataclasses import dataclass
from typing import Literal

import torch
from torch import Tensor
from torch.nn.functional import binary_cross_entropy_with_logits

from link.errors import ParameterError
from link.layout import Layout, make_layout
from models import shipped_checkpoint
from models.phi.checkpoint import load_checkpoint
from models.phi.config import DecoderConfig
from models.phi.decoder import START_LOG_TEMPERATURE, PhiDecoder

Start = Literal["shipped", "constants"]
LayoutKind = Literal["ratex", "hidden"]
HIDDEN_GRIDS = (
    (8, 8, "antipodal"),
    (16, 16, "antipodal"),
    (24, 32, "antipodal"),
    (48, 64, "antipodal"),
    (96, 128, "antipodal"),
    (8, 8, "on_off"),
    (24, 32, "on_off"),
)
"""Rows, columns and modulation of the layouts with pilots on which one decoder is trained."""
LAYOUTS: dict[LayoutKind, tuple[Layout, ...]] = {
    "ratex": (make_layout(),),
    "hidden": tuple(
        make_layout(rows, cols, modulation=modulation, pilots="auto")
        for rows, cols, modulation in HIDDEN_GRIDS
    ),
}
"""Layouts on which a decoder is trained, by the name that ``train.py --layouts`` takes."""
BATCH_BLOCKS = 16_384
"""Largest number of blocks in the frame pairs of one step, which bounds its memory."""


@dataclass(frozen=True)
class StepResult:
    """Loss and accuracy of the decoder on a batch, before the training step on this batch."""

    loss: float
    """Mean cross-entropy of a message bit, in nats."""
    bit_error: float
    """Share of the message bits that were decided wrongly, 0 to 1."""


def initial_decoder(layout: Layout, config: DecoderConfig, start: Start) -> PhiDecoder:
    """Build the decoder from which a training starts.

    Args:
        layout: grid of blocks and ratex patches that the frames show.
        config: which parts the decoder has.
        start: "shipped" copies the parameters of the shipped checkpoint, which were trained on the
            training pictures and training draws of all camera-display pairs. "constants" takes the
            values that are written in the code, which no picture has taught.

    Raises:
        ParameterError: the shipped parameters belong to a decoder with other parts.

    >>> from link.layout import make_layout
    >>> initial_decoder(make_layout(), DecoderConfig(), "shipped")
    Traceback (most recent call last):
    ...
    link.errors.ParameterError: start: the shipped decoder has other parts; choose constants
    """
    if start == "shipped":
        module = load_checkpoint(shipped_checkpoint(layout), layout)
        if module.config != config:
            raise ParameterError("start", "the shipped decoder has other parts; choose constants")
        return module
    module = PhiDecoder(layout, config)
    if module.refiner is None:
        torch.nn.init.constant_(module.log_temperature, START_LOG_TEMPERATURE)
    return module


def check_rate(lr: float) -> None:
    """Raise a `ParameterError` where a learning rate is out of its range."""
    if not 0 < lr < 10:
        raise ParameterError("lr", f"need more than 0 and less than 10, got {lr:g}")


def training_step(
    module: PhiDecoder,
    optimiser: torch.optim.Optimizer,
    known: Tensor,
    blocks: Tensor,
    bits: Tensor,
) -> StepResult:
    """Fit the heads of a batch and move the shared parameters towards fewer wrong bits.

    The loss is the cross-entropy of the message bits. Its gradient passes through the fit of each
    frame pair's head.

    Args:
        module: the decoder, whose parameters are changed.
        optimiser: the optimiser of these parameters.
        known: (B, N, F) float64 features of the training samples, from `PhiDecoder.summarise`.
        blocks: (B, n_bits, F) float64 features of the message blocks, from `PhiDecoder.summarise`.
        bits: (B, n_bits) message bits, 0 or 1, and -1 where one is not known, which does not count.

    Raises:
        FloatingPointError: the loss is not finite or a fit has no solution; nothing was changed.
    """
    try:
        scores, _ = module.solve_and_score(known, blocks)
    except torch.linalg.LinAlgError as error:  # type: ignore[attr-defined]
        raise FloatingPointError("a fit has no solution") from error
    counted = bits >= 0
    scores, bits = scores[counted], bits[counted]
    loss = binary_cross_entropy_with_logits(scores, bits.float())
    if not torch.isfinite(loss):
        raise FloatingPointError("the loss is not finite")
    optimiser.zero_grad()
    loss.backward()  # type: ignore[no-untyped-call]
    optimiser.step()
    return StepResult(loss.item(), ((scores > 0) != (bits > 0)).float().mean().item())
