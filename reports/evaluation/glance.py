"""At a glance: who wins, by how much, why, and where it fails."""

from collections.abc import Sequence
from dataclasses import dataclass

from reports.engine.methods import METHODS
from reports.evaluation.findings import (
    PartLoss,
    Standing,
    SweptAccuracy,
    leaders,
    parts_that_pay,
    undecided,
    worst_points,
)
from reports.run import Run
from reports.studies.ablation.results import Ablation

PART_WORDS = {
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
"""Parts of the decoder in words, by their names in rows of the ablation."""
SHOWN_PARTS = 3
"""Largest number of parts of the decoder that are named."""


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
    parts: list[PartLoss]
    """Parts of the decoder without which the stored ablation loses most."""
    failures: list[SweptAccuracy]
    """Values of sweeps at which the best method is said to fail, the worst first."""


def find_glance(
    run: Run,
    ranked: Sequence[Standing],
    swept: Sequence[SweptAccuracy],
    ablation: Ablation | None,
) -> Glance:
    """Gather the findings that stand first on the page.

    Args:
        run: what was decoded; at least one bit of it is known.
        ranked: standings of its methods.
        swept: accuracies of its sweeps.
        ablation: the stored ablation, if there is one.
    """
    by_method = {standing.method: standing for standing in ranked}
    best = leaders(run.records, run.swept)
    return Glance(
        [Winner(by_method[m], undecided(run, m, ranked), is_hidden(run, m)) for m in best],
        parts_that_pay(ablation, SHOWN_PARTS) if ablation else [],
        worst_points(swept, best[0]),
    )


def is_hidden(run: Run, method: str) -> bool:
    """Whether a method of a run was shown equalised pictures without ratex patches."""
    return not run.from_folder and method in METHODS and METHODS[method].hidden
