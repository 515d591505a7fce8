"""How many pilots a fit needs, measured: python -m reports.visibility.pilots.

Antipodal layouts whose number of pilots varies are filmed on the same held-out pictures and channel
draws of all nine camera-display pairs. More pilots calibrate better, and leave fewer blocks for the
message. Writes the results and a block of docs/hidden.md; takes some minutes, and goes on where it
was cut off.
"""

import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro
from pydantic import Field

from data_gen.channel.optics import check_view
from data_gen.frame_pair import Cell, Source
from data_gen.pairs import PAIRS
from link.cli import read_flags, run_cli
from link.embed import check_kappa
from link.errors import at_least, choose, each_once
from link.layout import Layout, count_pilots, make_layout
from link.outside import read_json
from models import shipped_checkpoint
from reports.engine.checked import Count, Number, checked, write_json
from reports.engine.methods import methods_for
from reports.engine.predict import Condition, predict_all
from reports.engine.provenance import Making, commit, provenance
from reports.render.tables import Table, TableCell, percent, share_interval, write_blocks
from reports.visibility.frontier_reading import read_rows
from reports.visibility.frontier_results import Positive, ReadRow

PILOTS = {
    (8, 8): (4, 8, 16, 24, 32),
    (16, 16): (8, 16, 32, 64, 96),
    (24, 32): (10, 20, 38, 77, 154),
    (48, 64): (20, 38, 77, 154, 307),
}
"""Numbers of pilots that are compared, by the rows and columns of the grid."""
METHODS_READ = ("oorc", "learned")
"""Methods that are trained on the pilots."""


@dataclass(frozen=True)
class PilotsConfig:
    """Compare numbers of pilots by what is read."""

    kappas: tuple[int, ...] = (1, 3)
    """Gray levels by which blocks change."""
    view: float = 45.0
    """Angle of observation, in degrees from the display's normal."""
    pairs: tuple[str, ...] = tuple(PAIRS)
    """Camera-display pairs."""
    frames: int = 4
    """Number of frame pairs for each camera-display pair."""
    seed: int = 0
    """Seed of messages and channel draws."""
    jobs: int = os.cpu_count() or 1
    """Number of processes."""
    work: Path = Path("runs/pilots")
    """Folder of the predictions, from which a run that was cut off goes on."""
    page: Path = Path("docs/hidden.md")
    """Page whose block is written; pilots.json is put beside it."""


@dataclass(frozen=True)
class PilotRow:
    """What is read from a grid with some number of pilots at one kappa."""

    rows: Positive
    """Number of rows of blocks."""
    cols: Positive
    """Number of columns of blocks."""
    pilots: Annotated[int, Field(ge=2)]
    """Number of blocks that carry known bits."""
    kappa: Count
    """Number of gray levels by which blocks change."""
    view_deg: Number
    """Angle of observation, in degrees from the display's normal."""
    read: Annotated[list[ReadRow], Field(min_length=1)]
    """One row for each method, over all camera-display pairs."""

    @property
    def layout(self) -> Layout:
        """The layout that the display shows."""
        return make_layout(self.rows, self.cols, modulation="antipodal", pilots=self.pilots)


@dataclass(frozen=True)
class PilotResults:
    """Content of a pilots.json."""

    meta: dict[str, Any]
    """What produced the rows; `reports.engine.provenance.Making` at least."""
    rows: Annotated[list[PilotRow], Field(min_length=1)]
    """One row for each grid, number of pilots and kappa."""


def main() -> None:
    """Decode, store, tabulate."""
    config = read_flags(lambda: tyro.cli(PilotsConfig))
    each_once(kappas=config.kappas, pairs=config.pairs)
    at_least(1, frames=config.frames, jobs=config.jobs)
    at_least(0, seed=config.seed)
    check_view(config.view, "view")
    for kappa in config.kappas:
        check_kappa(kappa, "kappas")
    for pair in config.pairs:
        choose(PAIRS, pair, "name in --pairs")
    rows = measure(config, PILOTS)
    stored = config.page.with_name("pilots.json")
    meta = provenance(config.seed, simulated=True) | {"commit": commit()}
    write_json(stored, asdict(PilotResults(meta, rows)))
    block = pilots_block(stored)
    print(block)
    write_blocks(config.page, {"hidden_pilots": block})
    print(f"\nwritten: {config.page}, {stored}")


