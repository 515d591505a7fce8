"""Cost, and where the numbers come from."""

import math

from reports.render.markup import Html, table, tag
from reports.render.sections.common import absent, named
from reports.render.svg import (
    Axis,
    Line,
    Point,
    dot_chart,
)
from reports.run import Run


def cost(run: Run) -> Html:
    """Time as a multiple of two warps."""
    if run.cost is None:
        return absent("Cost", "It is timed at the end of a simulated run.")
    ratios: dict[str, list[float]] = run.cost["ratios"]
    reference = run.cost["reference"]
    order = sorted((n for n in ratios if n != reference), key=lambda name: ratios[name][1])
    if not order:
        return absent("Cost", "No receiver could do what was compared here.")
    high = max(ratios[name][2] for name in order)
    ticks = [(v, f"{v:g}") for v in (0.3, 1, 3, 10, 30, 100, 300) if v <= high * 1.2]
    low = min([0.8, *(ratios[name][0] for name in order)])
    axis = Axis(f"× {reference}", [t for t in ticks if t[0] >= low], low, high * 1.1, math.log)
    lines = [
        Line(
            name,
            [
                Point(
                    ratios[name][1], 0, ratios[name][0], ratios[name][2], f"{ratios[name][1]:.1f} ×"
                )
            ],
        )
        for name in order
    ]
    rows = [
        [named(n), f"{ratios[n][1]:.2f}", f"{ratios[n][0]:.2f} – {ratios[n][2]:.2f}"] for n in order
    ]
    note = tag(
        "p",
        f"Calibration and decision of one frame pair, one thread, as a multiple of rectifying it "
        f"(two warps, median {run.cost['reference_ms']:.1f} ms on the machine below) in the same "
        f"round; median and quartiles of {run.cost['rounds']} rounds. No method has a fit apart "
        "from this: all calibrate anew in each frame pair, except cnn, which does not.",
        class_="note",
    )
    chart = tag("figure", dot_chart("Time of each method", axis, lines))
    body = tag("div", note, table(["method", f"× {reference}", "quartiles"], list(rows)))
    return tag("div", body, chart, class_="split")


def provenance(run: Run) -> Html:
    """Command, versions, seed, machine, commit."""
    about = run.about
    meta, machine = about["meta"], about["machine"]
    entries: list[tuple[str, object]] = [
        ("command", tag("code", meta["command"])),
        ("captures", "simulated" if run.simulated else "real"),
        ("seed", meta["seed"]),
        ("commit", tag("code", about["commit"] or "not known: no git checkout")),
        ("machine", f"{machine['processor']}, {machine['cores']} cores, {machine['system']}"),
        ("time", ", ".join(f"{name} {value:g} s" for name, value in about["seconds"].items())),
    ]
    skip = {"command", "seed", "simulated", "failed_cells"}
    entries.append(("versions", ", ".join(f"{k} {v}" for k, v in meta.items() if k not in skip)))
    for name, digest in about["settings"].get("checkpoints", {}).items():
        if digest:
            entries.append((f"checkpoint of {name}", tag("code", digest[:16])))
    for note in about["notes"]:
        entries.append(("note", note))
    shown = {k: v for k, v in about["settings"].items() if k != "checkpoints"}
    settings = "; ".join(f"{key}: {_value(value)}" for key, value in shown.items())
    entries.append(("settings", settings))
    parts = [part for key, value in entries for part in (tag("dt", key), tag("dd", value))]
    return tag("dl", *parts)


def _value(value: object) -> str:
    if isinstance(value, list):
        return ", ".join(map(str, value)) or "none"
    return "–" if value is None else str(value)
