"""What the report shows beside the main comparison: sweeps, pictures, responses, and time."""

import contextlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter
from typing import NamedTuple

import pandas as pd

from data_gen.frame_pair import Cell, FramePair
from reports.engine.backends import Backend
from reports.engine.methods import Method
from reports.engine.predict import Condition, predict
from reports.evaluation.cost import measure_cost
from reports.evaluation.findings import REFERENCES, leaders
from reports.evaluation.response import measure_response
from reports.evaluation.stories import Place, captured_stories, simulated_stories
from reports.evaluation.sweeps import sweep_conditions, swept_methods
from reports.run import COST, RESPONSES, STORIES, SWEEPS, SWEPT, RunFolder, SweepCurve


@dataclass(frozen=True)
class Amount:
    """How much is decoded, and how much goes into a report beside the predictions."""

    frames: int
    """Largest number of frame pairs of each cell."""
    strips: int
    """Number of typical frame pairs that are shown."""
    failures: int
    """Number of badly read frame pairs that are shown."""
    response_cells: int
    """Number of cells in which responses are measured."""
    response_frames: int
    """Number of frame pairs of such a cell in which responses are measured."""
    cost_rounds: int
    """Number of times that each method is timed."""


USUAL, QUICK = Amount(10**6, 3, 8, 6, 3, 30), Amount(4, 2, 6, 2, 1, 8)
"""Amounts of a usual run, and of ``evaluate.py --quick``."""


@dataclass
class Stopwatch:
    """Seconds by what took them.

    >>> clock = Stopwatch()
    >>> with clock.time("nothing"):
    ...     pass
    >>> clock.seconds["nothing"] < 1
    True
    """

    seconds: dict[str, float] = field(default_factory=dict)
    """Seconds that were spent so far, by what took them."""

    @contextlib.contextmanager
    def time(self, name: str) -> Iterator[None]:
        """Add the time that the block takes to what was spent on ``name`` before."""
        start = perf_counter()
        yield
        self.seconds[name] = self.seconds.get(name, 0.0) + perf_counter() - start


class Swept(NamedTuple):
    """Sweeps that were decoded."""

    conditions: list[Condition]
    """The channel at each value."""
    curves: list[SweepCurve]
    """What the conditions are values of."""
    records: pd.DataFrame
    """Predictions."""
    failed: list[str]
    """One line for each cell that failed."""


@dataclass(frozen=True)
class SimulatedRun:
    """A main comparison that was decoded, and what is measured beside it for the report."""

    folder: RunFolder
    """Folder of the run; it holds the main comparison already."""
    comparison: Condition
    """The main comparison."""
    predicted: pd.DataFrame
    """Its predictions."""
    methods: Sequence[Method]
    """All methods that were compared."""
    amount: Amount
    """How much is shown."""

    def write_sweeps(self, names: Sequence[str], quick: bool, backend: Backend) -> Swept:
        """Decode sweeps, and write what they measured.

        Args:
            names: names of the sweeps, keys of `reports.evaluation.sweeps.SWEEPS`.
            quick: whether fewer values are swept.
            backend: where cells are decoded.
        """
        fewer = max(1, 2 * self.comparison.frames // 3)
        conditions, curves = sweep_conditions(names, self.comparison.source, fewer, quick)
        methods = swept_methods(self.methods)
        swept = predict(conditions, methods, self.folder.path / SWEPT, backend)
        self.folder.write(SWEEPS, curves)
        return Swept(conditions, curves, swept.records, swept.failed)

    def write_pictures(self, swept: Swept) -> None:
        """Draw typical frame pairs, and badly read ones of the comparison and of the sweeps."""
        best = leaders(self.predicted, swept.records)
        labels = {method.label for method in self.methods}
        shown = [m for m in REFERENCES[:1] if m in labels and m not in best] + best[::-1]
        equalised = [method.label for method in self.methods if method.card.equalised]
        words = {p.condition: (c.name, c.words(p.value)) for c in swept.curves for p in c.points}
        places = {
            condition.name: Place(
                condition.source, *words.get(condition.name, ("", "main comparison"))
            )
            for condition in (self.comparison, *swept.conditions)
        }
        records = pd.concat([self.predicted, swept.records], ignore_index=True)
        erred = set(records.loc[records["correct"] < records["known"], "method"])
        told = [*(m for m in best if m in erred), *sorted(erred - set(best))] or shown[:1]
        strips, failures = self.amount.strips, max(self.amount.failures, len(told))
        stories = simulated_stories(
            records, places, shown, told, equalised, self.folder.path, strips, failures
        )
        self.folder.write(STORIES, stories)

    def write_responses(self) -> None:
        """Measure what each method finds of the transfer function, where patches show it."""
        if not self.comparison.source.layout.ratex:
            return
        cells = response_cells(self.comparison.cells)[: self.amount.response_cells]
        pairs = [
            FramePair(self.comparison.source, cell, index)
            for cell in cells
            for index in range(self.amount.response_frames)
        ]
        self.folder.write(RESPONSES, [measure_response(pair, self.methods) for pair in pairs])

    def write_cost(self) -> None:
        """Measure the time that each method takes for a frame pair."""
        source, cell = self.comparison.source, self.comparison.cells[0]
        self.folder.write(COST, measure_cost(source, cell, self.amount.cost_rounds, self.methods))


def capture_evidence(
    folder: RunFolder, captures: Path, records: pd.DataFrame, amount: Amount, clock: Stopwatch
) -> None:
    """Write the pictures of a folder of captures.

    Args:
        folder: folder of the run.
        captures: folder with a manifest.
        records: predictions of these captures.
        amount: how much is shown.
        clock: gets the time.
    """
    with clock.time("pictures"):
        decoded = [str(name) for name in records["method"].unique()]
        best = leaders(records, records[:0])[:1] or decoded[-1:]
        shown = [m for m in REFERENCES if m in decoded and m not in best][:1] + best
        stories = captured_stories(
            captures, records, shown, folder.path, amount.strips, amount.failures
        )
        folder.write(STORIES, stories)


def response_cells(cells: Sequence[Cell]) -> list[Cell]:
    """Choose the cells whose responses are measured: some unlike pairs, at the largest kappa.

    >>> response_cells([Cell("canon-lg", 0.0, 3), Cell("canon-lg", 0.0, 5)])
    [Cell(pair='canon-lg', view_deg=0.0, kappa=5)]
    """
    kappa = max(cell.kappa for cell in cells)
    mine = [cell for cell in cells if cell.kappa == kappa]
    pairs = list(dict.fromkeys(cell.pair for cell in mine))
    wanted = pairs[:: max(1, len(pairs) // 3 + 1)] if len(pairs) > 3 else pairs
    return [cell for pair in wanted for cell in mine if cell.pair == pair]
