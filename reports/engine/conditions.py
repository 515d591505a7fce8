"""Named conditions of the comparison: views, kappas, and parameters of the channel."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from data_gen.frame_pair import Cell, Source
from reports.engine.predict import paper_cells


@dataclass(frozen=True)
class Condition:
    """Cells of the comparison, and what of the channel differs from the fitted one."""

    views: tuple[float, ...]
    """Angles of observation, degrees."""
    kappas: tuple[int, ...]
    """Gray levels added for a bit 1."""
    parameters: tuple[tuple[str, Any], ...] = ()
    """As `Source.parameters`: (name, value) of data_gen/parameters.py."""


CONDITIONS: dict[str, Condition] = {
    "paper": Condition((0.0, 45.0), (5, 3)),
    "kappa1": Condition((45.0,), (1,)),
    "60deg": Condition((60.0,), (3,), (("metering", 1.0),)),
    "70deg": Condition((70.0,), (3,), (("metering", 1.0),)),
    "drift": Condition((0.0, 45.0), (3,), (("drift", 0.1),)),
    "shift": Condition((0.0, 45.0), (3,), (("jitter_px", 1.0),)),
    "jpeg": Condition((0.0, 45.0), (3,), (("jpeg_quality", 70),)),
}
"""By name. ``drift`` and ``jitter_px`` are standard deviations: at 2 sigma ``shift`` is 2 px an
axis. ``metering`` 1 keeps white equally bright at every angle, as an automatic exposure does."""


def cells(condition: Condition, pairs: Sequence[str]) -> list[Cell]:
    """Every pair at every view and kappa of the condition, ordered as `paper_cells`."""
    return paper_cells(pairs, condition.views, condition.kappas)


def source(condition: Condition, base_source: Source) -> Source:
    """The base source with the condition's parameters set after its own.

    Draws depend on seed, split, cell and index alone, so conditions that share a cell show the same
    picture and message from the same pose.
    """
    return replace(base_source, parameters=base_source.parameters + condition.parameters)
