"""Compare decoders: python evaluate.py --out DIR, or --quick, or --captures DIR.

Predict, score, render: every frame pair is decoded once to predictions.jsonl, which is scored to
metrics.json and shown beside the paper's numbers in tables and in report.html. --report DIR builds
the page again, --compare A B compares two runs.
"""

import os
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import tyro

from data_gen.channel.optics import check_view
from data_gen.effects import parse_settings
from data_gen.flags import LayoutFlags
from data_gen.frame_pair import Source, shuffled_pictures
from data_gen.pairs import PAIRS
from link.embed import check_kappa
from link.errors import InputError, at_least, choose, each_once, read_flags, run_cli
from link.files.lock import locked
from models import DECODERS, shipped_checkpoint
from reports.engine.backends import make_backend
from reports.engine.methods import METHODS, Method, methods_for, suited_methods
from reports.engine.predict import (
    Condition,
    paper_cells,
    predict,
)
from reports.engine.protocols import PROTOCOLS, apply_protocol
from reports.engine.provenance import provenance
from reports.evaluation.captures import evaluate_folder
from reports.evaluation.evidence import (
    QUICK,
    USUAL,
    Stopwatch,
    simulated_evidence,
)
from reports.evaluation.page import write_report
from reports.evaluation.settings import chosen_sweeps, decisive_settings
from reports.evaluation.versus import compare_runs
from reports.render.annotated import show
from reports.render.tables import cell_tables, summary_table
from reports.run import RunFolder
from reports.score.accuracy import score
from reports.studies.sweeps import SWEEPS, sweep_conditions, swept_methods


@dataclass(frozen=True)
class EvaluateConfig(LayoutFlags):
    """The paper's protocol on simulated captures, or your own captures with --captures."""

    pairs: tuple[str, ...] = tuple(PAIRS)
    """Camera-display pairs."""
    views: tuple[float, ...] = (0.0, 45.0)
    """Angles of observation, degrees."""
    kappas: tuple[int, ...] = (5, 3)
    """Gray levels added for a bit 1."""
    methods: tuple[str, ...] = tuple(DECODERS)
    """Decoders to compare; "ideal" and "ideal_change" are floors under them, slow and
    for the simulation alone (data_gen/ideal.py)."""
    frames: int = 15
    """Frame pairs a cell; the paper has 25 (text) to 75 (15 pictures, 5 messages each)."""
    sweeps: tuple[str, ...] | None = None
    """Sweeps of reports/studies/sweeps.py; by default all beside the paper's 36 cells, and none
    beside others."""
    quick: bool = False
    """At most 4 frame pairs a cell, fewer values a sweep: three minutes on two cores."""
    seed: int = 0
    protocol: str = "fair"
    """How thresholds are set: "fair" (in each frame pair), "paper", or another of
    reports/engine/protocols.py."""
    without: tuple[str, ...] = ()
    """Effects of the channel to switch off, such as drift or moire (data_gen/effects.py)."""
    set: tuple[str, ...] = ()
    """Parameters of the channel, such as drift=0.1 jpeg_quality=70 (data_gen/parameters.py)."""
    out: Path = Path("runs/evaluation")
    """Folder for predictions.jsonl, metrics.json, tables.md and report.html. A run of the same
    settings that was cut off goes on there; a folder that holds another run is refused, and so is
    one that another process is writing."""
    html: bool = True
    """Write report.html, and what it shows beside the predictions."""
    report: Path | None = None
    """Build the report of this finished run again, without decoding; other flags do not count."""
    compare: tuple[Path, Path] | None = None
    """Compare two finished runs on the same captures, the second against the first."""
    captures: Path | None = None
    """Folder of captures, own or simulated, with a manifest.jsonl; replaces the simulation."""
    pictures: Path | None = None
    """Your own pictures, in place of the built-in test pictures."""
    run: Path | None = None
    """Checkpoint of the method "learned": by default the shipped one, trained on all pairs."""
    show: Path | None = None
    """With --captures: folder for annotated pictures, one a frame pair and method."""
    jobs: int = os.cpu_count() or 1
    """Processes."""
    backend: Literal["loky", "dask"] = "loky"
    """Where cells are decoded: processes of this machine, or the workers of a Dask cluster."""
    scheduler: str | None = None
    """With --backend dask: the scheduler's address, such as tcp://host:8786."""


