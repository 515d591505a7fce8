"""Predictions -> accuracies with intervals."""

import json
import platform
import sys
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from link.images import write_bytes

Z95 = 1.959963984540054
PACKAGES = ("torch", "kornia", "numpy", "opencv-python-headless", "scikit-learn", "onnxruntime")


def wilson(correct: float, bits: float) -> tuple[float, float]:
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


def clustered_interval(rows: "Sequence[Row]") -> tuple[float, float]:
    """Wilson's 95 % interval for the pooled accuracy that knows that errors cluster by frame pair.

    A drifted or textured frame loses many bits at once. The number of bits is divided by the design
    effect, the variance of the frames' accuracies over that of independent bits (at least 1).

    Returns:
        (low, high) in [0, 1].
    """
    frames, bits = sum(row.frames for row in rows), sum(row.bits for row in rows)
    correct = sum(row.correct for row in rows)
    if bits == 0 or correct in (0, bits):
        return wilson(correct, bits)
    p, per_frame = correct / bits, bits / frames
    variance = sum(row.correct_squared for row in rows) / frames - (correct / frames) ** 2
    effective = bits / max(1.0, variance / (per_frame * p * (1 - p)))
    return wilson(p * effective, effective)


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
    """Wilson's 95 % interval, as if bits were independent."""
    ci_high: float
    correct_squared: int
    """Sum over frame pairs of (correct bits)^2: errors cluster, see `clustered_interval`."""


def score(predictions: Iterable[dict[str, Any]]) -> list[Row]:
    """Accuracy of each (method, pair, view, kappa), in order of first appearance.

    Args:
        predictions: entries with method, pair, view_deg, kappa, scores (n_bits,) and bits (n_bits,)
            where -1 is unknown.
    """
    rows: dict[tuple[Any, ...], tuple[int, int, int, int]] = {}
    for entry in predictions:
        key = (entry["method"], entry["pair"], entry["view_deg"], entry["kappa"])
        truth, decided = np.array(entry["bits"]), np.array(entry["scores"]) > 0
        known = truth >= 0
        frames, bits, correct, squared = rows.get(key, (0, 0, 0, 0))
        right = int((decided == truth)[known].sum())
        rows[key] = (frames + 1, bits + int(known.sum()), correct + right, squared + right**2)
    return [make_row(*key, *tally) for key, tally in rows.items()]


def make_row(method: str, pair: str, view_deg: float | None, kappa: int | None, *tally: int) -> Row:
    """A row from (frames, bits, correct, correct_squared)."""
    frames, bits, correct, squared = tally
    low, high = wilson(correct, bits)
    accuracy = correct / bits if bits else None
    key = (method, pair, view_deg, kappa)
    return Row(*key, frames, bits, correct, accuracy, low, high, squared)


def command() -> str:
    """The command line, as one types it in the checkout."""
    spec = getattr(sys.modules["__main__"], "__spec__", None)
    name = f"-m {spec.name.removesuffix('.__main__')}" if spec else Path(sys.argv[0]).name
    return " ".join(["python", name, *sys.argv[1:]])


def provenance(seed: int, simulated: bool) -> dict[str, Any]:
    """What produced the numbers: versions, seed, command."""
    return {
        "simulated": simulated,
        "seed": seed,
        "command": command(),
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
