"""Train what the decoder shares across frames: python train.py --pair canon-lg.

Episodes come from the simulated channel. Each round warps and re-lights them anew; each step fits
every frame's head to its ratex pixels and backpropagates the message bits' cross-entropy through
that fit.
"""

import json
from dataclasses import asdict, dataclass
from pathlib import Path

import torch
import tyro
from torch.nn.functional import binary_cross_entropy_with_logits
from tqdm import tqdm

from data_gen.channel.optics import check_view
from data_gen.episodes import EpisodePlan, EpisodeSet, augmented, simulate_episodes
from data_gen.frame_pair import Source
from data_gen.pairs import PAIRS, get_pair
from export.to_onnx import export
from link.embed import check_kappa
from link.errors import InputError, at_least, run_cli
from link.images import make_folder, write_bytes
from link.layout import make_layout
from models import DECODERS
from models.neural.checkpoint import resume_state, save_checkpoint, save_state, training_settings
from models.neural.decoder import FULL, DecoderConfig, PhiDecoder
from reports.engine.predict import code_digest, decode_cells, methods_for, paper_cells
from reports.render.tables import summary_table
from reports.score.metrics import provenance, score, write_metrics

STATE = "state.pt"
DEVICES = {"cpu": lambda: True, "cuda": torch.cuda.is_available}
START_LOG_TEMPERATURE = 3.0
"""Margins are about 1 and log-likelihood ratios about 20, so training starts there."""


@dataclass(frozen=True)
class TrainConfig:
    """One pair, or all nine with --pair all."""

    pair: str = "canon-lg"
    """Camera and display, or "all"."""
    out: Path | None = None
    """Run folder; runs/PAIR where absent."""
    decoder: DecoderConfig = FULL
    episodes: int = 240
    """Simulated frame pairs of training pictures."""
    rounds: int = 4
    """Times that all episodes are augmented anew."""
    steps: int = 75
    """Optimiser steps a round."""
    batch: int = 256
    """Frame pairs a step."""
    lr: float = 0.03
    """Adam's learning rate; falls to zero on a cosine."""
    kappas: tuple[int, ...] = (1, 2, 3, 5)
    """Of the episodes."""
    max_view: float = 72.0
    """Views of the episodes are uniform from 0 to this, degrees."""
    frames: int = 15
    """Held-out frame pairs a cell in the final evaluation."""
    seed: int = 0
    jobs: int = torch.get_num_threads()
    """Processes that simulate."""
    device: str = "cuda" if torch.cuda.is_available() else "cpu"


def main() -> None:
    """Simulate, train, export, evaluate."""
    config = tyro.cli(TrainConfig)
    pairs = tuple(PAIRS) if config.pair == "all" else (get_pair(config.pair).name,)
    at_least(1, episodes=config.episodes, rounds=config.rounds, steps=config.steps)
    at_least(1, batch=config.batch, frames=config.frames, jobs=config.jobs)
    at_least(0, seed=config.seed)
    check_view(config.max_view, "--max-view")
    for kappa in config.kappas:
        check_kappa(kappa)
    if not config.kappas or config.max_view < 0 or not 0 < config.lr < 10:
        raise InputError("--kappas: name one; --max-view: 0 or more; --lr: between 0 and 10")
    if config.device not in DEVICES or not DEVICES[config.device]():
        raise InputError(f"--device: {config.device!r} is not here; choose cpu, or cuda with a GPU")
    folder = config.out or Path("runs") / config.pair
    make_folder(folder)
    layout = make_layout()
    module = PhiDecoder(layout, config.decoder).to(config.device)
    if module.refiner is None:
        torch.nn.init.constant_(module.log_temperature, START_LOG_TEMPERATURE)
    episodes = simulate_episodes(
        Source(layout, "train", config.seed),
        pairs,
        EpisodePlan(config.episodes, config.kappas, config.max_view),
        config.jobs,
    )
    train(module, episodes, config, folder)
    module.cpu()
    settings = training_settings(config)
    save_checkpoint(folder, module, {"train": settings})
    parity = export(module, folder / "decoder.onnx", folder.name, frames=30, training=settings)
    (folder / STATE).unlink(missing_ok=True)
    predictions = decode_cells(
        Source(layout, "test", config.seed),
        paper_cells(pairs),
        config.frames,
        methods_for(tuple(DECODERS), folder),
        folder / "evaluation",
        config.jobs,
    )
    rows = score(predictions)
    write_metrics(folder / "metrics.json", rows, provenance(config.seed, simulated=True))
    title = f"{config.pair}: 0° and 45°, κ 5 and 3, held-out pictures and channel draws, simulated"
    print(summary_table(rows, title))
    print(
        f"\n{folder}/decoder.onnx: torch and onnxruntime agree on all {parity.bits} bits of "
        f"{parity.frames} synthetic frame pairs, scores within {parity.max_difference:.1e}"
    )


def train(module: PhiDecoder, episodes: EpisodeSet, config: TrainConfig, folder: Path) -> None:
    """The loop; each round ends with log.jsonl and state.pt, from which a killed run goes on."""
    optimiser = torch.optim.Adam(module.parameters(), lr=config.lr)
    total = config.rounds * config.steps
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, total)
    generator = torch.Generator().manual_seed(config.seed)
    parts = {"module": module, "optimiser": optimiser, "schedule": schedule}
    ignored = ("out", "frames", "jobs", "device")
    settings = {k: v for k, v in asdict(config).items() if k not in ignored}
    key = json.dumps(settings, default=str) + code_digest()
    first, log = resume_state(folder / STATE, parts, generator, key)
    progress = tqdm(total=total, initial=first * config.steps, desc="train", unit="step")
    for number in range(first, config.rounds):
        ratex, blocks = summarise(module, episodes, config.device, generator)
        bits = episodes.bits.to(config.device)
        for step in range(number * config.steps, (number + 1) * config.steps):
            index = torch.randint(len(bits), (config.batch,), generator=generator)
            try:
                scores, _ = module.solve_and_score(ratex[index], blocks[index])
                loss = binary_cross_entropy_with_logits(scores, bits[index].float())
                finite = bool(torch.isfinite(loss))
            except torch.linalg.LinAlgError:  # type: ignore[attr-defined]
                finite = False
            if not finite:
                raise InputError(f"step {step}: the loss is not finite; lower --lr")
            optimiser.zero_grad()
            loss.backward()  # type: ignore[no-untyped-call]
            optimiser.step()
            schedule.step()
            errors = ((scores > 0) != (bits[index] > 0)).float().mean().item()
            log.append({"step": step, "loss": loss.item(), "bit_error": errors})
            progress.update()
            progress.set_postfix(loss=f"{loss.item():.4f}", errors=f"{100 * errors:.2f} %")
        save_state(folder / STATE, parts, generator, key, number + 1, log)
        lines = "".join(json.dumps(entry) + "\n" for entry in log)
        write_bytes(folder / "log.jsonl", lines.encode())


@torch.no_grad()
def summarise(
    module: PhiDecoder, episodes: EpisodeSet, device: str, generator: torch.Generator
) -> tuple[torch.Tensor, torch.Tensor]:
    """Augment every episode and reduce it to what the learned part of the decoder takes."""
    parts = [module.summarise(*batch) for batch in augmented(episodes, device, generator)]
    ratex, blocks = (torch.cat(part) for part in zip(*parts, strict=True))
    return ratex, blocks


if __name__ == "__main__":
    run_cli(main)
