"""What the report shows beside the main comparison: sweeps, pictures, responses, and time."""

import contextlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter

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
from reports.run import RunFolder


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


def simulated_evidence(
    folder: RunFolder,
    comparison: Condition,
    predicted: pd.DataFrame,
    methods: Sequence[Method],
    sweeps: Sequence[str],
    quick: bool,
    backend: Backend,
    clock: Stopwatch,
) -> list[str]:
    """Write sweeps, pictures, responses and time of a simulated run.

    Args:
        folder: folder of the run; it holds the main comparison already.
        comparison: the main comparison.
        predicted: predictions of the main comparison.
        methods: all methods that were compared.
        sweeps: names of the sweeps, keys of `reports.evaluation.sweeps.SWEEPS`.
        quick: whether fewer values are swept, and fewer frame pairs shown.
        backend: where the cells of sweeps are decoded.
        clock: gets the times.

    Returns:
        one line for each cell of a sweep that failed.
    """
    amount = QUICK if quick else USUAL
    fewer = max(1, 2 * comparison.frames // 3)
    swept_conditions, curves = sweep_conditions(sweeps, comparison.source, fewer, quick)
    with clock.time("sweeps"):
        swept = predict(swept_conditions, swept_methods(methods), folder.path, backend)
    folder.write_sweeps(curves, swept.records)
    with clock.time("pictures"):
        best = leaders(predicted, swept.records)
        labels = {method.label for method in methods}
        shown = [m for m in REFERENCES[:1] if m in labels and m not in best] + best[::-1]
        hidden = [method.label for method in methods if method.card.equalised]
        words = {p.condition: (c.name, c.words(p.value)) for c in curves for p in c.points}
        places = {
            condition.name: Place(
                condition.source, *words.get(condition.name, ("", "main comparison"))
            )
            for condition in (comparison, *swept_conditions)
        }
        records = pd.concat([predicted, swept.records], ignore_index=True)
        stories = simulated_stories(
            records, places, shown, best, hidden, folder.path, amount.strips, amount.failures
        )
        folder.write_stories(stories)
    with clock.time("responses"):
        if comparison.source.layout.ratex:
            cells = response_cells(comparison.cells)[: amount.response_cells]
            folder.write_responses(
                [
                    measure_response(FramePair(comparison.source, cell, index), methods)
                    for cell in cells
                    for index in range(amount.response_frames)
                ]
            )
    with clock.time("cost"):
        folder.write_cost(
            measure_cost(comparison.source, comparison.cells[0], amount.cost_rounds, methods)
        )
    return swept.failed


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
        folder.write_stories(
            captured_stories(captures, records, shown, folder.path, amount.strips, amount.failures)
        )


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
