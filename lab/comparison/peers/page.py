"""What readings show: a row for each system, strength and condition, a table, and a figure."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from statistics import fmean, median
from typing import Annotated

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from pydantic import Field

from lab.comparison.peers.systems import NO_CHANNEL, Reading
from lab.study import Picture, Results
from models import DECODERS
from reports.engine.checked import Count, Number, Share
from reports.render.charts import (
    Point,
    Series,
    draw_series,
    in_style,
    new_panels,
    set_accuracy_axis,
)
from reports.render.tables import Table, percent, share_interval
from reports.score.intervals import clustered_interval

OURS = frozenset(DECODERS)
"""Systems that show a pair of frames; the others mark one picture."""
PACKAGES = ("invisible-watermark", "blind-watermark", "PyWavelets")
"""Packages of the other systems, whose versions a stored measurement states."""
COLOURS = {
    "rivaGAN": "#b04a3a",
    "DWT-DCT": "#5a7d8c",
    "DWT-DCT in Y": "#7a8a2a",
    "DWT-DCT-SVD": "#6b6bb0",
    "DWT-DCT-SVD in Y": "#b07ab8",
    "blind-watermark": "#2f8f9c",
}
"""Colours of the other systems in charts, "#rrggbb"."""
NAMES_IN = 1.8
"""Width beside a panel in which the systems are named, inches."""
LEAST_ACCURACY = 0.3
"""Accuracy at which the charts end below; chance gives 0.5."""


@dataclass(frozen=True)
class PeerRow:
    """One system at one strength in one condition."""

    method: str
    """Name of the system."""
    strength: str
    """How strongly it embeds."""
    condition: str
    """Name of the condition: no channel, JPEG, or the view in degrees."""
    frames_used: Annotated[int, Field(ge=1, le=2)]
    """Number of captured frames that one message is read from."""
    message_bits: Count
    """Number of message bits in a displayed picture, or frame pair."""
    captures: Count
    """Number of captures."""
    bits: Count
    """Number of bits in all captures."""
    correct: Count
    """Number of bits that were read right."""
    accuracy: Share
    """Share of bits that were read right, in [0, 1]."""
    ci_low: Share
    """Lower end of the 95 % interval of the accuracy, which knows that errors cluster by
    capture."""
    ci_high: Share
    """Upper end of the 95 % interval of the accuracy."""
    psnr: Number
    """Peak signal-to-noise ratio of the displayed message, dB, mean over pictures."""
    ssim: Number
    """Structural similarity of the pictures with and without the message, mean over pictures."""
    decode_ms: Number
    """Median processor time of a reading, milliseconds, one thread."""


@dataclass(frozen=True)
class PeersContent:
    """What was measured."""

    rows: Annotated[list[PeerRow], Field(min_length=1)]
    """One row for each system, strength, condition and number of captured frames."""
    packages: dict[str, str] = field(default_factory=dict)
    """Versions of the other systems' packages by name."""

    def __post_init__(self) -> None:
        """Check that tables find one row in each of their places."""
        places = {(row.method, row.strength, row.condition, row.frames_used) for row in self.rows}
        if len(places) != len(self.rows):
            raise ValueError("two rows are of the same system, strength, condition and frames")


def count_readings(readings: Sequence[Reading]) -> list[PeerRow]:
    """Pool readings for each system, strength, condition and number of frames used.

    Returns:
        a row for each, in order of first appearance.
    """
    groups: dict[tuple[str, str, str, int], list[Reading]] = {}
    for reading in readings:
        key = (reading.method, reading.strength, reading.condition, reading.frames_used)
        groups.setdefault(key, []).append(reading)
    return [_pooled(group) for group in groups.values()]


def _pooled(readings: Sequence[Reading]) -> PeerRow:
    """Pool readings that differ in capture alone."""
    first = readings[0]
    truth = np.array([reading.bits for reading in readings])  # (captures, message bits)
    right = ((np.array([reading.scores for reading in readings]) > 0) == truth).sum(axis=1)
    correct = int(right.sum())
    low, high = clustered_interval(len(readings), truth.size, correct, int((right**2).sum()))
    return PeerRow(
        method=first.method,
        strength=first.strength,
        condition=first.condition,
        frames_used=first.frames_used,
        message_bits=truth.shape[1],
        captures=len(readings),
        bits=truth.size,
        correct=correct,
        accuracy=correct / truth.size,
        ci_low=low,
        ci_high=high,
        psnr=fmean(reading.psnr for reading in readings),
        ssim=fmean(reading.ssim for reading in readings),
        decode_ms=1000 * median(reading.decode_s for reading in readings),
    )


def best_readings(rows: Sequence[PeerRow]) -> list[PeerRow]:
    """Keep, of the ways to read a system at a strength in a condition, the one most often right."""
    best: dict[tuple[str, str, str], PeerRow] = {}
    for row in rows:
        key = (row.method, row.strength, row.condition)
        if key not in best or row.accuracy > best[key].accuracy:
            best[key] = row
    return list(best.values())


