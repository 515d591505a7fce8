"""Reliability of log-likelihood ratios as tables and as a diagram, for docs and the page."""

from collections.abc import Sequence

from matplotlib.figure import Figure

from reports.render.charts import Series, draw_series, in_style, new_panels
from reports.render.tables import Table, number
from reports.score.reliability import BINS, Curves, calibration_error

SHOWN_BITS = 20
"""Bins with fewer bits are left out of the diagram, though not of the error."""
TARGET = 0.02
"""Largest expected calibration error that the trained decoder aims at."""


def calibration_table(curves: Curves, kind: str = "simulated") -> Table:
    """Make the table of the expected calibration error, methods by conditions.

    Args:
        curves: bins by method and condition; a method need not have all conditions.
        kind: word for the captures.
    """
    names = conditions_of(curves)
    rows = []
    for method, by_name in curves.items():
        errors = (calibration_error(by_name[n]) if n in by_name else None for n in names)
        rows.append([method, *(number(error, 4) for error in errors)])
    title = (
        f"Expected calibration error of log-likelihood ratios, {BINS} bins of equal width "
        f"(aim: at most {TARGET:g}; {kind} captures):"
    )
    return Table(["method", *names], rows, title)


def conditions_of(curves: Curves) -> list[str]:
    """List the conditions of curves, in the order in which methods have them."""
    return list(dict.fromkeys(name for by_name in curves.values() for name in by_name))


@in_style
def reliability_figure(curves: Curves, conditions: Sequence[str] | None = None) -> Figure:
    """Draw accuracy against confidence, one panel a condition.

    Args:
        curves: bins by method and condition; a method need not have all conditions.
        conditions: names of the conditions to draw; all by default.
    """
    conditions = conditions_of(curves) if conditions is None else conditions
    figure, panels = new_panels(len(conditions), legend=0.1, title=True)
    for panel, name in zip(panels, conditions, strict=True):
        panel.plot([0.5, 1], [0.5, 1], "--", color="0.6", linewidth=1)
        mine = {method: by_name[name] for method, by_name in curves.items() if name in by_name}
        count = max(sum(b.count for b in bins) for bins in mine.values())
        panel.set(
            xlim=(0.5, 1.0),
            ylim=(0.4, 1.0),
            xlabel="confidence",
            ylabel="share right, 95 % interval",
            title=f"{name}, {count:,} bits",
        )
        series = []
        for method, bins in mine.items():
            shown = [b for b in bins if b.count >= SHOWN_BITS]
            if shown:
                text = f"{method}, error {calibration_error(bins):.3f}"
                x, y = [b.confidence for b in shown], [b.accuracy for b in shown]
                intervals = [(b.ci_low, b.ci_high) for b in shown]
                series.append(Series(method, x, y, intervals, name=text))
        draw_series(panel, series, legend="lower right")
    return figure
