"""Other systems on the same captures: accuracy against visibility."""

from collections.abc import Sequence
from math import ceil, floor

from reports.render.markup import Html, join, table, tag
from reports.render.sections.common import absent, interval, named, percent
from reports.render.svg import Axis, Line, Point, accuracy_axis, line_chart
from reports.run import Run
from reports.studies.peers.page import OURS, PeerRow, best_readings

TICK_DB = 5
NAMES_PX = 128
"""Room for the longest name."""
PACKAGES = ("invisible-watermark", "blind-watermark")


def peers(run: Run) -> Html:
    """A chart a condition and a table, as the stored measurement has them."""
    stored = run.references.get("peers")
    if stored is None:
        return absent("Other systems", "python -m reports.studies.peers measures them.")
    rows = [PeerRow(**row) for row in stored["rows"]]
    conditions = list(dict.fromkeys(row.condition for row in rows))
    meta = stored["meta"]
    packages = ", ".join(f"{name} {meta[name]}" for name in PACKAGES if name in meta)
    note = tag(
        "p",
        "Watermarks of one still picture, in the same pictures through the same draws of the "
        "channel, with the true corners. Equal visibility is the fair axis: PSNR of what carries "
        "the message against what does not, 50 % is chance. A peer is read from one captured frame "
        "and from the mean of two, and the better one is shown; ours needs two frames, which the "
        "display shows in turn, and flicker is in no PSNR. None of the peers was made for a filmed "
        f"display. Simulated, seed {meta['seed']}; by ",
        tag("code", meta["command"]),
        f" with {packages}. Details: docs/peers.md.",
        class_="note",
    )
    x = _visibility([row.psnr for row in rows])
    charts = [
        _chart(name, [row for row in rows if row.condition == name], x) for name in conditions
    ]
    return join(note, tag("div", *charts, class_="grid"), _numbers(rows, conditions))


def _visibility(values: Sequence[float]) -> Axis:
    low, high = floor(min(values) / TICK_DB) * TICK_DB, ceil(max(values) / TICK_DB) * TICK_DB
    ticks = [(float(v), str(v)) for v in range(low, high + 1, TICK_DB)]
    return Axis("PSNR of the displayed message, dB", ticks, low, high)


def _chart(condition: str, rows: Sequence[PeerRow], x: Axis) -> Html:
    lines = []
    for method in dict.fromkeys(row.method for row in rows):
        mine = best_readings([row for row in rows if row.method == method])
        marks = [
            Point(row.psnr, row.accuracy, row.ci_low, row.ci_high, _spoken(row))
            for row in sorted(mine, key=lambda row: row.psnr)
        ]
        lines.append(Line(method, marks))
    counts = sorted({row.captures for row in rows})
    return tag(
        "figure",
        tag("h3", condition),
        line_chart(f"Accuracy by PSNR, {condition}", x, accuracy_axis(0.3), lines, margin=NAMES_PX),
        tag("figcaption", f"{counts[0]} captures a point."),
    )


def _spoken(row: PeerRow) -> str:
    return (
        f"{row.method}, {row.strength}: {percent(row.accuracy)} % "
        f"({interval(row.ci_low, row.ci_high)}), {row.bits} bits, {row.psnr:.1f} dB"
    )


def _numbers(rows: Sequence[PeerRow], conditions: Sequence[str]) -> Html:
    heads = ["system", "strength", "PSNR, dB", "SSIM", "bits a frame"]
    entries: list[list[object]] = []
    for method, strength in dict.fromkeys((row.method, row.strength) for row in rows):
        mine = [row for row in rows if (row.method, row.strength) == (method, strength)]
        found = {row.condition: row for row in best_readings(mine)}
        shown = 2 if method in OURS else 1
        entries.append(
            [
                named(method),
                strength,
                f"{mine[0].psnr:.1f}",
                f"{mine[0].ssim:.4f}",
                f"{mine[0].message_bits / shown:g}",
                *(_cell(found[name]) if name in found else "–" for name in conditions),
                f"{max(row.decode_ms for row in mine):.0f}",
            ]
        )
    return table(
        [*heads, *conditions, "decode, ms"],
        entries,
        "Bits right, per cent, with the 95 % interval; message bits a displayed frame; processor "
        "time to read a rectified capture, one thread",
        left=2,
    )


def _cell(row: PeerRow) -> Html:
    return join(percent(row.accuracy, 1), tag("small", interval(row.ci_low, row.ci_high, 1)))
