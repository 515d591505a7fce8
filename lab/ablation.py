"""Measure what each switch of the torch decoder is worth, and under which conditions.

A row adds one switch to plain OORC or removes one from the full decoder; a condition is a setting
of the channel. All rows decode identical captures.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pandas as pd
from matplotlib.figure import Figure

from data_gen.frame_pair import Source
from data_gen.pairs import PAIRS
from lab.study import Results, Study, StudyFlags, Workshop
from link.errors import InputError, at_least, each_known
from link.layout import make_layout
from models.phi.checkpoint import load_checkpoint
from reports.ablation.page import ablation_figure, ablation_tables
from reports.ablation.results import Ablation, compare_rows
from reports.ablation.switches import ROWS, WHOLE_DECODERS, row_method
from reports.engine.conditions import SETTINGS, named_condition
from reports.render.reliability import calibration_table, reliability_figure
from reports.render.tables import Table
from reports.score.reliability import ALL, reliability_curves

FIRST = "kappa1"
"""Condition of the small picture: a faint bit, seen from the side."""


@dataclass(frozen=True)
class AblationFlags(StudyFlags):
    """Switches of the torch decoder by conditions, on simulated captures of the test pictures."""

    conditions: tuple[str, ...] = tuple(SETTINGS)
    """Settings of the channel, named in reports/engine/conditions.py."""
    rows: tuple[str, ...] = ROWS
    """Rows, named in reports/ablation/switches.py; the references oorc and full always
    join, and the trained decoder."""
    pairs: tuple[str, ...] = tuple(PAIRS)
    """Camera-display pairs."""
    frames: int = 20
    """Number of frame pairs in each cell, which is a pair, view and kappa; each has 59 bits."""
    run: Path | None = None
    """Checkpoint of the trained decoder: by default the shipped one."""
    label: str = "ablation"
    """Name of the results, which tells apart those of other rows and conditions."""


def check_ablation(flags: AblationFlags) -> None:
    """Raise an `InputError` for a wrong flag, before any work."""
    each_known(SETTINGS, conditions=flags.conditions)
    each_known(ROWS, rows=flags.rows)
    each_known(PAIRS, pairs=flags.pairs)
    at_least(1, frames=flags.frames)
    if not flags.label or Path(flags.label).name != flags.label:
        raise InputError(f"--label: need a name without slashes, got {flags.label!r}")
    if flags.run is not None:
        try:
            load_checkpoint(flags.run)
        except InputError as error:
            raise InputError(f"--run: {error}") from None


def measure_ablation(flags: AblationFlags, workshop: Workshop) -> Ablation:
    """Decode all conditions by all rows, and compare."""
    base = Source(make_layout(), "test", flags.seed)
    conditions = [
        named_condition(name, base, flags.pairs, flags.frames) for name in flags.conditions
    ]
    rows = [*(row for row in ROWS if row in ("oorc", "full", *flags.rows)), "learned"]
    methods = [row_method(row, flags.run) for row in rows]
    records = workshop.predict(conditions, methods)
    entries = compare_rows(records, flags.seed)
    twice = pd.concat([records, records.assign(condition=ALL)])
    curves = reliability_curves(twice, WHOLE_DECODERS)
    return Ablation(entries, curves)


def ablation_blocks(results: Mapping[str, Results[Ablation]]) -> dict[str, str]:
    """Show the ablation of the label "ablation", or else of the only one there is."""
    shown = results.get("ablation") or next(iter(results.values()))
    ablation = shown.content
    tables = [f"## {table.markdown()}" for table in ablation_tables(ablation)]
    blocks = {"ablation": describe_study(shown.meta), "parts": "\n\n".join(tables)}
    if ablation.curves:
        blocks["reliability"] = calibration_table(ablation.curves).markdown()
    return blocks


def ablation_pictures(results: Mapping[str, Results[Ablation]]) -> dict[str, Figure]:
    """Draw the paired differences, and the diagram of reliability where it was measured.

    The picture "ablation_first.png" has the condition `FIRST` alone, for narrow pages.
    """
    ablation = (results.get("ablation") or next(iter(results.values()))).content
    first = [entry for entry in ablation.entries if entry.condition == FIRST]
    pictures = {"ablation.png": ablation_figure(ablation)}
    if first:
        pictures["ablation_first.png"] = ablation_figure(replace(ablation, entries=first))
    if ablation.curves:
        names = [*dict.fromkeys(entry.condition for entry in ablation.entries), ALL]
        pictures["reliability.png"] = reliability_figure(ablation.curves, names)
    return pictures


def describe_study(meta: Mapping[str, Any]) -> str:
    """Describe the numbers in Markdown, from the provenance in a file of results."""
    flags = meta["flags"]
    bits = flags["frames"] * make_layout().n_bits
    rows = []
    for name in flags["conditions"]:
        setting = SETTINGS[name]
        cells = len(flags["pairs"]) * len(setting.views) * len(setting.kappas)
        views = ", ".join(f"{view:g}°" for view in setting.views)
        changed = ", ".join(f"`{key}={value:g}`" for key, value in setting.parameters) or "nothing"
        kappas = ", ".join(map(str, setting.kappas))
        rows.append([setting.words, name, views, kappas, changed, f"{cells * bits:,}"])
    heads = ["condition", "its name", "views", "κ", "changed by `--set`", "bits"]
    return "\n\n".join(
        [
            f"Simulated captures of {len(flags['pairs'])} pairs, test pictures and channel draws, "
            f"seed {meta['seed']}; {flags['frames']} frame pairs a cell. By `{meta['command']}`.",
            Table(heads, rows, left=5).markdown(),
        ]
    )


STUDY = Study(
    name="ablation",
    flags=AblationFlags,
    content=Ablation,
    measure=measure_ablation,
    blocks=ablation_blocks,
    page=Path("docs/results.md"),
    printed_alone=frozenset({"parts"}),
    pictures=ablation_pictures,
    check=check_ablation,
    label=lambda flags: flags.label,
)
"""The study that `python -m lab ablation` runs."""
