"""Predictions -> accuracies with intervals."""

import json
import platform
import sys
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from link.images import write_bytes

Z95 = 1.959963984540054
PACKAGES = ("torch", "kornia", "numpy", "opencv-python-headless", "scikit-learn", "onnxruntime")


def wilson(correct: int, bits: int) -> tuple[float, float]:
    """Wilson score interval at 95 % for ``correct`` successes in ``bits`` independent trials.

    Returns:
        (low, high) in [0, 1]; (0, 1) where there is no trial.
    """
    if bits == 0:
        return 0.0, 1.0
    p, z2 = correct / bits, Z95**2
    centre = (p + z2 / (2 * bits)) / (1 + z2 / bits)
    half = Z95 / (1 + z2 / bits) * np.sqrt(p * (1 - p) / bits + z2 / (4 * bits**2))
    return max(0.0, float(centre - half)), min(1.0, float(centre + half))


@dataclass(frozen=True)
class Row:
    """One method in one cell."""

    method: str
    pair: str
    view_deg: float | None
    kappa: int | None
    frames: int
    """Frame pairs decoded."""
    bits: int
    """Bits whose truth is known."""
    correct: int
    accuracy: float | None
    """correct / bits in [0, 1]; None where no truth is known."""
    ci_low: float
    ci_high: float


def score(predictions: Iterable[dict[str, Any]]) -> list[Row]:
    """Accuracy of each (method, pair, view, kappa), in order of first appearance.

    Args:
        predictions: entries with method, pair, view_deg, kappa, scores (n_bits,) and bits (n_bits,)
            where -1 is unknown.
    """
    rows: dict[tuple[Any, ...], tuple[int, int, int]] = {}
    for entry in predictions:
        key = (entry["method"], entry["pair"], entry["view_deg"], entry["kappa"])
        truth, decided = np.array(entry["bits"]), np.array(entry["scores"]) > 0
        known = truth >= 0
        frames, bits, correct = rows.get(key, (0, 0, 0))
        correct += int((decided == truth)[known].sum())
        rows[key] = (frames + 1, bits + int(known.sum()), correct)
    return [make_row(*key, *tally) for key, tally in rows.items()]


def make_row(method: str, pair: str, view_deg: float | None, kappa: int | None, *tally: int) -> Row:
    """A row from (frames, bits, correct)."""
    frames, bits, correct = tally
    accuracy = correct / bits if bits else None
    return Row(
        method, pair, view_deg, kappa, frames, bits, correct, accuracy, *wilson(correct, bits)
    )


def provenance(seed: int, simulated: bool) -> dict[str, Any]:
    """What produced the numbers: versions, seed, command."""
    return {
        "simulated": simulated,
        "seed": seed,
        "command": " ".join(["python", *sys.argv]),
        "python": platform.python_version(),
        **{package: version(package) for package in PACKAGES},
    }


def write_metrics(path: Path, rows: list[Row], meta: dict[str, Any]) -> None:
    """Write metrics.json (strict JSON): {"meta": ..., "rows": [...]}."""
    content = {"meta": meta, "rows": [asdict(row) for row in rows]}
    write_bytes(path, (json.dumps(content, indent=1, allow_nan=False) + "\n").encode())


def read_metrics(path: Path) -> tuple[list[Row], dict[str, Any]]:
    """Rows and meta of a metrics.json that `write_metrics` wrote."""
    content = json.loads(path.read_text())
    return [Row(**row) for row in content["rows"]], content["meta"]
