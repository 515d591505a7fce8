"""Predictions of `study.measure` -> rows, a Markdown table, and accuracy against visibility."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean, median
from typing import Any

import matplotlib
import numpy as np

from link.images import make_folder
from models import DECODERS
from reports.score.metrics import clustered_interval, make_row

matplotlib.use("Agg")
import matplotlib.pyplot as plt

MARKERS = "osD^vP*X<>"
OURS = frozenset(DECODERS)
"""Systems that show a pair of frames; the others mark one picture."""


@dataclass(frozen=True)
class PeerRow:
    """One system at one strength in one condition."""

    method: str
    strength: str
    condition: str
    frames_used: int
    """Captured frames that one message is read from."""
    message_bits: int
    """A displayed picture, or frame pair."""
    captures: int
    bits: int
    correct: int
    accuracy: float
    """correct / bits in [0, 1]."""
    ci_low: float
    """95 % interval that knows that errors cluster by capture."""
    ci_high: float
    psnr: float
    """dB, mean over pictures, of the displayed message."""
    ssim: float
    decode_ms: float
    """Median of the processor's time, one thread."""


def tally(lines: Sequence[dict[str, Any]]) -> list[PeerRow]:
    """A row for each (method, strength, condition, frames used), in order of first appearance."""
    groups: dict[tuple[Any, ...], list[dict[str, Any]]] = {}
    for line in lines:
        key = (line["method"], line["strength"], line["condition"], line["frames_used"])
        groups.setdefault(key, []).append(line)
    return [_row(key, group) for key, group in groups.items()]


def _row(key: tuple[Any, ...], lines: list[dict[str, Any]]) -> PeerRow:
    truth = np.array([line["bits"] for line in lines])  # (captures, message bits)
    right = ((np.array([line["scores"] for line in lines]) > 0) == truth).sum(axis=1)
    counts = (len(lines), truth.size, int(right.sum()), int((right**2).sum()))
    low, high = clustered_interval([make_row(key[0], "", None, None, *counts)])
    method, strength, condition, frames_used = key
    return PeerRow(
        method=method,
        strength=strength,
        condition=condition,
        frames_used=frames_used,
        message_bits=truth.shape[1],
        captures=len(lines),
        bits=truth.size,
        correct=int(right.sum()),
        accuracy=float(right.sum() / truth.size),
        ci_low=low,
        ci_high=high,
        psnr=fmean(line["psnr"] for line in lines),
        ssim=fmean(line["ssim"] for line in lines),
        decode_ms=1000 * median(line["decode_s"] for line in lines),
    )


def best_readings(rows: Sequence[PeerRow]) -> list[PeerRow]:
    """Of each (method, strength, condition) the reading that is right more often: the kind view."""
    best: dict[tuple[str, str, str], PeerRow] = {}
    for row in rows:
        key = (row.method, row.strength, row.condition)
        if key not in best or row.accuracy > best[key].accuracy:
            best[key] = row
    return list(best.values())


def table(rows: Sequence[PeerRow]) -> str:
    """Systems x conditions: accuracy in per cent with half its interval."""
    conditions = list(dict.fromkeys(row.condition for row in rows))
    filmed = [(c, n) for c in conditions for n in (1, 2) if _any(rows, c, n)]
    heads = [f"{c}, {n} frame{'s' * (n > 1)}" for c, n in filmed]
    lines = [
        f"| system | strength | PSNR dB | SSIM | bits | {' | '.join(heads)} | decode ms |",
        f"|---|---|---:|---:|---:|{'---:|' * len(heads)}---:|",
    ]
    for method, strength in dict.fromkeys((row.method, row.strength) for row in rows):
        mine = [row for row in rows if (row.method, row.strength) == (method, strength)]
        found = {(row.condition, row.frames_used): _percent(row) for row in mine}
        cells = " | ".join(found.get(key, "–") for key in filmed)
        first = mine[0]
        lines.append(
            f"| {method} | {strength} | {first.psnr:.1f} | {first.ssim:.4f} | "
            f"{first.message_bits} | {cells} | {median(row.decode_ms for row in mine):.0f} |"
        )
    return "\n".join(lines)


def _any(rows: Sequence[PeerRow], condition: str, frames_used: int) -> bool:
    return any((row.condition, row.frames_used) == (condition, frames_used) for row in rows)


def _percent(row: PeerRow) -> str:
    return f"{100 * row.accuracy:.1f} ±{50 * (row.ci_high - row.ci_low):.1f}"


def plot(rows: Sequence[PeerRow], path: Path) -> None:
    """Bit accuracy against PSNR, a panel a condition; of a peer's two readings the better."""
    conditions = list(dict.fromkeys(row.condition for row in rows))
    methods = list(dict.fromkeys(row.method for row in rows))
    figure, axes = plt.subplots(
        1, len(conditions), figsize=(3.6 * len(conditions), 4.2), sharey=True, squeeze=False
    )
    for axis, condition in zip(axes[0], conditions, strict=True):
        for number, method in enumerate(methods):
            here = [r for r in rows if (r.method, r.condition) == (method, condition)]
            points = sorted(best_readings(here), key=lambda row: row.psnr)
            accuracy = [100 * row.accuracy for row in points]
            bars = [
                [100 * (row.accuracy - row.ci_low) for row in points],
                [100 * (row.ci_high - row.accuracy) for row in points],
            ]
            axis.errorbar(
                [row.psnr for row in points],
                accuracy,
                np.maximum(bars, 0),
                marker=MARKERS[number % len(MARKERS)],
                color=f"C{number}",
                linestyle="-" if method in OURS else "--",
                markersize=5,
                linewidth=1,
                elinewidth=0.6,
                label=method,
            )
        axis.axhline(50, color="0.6", linewidth=0.8)
        axis.set_title(condition)
        axis.set_xlabel("PSNR of the displayed message, dB")
        axis.grid(alpha=0.3)
    axes[0, 0].set_ylabel("bits right, % (50 is chance)")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="lower center", ncols=len(methods), frameon=False)
    figure.tight_layout(rect=(0, 0.08, 1, 1))
    make_folder(path.parent)
    figure.savefig(path, dpi=110)
    plt.close(figure)
