"""Predictions to accuracies with intervals, as tables.

A *score table* has a row for each method in each cell of each condition, with the columns of
`SCORES`. Errors cluster by frame pair: a drifted or textured frame loses many bits at once. So a
score table also keeps the sum of squares that `clustered_interval` needs.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from pydantic import FiniteFloat

from link.outside import read_json
from reports.engine.checked import Count, Share, checked, write_json
from reports.engine.records import CELL
from reports.score.intervals import clustered_interval, wilson
from reports.score.paper import paper_accuracy

SCORES = [
    "condition", "method", *CELL, "frames", "bits", "correct", "correct_squared",
    "accuracy", "ci_low", "ci_high", "paper",
]  # fmt: skip
"""Columns of a score table; `score` says what they hold."""


@dataclass(frozen=True)
class ScoreRow:
    """One row of a stored score table, against which files are checked."""

    method: str
    """Label of the method."""
    pair: str
    """Name of the camera-display pair."""
    view_deg: FiniteFloat | None
    """Angle of observation, degrees."""
    kappa: Count | None
    """Gray levels added for a bit 1."""
    frames: Count
    """Number of frame pairs."""
    bits: Count
    """Number of bits whose truth is known."""
    correct: Count
    """Number of bits that were decided right."""
    correct_squared: Count
    """Sum over frame pairs of (right bits)^2."""
    accuracy: Share | None
    """Share of right bits; None where no truth is known."""
    ci_low: Share
    """Lower end of Wilson's 95 % interval of the accuracy, as if bits were independent."""
    ci_high: Share
    """Upper end of that interval."""


@dataclass(frozen=True)
class StoredScores:
    """Content of a metrics.json."""

    meta: dict[str, Any]
    """Provenance of the scores."""
    rows: list[ScoreRow]
    """One row for each method in each cell."""


def score(records: pd.DataFrame, *, in_paper: bool = True) -> pd.DataFrame:
    """Accuracy of each method in each cell, in order of first appearance.

    Args:
        records: predictions, as `reports.engine.records.to_records` makes them.
        in_paper: whether cells may be the paper's; those of films, and of layouts with pilots, are
            not, though a pair, view and kappa of the paper's names them.

    Returns:
        `SCORES`: ``frames`` frame pairs, ``bits`` whose truth is known, ``correct`` ones,
        ``accuracy`` in [0, 1] (missing where no truth is known), Wilson's interval as if bits were
        independent, and the accuracy that the ``paper`` prints for this cell, missing elsewhere.
    """
    counted = records[["condition", "method", *CELL, "known", "correct"]].copy()
    counted["squared"] = counted["correct"] ** 2
    groups = counted.groupby(["condition", "method", *CELL], sort=False, dropna=False)
    table = groups.agg(
        frames=("correct", "size"),
        bits=("known", "sum"),
        correct=("correct", "sum"),
        correct_squared=("squared", "sum"),
    ).reset_index()
    table["accuracy"] = (table["correct"] / table["bits"].where(table["bits"] > 0)).astype(float)
    intervals = [wilson(*row) for row in zip(table["correct"], table["bits"], strict=True)]
    table["ci_low"] = [low for low, _ in intervals]
    table["ci_high"] = [high for _, high in intervals]
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
    table = groups[["frames", "bits", "correct", "correct_squared"]].sum().reset_index()
    table["errors"] = table["bits"] - table["correct"]
    table["accuracy"] = (table["correct"] / table["bits"].where(table["bits"] > 0)).astype(float)
    counts = table[["frames", "bits", "correct", "correct_squared"]].itertuples(index=False)
    intervals = [clustered_interval(*row) for row in counts]
    table["low"] = [low for low, _ in intervals]
    table["high"] = [high for _, high in intervals]
    table["paper"] = groups["paper"].agg(lambda cells: cells.mean(skipna=False)).to_numpy()
    return table.drop(columns="correct_squared")


def write_scores(file: Path, scores: pd.DataFrame, meta: dict[str, Any]) -> None:
    """Write a score table as metrics.json (strict JSON): {"meta": ..., "rows": [...]}."""
    write_json(file, {"meta": meta, "rows": [asdict(row) for row in to_score_rows(scores)]})


def to_score_rows(scores: pd.DataFrame) -> list[ScoreRow]:
    """Turn a score table of one condition into rows that JSON can hold."""
    kept = scores.drop(columns=["condition", "paper"])[[field.name for field in fields(ScoreRow)]]
    rows = [
        {key: None if pd.isna(value) else value for key, value in row.items()}
        for row in kept.to_dict("records")
    ]
    return checked(list[ScoreRow], rows, "scores")


def read_scores(file: Path) -> tuple[pd.DataFrame, dict[str, Any]]:
    """Rows and meta of a metrics.json that `write_scores` wrote.

    Returns:
        a score table whose only condition is "", and what produced it.

    Raises:
        InputError: the file is missing or damaged.
    """
    content = checked(StoredScores, read_json(file), str(file))
    return to_scores(content.rows), content.meta


def to_scores(rows: Sequence[ScoreRow]) -> pd.DataFrame:
    """Turn stored rows into a score table, whose only condition is ""."""
    table = pd.DataFrame([vars(row) for row in rows], columns=SCORES)
    table["condition"] = ""
    table["view_deg"] = pd.to_numeric(table["view_deg"]).astype("Float64")
    table["kappa"] = pd.to_numeric(table["kappa"]).astype("Int64")
    table["accuracy"] = table["accuracy"].astype(float)
    table["paper"] = _printed(table)
    return table


def _printed(table: pd.DataFrame) -> list[float]:
    """The paper's accuracy in [0, 1] for each row of a score table; NaN where it has no cell."""
    return [
        np.nan if pd.isna(row.view_deg) or pd.isna(row.kappa) else paper_accuracy(*row) or np.nan
        for row in table[[*CELL, "method"]].itertuples(index=False, name="PaperCell")
    ]
