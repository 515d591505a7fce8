"""At a glance: who wins, by how much, and where it fails."""

from collections.abc import Sequence
from dataclasses import dataclass

from models import DECODERS
from reports.evaluation.findings import (
    Standing,
    SweptAccuracy,
    leaders,
    undecided,
    worst_points,
)
from reports.run import Run


@dataclass(frozen=True)
class Winner:
    """The best method of those that decoded the same captures."""

    standing: Standing
    """Its accuracy and its comparison with the paper's methods."""
    rivals: list[str]
    """Methods that the main comparison does not tell apart from it."""
    hidden: bool
    """Whether it was shown equalised pictures without ratex patches."""


@dataclass(frozen=True)
class Glance:
    """The findings of a run that stand first on its page."""

    winners: list[Winner]
    """The best methods of groups that decoded the same captures, the best first."""
    failures: list[SweptAccuracy]
    """Values of sweeps at which the best method is said to fail, the worst first."""


def find_glance(
    run: Run,
    ranked: Sequence[Standing],
    swept: Sequence[SweptAccuracy],
) -> Glance:
    """Gather the findings that stand first on the page.

    Args:
        run: what was decoded; at least one bit of it is known.
        ranked: standings of its methods.
        swept: accuracies of its sweeps.
    """
    by_method = {standing.method: standing for standing in ranked}
    best = leaders(run.records, run.swept)
    hidden = {m for m in best if not run.from_folder and m in DECODERS and DECODERS[m].equalised}
    return Glance(
        [Winner(by_method[m], undecided(run, m, ranked), m in hidden) for m in best],
        worst_points(swept, best[0]),
    )
