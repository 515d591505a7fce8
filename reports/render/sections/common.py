"""What the sections share: numbers as text, and the line for what is missing."""

from reports.render.markup import Html, join, tag
from reports.render.svg import (
    colour_of,
)
from reports.score.paired import MIN_FRAMES, Paired


def absent(what: str, how: str) -> Html:
    """What stands in place of a section without data."""
    return tag("p", f"{what}: not in this run. {how}", class_="none")


def percent(value: float | None, digits: int = 2) -> str:
    """Of a share in [0, 1]."""
    return "–" if value is None else f"{100 * value:.{digits}f}"


def interval(low: float, high: float, digits: int = 2) -> str:
    """Of two shares in [0, 1]."""
    return f"{100 * low:.{digits}f} – {100 * high:.{digits}f}"


def named(method: str) -> Html:
    """A method's name behind a dot of its colour."""
    return join(tag("span", class_="key", style=f"--c:{colour_of(method)}"), method)


def between(paired: Paired) -> str:
    """Interval of a difference, points."""
    if paired.frames < MIN_FRAMES:
        return f"no interval from {paired.frames} frame pairs"
    return f"{paired.low:+.2f} to {paired.high:+.2f}"
