"""What each effect of the channel costs each method: switch it off, on the same draws."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from data_gen.effects import EFFECTS
from data_gen.frame_pair import Source
from link.layout import make_layout
from reports.engine.predict import Method, decode_cells, paper_cells
from reports.score.metrics import Z95

SKIPPED = ("perspective", "transfer")
"""Without them there is no oblique view and no CDTF: another problem, not an easier channel."""
PAIRS = ("canon-imac", "nikon-lg", "sony-samsung")
KAPPA = 3


@dataclass(frozen=True)
class Change:
    """Paired difference in accuracy, points."""

    mean: float
    half: float
    """Half of the 95 % interval, over frame pairs."""


def per_frame(predictions: Sequence[dict[str, Any]], view: float) -> dict[str, np.ndarray]:
    """Accuracy of each frame pair at a view, in per cent, by method: (frames,)."""
    found: dict[str, list[float]] = {}
    for entry in predictions:
        if entry["view_deg"] == view:
            right = (np.array(entry["scores"]) > 0) == np.array(entry["bits"])
            found.setdefault(entry["method"], []).append(100 * float(right.mean()))
    return {method: np.array(values) for method, values in found.items()}


def change(without: np.ndarray, full: np.ndarray) -> Change:
    """Mean and interval of the paired difference."""
    difference = without - full
    return Change(
        float(difference.mean()), float(Z95 * difference.std(ddof=1) / np.sqrt(difference.size))
    )


def sensitivity_table(
    methods: Sequence[Method], frames: int, seed: int, folder: Path, jobs: int
) -> str:
    """Markdown: accuracy with all effects, then what switching each off adds, by view."""
    full_source = Source(make_layout(), "test", seed)
    cells = paper_cells(PAIRS, kappas=(KAPPA,))

    def run(source: Source, name: str) -> list[dict[str, Any]]:
        return decode_cells(source, cells, frames, methods, folder / name, jobs)

    full = run(full_source, "all")
    runs = {
        effect: run(replace(full_source, without=(effect,)), effect)
        for effect in EFFECTS
        if effect not in SKIPPED
    }
    names = [method.label or method.name for method in methods]
    tables = []
    for view in (0.0, 45.0):
        base = per_frame(full, view)
        lines = [
            f"**{view:g}°**, κ = {KAPPA}, {', '.join(PAIRS)}, {base[names[0]].size} frame pairs:",
            "",
            f"| switched off | {' | '.join(names)} |",
            f"|---|{'---:|' * len(names)}",
            f"| nothing: accuracy % | {' | '.join(f'{base[n].mean():.1f}' for n in names)} |",
        ]
        for effect, predictions in runs.items():
            other = per_frame(predictions, view)
            changes = [change(other[name], base[name]) for name in names]
            parts = [f"{c.mean:+.1f} ±{c.half:.1f}" for c in changes]
            lines.append(f"| {effect} | {' | '.join(parts)} |")
        tables.append("\n".join(lines))
    return "\n\n".join(tables)
