"""Compare decoders: python evaluate.py --out DIR, or --quick, or --captures FILM --sent PLAYER.

Predict, score, render: every frame pair is decoded once to predictions.jsonl, which is scored to
metrics.json and shown beside the paper's numbers in tables and in report.html. --report DIR builds
the page again, --compare A B compares two runs.
"""

import os
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

import tyro

from data_gen.flags import SourceFlags
from data_gen.frame_pair import shuffled_pictures
from data_gen.pairs import PAIRS, pair_names
from link.captures import is_window, read_layouts, read_manifest
from link.cli import check_flags, run_cli
from link.errors import InputError, at_least, choose, each_once
from link.files.lock import locked
from models import DECODERS, OF_PAIRS
from models.film.window import reads_films
from reports.ablation.switches import ROWS, row_method
from reports.captured.door import Recordings, open_recordings
from reports.engine.backends import Backend, make_backend
from reports.engine.methods import Method, methods_for, suited_methods
from reports.engine.predict import Condition, paper_cells, predict
from reports.engine.protocols import PROTOCOLS, apply_protocol
from reports.engine.provenance import provenance
from reports.evaluation.captures import evaluate_folder
from reports.evaluation.evidence import QUICK, USUAL, SimulatedRun, Stopwatch
from reports.evaluation.films import evaluate_films, film_conditions
from reports.evaluation.page import write_report
from reports.evaluation.settings import chosen_sweeps, decisive_settings
from reports.evaluation.sweeps import SWEEPS
from reports.evaluation.versus import compare_runs
from reports.render.annotated import write_annotated
from reports.render.tables import cell_tables, summary_table
from reports.run import PREDICTIONS, RunFolder
from reports.score.accuracy import score

CAPTURES = "captures"
"""Name of the folder, in that of a run, of the captures that were cut from own recordings."""


@dataclass(frozen=True)
class EvaluateConfig(SourceFlags):
    """The paper's protocol on simulated captures, or your own recordings with --captures."""

    pairs: tuple[str, ...] = tuple(PAIRS)
    """Camera-display pairs, or "today" for all of data_gen/today.py."""
    views: tuple[float, ...] = (0.0, 45.0)
    """Angles of observation, degrees."""
    kappas: tuple[int, ...] = (5, 3)
    """Gray levels added for a bit 1."""
    methods: tuple[str, ...] = OF_PAIRS
    """Decoders to compare, or "package.module:Class" for your own (docs/extend.md); by default
    all that read frame pairs, or all where films are decoded. Options stand behind the name, as in
    oorc:C=0.1."""
    ablation: bool = False
    """Compare what each part of the learned decoder is worth in place of --methods: parts are added
    to plain OORC, and removed from the full decoder (reports/ablation/switches.py)."""
    films: tuple[str, ...] = ()
    """Decode simulated films in place of frame pairs: PRESET or PRESET:FPS each, such as hidden:30;
    a window of each of --frames films a cell. Layout and kappa are the preset's."""
    frames: int = 15
    """Number of frame pairs in each cell; the paper has 25 (text) to 75 (15 pictures with 5
    messages each)."""
    sweeps: tuple[str, ...] | None = None
    """Sweeps of reports/evaluation/sweeps.py; by default all beside the paper's 36 cells, and none
    beside others."""
    quick: bool = False
    """At most 4 frame pairs in each cell, and fewer values in each sweep, which takes three
    minutes on two cores."""
    protocol: str = "fair"
    """How thresholds are set: "fair" (in each frame pair), or "paper" (fixed, as the paper has
    them)."""
    out: Path = Path("runs/evaluation")
    """Folder for predictions.jsonl, metrics.json, tables.md and report.html. A run of the same
    settings that was cut off goes on there; a folder that holds another run is refused, and so is
    one that another process is writing."""
    html: bool = True
    """Write report.html, and what it shows beside the predictions; --report builds it later."""
    report: Path | None = None
    """Build the report of this finished run again, without decoding; other flags do not count."""
    compare: tuple[Path, Path] | None = None
    """Compare two finished runs on the same captures, the second against the first."""
    captures: Path | None = None
    """In place of the simulation a folder of captures with a manifest.jsonl; or, with --sent, a
    film (a video, or a folder of its frames), a folder of several, or photographs."""
    sent: Path | None = None
    """With --captures: what the display showed, the player's .html, or the folder of states that
    python -m sender wrote; for several films also a folder of these, named as the films."""
    photos: bool = False
    """With --sent: --captures holds photographs of all states, one of each, in order."""
    camera: str | None = None
    """With --sent: name of camera and display, by which tables group; the film's where absent."""
    view: Annotated[float | None, tyro.conf.arg(name="view")] = None
    """With --sent: angle between camera and the display's normal, degrees; where absent, what
    stands before "deg" in the film's name."""
    fps: float | None = None
    """With --sent: frames a second of the films, in place of what they state."""
    run: Path | None = None
    """Checkpoint of the method "learned": by default the shipped one for the layout of each frame
    pair, trained on all pairs."""
    show: Path | None = None
    """With --captures: folder for annotated pictures, one a frame pair and method."""
    jobs: int = os.cpu_count() or 1
    """Number of processes that decode."""
    backend: Literal["loky", "dask"] = "loky"
    """Where cells are decoded: processes of this machine, or the workers of a Dask cluster."""
    scheduler: str | None = None
    """With --backend dask: the scheduler's address, such as tcp://host:8786."""


