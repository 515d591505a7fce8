"""What several captures of one static frame pair bring: python -m reports.studies.repeats.

Each capture is decoded alone and the log-likelihood ratios of a bit are added; every capture has
its own pose, exposure, flicker and noise.
"""

import json
import os
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import tyro
from joblib import Parallel, delayed
from numpy.typing import NDArray
from tqdm import tqdm

from data_gen.frame_pair import Cell, FramePair, Source
from data_gen.pairs import PAIRS
from link.errors import at_least, choose, run_cli
from link.frames import combined
from link.images import write_bytes
from link.layout import make_layout
from models import PRETRAINED
from models.neural.methods import Learned
from reports.engine.conditions import CONDITIONS, cells, source
from reports.score.metrics import provenance, wilson


@dataclass(frozen=True)
class RepeatsConfig:
    """Errors by number of captures."""

    conditions: tuple[str, ...] = ("kappa1", "60deg")
    """Of reports/engine/conditions.py."""
    captures: tuple[int, ...] = (1, 2, 4, 8)
    """How many captures are added; the largest is filmed."""
    frames: int = 20
    """Frame pairs a cell, of held-out pictures."""
    seed: int = 0
    checkpoint: Path = PRETRAINED
    jobs: int = os.cpu_count() or 1
    out: Path = Path("runs/repeats")


def main() -> None:
    """Film, decode, add, print."""
    config = tyro.cli(RepeatsConfig)
    at_least(1, frames=config.frames, captures=min(config.captures, default=0), jobs=config.jobs)
    at_least(0, seed=config.seed)
    base = Source(make_layout(), "test", config.seed)
    lines = [f"| condition | bits | {' | '.join(f'{n} captures' for n in config.captures)} |"]
    lines.append("|---|---:|" + "---:|" * len(config.captures))
    found: dict[str, list[int]] = {}
    for name in config.conditions:
        condition = choose(CONDITIONS, name, "--conditions")
        work = [
            (cell, index)
            for cell in cells(condition, tuple(PAIRS))
            for index in range(config.frames)
        ]
        results = Parallel(n_jobs=config.jobs, return_as="generator")(
            delayed(wrong_bits)(source(condition, base), cell, index, config)
            for cell, index in work
        )
        progress = tqdm(results, total=len(work), desc=name, unit="pair")
        wrong = np.sum(list(progress), axis=0)
        bits = len(work) * base.layout.n_bits
        found[name] = [bits, *(int(count) for count in wrong)]
        lines.append(f"| {name} | {bits} | {' | '.join(percent(n, bits) for n in wrong)} |")
    page = "\n".join(lines)
    meta = provenance(config.seed, simulated=True)
    text = json.dumps({"meta": meta, "captures": config.captures, "errors": found}, indent=2)
    write_bytes(config.out / "repeats.json", f"{text}\n".encode())
    write_bytes(config.out / "repeats.md", f"{page}\n".encode())
    print(page)


def wrong_bits(base: Source, cell: Cell, index: int, config: RepeatsConfig) -> NDArray[np.int64]:
    """Wrong bits after each number of captures of one frame pair."""
    cv2.setNumThreads(1)
    decoder = Learned(config.checkpoint)
    bits = FramePair(base, cell, index).displayed.bits
    decoded = []
    for number in range(max(config.captures)):
        # another seed films the same picture and message anew
        again = replace(base, seed=base.seed + number)
        filmed = FramePair(again, cell, index, message=tuple(bits))
        decoded.append(decoder.decode(filmed.rectified))
    return np.array([(combined(decoded[:n]).bits != bits).sum() for n in config.captures])


def percent(wrong: int, bits: int) -> str:
    """Error with Wilson's 95 % interval over single bits."""
    low, high = wilson(wrong, bits)
    return f"{100 * wrong / bits:.2f} % ({100 * low:.2f} – {100 * high:.2f})"


if __name__ == "__main__":
    run_cli(main)
