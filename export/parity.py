"""Parity of torch and onnxruntime on unseen frames and sizes, down to the bits.

python -m export.parity RUN --frames 1000
"""

import json
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import tyro
from tqdm import tqdm

from data_gen.dataset import Cell, Source, simulate
from data_gen.pairs import PAIRS
from export.runtime import Decoder
from link.errors import InputError, at_least, run_cli
from link.layout import MAX_SIDE_PX, MIN_BLOCK_PX, Layout
from models.neural.checkpoint import load_checkpoint
from models.neural.decoder import PhiDecoder
from models.neural.methods import run

TOLERANCE = 1e-4
"""Largest difference of a score between torch and onnxruntime."""


@dataclass(frozen=True)
class Parity:
    """What a comparison found."""

    frames: int
    bits: int
    different_bits: int
    max_difference: float
    """Largest difference of a score."""
    largest_score: float

    @property
    def holds(self) -> bool:
        """Every bit equal and every score within `TOLERANCE`."""
        return self.different_bits == 0 and self.max_difference <= TOLERANCE


def compare(module: PhiDecoder, decoder: Decoder, frames: int, seed: int) -> Parity:
    """Decode simulated captures with both, every third at a size other than the exported one."""
    pairs = list(PAIRS)
    rng = np.random.default_rng(seed)
    bits = different = 0
    worst = largest = 0.0
    module.eval()
    for index in tqdm(range(frames), desc="parity", unit="pair"):
        cell = Cell(pairs[index % len(pairs)], float(rng.integers(0, 61)), int(rng.integers(1, 11)))
        captured = simulate(Source(module.layout, seed=seed), cell, index)
        if index % 3 == 2:
            captured = replace(captured, layout=resized(module.layout, rng.uniform(0.5, 1.5)))
        pair = captured.rectified()
        ours, theirs = run(module, pair), decoder.decode(pair.original, pair.embedded)
        bits += ours.scores.size
        different += int((ours.bits != theirs.bits).sum())
        worst = max(worst, float(np.abs(ours.scores - theirs.scores).max()))
        largest = max(largest, float(np.abs(ours.scores).max()))
    return Parity(frames, bits, different, worst, largest)


def resized(layout: Layout, scale: float) -> Layout:
    """The layout over a frame of about ``scale`` times its size, within what layouts allow."""
    smallest = {"width": layout.cols * MIN_BLOCK_PX, "height": layout.rows * MIN_BLOCK_PX}
    size = {
        side: min(MAX_SIDE_PX, max(low, round(scale * getattr(layout, side))))
        for side, low in smallest.items()
    }
    return replace(layout, **size)


@dataclass(frozen=True)
class ParityConfig:
    """Compare a run's decoder.onnx with its checkpoint."""

    run: tyro.conf.Positional[Path]
    """Folder with decoder.pt, config.json and decoder.onnx."""
    frames: int = 1000
    seed: int = 1


def main() -> None:
    """Print the comparison as JSON; exit status 2 where parity fails."""
    config = tyro.cli(ParityConfig)
    at_least(1, frames=config.frames)
    at_least(0, seed=config.seed)
    module, decoder = load_checkpoint(config.run), Decoder(config.run / "decoder.onnx")
    parity = compare(module, decoder, config.frames, config.seed)
    print(json.dumps(asdict(parity)))
    if not parity.holds:
        raise InputError(f"{config.run}: torch and onnxruntime disagree; export again")


if __name__ == "__main__":
    run_cli(main)
