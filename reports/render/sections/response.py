"""The CDTF that each method finds, against the true one."""

from reports.evaluation.response import Response
from reports.render.markup import Html, join, table, tag
from reports.render.sections.common import absent, named
from reports.render.svg import (
    Axis,
    Line,
    Point,
    area,
    line_chart,
)
from reports.run import Run


def response(run: Run) -> Html:
    """The response that each method finds against the true one."""
    if not run.responses:
        return absent("CDTF", "It is measured on simulated captures with ratex patches.")
    firsts = [r for r in run.responses if r.index == run.responses[0].index]
    figures = [_response(curve) for curve in firsts]
    methods = list(dict.fromkeys(m for curve in run.responses for m in curve.error))
    keys = list(dict.fromkeys((c.pair, c.view_deg) for c in run.responses))
    rows: list[list[object]] = []
    for pair, view in keys:
        mine = [c for c in run.responses if (c.pair, c.view_deg) == (pair, view)]
        values = [[c.error[m] for c in mine if m in c.error] for m in methods]
        rows.append(
            [f"{pair}, {view:g}°", len(mine)]
            + [f"{sum(v) / len(v):.1f}" if v else "–" for v in values]
        )
    note = tag(
        "p",
        "Black: captured luma of uniform gray frames filmed through the very draw of the frame "
        "pair, without noise; the band holds 80 % of the picture, for the CDTF varies over it. "
        "Coloured: what a method finds from the captured pair, over the range that its ratex tiles "
        "cover. g of oorc and learned is known up to scale and offset, which the tiles set; naive "
        "takes the response for a straight line, and hidden_ratex the picture’s histogram for "
        "uniform. learned goes on from this g in its refinement; "
        "blind and cnn state no g. Simulated.",
        class_="note",
    )
    error = table(
        ["frame pairs of", "n", *map(named, methods)], rows,
        "Root mean square error of the displayed level found, gray levels; mean over frame pairs",
        left=1,
    )  # fmt: skip
    return join(note, tag("div", *figures, class_="grid"), error)


def _response(curve: Response) -> Html:
    ticks = [(v, f"{v:g}") for v in (0.0, 64.0, 128.0, 192.0, 255.0)]
    x, y = Axis("displayed gray level", ticks, 0, 255), Axis("captured", ticks, 0, 255)
    band = area(
        x, y, list(zip(curve.displayed, curve.low, strict=True)),
        list(zip(curve.displayed, curve.high, strict=True)),
    )  # fmt: skip
    true = [Point(a, b, b, b) for a, b in zip(curve.displayed, curve.median, strict=True)]
    lines = [Line("true", true, marked=False, colour="var(--ink)")]
    for method, points in curve.found.items():
        inside = [(d, c) for d, c in points if 0 <= d <= 255]
        if inside:
            lines.append(Line(method, [Point(d, c, c, c) for d, c in inside], marked=False))
    title = f"{curve.pair}, {curve.view_deg:g}°"
    caption = f"κ {curve.kappa}, frame pair {curve.index}"
    return tag(
        "figure", tag("h3", title), line_chart(f"CDTF, {title}", x, y, lines, band=band),
        tag("figcaption", caption),
    )  # fmt: skip
