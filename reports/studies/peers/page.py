"""Other systems as rows, a table, and charts of accuracy against visibility."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, floor
from statistics import fmean, median
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from models import DECODERS
from reports.render.charts import (
    Point,
    Series,
    colour_of,
    draw_series,
    new_panels,
    set_accuracy_axis,
    set_ticks,
)
from reports.render.tables import Table, percent, share_interval
from reports.score.accuracy import clustered_interval

OURS = frozenset(DECODERS)
"""Systems that show a pair of frames; the others mark one picture."""
PEER_COLOURS = {
    "rivaGAN": "#b04a3a",
    "DWT-DCT": "#5a7d8c",
    "DWT-DCT in Y": "#7a8a2a",
    "DWT-DCT-SVD": "#6b6bb0",
    "DWT-DCT-SVD in Y": "#b07ab8",
    "blind-watermark": "#2f8f9c",
}
"""Colours of the other systems in charts and tables."""
CHANCE = 0.3
"""Smallest accuracy that the charts show; guessing reaches 0.5."""
TICK_DB = 5
"""Distance of two ticks on the axis of visibility, dB."""
NAMES_IN = 1.8
"""Width beside a panel in which the systems are named, inches."""


@dataclass(frozen=True)
class PeerRow:
    """One system at one strength in one condition."""

    method: str
    """Name of the system."""
    strength: str
    """Strength of the mark, in words."""
    condition: str
    """What lies between display and reading, in words."""
    frames_used: int
    """Number of captured frames that one message is read from."""
    message_bits: int
    """Number of message bits of a displayed picture, or of a pair of frames."""
    captures: int
    """Number of captures."""
    bits: int
    """Number of message bits of all captures."""
    correct: int
    """Number of bits that were read right."""
    accuracy: float
    """Share of right bits, in [0, 1]."""
    ci_low: float
    """Lower end of the 95 % interval of the accuracy; it knows that errors cluster by capture."""
    ci_high: float
    """Upper end of the 95 % interval of the accuracy."""
    psnr: float
    """Peak signal-to-noise ratio of the displayed message, dB, mean over pictures."""
    ssim: float
    """Structural similarity of the picture with and without message, mean over pictures."""
    decode_ms: float
    """Median time of the processor to read a rectified capture with one thread, milliseconds."""


def peer_rows(lines: Sequence[dict[str, Any]]) -> list[PeerRow]:
    """Count the readings of each system, strength, condition and number of frames.

    Args:
        lines: readings, as `reports.studies.peers.study.measure` makes them.

    Returns:
        rows in order of first appearance.
    """
    groups: dict[tuple[Any, ...], list[dict[str, Any]]] = {}
    for line in lines:
        key = (line["method"], line["strength"], line["condition"], line["frames_used"])
        groups.setdefault(key, []).append(line)
    return [_row(key, group) for key, group in groups.items()]


def best_readings(rows: Sequence[PeerRow]) -> list[PeerRow]:
    """Keep the reading that is right more often for each system, strength and condition.

    A system may be read from one captured frame and from the mean of two.
    """
    best: dict[tuple[str, str, str], PeerRow] = {}
    for row in rows:
        key = (row.method, row.strength, row.condition)
        if key not in best or row.accuracy > best[key].accuracy:
            best[key] = row
    return list(best.values())


def peers_table(rows: Sequence[PeerRow], best: bool = False) -> Table:
    """Make the table of systems by conditions: per cent of right bits with half its interval.

    Args:
        rows: all readings.
        best: show the better reading of each system alone, and bits by displayed frame.
    """
    conditions = list(dict.fromkeys(row.condition for row in rows))
    if best:
        columns: list[tuple[str, int | None]] = [(name, None) for name in conditions]
        heads = conditions
        rows = best_readings(rows)
    else:
        present = {(row.condition, row.frames_used) for row in rows}
        columns = [(name, n) for name in conditions for n in (1, 2) if (name, n) in present]
        heads = [f"{name}, {n} frame{'s' * (n == 2)}" for name, n in columns]
    entries = []
    for method, strength in dict.fromkeys((row.method, row.strength) for row in rows):
        mine = [row for row in rows if (row.method, row.strength) == (method, strength)]
        found = {(r.condition, None if best else r.frames_used): _accuracy(r) for r in mine}
        entries.append(
            [
                method,
                strength,
                f"{mine[0].psnr:.1f}",
                f"{mine[0].ssim:.4f}",
                f"{mine[0].message_bits / (2 if best and method in OURS else 1):g}",
                *(found.get(column, "–") for column in columns),
                f"{median(row.decode_ms for row in mine):.0f}",
            ]
        )
    measures = ["PSNR dB", "SSIM", "bits a frame" if best else "bits"]
    return Table(["system", "strength", *measures, *heads, "decode ms"], entries, left=2)


def peers_figure(rows: Sequence[PeerRow], columns: int = 2) -> Figure:
    """Draw accuracy against visibility, a panel a condition; each system's better reading.

    Args:
        rows: all readings.
        columns: largest number of panels beside each other.
    """
    conditions = list(dict.fromkeys(row.condition for row in rows))
    low = floor(min(row.psnr for row in rows) / TICK_DB) * TICK_DB
    high = ceil(max(row.psnr for row in rows) / TICK_DB) * TICK_DB
    ticks = list(range(low, high + 1, TICK_DB))
    figure, panels = new_panels(len(conditions), columns, NAMES_IN, title=len(conditions) > 1)
    for panel, condition in zip(panels, conditions, strict=True):
        if len(conditions) > 1:
            panel.set_title(condition)
        panel.set(xlim=(low, max(high, low + TICK_DB)), xlabel="PSNR of the displayed message, dB")
        set_ticks(panel.xaxis, ticks, [f"{tick}" for tick in ticks])
        set_accuracy_axis(panel, "y", CHANCE)
        series = []
        for method in dict.fromkeys(row.method for row in rows):
            mine = [r for r in rows if (r.method, r.condition) == (method, condition)]
            points = [_point(r) for r in sorted(best_readings(mine), key=lambda row: row.psnr)]
            if points:
                colour = colour_of(method, PEER_COLOURS)
                series.append(Series(method, points, colour, dashed=method not in OURS))
        draw_series(panel, series)
    return figure


def _row(key: tuple[Any, ...], lines: list[dict[str, Any]]) -> PeerRow:
    truth = np.array([line["bits"] for line in lines])  # (captures, message bits)
    right = ((np.array([line["scores"] for line in lines]) > 0) == truth).sum(axis=1)
    counts = (len(lines), truth.size, int(right.sum()), int((right**2).sum()))
    low, high = clustered_interval(*counts)
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


def _accuracy(row: PeerRow) -> str:
    return f"{100 * row.accuracy:.1f} ±{50 * (row.ci_high - row.ci_low):.1f}"


def _point(row: PeerRow) -> Point:
    note = (
        f"{row.method}, {row.strength}: {percent(row.accuracy)} % "
        f"({share_interval(row.ci_low, row.ci_high)}), {row.bits} bits, {row.psnr:.1f} dB"
    )
    return Point(row.psnr, row.accuracy, row.ci_low, row.ci_high, note)
