"""At a glance, and the summary table."""

from collections.abc import Sequence

from reports.render.markup import Html, join, table, tag
from reports.render.sections.common import between, interval, named, percent
from reports.render.svg import (
    Axis,
    Line,
    Point,
    accuracy_axis,
    dot_chart,
)
from reports.run import Run
from reports.score.findings import (
    WELL_READ,
    Standing,
    leaders,
    parts_that_pay,
    undecided,
    worst_points,
)
from reports.score.paired import MIN_FRAMES
from reports.studies.sweeps import spoken

PARTS = {
    "refine": "refinement",
    "register": "registration",
    "rows": "gains by row",
    "space": "calibration over the display",
    "drift": "drift terms",
    "texture": "texture weights",
    "area": "whole tiles",
    "quiet": "least-noise intensity",
    "coarsen": "averaged pixels",
}
PLACES = {
    "paper": "the paper’s cells",
    "kappa1": "κ 1, 45°",
    "60deg": "60°",
    "70deg": "70°",
    "drift": "drift σ 10 %",
    "shift": "shift σ 1 px",
    "jpeg": "JPEG quality 70",
}


def glance(run: Run, ranked: Sequence[Standing]) -> Html:
    """Who wins, by how much, why, and where it fails."""
    first = ranked[0]
    if first.accuracy is None:
        frames = sum(s.frames for s in ranked[:1])
        return tag(
            "p",
            f"The bits of these captures are not known, so nothing can be scored. {frames} frame "
            f"pairs were decoded by {', '.join(s.method for s in ranked)}; the decided bits are "
            "in the pictures below and in predictions.jsonl.",
        )
    best = [next(s for s in ranked if s.method == name) for name in leaders(run)]
    cards = [
        _card("Who wins", *_winners(run, best, ranked)),
        _card("By how much", *_margins(best)),
        _card("Why", *_why(run)),
        _card("Where it fails", *_fails(run, best[0].method)),
    ]
    return tag("div", *cards, class_="cards")


def _card(title: str, head: object, *content: Html) -> Html:
    return tag("div", tag("h3", title), tag("strong", head), *content, class_="card")


def _winners(
    run: Run, best: Sequence[Standing], ranked: Sequence[Standing]
) -> tuple[object, *tuple[Html, ...]]:
    head = [named(best[0].method)]
    parts = []
    for s in best:
        same = undecided(run, s.method, ranked)
        if s is not best[0] and best[0].method in same:
            head.append(named(s.method))
        text = (
            f"{percent(s.accuracy)} % of {s.bits:,} bits right (95 % interval "
            f"{interval(s.low, s.high)}): {s.errors:,} wrong in {s.frames:,} frame pairs"
        )
        rivals = [name for name in same if name not in [other.method for other in best]]
        text += f"; not told apart from it: {', '.join(rivals)}." if rivals else "."
        parts.append(tag("p", tag("b", s.method), f"{_kind(s)}: {text}"))
    if len(best) > 1:
        first, second = best[0].method, best[1].method
        verdict = "are not told apart" if len(head) > 1 else f"differ: {first} is ahead"
        parts.append(
            tag(
                "p",
                f"{first} and {second} {verdict}; their captures differ.",
                class_="note",
            )
        )
    return join(*head, by=" "), *parts


def _kind(s: Standing) -> str:
    """What the method was shown, where methods were shown different things."""
    if "hidden_ratex" in (s.method, s.reference) or s.method == "blind":
        return ", on pictures without a patch"
    return ""


def _margins(best: Sequence[Standing]) -> tuple[object, *tuple[Html, ...]]:
    head = "no reference"
    parts: list[Html] = []
    for s in best:
        against = s.against
        if against is None:
            continue
        text = (
            f"{against.difference:+.2f} points to {s.reference} on the same captures "
            f"({between(against)}; paired bootstrap over {against.frames:,} frame pairs)"
        )
        ratio = f"{s.reference} makes no error"
        if against.ratio is not None:
            ratio = f"{100 * against.ratio:.0f} % of {s.reference}’s errors"
            high = "∞" if against.ratio_high is None else f"{100 * against.ratio_high:.0f}"
            if against.frames >= MIN_FRAMES:
                text += f"; {ratio} ({100 * against.ratio_low:.0f} – {high} %)"
        if not parts:
            head = ratio
        text += f"; behind it in {s.behind} cells." if s.behind is not None else "."
        parts.append(tag("p", tag("b", s.method), ": ", text))
    return head, *(parts or [tag("p", "No method to compare with saw the same captures.")])


