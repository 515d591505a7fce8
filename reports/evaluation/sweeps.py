"""One parameter of the channel, or of the message, at a time: where each method gives way."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import pandas as pd

from data_gen.channel.optics import CAPTURE_WIDTH, FILL
from data_gen.frame_pair import Cell, Source
from link.layout import make_layout
from reports.engine.predict import Condition
from reports.score.accuracy import pool, score

SWEPT_PAIRS = (
    "canon-imac", "nikon-lg", "sony-samsung", "canon-lg", "nikon-samsung", "sony-imac",
)  # fmt: skip
"""Camera-display pairs of the sweeps: every camera and every display twice; the first three have
each once, and are those of a quick run."""
USUAL_VIEW, USUAL_KAPPA = 45.0, 3
"""Angle of observation in degrees, and gray levels of a bit 1, where a sweep sets nothing else."""


@dataclass(frozen=True)
class Sweep:
    """A quantity and the values that it takes."""

    title: str
    """Heading of the sweep in the report."""
    axis: str
    """Label of the axis, with the unit."""
    values: tuple[float, ...]
    """Values that are decoded."""
    quick: tuple[float, ...]
    """Values that a quick run decodes."""
    note: str = ""
    """Note beside the chart of the sweep."""
    parameter: str = ""
    """Name in data_gen/parameters.py; empty for kappa, the angle and the number of patches."""
    fixed: tuple[tuple[str, Any], ...] = ()
    """(name, value) of parameters that are set at every value."""
    log: bool = False
    """Whether the axis is logarithmic."""
    scale: float = 1.0
    """Factor from a value to its number on the axis."""


SWEEPS: dict[str, Sweep] = {
    "kappa": Sweep(
        "κ, the height of a bit", "κ, gray levels", tuple(range(1, 11)), (1, 2, 3, 5, 10)
    ),
    "angle": Sweep(
        "Viewing angle", "angle, degrees", (0, 10, 20, 30, 45, 60, 70), (0, 30, 45, 60, 70),
        "The camera's exposure makes up for the fall-off of light (metering 1).",
        fixed=(("metering", 1.0),),
    ),
    "drift": Sweep(
        "Exposure drift between the frames", "drift σ, % of exposure",
        (0, 0.01, 0.03, 0.06, 0.1, 0.2), (0, 0.03, 0.1, 0.2),
        "Standard deviation of the change in log exposure.", "drift", scale=100.0,
    ),
    "shift": Sweep(
        "Misregistration of the frames", "shift σ an axis, captured pixels",
        (0, 0.15, 0.3, 0.6, 1, 2), (0, 0.3, 1, 2),
        "Standard deviation; turning and zooming by the same order.", "jitter_px",
    ),
    "noise": Sweep(
        "Noise", "noise, × one native pixel's", (0, 0.5, 1, 2, 4, 8), (0, 1, 4),
        "1 is shot and read noise of a single native pixel of the sensor; cameras pool several.",
        "noise_scale",
    ),
    "jpeg": Sweep(
        "JPEG quality", "quality of libjpeg", (20, 35, 50, 70, 85, 95), (20, 50, 70, 95),
        "", "jpeg_quality",
    ),
    "resolution": Sweep(
        "Capture resolution", "width of the picture at 0°, captured pixels",
        (0.2, 0.25, 0.35, 0.5, 0.7, 1.0), (0.25, 0.5, 1.0),
        "The display shows 512 pixels across 8 blocks. Noise and shift shrink with the image.",
        "resolution", log=True, scale=FILL * CAPTURE_WIDTH,
    ),
    "ratex": Sweep(
        "Ratex patches", "number of patches", (1, 2, 3, 5), (1, 3, 5),
        "Methods that show no patch decode the same captures at every number.",
    ),
}  # fmt: skip
"""Sweeps by name, in the report's order."""


def condition_values(name: str) -> dict[str, float]:
    """Give the values of a sweep, as its axis shows them, by the name of their condition.

    >>> condition_values("drift")["drift 0.03"]
    3.0
    """
    sweep = SWEEPS[name]
    return {f"{name} {value:g}": sweep.scale * value for value in sweep.values}


def sweep_conditions(
    names: Sequence[str], base: Source, frames: int, quick: bool
) -> list[Condition]:
    """Declare the conditions of sweeps, whose names `condition_values` has.

    Args:
        names: keys of `SWEEPS`.
        base: pictures, seed, and parameters that hold in every sweep.
        frames: frame pairs of each camera-display pair at each value.
        quick: fewer values and pairs.
    """
    pairs = SWEPT_PAIRS[:3] if quick else SWEPT_PAIRS
    return [
        _condition(name, value, base, pairs, frames)
        for name in names
        for value in (SWEEPS[name].quick if quick else SWEEPS[name].values)
    ]


def swept_accuracies(records: pd.DataFrame) -> list[tuple[Sweep, pd.DataFrame]]:
    """Pool the predictions at every value of every sweep, by method.

    Args:
        records: predictions of all sweeps.

    Returns:
        each sweep with a known bit, and its rows of `reports.score.accuracy.pool`, by rising
        ``value``, as the axis shows it; methods stand in the order of the predictions.
    """
    pooled = pool(score(records), ["condition", "method"])
    found = []
    for name, sweep in SWEEPS.items():
        values = condition_values(name)
        mine = pooled[pooled["condition"].isin(values) & (pooled["bits"] > 0)]
        if len(mine):
            mine = mine.assign(value=mine["condition"].map(values))
            found.append((sweep, mine.sort_values("value", kind="stable")))
    return found


def _condition(
    name: str, value: float, base: Source, pairs: Sequence[str], frames: int
) -> Condition:
    """One value of a sweep."""
    sweep = SWEEPS[name]
    source = replace(base, parameters=base.parameters + sweep.fixed)
    if sweep.parameter:
        whole = int(value) if value == int(value) else value
        source = replace(source, parameters=(*source.parameters, (sweep.parameter, whole)))
    if name == "ratex":
        shown = base.layout
        usual = make_layout(
            shown.rows, shown.cols, shown.width, shown.height, int(value), shown.modulation
        )
        source = replace(source, layout=usual)
    view = float(value) if name == "angle" else USUAL_VIEW
    kappa = int(value) if name == "kappa" else USUAL_KAPPA
    cells = tuple(Cell(pair, view, kappa) for pair in pairs)
    return Condition(f"{name} {value:g}", source, cells, frames)
