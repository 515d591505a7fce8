"""Predictions as one table: a row for each frame pair and method.

A prediction is stored as one line of JSON with method, pair, view_deg, kappa, picture, index,
scores and bits. `to_records` makes the table that everything downstream groups, joins and counts.
"""

import json
from collections.abc import Iterable
from typing import Any

import numpy as np
import pandas as pd

from link.frames import Captured, SoftBits

CELL = ["pair", "view_deg", "kappa"]
"""Columns that name a cell of the comparison."""
FRAME = [*CELL, "index"]
"""Columns that name a frame pair."""
COLUMNS = ["condition", "method", *FRAME, "picture", "scores", "bits"]


def to_line(method: str, index: int, soft: SoftBits, captured: Captured) -> dict[str, Any]:
    """One prediction as JSON has it: scores to six digits; bits 0 or 1, and -1 where unknown."""
    unknown = [-1] * captured.layout.n_bits
    return {
        "method": method,
        "pair": captured.meta.get("pair", "captures"),
        "view_deg": captured.meta.get("view_deg"),
        "kappa": captured.kappa,
        "picture": captured.meta.get("picture"),
        "scores": [float(f"{score:.6g}") for score in soft.scores],
        "bits": unknown if captured.bits is None else [int(bit) for bit in captured.bits],
        "index": index,
    }


def to_records(lines: Iterable[dict[str, Any]], condition: str = "") -> pd.DataFrame:
    """The table of predictions.

    >>> line = {"method": "oorc", "pair": "canon-lg", "view_deg": 45.0, "kappa": 3, "index": 0,
    ...         "picture": None, "scores": [1.5, -2.0, 0.3], "bits": [1, 1, -1]}
    >>> to_records([line])[["method", "known", "correct"]]
      method  known  correct
    0   oorc      2        1

    Args:
        lines: as `to_line` makes them.
        condition: name of the condition, for lines that do not name theirs.

    Returns:
        `COLUMNS` (scores and bits are arrays (n_bits,) of each row; view_deg and kappa are missing
        where unknown), and the numbers of bits that are ``known`` and decided ``correct``-ly.
    """
    table = pd.DataFrame([{"condition": condition, **line} for line in lines], columns=COLUMNS)
    table["scores"] = [np.array(scores, np.float64) for scores in table["scores"]]
    table["bits"] = [np.array(bits, np.int64) for bits in table["bits"]]
    table["view_deg"] = pd.to_numeric(table["view_deg"]).astype("Float64")
    table["kappa"] = pd.to_numeric(table["kappa"]).astype("Int64")
    table["index"] = table["index"].astype(int)
    pairs = list(zip(table["scores"], table["bits"], strict=True))
    table["known"] = [int((bits >= 0).sum()) for _, bits in pairs]
    table["correct"] = [int(((scores > 0) == bits)[bits >= 0].sum()) for scores, bits in pairs]
    return table


def to_lines(records: pd.DataFrame) -> list[dict[str, Any]]:
    """The predictions of a table, as `to_line` makes them."""
    return [
        {
            **({"condition": row.condition} if row.condition else {}),
            "method": row.method,
            "pair": row.pair,
            "view_deg": None if pd.isna(row.view_deg) else float(row.view_deg),
            "kappa": None if pd.isna(row.kappa) else int(row.kappa),
            "picture": row.picture,
            "scores": row.scores.tolist(),
            "bits": row.bits.tolist(),
            "index": row.index_,
        }
        for row in records.rename(columns={"index": "index_"}).itertuples(index=False)
    ]


def read_lines(data: bytes) -> list[dict[str, Any]]:
    """Predictions from the bytes of a file, one line of JSON each."""
    return [json.loads(line) for line in data.split(b"\n") if line]


def write_lines(lines: Iterable[dict[str, Any]]) -> bytes:
    """Predictions as the bytes of a file."""
    return "".join(json.dumps(line) + "\n" for line in lines).encode()
