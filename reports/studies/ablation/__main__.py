"""Which switch of the torch decoder pays, and where: python -m reports.studies.ablation --out DIR.

A row adds one switch to plain OORC or removes one from the full decoder; a condition is a setting
of the channel. All rows decode identical captures. Writes ablation.json, which holds the numbers,
ablation.md and ablation.png, which show them, and reliability.md and reliability.png.
"""

import json
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import tyro

from data_gen.frame_pair import Source
from data_gen.pairs import PAIRS
from link.cli import read_flags, run_cli
from link.errors import InputError, at_least, choose, each_once
from link.files.lock import locked
from link.images import write_bytes
from link.layout import make_layout
from models import PRETRAINED
from models.neural.checkpoint import load_checkpoint
from reports.engine.backends import Backend
from reports.engine.conditions import SETTINGS, named_condition
from reports.engine.predict import predict_all
from reports.engine.provenance import provenance
from reports.render.charts import save_png
from reports.render.reliability import reliability_figure, reliability_tables
from reports.render.tables import Table
from reports.score.accuracy import pool, score
from reports.score.paired import COUNTS, cells_behind, compare, tally
from reports.score.reliability import ALL, reliability_curves
from reports.studies.ablation.page import ablation_figure, ablation_tables
from reports.studies.ablation.results import AblationEntry, read_ablation
from reports.studies.ablation.switches import FLOORS, ROWS, WHOLE_DECODERS, row_method

REFERENCES = ("oorc", "full", "ideal")
"""Rows with which every other row is compared, where they are decoded."""


@dataclass(frozen=True)
class AblationConfig:
    """Switches of the torch decoder by conditions, on simulated captures of the test pictures."""

    conditions: tuple[str, ...] = tuple(SETTINGS)
    """Settings of the channel, named in reports/engine/conditions.py."""
    rows: tuple[str, ...] = ROWS
    """Rows, named in reports/studies/ablation/switches.py; the references oorc and full always
    join."""
    learned: bool = True
    """Add the trained decoder."""
    ideal: bool = False
    """Add the floors, under every decoder and under those that do not know the picture. They take
    some ten times as long as all else."""
    pairs: tuple[str, ...] = tuple(PAIRS)
    """Camera-display pairs."""
    frames: int = 20
    """Number of frame pairs in each cell, which is a pair, view and kappa; each has 59 bits."""
    seed: int = 0
    """Seed of messages, channel draws and resamples."""
    run: Path | None = None
    """Checkpoint of the trained decoder: by default the shipped one."""
    out: Path = Path("runs/ablation")
    """Folder for the report and for what is decoded; a run that was cut off goes on from there."""
    jobs: int = os.cpu_count() or 1
    """Number of processes."""


def main() -> None:
    """Decode, compare, write, print."""
    config = read_flags(lambda: tyro.cli(AblationConfig))
    check_flags(config)
    with locked(config.out):
        _run(config)


def _run(config: AblationConfig) -> None:
    """Decode, compare, write, print, while no other process writes the folder."""
    base = Source(make_layout(), "test", config.seed)
    conditions = [
        named_condition(name, base, config.pairs, config.frames) for name in config.conditions
    ]
    rows = [row for row in ROWS if row in ("oorc", "full", *config.rows)]
    rows += ["learned"] if config.learned else []
    rows += FLOORS if config.ideal else []
    methods = [row_method(row, config.run or PRETRAINED) for row in rows]
    records = predict_all(conditions, methods, config.out, Backend(config.jobs))

    meta = provenance(config.seed, simulated=True) | {"settings": asdict(config)}
    content = {"meta": meta, **compare_rows(records, config.seed)}
    numbers = json.dumps(content, indent=1, allow_nan=False, default=_path_text)
    write_bytes(config.out / "ablation.json", f"{numbers}\n".encode())
    ablation = read_ablation(config.out / "ablation.json")
    tables = [f"## {table.markdown()}" for table in ablation_tables(ablation)]
    text = "\n\n".join(["# Ablation", describe_study(config), *tables])
    curves = reliability_curves(records, [row for row in rows if row in WHOLE_DECODERS])
    calibration = "\n\n".join(
        ["# Reliability", *(table.markdown() for table in reliability_tables(curves))]
    )

    out = config.out
    write_bytes(out / "ablation.md", f"{text}\n\n![Ablation](ablation.png)\n".encode())
    write_bytes(out / "reliability.md", f"{calibration}\n\n![Diagram](reliability.png)\n".encode())
    save_png(ablation_figure(ablation), out / "ablation.png")
    names = [condition.name for condition in conditions] + [ALL]
    save_png(reliability_figure(curves, names), out / "reliability.png")
    print(text, calibration, f"written: {out}/ablation.* and reliability.*", sep="\n\n")


