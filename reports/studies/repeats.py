"""What several captures of one static frame pair bring: python -m reports.studies.repeats.

Every capture has its own pose, exposure, flicker and noise. Captures are combined in two ways. Each
is decoded alone, and the log-likelihood ratios of a bit are added; or all enter one fit, in which
they share the bits.
"""

import json
import os
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import tyro

from data_gen.frame_pair import Cell, FramePair, Source
from data_gen.pairs import PAIRS
from link.cli import read_flags, run_cli
from link.errors import ParameterError, at_least, choose, each_once
from link.files.lock import locked
from link.frames import combined
from link.images import write_bytes
from link.layout import make_layout
from models import shipped_checkpoint
from models.neural.methods import Learned
from reports.engine.backends import one_thread
from reports.engine.conditions import SETTINGS, named_condition
from reports.engine.methods import Method
from reports.engine.predict import fingerprint
from reports.engine.provenance import provenance
from reports.engine.stored import resume
from reports.render.tables import Table, TableCell, percent, share_interval, write_blocks
from reports.score.intervals import wilson

MAX_CAPTURES = 256
"""Largest number of captures of one frame pair that are filmed and combined."""
LAYOUTS = {
    "ratex": make_layout(),
    "pilots": make_layout(24, 32, modulation="antipodal", pilots="auto"),
}
"""Layouts on which captures are combined, by name: the usual grid with ratex patches, and 24 x 32
antipodal blocks with pilots."""
WAYS = ("scores added", "one fit")
"""Names of the ways to combine captures, in the order of every list of results."""


@dataclass(frozen=True)
class RepeatsConfig:
    """Errors by number of captures, on simulated captures of held-out pictures."""

    conditions: tuple[str, ...] = ("kappa1", "60deg")
    """Settings of the channel, named in reports/engine/conditions.py."""
    layouts: tuple[str, ...] = tuple(LAYOUTS)
    """Layouts that are shown: "ratex" is the usual grid with patches, "pilots" 24 x 32 antipodal
    blocks."""
    captures: tuple[int, ...] = (1, 2, 4, 8)
    """Numbers of captures that are combined; the largest of them is filmed."""
    frames: int = 20
    """Number of frame pairs in each cell."""
    seed: int = 0
    """Seed of messages and channel draws."""
    checkpoint: Path | None = None
    """Folder of the trained decoder; by default the shipped one for each layout."""
    jobs: int = os.cpu_count() or 1
    """Number of processes."""
    out: Path = Path("runs/repeats")
    """Folder for the report and for what is decoded; a run that was cut off goes on from there."""
    page: Path | None = None
    """Page whose block "repeats" gets the table as well, such as docs/hidden.md."""


@dataclass(frozen=True)
class RepeatedPair:
    """A frame pair that is filmed several times, and what decodes it."""

    source: Source
    """Pictures, seed, and the channel as it is set."""
    cell: Cell
    """Camera-display pair, view and kappa."""
    index: int
    """Number of the frame pair in its cell."""
    captures: tuple[int, ...]
    """Numbers of captures that are combined; it is filmed as often as the largest says."""
    checkpoint: Path
    """Folder of the trained decoder."""


def main() -> None:
    """Film, decode, combine, print."""
    config = read_flags(lambda: tyro.cli(RepeatsConfig))
    each_once(conditions=config.conditions, layouts=config.layouts, captures=config.captures)
    at_least(1, frames=config.frames, captures=min(config.captures), jobs=config.jobs)
    at_least(0, seed=config.seed)
    if max(config.captures) > MAX_CAPTURES:
        raise ParameterError("captures", f"need at most {MAX_CAPTURES}, got {max(config.captures)}")
    for name in config.conditions:
        choose(SETTINGS, name, "condition")
    for name in config.layouts:
        choose(LAYOUTS, name, "layout")
    with locked(config.out):
        _run(config)


def _run(config: RepeatsConfig) -> None:
    """Film, decode, combine, print, while no other process writes the folder."""
    found: list[dict[str, object]] = []
    rows: list[list[str | TableCell]] = []
    for layout in config.layouts:
        for condition in config.conditions:
            bits, wrong = count_errors(layout, condition, config)
            found.append({"layout": layout, "condition": condition, "bits": bits, "wrong": wrong})
            rows += [
                [layout, condition, str(bits), way, *(error_share(each, bits) for each in counts)]
                for way, counts in wrong.items()
            ]
    numbers = [f"{number} capture{'s' * (number > 1)}" for number in config.captures]
    page = Table(["layout", "condition", "bits", "combined", *numbers], rows, left=2).markdown()
    meta = provenance(config.seed, simulated=True)
    text = json.dumps({"meta": meta, "captures": config.captures, "rows": found}, indent=2)
    write_bytes(config.out / "repeats.json", f"{text}\n".encode())
    write_bytes(config.out / "repeats.md", f"{page}\n".encode())
    if config.page:
        write_blocks(config.page, {"repeats": page})
    print(page)


def count_errors(
    layout: str, condition: str, config: RepeatsConfig
) -> tuple[int, dict[str, list[int]]]:
    """Film and decode the frame pairs of a layout under a named setting.

    Args:
        layout: a key of `LAYOUTS`.
        condition: a key of `SETTINGS`.
        config: numbers of captures and frame pairs, checkpoint, and where results are kept.

    Returns:
        the number of bits, and by each of `WAYS` the number of wrong bits for each number of
        captures.
    """
    base = Source(LAYOUTS[layout], "test", config.seed)
    filmed = named_condition(condition, base, tuple(PAIRS), config.frames)
    checkpoint = config.checkpoint or shipped_checkpoint(base.layout)
    numbers = " ".join(map(str, config.captures))
    work = {
        f"{cell.pair} {cell.view_deg:g} {cell.kappa} {index}: {numbers}": RepeatedPair(
            filmed.source, cell, index, config.captures, checkpoint
        )
        for cell in filmed.cells
        for index in range(config.frames)
    }
    learned = Method("learned", (("checkpoint", checkpoint),))
    mark = fingerprint(filmed.source, max(config.captures), learned)[:16]
    file = config.out / "decoded" / f"{condition}_{layout}_{mark}.jsonl"
    found = resume(errors_by_way, work, file, config.jobs, f"{condition}, {layout}")
    wrong = np.sum(list(found.values()), axis=0)
    return len(work) * base.layout.n_bits, dict(zip(WAYS, wrong.tolist(), strict=True))


def errors_by_way(work: RepeatedPair) -> list[list[int]]:
    """Count the wrong bits of one frame pair, by each of `WAYS` and each number of captures."""
    one_thread()
    decoder = Learned(work.checkpoint)
    bits = FramePair(work.source, work.cell, work.index).displayed.bits
    captures = []
    for number in range(max(work.captures)):
        # another seed films the same picture and message anew
        again = replace(work.source, seed=work.source.seed + number)
        filmed = FramePair(again, work.cell, work.index, message=tuple(bits))
        captures.append(filmed.rectified)
    alone = [decoder.decode(pair) for pair in captures]
    added = [combined(alone[:count]) for count in work.captures]
    fitted = [decoder.decode_together(captures[:count]) for count in work.captures]
    return [[int((soft.bits != bits).sum()) for soft in way] for way in (added, fitted)]


def error_share(wrong: int, bits: int) -> TableCell:
    """Return the share of wrong bits in per cent, with Wilson's 95 % interval over single bits."""
    return TableCell(f"{percent(wrong / bits)} %", share_interval(*wilson(wrong, bits)))


if __name__ == "__main__":
    run_cli(main)