def _why(run: Run) -> tuple[object, *tuple[Html, ...]]:
    ablation = run.references.get("ablation")
    losses = parts_that_pay(ablation, 3) if ablation else []
    if not losses:
        return "no ablation stored", tag("p", "python -m reports.studies.ablation makes one.")
    items = [
        tag(
            "li",
            f"without {PARTS.get(part, part)} {-loss['difference']:.1f} points less at "
            f"{PLACES.get(place, place)} ({-loss['high']:.1f} – {-loss['low']:.1f})",
        )
        for part, place, loss in losses
    ]
    note = "Untrained full decoder, the design of learned; stored ablation, simulated, see below."
    head = f"{PARTS.get(losses[0][0], losses[0][0])}, above all"
    return head, tag("ul", *items), tag("p", note, class_="note")


def _fails(run: Run, best: str) -> tuple[object, *tuple[Html, ...]]:
    if not run.sweeps:
        return "no sweeps in this run", tag("p", "See the worst frame pairs below.")
    points = worst_points(run, best)
    if not points:
        return f"nowhere below {100 * WELL_READ:.0f} %", tag("p", f"{best}, of all values swept.")
    items = [
        tag("li", f"{spoken(p.sweep, p.value)}: {percent(share, 1)} % ({interval(low, high, 1)})")
        for p, share, low, high in points[:4]
    ]
    more = len(points) - len(items)
    rest = f"{best} is below {100 * WELL_READ:.0f} % of bits at these values"
    rest += f" and {more} more." if more > 0 else " alone, of all that were swept."
    worst, share, _, _ = points[0]
    head = f"{spoken(worst.sweep, worst.value)}: {percent(share, 0)} %"
    return head, tag("ul", *items), tag("p", rest)


def summary(run: Run, ranked: Sequence[Standing]) -> Html:
    """Methods with intervals, as a table and as dots."""
    heads: list[object] = ["method", "right %", "95 % interval", "wrong of bits"]
    has_reference = any(s.against for s in ranked)
    if has_reference:
        heads += [
            join("points", tag("small", "to the reference")),
            join("× errors", tag("small", "of the reference")),
        ]
    if run.simulated:
        heads.append("paper %")
    rows: list[list[object]] = []
    for s in ranked:
        known = s.accuracy is not None
        row: list[object] = [named(s.method), percent(s.accuracy)]
        row += [
            interval(s.low, s.high) if known else "–",
            f"{s.errors:,} of {s.bits:,}" if known else "–",
        ]
        if has_reference:
            row += _against(s)
        if run.simulated:
            row.append(percent(s.paper))
        rows.append(row)
    scored = [s for s in ranked if s.accuracy is not None]
    chart = Html()
    if scored:
        axis = accuracy_axis(min(s.low for s in scored))
        lines = [
            Line(s.method, [Point(s.accuracy or 0, 0, s.low, s.high, f"{percent(s.accuracy)} %")])
            for s in scored
        ]
        chart = tag(
            "figure", dot_chart("Accuracy of each method with its interval", _thinned(axis), lines)
        )
    conditions = _conditions(run)
    note = tag(
        "p",
        f"{conditions} Intervals know that errors cluster by frame pair. Differences are paired on "
        "identical captures (bootstrap over frame pairs): with patches to oorc, without to "
        "hidden_ratex. Without patches the pictures are equalised and a frame carries 64 bits, so "
        "the two kinds are not paired with each other.",
        class_="note",
    )
    return tag("div", tag("div", table(heads, rows), note), chart, class_="split")


def _thinned(axis: Axis) -> Axis:
    """Fewer ticks, for a short axis."""
    dropped = {"99.5", "98", "70", "95"} if axis.low < 0.9 else {"99.5"}
    kept = [tick for tick in axis.ticks if tick[1] not in dropped]
    return Axis(axis.label, kept, axis.low, axis.high, axis.scale)


def _against(s: Standing) -> list[object]:
    if s.against is None:
        return ["–", "–"]
    ratio = "–" if s.against.ratio is None else f"{s.against.ratio:.2f}"
    high = "∞" if s.against.ratio_high is None else f"{s.against.ratio_high:.2f}"
    span = f"{s.against.ratio_low:.2f} – {high}" if s.against.frames >= MIN_FRAMES else "–"
    return [
        join(f"{s.against.difference:+.2f}", tag("small", between(s.against))),
        join(ratio, tag("small", span)),
    ]


def _conditions(run: Run) -> str:
    if run.from_folder:
        count = len({line["index"] for line in run.predictions})
        return f"{'Simulated' if run.simulated else 'Real'} captures: {count} frame pairs."
    pairs = len({row.pair for row in run.rows})
    views = ", ".join(
        dict.fromkeys(f"{row.view_deg:g}°" for row in run.rows if row.view_deg is not None)
    )
    kappas = ", ".join(dict.fromkeys(str(row.kappa) for row in run.rows))
    frames = ", ".join(sorted({str(row.frames) for row in run.rows}))
    return (
        f"Simulated: {pairs} camera–display pairs × {views or 'unknown angle'} × κ {kappas}; "
        f"{frames} frame pairs a cell, seed {run.about['meta']['seed']}."
    )