def check_flags(config: AblationConfig) -> None:
    """Raise an `InputError` for a wrong flag, before any work."""
    valid: dict[str, Mapping[str, object]] = {
        "conditions": SETTINGS,
        "rows": dict.fromkeys(ROWS),
        "pairs": PAIRS,
    }
    for flag, choices in valid.items():
        names = getattr(config, flag)
        for name in names:
            choose(choices, name, f"name in --{flag}")
        each_once(**{flag: names})
    at_least(1, frames=config.frames, jobs=config.jobs)
    at_least(0, seed=config.seed)
    if config.learned:
        try:
            load_checkpoint(config.run or PRETRAINED)
        except InputError as error:
            raise InputError(f"--run: {error}; or leave it out: --no-learned") from None


def compare_rows(records: pd.DataFrame, seed: int) -> dict[str, list[dict[str, Any]]]:
    """Return the numbers of the ablation, as ablation.json stores them.

    Args:
        records: predictions of all rows in all conditions.
        seed: seed of the resamples, which are the same for every comparison.

    Returns:
        "entries", one `AblationEntry` a condition and row, and "behind_oorc", one for each cell in
        which a decoder to use is behind OORC beyond the paired 95 % interval: row, condition, pair,
        view_deg, kappa and the fields of `Paired`.
    """
    entries, behind = [], []
    for condition, mine in records.groupby("condition", sort=False):
        rows = list(mine["method"].unique())
        for row in pool(score(mine)).itertuples():
            against = {}
            for reference in REFERENCES:
                if reference in rows and reference != row.method:
                    counts = tally(mine, row.method, reference)[COUNTS].to_numpy()
                    against[reference] = compare(counts, np.random.default_rng(seed))
            entries.append(
                AblationEntry(
                    row=row.method,
                    condition=condition,
                    frames=int(row.frames),
                    bits=int(row.bits),
                    errors=int(row.errors),
                    error=row.errors / row.bits,
                    ci_low=1 - row.high,
                    ci_high=1 - row.low,
                    against=against,
                )
            )
        for row in rows:
            if row in WHOLE_DECODERS:
                rng = np.random.default_rng(seed)
                for cell, paired in cells_behind(mine, row, "oorc", rng):
                    place = {
                        "row": row,
                        "condition": condition,
                        "pair": cell["pair"],
                        "view_deg": float(cell["view_deg"]),
                        "kappa": int(cell["kappa"]),
                    }
                    behind.append(place | asdict(paired))
    return {"entries": [asdict(entry) for entry in entries], "behind_oorc": behind}


def describe_study(config: AblationConfig) -> str:
    """Return what the numbers are, as Markdown."""
    bits = config.frames * make_layout().n_bits
    rows = []
    for name in config.conditions:
        setting = SETTINGS[name]
        views = ", ".join(f"{view:g}°" for view in setting.views)
        changed = ", ".join(f"{key} {value:g}" for key, value in setting.parameters) or "fitted"
        rows.append([name, views, ", ".join(map(str, setting.kappas)), changed])
    return "\n\n".join(
        [
            f"Simulated captures, test pictures and channel draws, seed {config.seed}; a cell is a "
            f"pair, view and κ and has {config.frames} frame pairs, {bits:,} bits. Pairs: "
            f"{', '.join(config.pairs)}. By `{provenance(config.seed, True)['command']}`.",
            "An entry is the error in per cent, and in brackets the difference in accuracy to the "
            "reference on identical captures: points, positive is better, with the 95 % interval "
            "of a paired bootstrap over frame pairs"
            + ("; × is the multiple of the ideal observer's errors." if config.ideal else "."),
            Table(["condition", "views", "κ", "channel"], rows, left=4).markdown(),
        ]
    )


def _path_text(value: object) -> str:
    """Write a path of the settings as text; anything else that JSON does not know is an error."""
    if isinstance(value, Path):
        return str(value)
    raise TypeError(f"cannot write {type(value).__name__} as JSON")


if __name__ == "__main__":
    run_cli(main)
