"""Predictions as one table: a row for each frame pair and method.

A prediction is stored as one line of JSON: a `Prediction`, with a digest that tells a damaged line.
`to_records` makes the table that everything downstream groups, joins and counts.
"""

import json
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pandas as pd
from pydantic import Field, FiniteFloat

from link.captures import KnownWindow
from link.embed import MAX_KAPPA
from link.errors import InputError
from link.frames import Captured, SoftBits
from link.outside import read_json_lines
from reports.engine.checked import checked, read_sealed

CELL = ["pair", "view_deg", "kappa"]
"""Columns that name a cell of the comparison."""
FRAME = [*CELL, "index"]
"""Columns that name a frame pair."""
COLUMNS = ["condition", "method", *FRAME, "picture", "scores", "bits"]
"""Columns of the table of predictions, as stored; `to_records` adds two counts."""
MOST_BITS = 2**20
"""Largest number of bits of a frame pair in a stored file."""


@dataclass(frozen=True)
class Prediction:
    """One stored line of predictions, against which files are checked."""

    method: str
    """Label of the method."""
    pair: str
    """Name of the camera-display pair, or "captures" where it is not known."""
    view_deg: FiniteFloat | None
    """Angle of observation, degrees."""
    kappa: Annotated[int, Field(ge=1, le=MAX_KAPPA)] | None
    """Gray levels added for a bit 1."""
    picture: str | None
    """Name of the picture."""
    index: Annotated[int, Field(ge=0, lt=2**31)]
    """Number of the frame pair in its cell."""
    scores: Annotated[list[FiniteFloat], Field(max_length=MOST_BITS)]
    """Score of each message bit, in log-likelihood units."""
    bits: list[Annotated[int, Field(ge=-1, le=1)]]
    """True bits, 0 or 1, and -1 where one is not known."""
    condition: str = ""
    """Name of the condition; empty in the main comparison."""
    mark: str = ""
    """First digits of the digest of all that decided the scores (`reports.engine.predict`)."""

    def __post_init__(self) -> None:
        if len(self.scores) != len(self.bits):
            raise ValueError("has not as many scores as bits")


def to_line(
    method: str, index: int, soft: SoftBits, captured: Captured | KnownWindow
) -> dict[str, Any]:
    """One prediction as JSON has it: scores to six digits; bits 0 or 1, and -1 where unknown."""
    bits = np.full(captured.layout.n_bits, -1) if captured.bits is None else captured.bits
    return {
        "method": method,
        "pair": captured.meta.get("pair", "captures"),
        "view_deg": captured.meta.get("view_deg"),
        "kappa": captured.kappa,
        "picture": captured.meta.get("picture"),
        "index": index,
        "scores": [float(f"{score:.6g}") for score in soft.scores],
        "bits": bits.reshape(-1).tolist(),
    }


def key_of(line: dict[str, Any]) -> tuple[Any, ...]:
    """Tell a stored prediction from all others: what was decoded, by which method, and its mark."""
    return tuple(line[name] for name in ("condition", "method", *FRAME, "mark"))


def to_records(lines: Iterable[dict[str, Any]]) -> pd.DataFrame:
    """Make the table of predictions.

    >>> line = {"method": "oorc", "pair": "canon-lg", "view_deg": 45.0, "kappa": 3, "index": 0,
    ...         "picture": None, "scores": [1.5, -2.0, 0.3], "bits": [1, 1, -1]}
    >>> to_records([line])[["method", "known", "correct"]]
      method  known  correct
    0   oorc      2        1

    Args:
        lines: predictions as `to_line` makes them, with a condition where it is not "".

    Returns:
        `COLUMNS` (scores and bits are arrays (n_bits,) of each row; view_deg and kappa are missing
        where unknown), and the numbers of bits that are ``known`` and decided ``correct``-ly.
    """
    table = pd.DataFrame([{"condition": "", **line} for line in lines], columns=COLUMNS)
    table["scores"] = [np.array(scores, np.float64) for scores in table["scores"]]
    table["bits"] = [np.array(bits, np.int64) for bits in table["bits"]]
    table = table.astype({"view_deg": "Float64", "kappa": "Int64", "index": int})
    pairs = list(zip(table["scores"], table["bits"], strict=True))
    table["known"] = [int((bits >= 0).sum()) for _, bits in pairs]
    table["correct"] = [int(((scores > 0) == bits)[bits >= 0].sum()) for scores, bits in pairs]
    return table


def write_lines(lines: Iterable[dict[str, Any]]) -> bytes:
    """Objects as the bytes of a file with one line of JSON each, such as predictions or a log."""
    return "".join(json.dumps(line) + "\n" for line in lines).encode()


def read_predictions(file: Path) -> pd.DataFrame:
    """Read the table of predictions from a file of a run, each line of it checked.

    Raises:
        InputError: the file is missing, a line is not a `Prediction`, or one is there twice, which
            would count its bits twice.
    """
    table = to_records(
        vars(checked(Prediction, line, where)) for where, line in read_json_lines(file)
    )
    twice = table[table.duplicated(["condition", "method", *FRAME])]
    if len(twice):
        number, method = twice.iloc[0][["index", "method"]]
        raise InputError(f"{file}: holds frame pair {number} twice for {method}")
    return table


def stored_predictions(file: Path) -> list[dict[str, Any]]:
    """Read the predictions of a file whose lines are as they were written, and leave out others."""
    found = []
    for line in read_sealed(file):
        with suppress(InputError):
            found.append(vars(checked(Prediction, line, str(file))))
    return found