def peers_table(rows: Sequence[PeerRow]) -> Table:
    """Show per cent of bits right with half the 95 % interval, systems by conditions."""
    table = pd.DataFrame([asdict(row) for row in rows])
    systems, conditions = ["method", "strength"], ["condition", "frames_used"]
    half = 50 * (table["ci_high"] - table["ci_low"])
    table["text"] = [
        f"{100 * accuracy:.1f} ±{width:.1f}"
        for accuracy, width in zip(table["accuracy"], half, strict=True)
    ]
    shown = table.pivot(index=systems, columns=conditions, values="text").fillna("–")
    first = table.groupby(systems, sort=False).agg(
        psnr=("psnr", "first"),
        ssim=("ssim", "first"),
        message_bits=("message_bits", "first"),
        decode_ms=("decode_ms", "median"),
    )
    order = [
        (condition, used)
        for condition in table["condition"].unique()
        for used in (1, 2)
        if (condition, used) in shown.columns
    ]
    heads = [f"{condition}, {used} frame{'s' * (used > 1)}" for condition, used in order]
    return Table(
        ["system", "strength", "PSNR dB", "SSIM", "bits", *heads, "decode ms"],
        [
            [
                *names,
                f"{about.psnr:.1f}",
                f"{about.ssim:.4f}",
                str(about.message_bits),
                *(shown.loc[names, key] for key in order),
                f"{about.decode_ms:.0f}",
            ]
            for names, about in zip(first.index, first.itertuples(), strict=True)
        ],
        left=2,
    )


@in_style
def peers_figure(rows: Sequence[PeerRow], columns: int = 1) -> Figure:
    """Draw bit accuracy against PSNR, a panel for each condition; of two readings the better one.

    Args:
        rows: what was measured.
        columns: largest number of panels beside each other.
    """
    conditions = list(dict.fromkeys(row.condition for row in rows))
    decibels = [row.psnr for row in rows]
    several = len(conditions) > 1
    figure, panels = new_panels(len(conditions), columns, NAMES_IN, title=several)
    for panel, condition in zip(panels, conditions, strict=True):
        panel.set_xlim(min(decibels) - 1, max(decibels) + 1)
        set_accuracy_axis(panel, "y", LEAST_ACCURACY)
        lines = []
        for method in dict.fromkeys(row.method for row in rows):
            here = [row for row in rows if (row.method, row.condition) == (method, condition)]
            mine = sorted(best_readings(here), key=lambda row: row.psnr)
            points = [
                Point(row.psnr, row.accuracy, row.ci_low, row.ci_high, spoken_row(row))
                for row in mine
            ]
            if points:
                lines.append(Series(method, points, COLOURS.get(method, ""), method not in OURS))
        draw_series(panel, lines)
        if several:
            panel.set_title(condition)
        panel.set_xlabel("PSNR of the displayed message, dB")
    return figure


def spoken_row(row: PeerRow) -> str:
    """Describe a row in one line.

    >>> spoken_row(PeerRow("toy", "weak", "0°", 1, 2, 2, 4, 3, 0.75, 0.3, 0.95, 35.0, 0.8, 3.0))
    'toy, weak: 75.00 % (30.00 – 95.00), 4 bits, 35.0 dB'
    """
    return (
        f"{row.method}, {row.strength}: {percent(row.accuracy)} % "
        f"({share_interval(row.ci_low, row.ci_high)}), {row.bits} bits, {row.psnr:.1f} dB"
    )


def peers_blocks(results: Mapping[str, Results[PeersContent]]) -> dict[str, str]:
    """Say what a measurement was made on, and show its table."""
    meta, content = results["peers"].meta, results["peers"].content
    rows = content.rows
    pictures = next(row.captures for row in rows if row.condition == NO_CHANNEL)
    pairs = max(row.captures for row in rows) // pictures
    packages = ", ".join(f"{name} {number}" for name, number in content.packages.items())
    sentences = [
        f"Simulated captures of held-out pictures, seed {meta['seed']}: {pictures} pictures, each "
        f"filmed by {pairs} camera–display pairs at every view, with one draw of the channel for "
        "all systems.",
        f"Packages: {packages}." if packages else "",
        "Entries are per cent of message bits that are right, ± half the 95 % interval, which "
        "knows that errors cluster by capture.",
    ]
    return {"peers": f"{' '.join(filter(None, sentences))}\n\n{peers_table(rows).markdown()}"}


def peers_pictures(results: Mapping[str, Results[PeersContent]]) -> dict[str, Picture]:
    """Draw bit accuracy against PSNR in every condition."""
    return {"peers.png": peers_figure(results["peers"].content.rows, columns=2)}
