"""How many pilots a fit needs.

Antipodal layouts whose number of pilots varies are filmed on the same held-out pictures and channel
draws of all nine camera-display pairs. More pilots calibrate better, and leave fewer blocks for the
message. Takes some minutes.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from pydantic import Field

from data_gen.channel.optics import check_view
from data_gen.frame_pair import Cell, Source
from data_gen.pairs import PAIRS
from lab.study import Results, Study, StudyFlags, Workshop
from lab.visibility.frontier_reading import read_rows
from lab.visibility.frontier_results import Positive, ReadRow
from link.embed import check_kappa
from link.errors import at_least, choose, each_once
from link.layout import Layout, count_pilots, make_layout
from reports.engine.checked import Count, Number
from reports.engine.methods import methods_for
from reports.engine.predict import Condition
from reports.render.tables import Table, TableCell, percent, share_interval

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
class PilotsFlags(StudyFlags):
    """Compare numbers of pilots by what is read."""

    kappas: tuple[int, ...] = (1, 3)
    """Gray levels by which blocks change."""
    view: float = 45.0
    """Angle of observation, in degrees from the display's normal."""
    pairs: tuple[str, ...] = tuple(PAIRS)
    """Camera-display pairs."""
    frames: int = 4
    """Number of frame pairs for each camera-display pair."""


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
class PilotsContent:
    """What was measured."""

    rows: Annotated[list[PilotRow], Field(min_length=1)]
    """One row for each grid, number of pilots and kappa."""


def check_pilots(flags: PilotsFlags) -> None:
    """Raise an `InputError` that names the first flag with a wrong value."""
    each_once(kappas=flags.kappas, pairs=flags.pairs)
    at_least(1, frames=flags.frames)
    check_view(flags.view, "view")
    for kappa in flags.kappas:
        check_kappa(kappa, "kappas")
    for pair in flags.pairs:
        choose(PAIRS, pair, "name in --pairs")


def measure_pilots(flags: PilotsFlags, workshop: Workshop) -> PilotsContent:
    """Let the methods read every grid with every number of pilots at every kappa."""
    found = []
    for (rows, cols), counts in PILOTS.items():
        for pilots in counts:
            layout = make_layout(rows, cols, modulation="antipodal", pilots=pilots)
            source = Source(layout, "test", flags.seed)
            methods = methods_for(METHODS_READ)
            for kappa in flags.kappas:
                cells = tuple(Cell(pair, flags.view, kappa) for pair in flags.pairs)
                name = f"{rows} × {cols}, {pilots} pilots, κ {kappa}"
                condition = Condition(name, source, cells, flags.frames)
                read = read_rows(workshop.predict([condition], methods), flags.seed)
                found.append(PilotRow(rows, cols, pilots, kappa, flags.view, read))
    return PilotsContent(found)


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


def pilots_blocks(results: Mapping[str, Results[PilotsContent]]) -> dict[str, str]:
    """Say what a measurement was made on, and show its table."""
    meta, rows = results["pilots"].meta, results["pilots"].content.rows
    frames = sorted({entry.frames for row in rows for entry in row.read})
    views = sorted({row.view_deg for row in rows})
    how = (
        f"Seed {meta['seed']}, {', '.join(map(str, frames))} frame pairs each at "
        f"{', '.join(f'{view:g}°' for view in views)}, antipodal blocks, simulated; 95 % intervals "
        "know that errors cluster by frame pair."
    )
    return {"hidden_pilots": f"{how}\n\n{pilots_table(rows).markdown()}"}


STUDY = Study(
    name="pilots",
    flags=PilotsFlags,
    content=PilotsContent,
    measure=measure_pilots,
    blocks=pilots_blocks,
    page=Path("docs/hidden.md"),
    check=check_pilots,
)
"""The study that `python -m lab pilots` runs."""
