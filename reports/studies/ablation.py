"""Which switch of the torch decoder pays, and where: python -m reports.studies.ablation --out DIR.

Rows add one switch to plain OORC or remove one from the full decoder, columns are conditions, and
all rows see identical captures. Writes ablation.md, .json and .png, and reliability.md and .png.
"""

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tyro

from data_gen.frame_pair import Source
from data_gen.pairs import PAIRS
from link.errors import InputError, at_least, choose, each_once, run_cli
from link.images import write_bytes
from link.layout import make_layout
from models import PRETRAINED
from models.neural.checkpoint import load_checkpoint
from reports.engine.conditions import CONDITIONS, cells, source
from reports.engine.predict import OBSERVERS, decode_cells
from reports.score.metrics import provenance, score
from reports.score.paired import Outcomes, behind, outcomes
from reports.score.reliability import diagram, pooled, reliability_page
from reports.studies.ablation_page import Entry, Standing, against_oorc, measure, plot, tables
from reports.studies.variants import ROWS, method_for

APART = ("learned", *OBSERVERS)
"""Decoded into folders of their own: a new checkpoint costs no other row its results."""
WHOLE = ("full", "learned")
"""Rows that are decoders to use: compared with OORC cell by cell; their scores are LLRs."""


@dataclass(frozen=True)
class AblationConfig:
    """Switches x conditions on simulated captures of the test pictures."""

    conditions: tuple[str, ...] = tuple(CONDITIONS)
    """Columns, of reports/engine/conditions.py."""
    rows: tuple[str, ...] = ROWS
    """Rows, of reports/studies/variants.py; oorc and full, the references, always join."""
    learned: bool = True
    """Add the trained decoder."""
    ideal: bool = False
    """Add the floors, under every decoder and under those that do not know the picture: takes some
    ten times as long as all else."""
    pairs: tuple[str, ...] = tuple(PAIRS)
    """Camera-display pairs."""
    frames: int = 20
    """Frame pairs a cell, which is a pair, view and kappa; each frame pair has 59 bits."""
    seed: int = 0
    run: Path | None = None
    """Checkpoint of the trained decoder: by default the shipped one."""
    out: Path = Path("runs/ablation")
    """Folder for the report, and in it one a condition, from which a cut-off run goes on."""
    jobs: int = os.cpu_count() or 1
    """Processes."""


def main() -> None:
    """Decode, compare, write, print."""
    config = tyro.cli(AblationConfig)
    check(config)
    rows = [row for row in ROWS if row in ("oorc", "full", *config.rows)]
    rows += [row for row in APART if (config.ideal if row in OBSERVERS else config.learned)]
    predictions = {name: decode(config, name, rows) for name in config.conditions}
    entries, standings = [], []
    for name, lines in predictions.items():
        found = outcomes(lines)
        entries += measure(score(lines), found, name, config.seed)
        standings += [stand(config, found, row, name) for row in rows if row in WHOLE]
    text = "\n\n".join(
        ["# Ablation", described(config), tables(entries), against_oorc(entries, standings)]
    )
    curves = pooled(predictions, [row for row in rows if row in WHOLE])
    calibration = f"# Reliability\n\n{reliability_page(curves)}"
    out = config.out
    write_bytes(out / "ablation.md", f"{text}\n\n![Ablation](ablation.png)\n".encode())
    write_bytes(out / "ablation.json", to_json(config, entries, standings))
    write_bytes(out / "reliability.md", f"{calibration}\n\n![Diagram](reliability.png)\n".encode())
    plot(out / "ablation.png", entries)
    diagram(out / "reliability.png", curves)
    print(text, calibration, f"written: {out}/ablation.* and reliability.*", sep="\n\n")


def check(config: AblationConfig) -> None:
    """Refuse wrong flags before any work."""
    valid: dict[str, Mapping[str, object]] = {
        "conditions": CONDITIONS,
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


def decode(config: AblationConfig, condition: str, rows: Sequence[str]) -> list[dict[str, Any]]:
    """Predictions of all rows in one condition; cells that are decoded already are read."""
    chosen = CONDITIONS[condition]
    filmed = source(chosen, Source(make_layout(), "test", config.seed))
    groups = [[row for row in rows if row not in APART], *([row] for row in rows if row in APART)]
    lines = []
    for group in groups:
        folder = config.out / condition / (group[0] if group[0] in APART else "switches")
        methods = [method_for(row, config.run or PRETRAINED) for row in group]
        where = cells(chosen, config.pairs)
        lines += decode_cells(filmed, where, config.frames, methods, folder, config.jobs)
    return lines


def stand(config: AblationConfig, found: Outcomes, row: str, condition: str) -> Standing:
    """Compare a row with OORC in every cell."""
    count = len(cells(CONDITIONS[condition], config.pairs))
    rng = np.random.default_rng(config.seed)
    return Standing(row, condition, count, behind(found, row, "oorc", rng))


def described(config: AblationConfig) -> str:
    """What the numbers are, as Markdown."""
    bits = config.frames * make_layout().n_bits
    lines = [
        f"Simulated captures, test pictures and channel draws, seed {config.seed}; a cell is a "
        f"pair, view and κ and has {config.frames} frame pairs, {bits:,} bits. Pairs: "
        f"{', '.join(config.pairs)}. By `{provenance(config.seed, True)['command']}`.",
        "",
        "An entry is the error in per cent, and in brackets the difference in accuracy to the "
        "reference on identical captures: points, positive is better, with the 95 % interval of a "
        "paired bootstrap over frame pairs"
        + ("; × is the multiple of the ideal observer's errors." if config.ideal else "."),
        "",
        "| condition | views | κ | channel |",
        "|---|---|---|---|",
    ]
    for name in config.conditions:
        condition = CONDITIONS[name]
        views = ", ".join(f"{view:g}°" for view in condition.views)
        changed = ", ".join(f"{key} {value:g}" for key, value in condition.parameters) or "fitted"
        lines.append(f"| {name} | {views} | {', '.join(map(str, condition.kappas))} | {changed} |")
    return "\n".join(lines)


def to_json(
    config: AblationConfig, entries: Sequence[Entry], standings: Sequence[Standing]
) -> bytes:
    """The report as strict JSON: {"meta": ..., "entries": [...], "behind_oorc": [...]}."""
    behind_oorc = [
        {"row": s.row, "condition": s.condition, "pair": pair, "view_deg": view, "kappa": kappa}
        | asdict(paired)
        for s in standings
        for (_, pair, view, kappa), paired in s.behind.items()
    ]
    content = {
        "meta": provenance(config.seed, simulated=True) | {"settings": asdict(config)},
        "entries": [asdict(entry) for entry in entries],
        "behind_oorc": behind_oorc,
    }
    return (json.dumps(content, indent=1, allow_nan=False, default=str) + "\n").encode()


if __name__ == "__main__":
    run_cli(main)
