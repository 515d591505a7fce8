"""Train what the decoder shares across frame pairs: python train.py --pair canon-lg.

Episodes come from the simulated channel. Each round warps and re-lights them anew. Each step fits
the head of every frame pair to its ratex patches or pilots, and backpropagates the cross-entropy of
the message bits through that fit.

python train.py --films trains the decoder of films (`reports.film_training`), and --regions the map
by which displays are found (`reports.region_training`); with --help they list their flags.
"""

import json
import sys
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal

import torch
import tyro
from tqdm import tqdm

from data_gen.episodes import EpisodePlan, EpisodeSet, augmented_features, simulate_episodes
from data_gen.frame_pair import Source
from data_gen.pairs import PAIRS, get_pair
from link.captures import read_manifest
from link.cli import check_flags, run_cli
from link.errors import InputError, ParameterError, at_least
from link.files.lock import locked
from link.images import write_bytes
from link.layout import Layout
from models.phi.checkpoint import resume_state, save_checkpoint, save_state, training_settings
from models.phi.config import FULL, DecoderConfig
from models.phi.decoder import PhiDecoder
from models.phi.training import (
    BATCH_BLOCKS,
    LAYOUTS,
    LayoutKind,
    Start,
    check_rate,
    initial_decoder,
    training_step,
)
from reports.captured.training_set import own_set
from reports.engine.digest import code_digest
from reports.engine.predict import recorded_conditions
from reports.engine.records import write_lines
from reports.evaluation.trained import BEFORE, export_and_evaluate, simulated_test
from reports.film_training import FilmTrainConfig, train_films
from reports.region_training import RegionTrainConfig, train_regions
from reports.run import claim_folder


@dataclass(frozen=True)
class TrainConfig:
    """Train on one pair, or on all nine with --pair all; --films, --regions train other parts."""

    pair: str = "canon-lg"
    """Camera and display, such as canon-lg, or "all"."""
    out: Path | None = None
    """Folder of the run; runs/PAIR by default. A run of the same settings goes on there if it was
    cut off, and is made again if it was finished; a folder that holds another run is refused, and
    so is one that another process is writing."""
    captures: Path | None = None
    """Train on own captures in place of simulated ones: a folder with a manifest.jsonl, such as the
    one that evaluate.py --captures makes of own recordings; a third of the recordings is held out,
    and measures the result. With --films these are windows of film."""
    layouts: LayoutKind = "ratex"
    """Layouts that the decoder learns to read: "ratex" is the usual grid with patches, "hidden" are
    grids of 8 x 8 to 96 x 128 blocks with pilots, of both modulations."""
    decoder: DecoderConfig = FULL
    """Parts that the decoder has, and their sizes."""
    start: Start = "shipped"
    """Initial parameters: "shipped" goes on from the shipped decoder, which all pairs' training
    pictures taught; "constants" wants more: --rounds 4 --steps 75 --batch 256 --lr 0.03."""
    episodes: int = 240
    """Number of simulated frame pairs, of training pictures, dealt out evenly to the layouts."""
    rounds: int = 1
    """Number of times that all episodes are augmented anew."""
    steps: int = 30
    """Number of the optimiser's steps in a round."""
    batch: int = 64
    """Number of frame pairs in a step; fewer of those with thousands of blocks."""
    lr: float = 0.01
    """Learning rate of Adam at the start; it falls to zero on a cosine."""
    kappas: tuple[int, ...] = (1, 2, 3, 5)
    """Values of κ, in gray levels, from which the episodes draw."""
    max_view: float = 72.0
    """Largest view of an episode, in degrees; views are uniform from 0 to this."""
    frames: int = 15
    """Number of held-out frame pairs in each cell of the final evaluation."""
    seed: int = 0
    """Seed of every random draw."""
    jobs: int = torch.get_num_threads()
    """Number of processes that simulate."""
    device: Literal["cpu", "cuda"] = "cuda" if torch.cuda.is_available() else "cpu"
    """Processor on which the parameters are trained."""


STATE = "state.pt"
"""Name of the file from which a training that was cut off goes on."""
UNDECISIVE = ("jobs", "device")
"""Settings in which two runs of one folder may differ, because they decide no result, but for the
rounding of another processor."""
TRAINED_BY = ("data_gen.episodes", "models.phi.training")
"""Modules that decide, with all that they import, what a step of training computes."""
LOOP_VERSION = 2
"""Version of what `train` computes; raise it when that changes, so that an older state.pt is not
continued."""


