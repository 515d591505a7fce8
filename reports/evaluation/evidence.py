"""Evidence in the report beside the main comparison: sweeps, pictures, and responses."""

from collections.abc import Sequence
from typing import Any

import pandas as pd

from data_gen.frame_pair import Cell, FramePair
from reports.engine.checked import write_json
from reports.engine.methods import Method
from reports.engine.predict import Condition
from reports.evaluation.response import measure_response
from reports.evaluation.stories import worst_stories
from reports.run import RESPONSES, STORIES, RunFolder

QUICK_FRAMES = 4
"""Largest number of frame pairs of each cell that ``evaluate.py --quick`` decodes."""
RESPONSE_CELLS, RESPONSE_FRAMES = 6, 3
"""Number of cells in which responses are measured, and of frame pairs in each of them."""


def simulated_pictures(
    folder: RunFolder, comparison: Condition, records: pd.DataFrame, methods: Sequence[Method]
) -> None:
    """Film the frame pairs that are read worst again, and write their pictures.

    Args:
        folder: folder of the run.
        comparison: the main comparison.
        records: its predictions.
        methods: all methods that were compared.
    """
    equalised = {method.label for method in methods if comparison.equalises(method)}

    def filmed_again(row: pd.Series) -> Any:
        cell = Cell(row["pair"], float(row["view_deg"]), int(row["kappa"]))
        return comparison.source.observe(cell, int(row["index"]), row["method"] in equalised)

    write_json(folder.path / STORIES, worst_stories(records, filmed_again, folder.path))


def write_responses(folder: RunFolder, comparison: Condition, methods: Sequence[Method]) -> None:
    """Measure what each method finds of the transfer function, where patches show it."""
    if not comparison.source.layout.ratex:
        return
    cells = response_cells(comparison.cells)[:RESPONSE_CELLS]
    pairs = [
        FramePair(comparison.source, cell, index)
        for cell in cells
        for index in range(min(RESPONSE_FRAMES, comparison.frames))
    ]
    write_json(folder.path / RESPONSES, [measure_response(pair, methods) for pair in pairs])


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
