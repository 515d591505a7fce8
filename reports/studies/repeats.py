"""What several captures of one static frame pair bring: python -m reports.studies.repeats.

Each capture is decoded alone and the log-likelihood ratios of a bit are added; every capture has
its own pose, exposure, flicker and noise.
"""

import json
import os
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import tyro

from data_gen.frame_pair import Cell, FramePair, Source
from data_gen.pairs import PAIRS
from link.errors import ParameterError, at_least, choose, each_once, read_flags, run_cli
from link.files.lock import locked
from link.frames import combined
from link.images import write_bytes
from link.layout import make_layout
from models import PRETRAINED
from models.neural.methods import Learned
from reports.engine.backends import one_thread
from reports.engine.conditions import SETTINGS, named_condition
from reports.engine.methods import Method
from reports.engine.predict import fingerprint
from reports.engine.provenance import provenance
from reports.engine.stored import resume
from reports.render.tables import Table, TableCell, percent, share_interval
from reports.score.accuracy import wilson

MAX_CAPTURES = 256
"""Largest number of captures of one frame pair that are filmed and added."""


@dataclass(frozen=True)
class RepeatsConfig:
    """Errors by number of captures, on simulated captures of held-out pictures."""

    conditions: tuple[str, ...] = ("kappa1", "60deg")
    """Settings of the channel, named in reports/engine/conditions.py."""
    captures: tuple[int, ...] = (1, 2, 4, 8)
    """Numbers of captures that are added; the largest of them is filmed."""
    frames: int = 20
    """Frame pairs a cell."""
    seed: int = 0
    """Seed of messages and channel draws."""
    checkpoint: Path = PRETRAINED
    """Folder of the trained decoder."""
    jobs: int = os.cpu_count() or 1
    """Processes."""
    out: Path = Path("runs/repeats")
    """Folder for the report and for what is decoded; a run that was cut off goes on from there."""


@dataclass(frozen=True)
class RepeatedPair:
    """A frame pair that is filmed several times, and what decodes it."""

    source: Source
    """Pictures, seed, and the channel as it is set."""
    cell: Cell
    """Camera-display pair, view and kappa."""
    index: int
    """Number of the frame pair in its cell."""
    captures: int
    """Number of times that it is filmed, at least 1."""
    checkpoint: Path
    """Folder of the trained decoder."""


def main() -> None:
    """Film, decode, add, print."""
    config = read_flags(lambda: tyro.cli(RepeatsConfig))
    each_once(conditions=config.conditions, captures=config.captures)
    at_least(1, frames=config.frames, captures=min(config.captures), jobs=config.jobs)
    at_least(0, seed=config.seed)
    if max(config.captures) > MAX_CAPTURES:
        raise ParameterError("captures", f"need at most {MAX_CAPTURES}, got {max(config.captures)}")
    for name in config.conditions:
        choose(SETTINGS, name, "condition")
    with locked(config.out):
        _run(config)


def _run(config: RepeatsConfig) -> None:
    """Film, decode, add, print, while no other process writes the folder."""
    base, most = Source(make_layout(), "test", config.seed), max(config.captures)
    conditions = [
        named_condition(name, base, tuple(PAIRS), config.frames) for name in config.conditions
    ]
    errors: dict[str, list[int]] = {}
    rows: list[list[str | TableCell]] = []
    for condition in conditions:
        work = {
            f"{cell.pair} {cell.view_deg:g} {cell.kappa} {index}": RepeatedPair(
                condition.source, cell, index, most, config.checkpoint
            )
            for cell in condition.cells
            for index in range(config.frames)
        }
        learned = Method("learned", (("checkpoint", config.checkpoint),))
        mark = fingerprint(condition.source, most, learned)[:16]
        file = config.out / "decoded" / f"{condition.name}_{mark}.jsonl"
        found = resume(errors_by_captures, work, file, config.jobs, condition.name)
        bits = len(work) * base.layout.n_bits
        wrong = np.sum(list(found.values()), axis=0)
        counts = [int(wrong[number - 1]) for number in config.captures]
        errors[condition.name] = [bits, *counts]
        rows.append([condition.name, str(bits), *(error_share(count, bits) for count in counts)])
    heads = ["condition", "bits", *(f"{number} captures" for number in config.captures)]
    page = Table(heads, rows).markdown()
    meta = provenance(config.seed, simulated=True)
    text = json.dumps({"meta": meta, "captures": config.captures, "errors": errors}, indent=2)
    write_bytes(config.out / "repeats.json", f"{text}\n".encode())
    write_bytes(config.out / "repeats.md", f"{page}\n".encode())
    print(page)


def errors_by_captures(work: RepeatedPair) -> list[int]:
    """Return the number of wrong bits after 1, 2, ... captures of one frame pair."""
    one_thread()
    decoder = Learned(work.checkpoint)
    bits = FramePair(work.source, work.cell, work.index).displayed.bits
    decoded = []
    for number in range(work.captures):
        # another seed films the same picture and message anew
        again = replace(work.source, seed=work.source.seed + number)
        filmed = FramePair(again, work.cell, work.index, message=tuple(bits))
        decoded.append(decoder.decode(filmed.rectified))
    counts = range(1, work.captures + 1)
    return [int((combined(decoded[:count]).bits != bits).sum()) for count in counts]


def error_share(wrong: int, bits: int) -> TableCell:
    """Return the share of wrong bits in per cent, with Wilson's 95 % interval over single bits."""
    return TableCell(f"{percent(wrong / bits)} %", share_interval(*wilson(wrong, bits)))


if __name__ == "__main__":
    run_cli(main)
