"""What each effect of the channel costs each method: switch it off, on the same draws."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from data_gen.effects import EFFECTS
from data_gen.frame_pair import Source
from reports.engine.predict import Condition, paper_cells
from reports.engine.records import FRAME
from reports.render.tables import Table
from reports.score.intervals import Z95

ALL_EFFECTS = "nothing"
"""Name of the condition in which no effect is switched off."""
SKIPPED = ("perspective", "transfer")
"""Effects that stay on: without them there is no oblique view and no transfer function, which is
another problem and not an easier channel."""
STUDIED_PAIRS = ("canon-imac", "nikon-lg", "sony-samsung")
"""Camera-display pairs of the study: every camera and every display once."""
KAPPA = 3
"""Gray levels added for a bit 1 in this study."""


@dataclass(frozen=True)
class Change:
    """What switching off an effect adds to the accuracy, over paired frame pairs."""

    mean: float
    """Mean difference, points."""
    half: float
    """Half of the 95 % interval of the mean over frame pairs, points."""


def effect_conditions(base: Source, frames: int) -> list[Condition]:
    """Declare the study: the whole channel, then one condition for each effect switched off.

    Args:
        base: pictures and seed.
        frames: frame pairs a cell.
    """
    cells = paper_cells(STUDIED_PAIRS, kappas=(KAPPA,))
    whole = Condition(ALL_EFFECTS, base, cells, frames)
    effects = [effect for effect in EFFECTS if effect not in SKIPPED]
    return [
        whole,
        *(replace(whole, name=e, source=replace(base, without=(e,))) for e in effects),
    ]


def paired_change(differences: Sequence[float]) -> Change:
    """Return mean and interval of paired differences, points, of at least two frame pairs.

    >>> paired_change([1.0, 2.0, 3.0])
    Change(mean=2.0, half=1.1315...)
    """
    values = np.asarray(differences, np.float64)
    return Change(float(values.mean()), float(Z95 * values.std(ddof=1) / np.sqrt(values.size)))


def sensitivity_tables(records: pd.DataFrame) -> list[Table]:
    """Return, for each view, the accuracy with all effects, and what switching each off adds.

    Args:
        records: predictions under `effect_conditions`, whose true bits are known.
    """
    methods = list(records["method"].unique())
    effects = [name for name in records["condition"].unique() if name != ALL_EFFECTS]
    points = records.assign(right=100 * (records["correct"] / records["known"])).pivot(
        index=FRAME, columns=["condition", "method"], values="right"
    )
    tables = []
    for view, right in points.groupby("view_deg", sort=False):
        rows = [
            [f"{ALL_EFFECTS}: accuracy %"]
            + [f"{right[ALL_EFFECTS, method].mean():.1f}" for method in methods]
        ]
        for effect in effects:
            changes = [paired_change(right[effect, m] - right[ALL_EFFECTS, m]) for m in methods]
            rows.append([effect, *(f"{c.mean:+.1f} ±{c.half:.1f}" for c in changes)])
        title = f"**{view:g}°**, κ = {KAPPA}, {', '.join(STUDIED_PAIRS)}, {len(right)} frame pairs:"
        tables.append(Table(["switched off", *methods], rows, title))
    return tables