def main() -> None:
    """Simulate, train, export, evaluate."""
    if "--films" in sys.argv[1:]:
        train_films(check_flags(tyro.cli(FilmTrainConfig)))
        return
    if "--regions" in sys.argv[1:]:
        train_regions(check_flags(tyro.cli(RegionTrainConfig)))
        return
    config = check_flags(tyro.cli(TrainConfig))
    check_training(config)
    pairs = tuple(PAIRS) if config.pair == "all" else (get_pair(config.pair).name,)
    layouts = LAYOUTS[config.layouts]
    plan = EpisodePlan(config.episodes // len(layouts), config.kappas, config.max_view)
    test = simulated_test(pairs, layouts, config.frames, config.seed)
    own = None
    if config.captures is not None:
        own = own_set(config.captures, films=False, seed=config.seed)
        layouts = (own.test[0].layout,)
        test = recorded_conditions(read_manifest(config.captures), own.held_out)
    module = initial_decoder(layouts[0], config.decoder, config.start).to(config.device)
    usual = "own" if own else config.pair
    folder, settings = config.out or Path("runs") / usual, training_settings(config)
    with locked(folder):
        claim_folder(folder, settings, "train", UNDECISIVE)
        save_checkpoint(folder / BEFORE, module.cpu(), module.to_config())
        module.to(config.device)
        if own is not None:
            episodes = {layouts[0]: own.episodes()}
        else:
            sources = {layout: Source(layout, "train", config.seed) for layout in layouts}
            episodes = {
                layout: simulate_episodes(source, pairs, plan, config.jobs)
                for layout, source in sources.items()
            }
        train(module, episodes, config, folder)
        save_checkpoint(folder, module.cpu(), module.to_config() | {"train": settings})
        bench = config.captures, config.seed, config.jobs
        print(export_and_evaluate(module, test, folder, settings, *bench))
        print(f"written: {folder}/report.html")
        (folder / STATE).unlink(missing_ok=True)


def check_training(config: TrainConfig) -> None:
    """Raise a `ParameterError` that names the first flag whose value is wrong."""
    at_least(len(LAYOUTS[config.layouts]), episodes=config.episodes)
    at_least(1, rounds=config.rounds, steps=config.steps, batch=config.batch)
    at_least(1, frames=config.frames, jobs=config.jobs)
    check_rate(config.lr)
    if config.device == "cuda" and not torch.cuda.is_available():
        raise ParameterError("device", "torch finds no GPU here; choose cpu")


def train(
    module: PhiDecoder, episodes: Mapping[Layout, EpisodeSet], config: TrainConfig, folder: Path
) -> None:
    """Run the loop; each round ends with log.jsonl and state.pt, from which a killed run goes on.

    Args:
        module: the decoder, whose parameters are changed.
        episodes: a set for each layout; the layouts take their steps in turn.
        config: settings of the run.
        folder: where log.jsonl and state.pt are written.

    Raises:
        InputError: the loss is not finite, or state.pt is damaged.
    """
    optimiser = torch.optim.Adam(module.parameters(), lr=config.lr)
    total = config.rounds * config.steps
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, total)
    generator = torch.Generator().manual_seed(config.seed)
    parts = {"module": module, "optimiser": optimiser, "schedule": schedule}
    key = resume_key(config)
    first, log = resume_state(folder / STATE, parts, generator, key)
    decoders = [module.for_layout(layout) for layout in episodes]
    bits = [each.bits.to(config.device) for each in episodes.values()]
    progress = tqdm(total=total, initial=first * config.steps, desc="train", unit="step")
    for number in range(first, config.rounds):
        features = [
            augmented_features(each, decoder.summarise, config.device, generator)
            for decoder, each in zip(decoders, episodes.values(), strict=True)
        ]
        for step in range(number * config.steps, (number + 1) * config.steps):
            turn = step % len(decoders)
            decoder, (known, blocks), sent = decoders[turn], features[turn], bits[turn]
            batch = max(1, min(config.batch, BATCH_BLOCKS // decoder.layout.message_mask.size))
            index = torch.randint(len(sent), (batch,), generator=generator)
            try:
                result = training_step(decoder, optimiser, known[index], blocks[index], sent[index])
            except FloatingPointError:
                raise InputError(f"step {step}: the loss is not finite; lower --lr") from None
            schedule.step()
            log.append({"step": step, **asdict(result)})
            progress.update()
            progress.set_postfix(loss=f"{result.loss:.4f}", errors=f"{result.bit_error:.2%}")
        save_state(folder / STATE, parts, generator, key, number + 1, log)
        write_bytes(folder / "log.jsonl", write_lines(log))
    progress.close()


def resume_key(config: TrainConfig) -> str:
    """Name all that decides what training computes: settings, the loop, and the code it runs."""
    ignored = ("out", "frames", "jobs", "device")
    settings = {name: value for name, value in asdict(config).items() if name not in ignored}
    code = code_digest(*TRAINED_BY)
    return json.dumps([settings, LOOP_VERSION, code], default=str)


if __name__ == "__main__":
    run_cli(main)
