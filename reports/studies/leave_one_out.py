"""Must training have seen the pair? Run python -m reports.studies.leave_one_out.

For each of the nine camera-display pairs, a decoder is trained on the other eight and tested on
this one. It is compared with a decoder trained on all nine, with the same number of steps and on
the same captures.
"""

import json
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import torch
import tyro
from tqdm import trange

from data_gen.episodes import EpisodePlan, EpisodeSet, augmented_features, simulate_episodes
from data_gen.frame_pair import Source
from data_gen.pairs import PAIRS
from link.cli import read_flags, run_cli
from link.errors import at_least
from link.files.lock import locked
from link.images import make_folder, write_bytes
from link.layout import make_layout
from models.neural.checkpoint import save_checkpoint
from models.neural.config import FULL
from models.neural.decoder import PhiDecoder
from models.neural.training import training_step
from reports.engine.backends import Backend
from reports.engine.methods import Method
from reports.engine.predict import Condition, paper_cells, predict_all
from reports.engine.provenance import provenance
from reports.render.tables import Table, percent
from reports.score.paired import COUNTS, Paired, compare, tally

ALL = "all nine"
"""Name of the training that leaves no pair out."""
KAPPAS = (1, 2, 3, 5)
"""Values of κ, in gray levels, from which the training episodes draw."""
MAX_VIEW_DEG = 72.0
"""Largest view of a training episode, in degrees; views are uniform from 0 to this."""
BATCH = 256
"""Number of frame pairs in a step of the optimiser."""
LEARNING_RATE = 0.03
"""Learning rate of Adam at the start; it falls to zero on a cosine."""


@dataclass(frozen=True)
class LeaveOneOutConfig:
    """Ten trainings from constants, nine comparisons."""

    out: Path = Path("runs/leave_one_out")
    """Folder for the results; checkpoints and predictions in it are not made again."""
    episodes: int = 900
    """Number of episodes of all pairs together; a training that leaves one pair out has eight
    ninths of them."""
    steps: int = 250
    """Number of the optimiser's steps in each training."""
    frames: int = 45
    """Number of held-out frame pairs in each of a pair's four cells."""
    seed: int = 0
    """Seed of every random draw."""
    jobs: int = torch.get_num_threads()
    """Number of processes that simulate and decode."""


def main() -> None:
    """Train, decode, print."""
    config = read_flags(lambda: tyro.cli(LeaveOneOutConfig))
    at_least(len(PAIRS), episodes=config.episodes)
    at_least(1, steps=config.steps, frames=config.frames, jobs=config.jobs)
    at_least(0, seed=config.seed)
    with locked(config.out):
        _run(config)


def _run(config: LeaveOneOutConfig) -> None:
    """Train, decode, print, while no other process writes the folder."""
    layout, pairs = make_layout(), tuple(PAIRS)
    plan = EpisodePlan(config.episodes, KAPPAS, MAX_VIEW_DEG)
    missing = [n for n in (ALL, *pairs) if not (folder_of(config, n) / "config.json").is_file()]
    if missing:
        episodes = simulate_episodes(Source(layout, "train", config.seed), pairs, plan, config.jobs)
    for left_out in missing:
        module = PhiDecoder(layout, FULL)
        train_in_one_round(module, without(episodes, left_out), config, left_out)
        make_folder(folder_of(config, left_out))
        save_checkpoint(folder_of(config, left_out), module, {"left_out": left_out})
    found, rows = {}, []
    for left_out in pairs:
        methods = [
            Method("learned", (("checkpoint", folder_of(config, name)),), label)
            for name, label in ((left_out, "without"), (ALL, "with"))
        ]
        test = Source(layout, "test", config.seed)
        condition = Condition("", test, paper_cells([left_out]), config.frames)
        folder = config.out / "decoded" / left_out
        records = predict_all([condition], methods, folder, Backend(config.jobs))
        counts = tally(records, "without", "with")[COUNTS]
        found[left_out] = compare(counts.to_numpy(), np.random.default_rng(config.seed))
        rows.append(difference_row(left_out, counts, found[left_out]))
    heads = ["left out", "bits", "trained without it %", "trained on all %", "difference, points"]
    page = Table(heads, rows).markdown()
    meta = provenance(config.seed, simulated=True)
    results = {left_out: asdict(result) for left_out, result in found.items()}
    text = json.dumps({"meta": meta, "pairs": results}, indent=2)
    write_bytes(config.out / "leave_one_out.json", f"{text}\n".encode())
    write_bytes(config.out / "leave_one_out.md", f"{page}\n".encode())
    print(page)


def train_in_one_round(
    module: PhiDecoder, episodes: EpisodeSet, config: LeaveOneOutConfig, title: str
) -> None:
    """Augment the episodes once and take all steps on them, as ``train.py --rounds 1`` does.

    Args:
        module: the decoder, whose parameters are changed.
        episodes: simulated frame pairs and their messages.
        config: number of steps, and the seed of every draw.
        title: words before the progress bar.
    """
    optimiser = torch.optim.Adam(module.parameters(), lr=LEARNING_RATE)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, config.steps)
    generator = torch.Generator().manual_seed(config.seed)
    ratex, blocks = augmented_features(episodes, module.summarise, "cpu", generator)
    for _ in trange(config.steps, desc=title, unit="step"):
        index = torch.randint(len(episodes.bits), (BATCH,), generator=generator)
        training_step(module, optimiser, ratex[index], blocks[index], episodes.bits[index])
        schedule.step()


def folder_of(config: LeaveOneOutConfig, left_out: str) -> Path:
    """Return the folder of the checkpoint that was trained without this pair."""
    return config.out / "runs" / left_out.replace(" ", "_")


def without(episodes: EpisodeSet, left_out: str) -> EpisodeSet:
    """Return the episodes of all other pairs; `simulate_episodes` deals pairs out in turn."""
    names = list(PAIRS)
    keep = [k for k in range(len(episodes.bits)) if names[k % len(names)] != left_out]
    return EpisodeSet(episodes.original[keep], episodes.embedded[keep], episodes.bits[keep])


def difference_row(left_out: str, counts: pd.DataFrame, result: Paired) -> list[str]:
    """Return a row of the table.

    Args:
        left_out: name of the camera-display pair.
        counts: `COUNTS` of each frame pair, of training without this pair against training on all.
        result: comparison of the two.
    """
    total = counts.sum()
    accuracies = [percent(1 - total[name] / total["bits"]) for name in ("wrong", "reference_wrong")]
    difference = f"{result.difference:+.2f} ({result.low:+.2f} to {result.high:+.2f})"
    return [left_out, str(total["bits"]), *accuracies, difference]


if __name__ == "__main__":
    run_cli(main)