def measure(
    config: PilotsConfig, numbers: Mapping[tuple[int, int], Sequence[int]]
) -> list[PilotRow]:
    """Let the methods read every grid with every number of pilots at every kappa.

    Args:
        config: pairs, view, frame pairs and kappas.
        numbers: numbers of pilots by the rows and columns of the grid.

    Raises:
        InputError: a pair is unknown, or a cell failed; what was decoded is kept.
    """
    found = []
    for (rows, cols), counts in numbers.items():
        for pilots in counts:
            layout = make_layout(rows, cols, modulation="antipodal", pilots=pilots)
            source = Source(layout, "test", config.seed)
            methods = methods_for(METHODS_READ, shipped_checkpoint(layout))
            for kappa in config.kappas:
                cells = tuple(Cell(pair, config.view, kappa) for pair in config.pairs)
                name = f"{rows} × {cols}, {pilots} pilots, κ {kappa}"
                condition = Condition(name, source, cells, config.frames)
                records = predict_all([condition], methods, config.work, config.jobs)
                read = read_rows(records, config.seed)
                found.append(PilotRow(rows, cols, pilots, kappa, config.view, read))
    return found


def read_pilots(file: Path) -> PilotResults:
    """Read a pilots.json that the command wrote.

    Raises:
        InputError: the file is missing or damaged.
    """
    results = checked(PilotResults, read_json(file), str(file))
    checked(Making, results.meta, f"{file}, meta")
    return results


def pilots_table(rows: Sequence[PilotRow]) -> Table:
    """Tabulate right bits and their interval, grids and numbers of pilots by kappas and methods.

    The number that "auto" takes is marked. The last columns give the bits of information that the
    scores of `learned` carry a frame pair, in which each further pilot costs a block.
    """
    kappas = sorted({row.kappa for row in rows})
    lines: dict[tuple[int, int, int], dict[tuple[int, str], ReadRow]] = {}
    for row in rows:
        place = lines.setdefault((row.rows, row.cols, row.pilots), {})
        place |= {(row.kappa, entry.method): entry for entry in row.read}
    shown = [(kappa, method) for kappa in kappas for method in METHODS_READ]
    table: list[list[str | TableCell]] = []
    for (height, width, pilots), read in lines.items():
        auto = ", auto" if pilots == count_pilots("auto", height, width) else ""
        right = [
            TableCell(percent(entry.accuracy), share_interval(entry.ci_low, entry.ci_high))
            for entry in (read[key] for key in shown)
        ]
        free = height * width - pilots
        carried = [
            f"{free * max(0.0, read[kappa, 'learned'].information):,.0f}" for kappa in kappas
        ]
        table.append([f"{height} × {width}", f"{pilots}{auto}", *right, *carried])
    heads = [
        "grid",
        "pilots",
        *(f"{method}, κ {kappa}, right %" for kappa, method in shown),
        *(f"κ {kappa}, bits a frame pair" for kappa in kappas),
    ]
    return Table(heads, table, left=2)


def pilots_block(file: Path) -> str:
    """Say what a stored measurement was made on, and show its table.

    Args:
        file: what the command wrote.
    """
    stored = read_pilots(file)
    frames = sorted({entry.frames for row in stored.rows for entry in row.read})
    views = sorted({row.view_deg for row in stored.rows})
    how = (
        f"Seed {stored.meta['seed']}, {', '.join(map(str, frames))} frame pairs each at "
        f"{', '.join(f'{view:g}°' for view in views)}, antipodal blocks, simulated; 95 % intervals "
        "know that errors cluster by frame pair."
    )
    return f"{how}\n\n{pilots_table(stored.rows).markdown()}"


if __name__ == "__main__":
    run_cli(main)
