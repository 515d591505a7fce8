"""Train the calibration-free baseline ``cnn``: python -m reports.lab.cnn_baseline --out DIR.

The network of `models.neural.cnn` gets the captures on which the method ``learned`` is trained.
They are augmented anew in each round, as for ``learned``, and flipped besides.
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch
import tyro
from torch import Tensor
from torch.nn.functional import binary_cross_entropy_with_logits
from tqdm import tqdm

from data_gen.episodes import EpisodePlan, EpisodeSet, augmented_features, simulate_episodes
from data_gen.frame_pair import Source
from data_gen.pairs import PAIRS
from link.cli import read_flags, run_cli
from link.errors import InputError, ParameterError, at_least
from link.images import make_folder, write_bytes
from link.layout import Layout, make_layout
from models import PRETRAINED_CNN
from models.neural.checkpoint import save_checkpoint, training_settings
from models.neural.cnn import BlockNet, CnnConfig, to_cells
from reports.engine.records import write_lines


@dataclass(frozen=True)
class CnnTrainConfig:
    """Train on all nine pairs, on the episodes of ``train.py --pair all --episodes 900``."""

    out: Path = PRETRAINED_CNN
    """Folder for decoder.pt, config.json and log.jsonl."""
    cnn: CnnConfig = field(default_factory=CnnConfig)
    """Size of the network."""
    episodes: int = 900
    """Number of simulated frame pairs, of training pictures."""
    rounds: int = 6
    """Number of times that all episodes are augmented anew."""
    epochs: int = 8
    """Number of passes over all episodes in a round."""
    batch: int = 9
    """Number of frame pairs in a step of the optimiser."""
    lr: float = 3e-3
    """AdamW's learning rate at its highest: it rises in the first twentieth of the steps, then
    falls to zero on a cosine."""
    weight_decay: float = 0.05
    """Share of a weight, times the learning rate, by which AdamW shrinks it in each step."""
    strength: float = 0.2
    """Standard deviation of the log factor by which a message is made stronger or weaker."""
    drift: float = 0.02
    """Standard deviation of a further relative gain of the embedded frame."""
    kappas: tuple[int, ...] = (1, 2, 3, 5)
    """Values of κ, in gray levels, from which the episodes draw."""
    max_view: float = 72.0
    """Largest view of an episode, in degrees; views are uniform from 0 to this."""
    seed: int = 0
    """Seed of every random draw."""
    jobs: int = 1
    """Number of processes that simulate."""


def main() -> None:
    """Simulate, train, save."""
    config = read_flags(lambda: tyro.cli(CnnTrainConfig))
    at_least(1, episodes=config.episodes, rounds=config.rounds, epochs=config.epochs)
    at_least(1, batch=config.batch, jobs=config.jobs)
    at_least(0, seed=config.seed)
    if not 0 < config.lr < 1:
        raise ParameterError("lr", f"need more than 0 and less than 1, got {config.lr:g}")
    for name in ("weight_decay", "strength", "drift"):
        if not 0 <= getattr(config, name) < 1:
            raise ParameterError(
                name, f"need at least 0 and less than 1, got {getattr(config, name):g}"
            )
    plan = EpisodePlan(config.episodes, config.kappas, config.max_view)
    make_folder(config.out)
    layout = make_layout()
    source = Source(layout, "train", config.seed)
    episodes = simulate_episodes(source, tuple(PAIRS), plan, config.jobs)
    module, log = train_network(episodes, layout, config)
    save_checkpoint(config.out, module, {"train": training_settings(config)})
    write_bytes(config.out / "log.jsonl", write_lines(log))
    print(f"written: {config.out}/decoder.pt, config.json, log.jsonl")


def train_network(
    episodes: EpisodeSet, layout: Layout, config: CnnTrainConfig
) -> tuple[BlockNet, list[dict[str, float]]]:
    """Fit the network to the message bits' cross-entropy; every draw comes from the seed.

    Args:
        episodes: frame pairs and their messages.
        layout: grid of blocks and ratex patches that the frames show.
        config: budget and strengths of the training.

    Returns:
        the network, and for each epoch its mean loss and bit error.

    Raises:
        InputError: the loss is not finite.
    """
    with torch.random.fork_rng():
        torch.manual_seed(config.seed)
        module = BlockNet(config.cnn)
    generator = torch.Generator().manual_seed(config.seed)
    decayed = [p for p in module.parameters() if p.ndim > 1]
    free = [p for p in module.parameters() if p.ndim == 1]
    groups: list[dict[str, Any]] = [
        {"params": decayed},
        {"params": free, "weight_decay": 0.0},
    ]
    optimiser = torch.optim.AdamW(groups, config.lr, weight_decay=config.weight_decay)
    steps = config.rounds * config.epochs * -(-len(episodes.bits) // config.batch)
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimiser, config.lr, steps, pct_start=0.05, cycle_momentum=False
    )
    labels, mask = block_maps(episodes.bits, layout)
    log = []
    progress = tqdm(total=steps, desc="train", unit="step")
    for _ in range(config.rounds):
        cells = augmented_cells(episodes, layout, generator)
        for _ in range(config.epochs):
            losses, wrong = [], []
            order = torch.randperm(len(labels), generator=generator)
            for index in torch.split(order, config.batch):
                maps = cells[0][index], cells[1][index], labels[index]
                original, embedded, wanted, kept = vary_batch(*maps, mask, config, generator)
                logits = module.decide(original, embedded)[kept]
                loss = binary_cross_entropy_with_logits(logits, wanted[kept])
                if not torch.isfinite(loss):
                    raise InputError("the loss is not finite; lower --lr")
                optimiser.zero_grad()
                loss.backward()  # type: ignore[no-untyped-call]
                torch.nn.utils.clip_grad_norm_(module.parameters(), 1.0)
                optimiser.step()
                schedule.step()
                losses.append(loss.item())
                wrong.append(((logits > 0) != (wanted[kept] > 0)).float().mean().item())
                progress.update()
            log.append({"loss": sum(losses) / len(losses), "bit_error": sum(wrong) / len(wrong)})
            progress.set_postfix(
                loss=f"{log[-1]['loss']:.4f}", errors=f"{log[-1]['bit_error']:.2%}"
            )
    progress.close()
    return module.eval(), log


def block_maps(bits: Tensor, layout: Layout) -> tuple[Tensor, Tensor]:
    """Lay the message bits out as the blocks lie.

    Args:
        bits: (N, n_bits) message bits, 0 or 1.
        layout: grid of blocks and ratex patches.

    Returns:
        labels: (N, rows, cols) float32, 0 at ratex patches.
        mask: (rows, cols) bool, true at message blocks.
    """
    mask = torch.from_numpy(layout.message_mask)
    labels = torch.zeros(len(bits), layout.rows, layout.cols)
    labels[:, mask] = bits.float()
    return labels, mask


def augmented_cells(
    episodes: EpisodeSet, layout: Layout, generator: torch.Generator
) -> tuple[Tensor, Tensor]:
    """Augment every frame as for ``learned`` and average it over the network's cells.

    Returns:
        original and embedded frames, (N, 3, rows CELLS_Y, cols CELLS_X) each, in [0, 1].
    """

    def cells_of(original: Tensor, embedded: Tensor) -> tuple[Tensor, Tensor]:
        rows, cols = layout.rows, layout.cols
        return to_cells(original, rows, cols), to_cells(embedded, rows, cols)

    return augmented_features(episodes, cells_of, "cpu", generator)


def vary_batch(
    original: Tensor,
    embedded: Tensor,
    labels: Tensor,
    mask: Tensor,
    config: CnnTrainConfig,
    generator: torch.Generator,
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Flip a batch with its labels; vary the strength of the message and the drift.

    Args:
        original: (B, 3, H, W) cells of the original frames, in [0, 1].
        embedded: (B, 3, H, W) cells of the embedded frames, in [0, 1].
        labels: (B, rows, cols) message bits.
        mask: (rows, cols) bool, true at message blocks.
        config: how far strength and drift vary.
        generator: source of every random draw.

    Returns:
        the varied frames and labels, and the mask as (B, rows, cols).
    """
    B = len(labels)
    strength, gain = torch.randn(2, B, 1, 1, 1, generator=generator)
    change = (config.strength * strength).exp() * (embedded - original)
    embedded = (original + change) * (1 + config.drift * gain)
    kept = mask.expand_as(labels)
    for axis in (-1, -2):
        flip = torch.rand(B, generator=generator) < 0.5
        original, embedded, labels, kept = (
            torch.where(flip.reshape(-1, *[1] * (maps.ndim - 1)), maps.flip(axis), maps)
            for maps in (original, embedded, labels, kept)
        )
    return original, embedded, labels, kept


if __name__ == "__main__":
    run_cli(main)
