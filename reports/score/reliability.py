"""Do log-likelihood ratios mean what they say? Expected calibration error, table, diagram."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from link.errors import InputError
from link.images import make_folder
from reports.score.metrics import wilson

matplotlib.use("Agg")
import matplotlib.pyplot as plt

BINS = 10
MAX_COLUMNS = 4
SHOWN_BITS = 20
"""Bins with fewer bits are left out of the diagram, though not of the error."""
ALL = "all"
TARGET = 0.02
"""The largest expected calibration error that issue 4 allows."""

Curves = Mapping[str, Mapping[str, "Sequence[Bin]"]]
"""By method, then by condition; `pooled` adds the condition "all"."""


@dataclass(frozen=True)
class Bin:
    """Bits decided with a similar confidence max(p, 1 - p)."""

    low: float
    """Edges, in [0.5, 1]."""
    high: float
    count: int
    """Bits, at least 1."""
    correct: int
    confidence: float
    """Mean, in [0.5, 1]."""
    ci_low: float
    """Wilson's 95 % interval of the accuracy, as if bits were independent."""
    ci_high: float

    @property
    def accuracy(self) -> float:
        """In [0, 1]."""
        return self.correct / self.count


def known_scores(
    predictions: Iterable[Mapping[str, Any]], method: str
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """A method's scores and their true bits, both (bits,), where the truth is known.

    Raises:
        InputError: there are none.
    """
    mine = [line for line in predictions if line["method"] == method]
    scores = np.array([score for line in mine for score in line["scores"]], np.float64)
    bits = np.array([bit for line in mine for bit in line["bits"]], np.int64)
    if not (bits >= 0).any():
        raise InputError(f"{method}: no scores whose bits are known")
    return scores[bits >= 0], bits[bits >= 0]


def reliability(scores: NDArray[np.float64], bits: NDArray[np.int64]) -> list[Bin]:
    """Sort decisions into ten equal-width bins of confidence.

    Args:
        scores: (bits,) natural log-likelihood ratios: p(bit = 1) = 1 / (1 + exp(-score)).
        bits: (bits,) 0 or 1.

    Returns:
        the bins that hold a bit, in ascending order.
    """
    confidence = expit(np.abs(scores))
    correct = (scores > 0) == (bits == 1)
    number = np.minimum(((2 * confidence - 1) * BINS).astype(np.int64), BINS - 1)
    edges = np.linspace(0.5, 1, BINS + 1)
    bins = []
    for i in np.unique(number):
        chosen = number == i
        count, right = int(chosen.sum()), int(correct[chosen].sum())
        mean = float(confidence[chosen].mean())
        bins.append(
            Bin(float(edges[i]), float(edges[i + 1]), count, right, mean, *wilson(right, count))
        )
    return bins


def calibration_error(bins: Sequence[Bin]) -> float:
    """Mean |accuracy - confidence| over bins, weighted by count, in [0, 1] (Naeini et al. 2015)."""
    total = sum(b.count for b in bins)
    return sum(b.count * abs(b.accuracy - b.confidence) for b in bins) / total


def pooled(
    predictions: Mapping[str, Iterable[Mapping[str, Any]]], methods: Sequence[str]
) -> dict[str, dict[str, list[Bin]]]:
    """Bins of each method in each condition, and over "all"; errors as of `known_scores`.

    Args:
        predictions: lines by condition.
        methods: whose scores are log-likelihood ratios.
    """
    curves = {}
    for method in methods:
        parts = {name: known_scores(lines, method) for name, lines in predictions.items()}
        scores, bits = (np.concatenate(part) for part in zip(*parts.values(), strict=True))
        curves[method] = {name: reliability(*part) for name, part in parts.items()}
        curves[method][ALL] = reliability(scores, bits)
    return curves


def reliability_page(curves: Curves) -> str:
    """Markdown: calibration error by method and condition, then each method's bins over all."""
    names = list(next(iter(curves.values())))
    lines = [
        f"Expected calibration error of log-likelihood ratios, {BINS} bins of equal width "
        f"(aim: at most {TARGET:g}; simulated):",
        "",
        f"| method | {' | '.join(names)} |",
        f"|---|{'---:|' * len(names)}",
    ]
    for method, by_name in curves.items():
        errors = " | ".join(f"{calibration_error(by_name[name]):.4f}" for name in names)
        lines.append(f"| {method} | {errors} |")
    for method, by_name in curves.items():
        lines += [
            "",
            f"{method}, all conditions; Wilson's 95 % interval, as if bits were independent:",
            "",
            "| confidence | bits | mean confidence | accuracy | 95 % interval |",
            "|---|---:|---:|---:|---:|",
        ]
        lines += [
            f"| {b.low:.2f} – {b.high:.2f} | {b.count} | {b.confidence:.4f} | {b.accuracy:.4f} "
            f"| {b.ci_low:.4f} – {b.ci_high:.4f} |"
            for b in by_name[ALL]
        ]
    return "\n".join(lines)


def diagram(path: Path, curves: Curves) -> None:
    """Accuracy against confidence, one panel a condition, one colour a method, as a PNG."""
    names = list(next(iter(curves.values())))
    columns = min(MAX_COLUMNS, len(names))
    rows = -(-len(names) // columns)
    figure, panels = plt.subplots(
        rows, columns, figsize=(3.2 * columns, 3.2 * rows), sharex=True, sharey=True, squeeze=False
    )
    for panel, name in zip(panels.flat, names, strict=False):
        panel.plot([0.5, 1], [0.5, 1], color="0.7", linewidth=1)
        for method, by_name in curves.items():
            bins = [b for b in by_name[name] if b.count >= SHOWN_BITS]
            accuracy = np.array([b.accuracy for b in bins])
            low, high = np.array([(b.ci_low, b.ci_high) for b in bins]).reshape(-1, 2).T
            panel.errorbar(
                [b.confidence for b in bins],
                accuracy,
                np.maximum(0, [accuracy - low, high - accuracy]),
                marker="o",
                markersize=4,
                linewidth=1,
                capsize=2,
                label=f"{method}, ECE {calibration_error(by_name[name]):.3f}",
            )
        panel.set_title(f"{name}, {sum(b.count for b in by_name[name]):,} bits")
        panel.set_ylim(0.4, 1.02)
        panel.tick_params(labelbottom=True)
        panel.legend(loc="lower right", fontsize=8)
    for panel in panels.flat[len(names) :]:
        panel.set_visible(False)
    figure.supxlabel("confidence (simulated captures)")
    figure.supylabel("accuracy, 95 % interval")
    figure.tight_layout()
    make_folder(path.parent)
    figure.savefig(path, dpi=110)
    plt.close(figure)