def main() -> None:
    """Decode, score, print; or show what was decoded before."""
    config = read_flags(lambda: tyro.cli(EvaluateConfig))
    if config.report is not None:
        print(f"written: {write_report(config.report)}")
        return
    if config.compare is not None:
        text, page = compare_runs(*config.compare)
        print(f"{text}\n\nwritten: {page}")
        return
    check(config)
    if config.quick:
        config = replace(config, frames=min(config.frames, QUICK.frames))
    checkpoint = config.run or shipped_checkpoint(config.layout())
    methods = apply_protocol(config.protocol, methods_for(config.methods, checkpoint))
    folder = RunFolder(config.out)
    with locked(config.out):
        folder.claim(decisive_settings(config, methods))
        if config.captures is None:
            evaluate_simulated(config, methods, folder)
        else:
            evaluate_folder(config.captures, methods, folder, config.seed, config.html)
            if config.show is not None:
                show(config.captures, methods, config.show)


def evaluate_simulated(config: EvaluateConfig, methods: list[Method], folder: RunFolder) -> None:
    """Compare on simulated captures; raises an `InputError` at the end where cells failed."""
    amount, clock = QUICK if config.quick else USUAL, Stopwatch()
    backend = make_backend(config.backend, config.jobs, config.scheduler)
    cells = paper_cells(config.pairs, config.views, config.kappas)
    comparison = Condition("", source_of(config), cells, config.frames)
    methods, left_out = suited_methods(methods, comparison.source.layout)
    print(*left_out, sep="\n", end="\n" * bool(left_out))
    with clock.time("decoding"):
        predicted = predict([comparison], methods, config.out, backend)
    meta = {**provenance(config.seed, simulated=True), "failed_cells": predicted.failed}
    scores = score(predicted.records)
    kind = "held-out pictures" if config.pictures is None else "your own pictures"
    title = f"All cells (simulated captures, {kind})"
    tables = [table.markdown() for table in (*cell_tables(scores), summary_table(scores, title))]
    folder.write_comparison(predicted.records, meta, "\n\n".join(tables))
    print(*tables, f"written: {config.out}/predictions.jsonl, metrics.json, tables.md", sep="\n\n")
    failed = predicted.failed
    if config.html:
        names, fewer = chosen_sweeps(config, config.sweeps), max(1, 2 * config.frames // 3)
        conditions, curves = sweep_conditions(names, comparison.source, fewer, config.quick)
        with clock.time("sweeps"):
            swept = predict(conditions, swept_methods(methods), config.out, backend)
        folder.write_sweeps(curves, swept.records)
        simulated_evidence(
            folder, [comparison, *conditions], curves, predicted, swept, methods, amount, clock
        )
        failed = [*failed, *swept.failed]
        folder.finish(meta, clock.seconds, [*left_out, *failed])
        print(f"written: {write_report(config.out)}")
    for line in failed:
        print(f"failed: {line}", file=sys.stderr)
    if failed:
        raise InputError(
            f"{len(failed)} cells failed, as listed above; the others are in {config.out}, and the "
            "same command tries the failed ones again"
        )


def check(config: EvaluateConfig) -> None:
    """Refuse wrong flags before any work."""
    for pair in config.pairs:
        source_of(config).pair(pair)
    for kappa in config.kappas:
        check_kappa(kappa, "kappas")
    for name in config.methods:
        choose(METHODS, name, "method")
    for name in config.sweeps or ():
        choose(SWEEPS, name, "sweep")
    for view in config.views:
        check_view(view, "--views")
    at_least(1, frames=config.frames, jobs=config.jobs)
    at_least(0, seed=config.seed)
    make_backend(config.backend, config.jobs, config.scheduler)
    if config.pictures is not None and config.captures is None:
        shuffled_pictures(source_of(config))
    if config.show is not None and config.captures is None:
        raise InputError("--show: draws captures, so it needs --captures")
    each_once(pairs=config.pairs, views=config.views, kappas=config.kappas, methods=config.methods)


def source_of(config: EvaluateConfig) -> Source:
    """Test pictures, and the channel as the flags set it."""
    return Source(
        config.layout(),
        "test",
        config.seed,
        pictures=config.pictures,
        ratex_kappa=choose(PROTOCOLS, config.protocol, "protocol").ratex_kappa,
        without=config.without,
        parameters=parse_settings(config.set),
    )


if __name__ == "__main__":
    run_cli(main)
