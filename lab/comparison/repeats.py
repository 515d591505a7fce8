"""What several captures of one static frame pair bring.

Every capture has its own pose, exposure, flicker and noise. Captures are combined in two ways. Each
is decoded alone, and the log-likelihood ratios of a bit are added; or all enter one fit, in which
they share the bits.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from data_gen.frame_pair import Cell, FramePair, Source
from data_gen.pairs import PAIRS
from lab.study import Results, Study, StudyFlags, Workshop
from link.errors import ParameterError, at_least, choose, each_once
from link.frames import combined
from link.layout import make_layout
from models import shipped_checkpoint
from models.neural.methods import Learned
from reports.engine.backends import one_thread
from reports.engine.checked import Count
from reports.engine.conditions import SETTINGS, named_condition
from reports.render.tables import Table, TableCell, percent, share_interval
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
class RepeatsFlags(StudyFlags):
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
    checkpoint: Path | None = None
    """Folder of the trained decoder; by default the shipped one for each layout."""


@dataclass(frozen=True)
class RepeatsRow:
    """Wrong bits on one layout under one setting of the channel."""

    layout: str
    """A key of `LAYOUTS`."""
    condition: str
    """A key of `reports.engine.conditions.SETTINGS`."""
    bits: Count
    """Number of bits."""
    wrong: dict[str, list[Count]]
    """Number of wrong bits for each number of captures, by each of `WAYS`."""


@dataclass(frozen=True)
class RepeatsContent:
    """What was measured."""

    captures: list[Count]
    """Numbers of captures that were combined."""
    rows: list[RepeatsRow]
    """One row for each layout and condition."""


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


def check_repeats(flags: RepeatsFlags) -> None:
    """Raise an `InputError` that names the first flag with a wrong value."""
    each_once(conditions=flags.conditions, layouts=flags.layouts, captures=flags.captures)
    at_least(1, frames=flags.frames, captures=min(flags.captures))
    if max(flags.captures) > MAX_CAPTURES:
        raise ParameterError("captures", f"need at most {MAX_CAPTURES}, got {max(flags.captures)}")
    for name in flags.conditions:
        choose(SETTINGS, name, "condition")
    for name in flags.layouts:
        choose(LAYOUTS, name, "layout")


def measure_repeats(flags: RepeatsFlags, workshop: Workshop) -> RepeatsContent:
    """Film and decode the frame pairs of every layout under every setting."""
    rows = []
    for layout in flags.layouts:
        for condition in flags.conditions:
            base = Source(LAYOUTS[layout], "test", flags.seed)
            filmed = named_condition(condition, base, tuple(PAIRS), flags.frames)
            checkpoint = flags.checkpoint or shipped_checkpoint(base.layout)
            work = {
                f"{condition} {layout} {cell.pair} {cell.view_deg:g} {cell.kappa} {index}": (
                    RepeatedPair(filmed.source, cell, index, flags.captures, checkpoint)
                )
                for cell in filmed.cells
                for index in range(flags.frames)
            }
            found = workshop.each(errors_by_way, work, [checkpoint / "decoder.pt"])
            wrong = np.sum(list(found.values()), axis=0).tolist()
            bits = len(work) * base.layout.n_bits
            rows.append(RepeatsRow(layout, condition, bits, dict(zip(WAYS, wrong, strict=True))))
    return RepeatsContent(list(flags.captures), rows)


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


def repeats_blocks(results: Mapping[str, Results[RepeatsContent]]) -> dict[str, str]:
    """Tabulate shares of wrong bits, layouts, conditions and ways by numbers of captures."""
    content = results["repeats"].content
    rows: list[list[str | TableCell]] = [
        [row.layout, row.condition, str(row.bits), way, *(error_share(w, row.bits) for w in counts)]
        for row in content.rows
        for way, counts in row.wrong.items()
    ]
    numbers = [f"{number} capture{'s' * (number > 1)}" for number in content.captures]
    table = Table(["layout", "condition", "bits", "combined", *numbers], rows, left=2)
    return {"repeats": table.markdown()}


def error_share(wrong: int, bits: int) -> TableCell:
    """Return the share of wrong bits in per cent, with Wilson's 95 % interval over single bits."""
    return TableCell(f"{percent(wrong / bits)} %", share_interval(*wilson(wrong, bits)))


STUDY = Study(
    name="repeats",
    flags=RepeatsFlags,
    content=RepeatsContent,
    measure=measure_repeats,
    blocks=repeats_blocks,
    page=Path("docs/hidden.md"),
    check=check_repeats,
)
"""The study that `python -m lab repeats` runs."""
