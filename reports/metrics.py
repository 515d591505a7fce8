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
    counts: dict[tuple[Any, ...], list[int]] = {}
    for entry in predictions:
        key = (entry["method"], entry["pair"], entry["view_deg"], entry["kappa"])
        truth, decided = np.array(entry["bits"]), np.array(entry["scores"]) > 0
        known = truth >= 0
        tally = counts.setdefault(key, [0, 0, 0])
        tally[0] += 1
        tally[1] += int(known.sum())
        tally[2] += int((decided == truth)[known].sum())
    return [
        Row(*key, frames, bits, correct, correct / bits if bits else None, *wilson(correct, bits))
        for key, (frames, bits, correct) in counts.items()
    ]


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
