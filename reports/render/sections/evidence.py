"""What the parts are worth, and what the scores mean: ablation and reliability."""

from typing import Any

from reports.engine.predict import OBSERVERS
from reports.render.markup import Html, join, table, tag
from reports.render.sections.common import absent, named
from reports.render.svg import (
    Axis,
    Line,
    Point,
    line_chart,
)
from reports.run import Run
from reports.score.paired import MIN_FRAMES
from reports.score.reliability import SHOWN_BITS, calibration_error, pooled

LLR = ("learned", "cnn", "blind", *OBSERVERS)
"""Methods whose scores are log-likelihood ratios."""


def ablation(run: Run) -> Html:
    """What each part is worth, as the stored ablation has it."""
    stored = run.references.get("ablation")
    if stored is None:
        return absent("Ablation", "python -m reports.studies.ablation makes it.")
    entries = stored["entries"]
    conditions = list(dict.fromkeys(entry["condition"] for entry in entries))
    by_place = {(entry["row"], entry["condition"]): entry for entry in entries}
    rows_there = list(dict.fromkeys(entry["row"] for entry in entries))
    blocks = []
    for title, reference, wanted in (
        (
            "Removed from the full decoder",
            "full",
            lambda row: row.startswith("full-") or row == "learned",
        ),
        (
            "Added to plain OORC",
            "oorc",
            lambda row: row.startswith("phi+") or row in ("full", "learned"),
        ),
    ):
        if reference not in rows_there:
            continue
        heads: list[object] = ["part"]
        for name in conditions:
            base = by_place[reference, name]
            heads.append(
                join(
                    name,
                    tag("small", f"{reference}: {100 * base['error']:.2f} % wrong"),
                    tag("small", f"{base['bits']:,} bits"),
                )
            )
        rows: list[list[object]] = []
        for row in filter(wanted, rows_there):
            shown = row.removeprefix("full").replace("-", "− ") if row.startswith("full-") else row
            rows.append(
                [shown, *(_loss(by_place[row, c]["against"][reference]) for c in conditions)]
            )
        blocks.append(join(tag("h3", title), table(heads, rows)))
    meta = stored["meta"]
    note = tag(
        "p",
        "Difference in accuracy to the reference on identical captures, points, with the 95 % "
        "interval of a paired bootstrap; green is better beyond it, red worse. Simulated, seed "
        f"{meta['seed']}; not of this run but of ",
        tag("code", meta["command"]),
        ". “learned” is the trained decoder, the other rows are untrained.",
        class_="note",
    )
    return join(note, *blocks)


def _loss(paired: dict[str, Any]) -> Html:
    tint = "good" if paired["low"] > 0 else "bad" if paired["high"] < 0 else None
    between = f"{paired['low']:+.2f} to {paired['high']:+.2f}"
    if paired["frames"] < MIN_FRAMES:
        between, tint = "no interval", None
    return tag("span", f"{paired['difference']:+.2f}", tag("small", between), class_=tint)


def reliability(run: Run) -> Html:
    """Whether scores are the probabilities that they say."""
    conditions = {"main comparison": run.predictions}
    for point in run.sweeps:
        conditions.setdefault("all sweeps", []).extend(point.predictions)
    known = {
        line["method"]
        for lines in conditions.values()
        for line in lines
        if any(bit >= 0 for bit in line["bits"])
    }
    methods = [m for m in run.methods if m in LLR and m in known]
    shared = {
        name: lines
        for name, lines in conditions.items()
        if methods and set(methods) <= {line["method"] for line in lines}
    }
    if not methods or not shared:
        return absent("Reliability", f"It needs known bits and one of {', '.join(LLR)}.")
    curves = pooled(shared, methods)
    figures = []
    for name in shared:
        lines = []
        for method in methods:
            bins = [b for b in curves[method][name] if b.count >= SHOWN_BITS]
            marks = [
                Point(b.confidence, b.accuracy, b.ci_low, b.ci_high, f"{method}: {b.count} bits")
                for b in bins
            ]
            if marks:
                lines.append(Line(method, marks))
        ticks = [(v, f"{v:.1f}") for v in (0.5, 0.6, 0.7, 0.8, 0.9, 1.0)]
        low = [(v, f"{v:.1f}") for v in (0.4, 0.6, 0.8, 1.0)]
        x, y = Axis("confidence", ticks, 0.5, 1.0), Axis("share right", low, 0.4, 1.0)
        count = sum(b.count for b in curves[methods[0]][name])
        figures.append(
            tag(
                "figure",
                tag("h3", name),
                line_chart(f"Reliability, {name}", x, y, lines, diagonal=True),
                tag(
                    "figcaption",
                    f"{count:,} bits of {methods[0]}; bins below {SHOWN_BITS} bits are left out.",
                ),
            )
        )
    rows = [
        [named(m), *(f"{calibration_error(curves[m][name]):.4f}" for name in shared)]
        for m in methods
    ]
    note = tag(
        "p",
        "A decision with log-likelihood ratio s has confidence 1 / (1 + exp(−|s|)); on the dashed "
        "line confidence is kept. Bars are Wilson’s 95 % intervals, as if bits were independent.",
        class_="note",
    )
    error = table(["method", *shared], rows, "Expected calibration error, ten bins of equal width")
    return join(note, tag("div", *figures, class_="grid"), error)
