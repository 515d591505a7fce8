"""Measure again what README.md and docs say: python -m lab.docs --steps all.

Each step is a command whose results are kept in docs/; a step goes on where it was cut off. After
the steps, or alone with ``--steps none``, the marked blocks of README.md and docs are written from
these results. Real photographs and timings are not among the steps: they need pictures that are not
in the repository, or depend on the machine.
"""

import os
import shlex
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import tyro

from data_gen.frame_pair import Source
from data_gen.pairs import PAIRS
from lab.__main__ import STUDIES, find_study
from lab.docs_blocks import BLOCKS
from lab.study import DOCS, keep_blocks, stored_results
from link.cli import check_flags, run_cli
from link.errors import InputError, at_least, choose
from link.layout import make_layout
from models import OF_PAIRS
from models.phi.config import FULL
from reports.engine.backends import Backend
from reports.engine.methods import Method, methods_for
from reports.engine.predict import Condition, paper_cells, predict_all
from reports.engine.provenance import provenance
from reports.render.tables import replace_block
from reports.run import PREDICTIONS
from reports.score.accuracy import score, write_scores

METRICS = DOCS / "metrics.json"
"""Accuracies of all methods in the paper's 36 cells."""
SEED = 0
"""Seed of the accuracies in the paper's cells."""
UNTRAINED = Method("phi", (("config", FULL),), "learned, untrained")
"""The learned decoder with the constants from which its training starts."""


STEPS = {
    "table": "",
    "ablation": "lab ablation --keep",
    "paper": "lab ablation --conditions paper --rows oorc full --frames 170 --label paper --keep",
}
"""Commands by the name of their step, as they follow ``python -m``, in the order in which they are
run; empty for `measure_table`."""
STEPS |= {
    f"rates_{name}": f"lab rates {flags} --keep"
    for name, flags in {
        "fast": "--settings fast --views 0 --runs 6",
        "hidden": "--settings hidden --runs 2",
        "code": '--settings "hidden, 30 fps" "hidden, 60 fps" hidden --n-bytes 100',
        "first": "--settings robust fast paper --n-bytes 100 --runs 2",
        "odd": '--settings "hidden, 24 fps of 50 Hz" "hidden, 25 fps of 75 Hz" "hidden, 29.97 fps '
        'of 72 Hz" "hidden, 50 fps of 60 Hz" "hidden, 59.94 fps of 75 Hz" "hidden, 30 fps, 33 ms" '
        '"hidden, 30 fps, 4 ms" --views 0 --n-bytes 100',
        "others": "--settings robust paper --runs 2",
    }.items()
}


@dataclass(frozen=True)
class ReadmeConfig:
    """Measure again, and rewrite the blocks of README.md and docs."""

    steps: tuple[str, ...] = ("table",)
    """Names of steps in lab/docs.py; "all" takes some hours, "none" writes the blocks
    alone."""
    frames: int = 15
    """Number of frame pairs in each cell of the step "table": one for each test picture."""
    jobs: int = os.cpu_count() or 1
    """Number of processes of the step "table"."""


def main() -> None:
    """Run the steps, keep their results, write the blocks."""
    config = check_flags(tyro.cli(ReadmeConfig, prog="python -m lab.docs"))
    at_least(1, frames=config.frames, jobs=config.jobs)
    whole: dict[tuple[str, ...], tuple[str, ...]] = {("all",): tuple(STEPS), ("none",): ()}
    names = whole.get(config.steps, config.steps)
    for name in names:
        choose(STEPS, name, "step")
    for name in names:
        print(f"step: {name}", flush=True)
        if name == "table":
            measure_table(config)
        else:
            done = subprocess.run([sys.executable, "-m", *shlex.split(STEPS[name])], check=False)
            if done.returncode != 0:
                raise InputError(f"step {name}: python -m {STEPS[name]} failed, as said above")
    for name in STUDIES:
        study = find_study(name)
        if stored_results(study, study.kept):
            keep_blocks(study)
    for marker, block in BLOCKS.items():
        replace_block(block.page, marker, block.render(DOCS))
    pages = dict.fromkeys(str(block.page) for block in BLOCKS.values())
    print(f"written: {', '.join(pages)}")


def measure_table(config: ReadmeConfig) -> None:
    """Decode the paper's 36 cells by every method into docs/metrics.json."""
    source = Source(make_layout(), "test", SEED)
    methods = methods_for(OF_PAIRS)
    methods.insert(OF_PAIRS.index("learned"), UNTRAINED)
    condition = Condition("", source, paper_cells(tuple(PAIRS)), config.frames)
    file = Path("runs/readme") / PREDICTIONS
    records = predict_all([condition], methods, file, Backend(config.jobs))
    write_scores(METRICS, score(records), provenance(SEED, simulated=True))


if __name__ == "__main__":
    run_cli(main)
