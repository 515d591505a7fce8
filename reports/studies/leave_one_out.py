"""Must training have seen the pair? Run python -m reports.studies.leave_one_out.

Trained on eight pairs and tested on the ninth, against trained on all nine, same budget, same
captures; for each of the nine.
"""

import json
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import torch
import tyro
from numpy.typing import NDArray

from data_gen.episodes import EpisodePlan, EpisodeSet, simulate_episodes
from data_gen.frame_pair import Source
from data_gen.pairs import PAIRS
from link.errors import at_least, run_cli
from link.images import make_folder, write_bytes
from link.layout import make_layout
from models.neural.checkpoint import save_checkpoint
from models.neural.decoder import FULL, PhiDecoder
from reports.engine.predict import Method, decode_cells, paper_cells
from reports.score.metrics import provenance
from reports.score.paired import Paired, compare, outcomes, tally
from train import TrainConfig, train

ALL = "all nine"


@dataclass(frozen=True)
class LeaveOneOutConfig:
    """Ten trainings, nine comparisons."""

    out: Path = Path("runs/leave_one_out")
    episodes: int = 900
    """Of all pairs together; a training that leaves one out has eight ninths of them."""
    steps: int = 250
    frames: int = 45
    """Held-out frame pairs a cell; four cells a pair."""
    seed: int = 0
    jobs: int = torch.get_num_threads()


def main() -> None:
    """Train, decode, print."""
    config = tyro.cli(LeaveOneOutConfig)
    at_least(1, episodes=config.episodes, steps=config.steps, frames=config.frames)
    at_least(1, jobs=config.jobs)
    at_least(0, seed=config.seed)
    layout, pairs = make_layout(), tuple(PAIRS)
    recipe = TrainConfig(rounds=1, steps=config.steps, seed=config.seed, device="cpu")
    plan = EpisodePlan(config.episodes, recipe.kappas, recipe.max_view)
    missing = [n for n in (ALL, *pairs) if not (folder_of(config, n) / "config.json").is_file()]
    if missing:
        episodes = simulate_episodes(Source(layout, "train", config.seed), pairs, plan, config.jobs)
    for left_out in missing:
        folder = folder_of(config, left_out)
        make_folder(folder)
        module = PhiDecoder(layout, FULL)
        train(module, without(episodes, left_out), replace(recipe, pair=left_out), folder)
        save_checkpoint(folder, module, {"left_out": left_out})
        (folder / "state.pt").unlink(missing_ok=True)
    lines = ["| left out | bits | trained without it % | trained on all % | difference, points |"]
    lines.append("|---|---:|---:|---:|---:|")
    found = {}
    for left_out in pairs:
        methods = [
            Method("learned", (("checkpoint", folder_of(config, name)),), label)
            for name, label in ((left_out, "without"), (ALL, "with"))
        ]
        predictions = decode_cells(
            Source(layout, "test", config.seed),
            paper_cells([left_out]),
            config.frames,
            methods,
            config.out / "decoded" / left_out,
            config.jobs,
        )
        _, counts = tally(outcomes(predictions), "without", "with")
        found[left_out] = compare(counts, np.random.default_rng(config.seed))
        lines.append(row(left_out, counts, found[left_out]))
    page = "\n".join(lines)
    meta = provenance(config.seed, simulated=True)
    results = {left_out: asdict(result) for left_out, result in found.items()}
    text = json.dumps({"meta": meta, "pairs": results}, indent=2)
    write_bytes(config.out / "leave_one_out.json", f"{text}\n".encode())
    write_bytes(config.out / "leave_one_out.md", f"{page}\n".encode())
    print(page)


def folder_of(config: LeaveOneOutConfig, left_out: str) -> Path:
    """Where the checkpoint trained without this pair lies."""
    return config.out / "runs" / left_out.replace(" ", "_")


def without(episodes: EpisodeSet, left_out: str) -> EpisodeSet:
    """The episodes of all other pairs; `simulate_episodes` deals pairs out in turn."""
    names = list(PAIRS)
    keep = [k for k in range(len(episodes.bits)) if names[k % len(names)] != left_out]
    return EpisodeSet(episodes.original[keep], episodes.embedded[keep], episodes.bits[keep])


def row(left_out: str, counts: NDArray[np.int64], result: Paired) -> str:
    """A line of the table; counts as of `reports.score.paired.tally`."""
    bits, errors, reference_errors, _ = counts.sum(axis=0)
    accuracies = f"{100 * (1 - errors / bits):.2f} | {100 * (1 - reference_errors / bits):.2f}"
    difference = f"{result.difference:+.2f} ({result.low:+.2f} to {result.high:+.2f})"
    return f"| {left_out} | {bits} | {accuracies} | {difference} |"


if __name__ == "__main__":
    run_cli(main)
