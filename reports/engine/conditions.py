"""Named settings of the channel under which methods are compared."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from data_gen.frame_pair import Source
from link.errors import choose
from link.layout import Layout
from reports.engine.predict import Condition, paper_cells


@dataclass(frozen=True)
class Setting:
    """Views, kappas, and what of the channel differs from the fitted one."""

    words: str
    """The setting in a few words, for tables and sentences."""
    views: tuple[float, ...]
    """Angles of observation, degrees."""
    kappas: tuple[int, ...]
    """Gray levels added for a bit 1."""
    parameters: tuple[tuple[str, Any], ...] = ()
    """(name, value) of parameters of the channel, named in data_gen/parameters.py."""


SETTINGS: dict[str, Setting] = {
    "paper": Setting("the paper’s cells", (0.0, 45.0), (5, 3)),
    "kappa1": Setting("κ 1, 45°", (45.0,), (1,)),
    "60deg": Setting("κ 3, 60°", (60.0,), (3,), (("metering", 1.0),)),
    "70deg": Setting("κ 3, 70°", (70.0,), (3,), (("metering", 1.0),)),
    "drift": Setting("drift σ 10 %", (0.0, 45.0), (3,), (("drift", 0.1),)),
    "shift": Setting("shift σ 1 px", (0.0, 45.0), (3,), (("jitter_px", 1.0),)),
    "jpeg": Setting("JPEG quality 70", (0.0, 45.0), (3,), (("jpeg_quality", 70),)),
}
"""Settings by name. ``drift`` and ``jitter_px`` are standard deviations: at 2 sigma ``shift`` is
2 px an axis. ``metering`` 1 keeps white equally bright at every angle, as automatic exposure does.
"""


def named_condition(name: str, base: Source, pairs: Sequence[str], frames: int) -> Condition:
    """The cells of a named setting.

    Draws depend on seed, split, cell and index alone, so conditions that share a cell show the same
    picture and message from the same pose.

    Args:
        name: a key of `SETTINGS`.
        base: pictures and seed; the setting's parameters are set after its own.
        pairs: camera-display pairs.
        frames: frame pairs of each cell.

    Raises:
        InputError: the name is unknown.
    """
    setting = choose(SETTINGS, name, "condition")
    source = replace(base, parameters=base.parameters + setting.parameters)
    return Condition(name, source, paper_cells(pairs, setting.views, setting.kappas), frames)


def condition_names(layouts: Sequence[Layout]) -> list[str]:
    """Name the conditions of an evaluation, one for each layout; a single one needs no name.

    >>> from link.layout import make_layout
    >>> condition_names([make_layout(), make_layout(24, 32, ratex=0, modulation="antipodal")])
    [', 8 × 8 on_off', ', 24 × 32 antipodal']
    """
    if len(layouts) == 1:
        return [""]
    return [f", {each.rows} × {each.cols} {each.modulation}" for each in layouts]