def main() -> None:
    """Decode, score, print; or show what was decoded before."""
    config = check_flags(tyro.cli(EvaluateConfig))
    if config.report is not None:
        print(f"written: {write_report(config.report)}")
        return
    if config.compare is not None:
        text, page = compare_runs(*config.compare)
        print(f"{text}\n\nwritten: {page}")
        return
    config = replace(config, pairs=pair_names(config.pairs))
    if config.quick:
        config = replace(config, frames=min(config.frames, QUICK.frames))
    if config.captures is not None and config.layout() != EvaluateConfig().layout():
        raise InputError("--captures: has layouts of its own; leave out the flags of the layout")
    door = opened(config)
    if config.ablation and config.methods != OF_PAIRS:
        raise InputError("--ablation: compares parts of one decoder; leave out --methods")
    if config.methods == OF_PAIRS and not config.ablation and are_windows(config, door):
        config = replace(config, methods=tuple(DECODERS))
    comparisons, backend = checked_flags(config)
    methods = apply_protocol(config.protocol, chosen_methods(config))
    if door is not None:
        layouts = list(dict.fromkeys(sent.layout for _, sent in door.films))
    else:
        layouts = read_layouts(config.captures) if config.captures else [config.layout()]
    folder = RunFolder(config.out)
    with locked(config.out):
        settings = decisive_settings(config, methods, layouts)
        folder.claim(settings | ({"recorded": door.digest} if door else {}))
        failed = []
        if config.films:
            failed = evaluate_films(comparisons, methods, folder, config.seed, backend)
        elif config.captures is None:
            failed = evaluate_simulated(config, comparisons[0], methods, folder, backend)
        else:
            captures, notes = config.captures, []
            if door is not None:
                captures = config.out / CAPTURES
                notes = door.record(captures)
            evaluate_folder(captures, methods, folder, config.seed, backend, config.html, notes)
            if config.show is not None:
                write_annotated(captures, methods, config.show)
        if config.html:
            print(f"written: {write_report(config.out)}")
    for line in failed:
        print(f"failed: {line}", file=sys.stderr)
    if failed:
        raise InputError(
            f"{len(failed)} cells failed, as listed above; the others are in {config.out}, and the "
            "same command tries the failed ones again"
        )


def chosen_methods(config: EvaluateConfig) -> list[Method]:
    """List the methods that --methods names, or the rows of the ablation."""
    if config.ablation:
        return [row_method(row, config.run) for row in (*ROWS, "learned")]
    return methods_for(config.methods, config.run)


