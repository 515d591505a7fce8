"""Rows of the ablation: the switches of the torch decoder, added or removed one at a time."""

from dataclasses import replace
from pathlib import Path
from typing import Any

from models.phi.config import FULL, DecoderConfig
from reports.engine.methods import Method, methods_for

ADDED: dict[str, dict[str, Any]] = {
    "phi+drift": {"drift_degree": 2},
    "phi+register": {"register": True},
    "phi+quiet": {"channels": "quiet"},
    "phi+rgb": {"channels": "rgb"},
    "phi+texture": {"texture": 0.02},
    "phi+area": {"train_on": "area"},
    "phi+coarsen": {"coarsen": 2},
    "phi+refine": {"refine": 3},
    "phi+refine+rows": {"refine": 3, "rows": True},
    "phi+refine+space": {"refine": 3, "space": True},
}
"""Rows that add to the twin of OORC, and the fields in which each differs from its config."""
REMOVED: dict[str, dict[str, Any]] = {
    "full-drift": {"drift_degree": 0},
    "full-register": {"register": False},
    "full-quiet": {"channels": "luma"},
    "full-texture": {"texture": 0.0},
    "full-area": {"train_on": "tile"},
    "full-coarsen": {"coarsen": 1},
    "full-refine": {"refine": 0, "rows": False, "space": False},
    "full-rows": {"rows": False},
    "full-space": {"space": False},
}
"""Rows that remove from the full decoder, and the fields in which each differs from `FULL`."""
ROWS = ("oorc", "phi", *ADDED, "full", *REMOVED)
"""Names of all untrained rows, in the order in which tables show them."""
WHOLE_DECODERS = ("full", "learned")
"""Rows that are decoders to use; their scores are log-likelihood ratios."""


def row_method(row: str, checkpoint: Path | None) -> Method:
    """Return the method that decodes a row; films it reads pair by pair.

    >>> dict(row_method("full-rows", Path("none")).options)["config"].rows
    False

    Args:
        row: a name of `ROWS`, or of a method that is shown beside them, such as "learned".
        checkpoint: folder of the trained decoder, for the row "learned"; None for the one that
            ships.

    Raises:
        InputError: the row is unknown.
    """
    if row == "phi" or row in ADDED:
        config = replace(DecoderConfig(), **ADDED.get(row, {}))
    elif row == "full" or row in REMOVED:
        config = replace(FULL, **REMOVED.get(row, {}))
    else:
        return replace(methods_for([row], checkpoint)[0], by_pairs=True)
    return Method("phi", (("config", config),), label=row, by_pairs=True)
