"""Rows of the ablation: plain OORC's twin with one switch added, FULL with one removed."""

from dataclasses import replace
from pathlib import Path
from typing import Any

from models.neural.decoder import FULL, DecoderConfig
from reports.engine.predict import Method, methods_for

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
"""What differs from `DecoderConfig`'s defaults, the twin of OORC."""
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
"""What differs from `FULL`."""
ROWS = ("oorc", "phi", *ADDED, "full", *REMOVED)


def method_for(row: str, checkpoint: Path) -> Method:
    """The decoder of a row: of `ROWS`, "learned" from the checkpoint, or another method by name."""
    config = None
    if row == "phi" or row in ADDED:
        config = replace(DecoderConfig(), **ADDED.get(row, {}))
    elif row == "full" or row in REMOVED:
        config = replace(FULL, **REMOVED.get(row, {}))
    if config is None:
        return methods_for([row], checkpoint)[0]
    return Method("phi", (("config", config),), label=row)