def opened(config: EvaluateConfig) -> Recordings | None:
    """Open own films or photographs, where --sent says what was shown."""
    if config.captures is None or config.sent is None:
        for flag in ("sent", "photos", "camera", "view", "fps"):
            if getattr(config, flag) not in (None, False):
                needed = "--captures and --sent" if flag != "sent" else "--captures"
                raise InputError(f"--{flag}: is about own recordings, and needs {needed}")
        return None
    meta = {"pair": config.camera, "view_deg": config.view}
    given = {key: value for key, value in meta.items() if value is not None}
    return open_recordings(
        config.captures, config.sent, photos=config.photos, meta=given, fps=config.fps
    )


def are_windows(config: EvaluateConfig, door: Recordings | None) -> bool:
    """Tell whether windows of film are decoded, which more methods read than frame pairs."""
    if door is not None:
        return not door.photos and any(reads_films(sent.layout) for _, sent in door.films)
    if config.captures is not None:
        return any(map(is_window, read_manifest(config.captures)))
    return bool(config.films)


def evaluate_simulated(
    config: EvaluateConfig,
    comparison: Condition,
    methods: list[Method],
    folder: RunFolder,
    backend: Backend,
) -> list[str]:
    """Compare on simulated captures; return a line for each cell that failed."""
    clock = Stopwatch()
    methods, left_out = suited_methods(methods, comparison.source.layout)
    print(*left_out, sep="\n", end="\n" * bool(left_out))
    with clock.time("decoding"):
        predicted = predict([comparison], methods, config.out / PREDICTIONS, backend)
    failed = predicted.failed
    meta = {**provenance(config.seed, simulated=True), "failed_cells": failed}
    scores = score(predicted.records)
    kind = "held-out pictures" if config.pictures is None else "your own pictures"
    title = f"All cells (simulated captures, {kind})"
    tables = [table.markdown() for table in (*cell_tables(scores), summary_table(scores, title))]
    folder.write_comparison(predicted.records, meta, "\n\n".join(tables))
    print(*tables, f"written: {config.out}/predictions.jsonl, metrics.json, tables.md", sep="\n\n")
    if config.html:
        amount = QUICK if config.quick else USUAL
        run = SimulatedRun(folder, comparison, predicted.records, methods, amount)
        with clock.time("sweeps"):
            swept = run.write_sweeps(chosen_sweeps(config, config.sweeps), config.quick, backend)
        with clock.time("pictures"):
            run.write_pictures(swept)
        with clock.time("responses"):
            run.write_responses()
        with clock.time("cost"):
            run.write_cost()
        failed = failed + swept.failed
    folder.finish(meta, clock.seconds, [*left_out, *failed])
    return failed


def checked_flags(config: EvaluateConfig) -> tuple[list[Condition], Backend]:
    """Return what is compared and where it runs, or refuse wrong flags before any work."""
    at_least(1, frames=config.frames, jobs=config.jobs)
    each_once(methods=config.methods)
    for name in config.sweeps or ():
        choose(SWEEPS, name, "sweep")
    choose(PROTOCOLS, config.protocol, "protocol")
    backend = make_backend(config.backend, config.jobs, config.scheduler)
    source = config.source()
    for pair in config.pairs:
        source.pair(pair)
    cells = paper_cells(config.pairs, config.views, config.kappas)
    if config.pictures is not None and config.captures is None:
        shuffled_pictures(source)
    if config.captures is not None and config.layout() != EvaluateConfig().layout():
        raise InputError("--captures: has layouts of its own; leave out the flags of the layout")
    if config.show is not None and config.captures is None:
        raise InputError("--show: draws captures, so it needs --captures")
    if not config.films:
        return [Condition("", source, cells, config.frames)], backend
    if config.captures is not None:
        raise InputError("--films: are simulated; leave out --captures")
    films = film_conditions(config.films, config.pairs, config.views, config.frames, config.seed)
    return films, backend


if __name__ == "__main__":
    run_cli(main)
