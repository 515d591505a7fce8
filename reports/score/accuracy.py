"""Predictions to accuracies with intervals, as tables.

A *score table* has a row for each method in each cell of each condition, with the columns of
`SCORES`. Errors cluster by frame pair: a drifted or textured frame loses many bits at once. So a
score table also keeps the sums of squares that `clustered_interval` needs.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from link.outside import read_json
from reports.engine.checked import write_json
from reports.engine.records import CELL
from reports.score.intervals import clustered_interval, wilson
from reports.score.paper import PRINTED

SUMS = ["bits", "correct", "bits_squared", "bits_correct", "correct_squared"]
"""Columns of a score table that are sums over frame pairs, as `clustered_interval` takes them."""
SCORES = [
    "condition", "method", *CELL, "frames", *SUMS, "accuracy", "ci_low", "ci_high", "paper",
]  # fmt: skip
"""Columns of a score table; `score` says what they hold."""
STORED = SCORES[:-1]
"""Columns that metrics.json and metrics.csv have: all but the paper's numbers."""


def score(records: pd.DataFrame, *, in_paper: bool = True) -> pd.DataFrame:
    """Accuracy of each method in each cell, in order of first appearance.

    Args:
        records: predictions, as `reports.engine.records.to_records` makes them.
        in_paper: whether cells may be the paper's; those of films, and of layouts with pilots, are
            not, though a pair, view and kappa of the paper's names them.

    Returns:
        `SCORES`: ``frames`` frame pairs, ``bits`` whose truth is known, ``correct`` ones,
        ``bits_squared``, ``bits_correct`` and ``correct_squared``, the sums of their squares and
        products over the frame pairs, ``accuracy`` in [0, 1] (missing where no truth is known),
        Wilson's 95 % interval ``ci_low`` to ``ci_high`` as if bits were independent, and the
        accuracy that the ``paper`` prints for this cell, missing elsewhere.
    """
    counted = records[["condition", "method", *CELL, "known", "correct"]].copy()
    known, correct = counted["known"], counted["correct"]
    squares = {"nn": known * known, "nc": known * correct, "cc": correct * correct}
    counted = counted.assign(**squares)
    groups = counted.groupby(["condition", "method", *CELL], sort=False, dropna=False)
    table = groups.agg(
        frames=("correct", "size"),
        bits=("known", "sum"),
        correct=("correct", "sum"),
        bits_squared=("nn", "sum"),
        bits_correct=("nc", "sum"),
        correct_squared=("cc", "sum"),
    ).reset_index()
    table["accuracy"] = (table["correct"] / table["bits"].where(table["bits"] > 0)).astype(float)
    intervals = [wilson(*row) for row in zip(table["correct"], table["bits"], strict=True)]
    table[["ci_low", "ci_high"]] = np.reshape(intervals, (-1, 2))
    table["paper"] = _printed(table) if in_paper else float("nan")
    return table[SCORES]


def pool(scores: pd.DataFrame, by: Sequence[str] = ("method",)) -> pd.DataFrame:
    """Pool the cells of a score table.

    Args:
        scores: a score table.
        by: columns whose values stay apart.

    Returns:
        ``by``, frames, bits, correct, errors, accuracy in [0, 1] (missing where no truth is known),
        its 95 % interval ``low`` to ``high`` by `clustered_interval`, and the mean of the paper's
        cells, missing where the paper lacks one of them; in order of first appearance.
    """
    groups = scores.groupby(list(by), sort=False, dropna=False)
    table = groups[["frames", *SUMS]].sum().reset_index()
    table["errors"] = table["bits"] - table["correct"]
    table["accuracy"] = (table["correct"] / table["bits"].where(table["bits"] > 0)).astype(float)
    intervals = [clustered_interval(*row) for row in table[SUMS].itertuples(index=False)]
    table[["low", "high"]] = np.reshape(intervals, (-1, 2))
    table["paper"] = groups["paper"].agg(lambda cells: cells.mean(skipna=False)).to_numpy()
    return table.drop(columns=SUMS[2:])


def write_scores(file: Path, scores: pd.DataFrame, meta: dict[str, Any]) -> None:
    """Write a score table as metrics.json (strict JSON): {"meta": ..., "rows": [...]}."""
    rows = scores[STORED].astype(object).where(scores[STORED].notna(), None)
    write_json(file, {"meta": meta, "rows": rows.to_dict("records")})


def read_scores(file: Path) -> tuple[pd.DataFrame, dict[str, Any]]:
    """Rows and meta of a metrics.json that `write_scores` wrote.

    Returns:
        a score table, and what produced it.

    Raises:
        InputError: the file is missing, or no JSON.
    """
    content = read_json(file)
    table = pd.DataFrame(content["rows"], columns=SCORES)
    table = table.astype({"view_deg": "Float64", "kappa": "Int64", "accuracy": float})
    table["paper"] = _printed(table)
    return table, content["meta"]


def _printed(table: pd.DataFrame) -> list[float]:
    """The paper's accuracy in [0, 1] for each row of a score table; NaN where it has no cell."""
    cells = table[[*CELL, "method"]].itertuples(index=False, name=None)
    return [PRINTED.get(cell, np.nan) for cell in cells]
