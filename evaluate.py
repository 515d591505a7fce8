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

from data_gen.flags import SourceFlags, own_first
from data_gen.frame_pair import shuffled_pictures
from data_gen.pairs import PAIRS, pair_names
from link.captures import read_manifest
from link.cli import check_flags, run_cli
from link.errors import InputError, at_least, choose, each_once
from link.files.lock import locked
from models import DECODERS, OF_PAIRS
from reports.ablation.switches import ablation_methods
from reports.benchmark import run_benchmark
from reports.captured.door import holds_windows, own_recordings
from reports.engine.backends import Backend, make_backend
from reports.engine.methods import methods_for
from reports.engine.predict import Condition, paper_cells
from reports.engine.protocols import PROTOCOLS, apply_protocol
from reports.evaluation.comparison import (
    compare_on,
    evaluate_folder,
    evaluate_simulated,
    film_conditions,
    film_tables,
)
from reports.evaluation.evidence import QUICK_FRAMES
from reports.evaluation.page import write_report
from reports.evaluation.settings import check_benchmark, chosen_sweeps, decisive_settings
from reports.evaluation.sweeps import SWEEPS
from reports.evaluation.versus import compare_runs
from reports.render.annotated import write_annotated
from reports.run import RunFolder

CAPTURES = "captures"
"""Name of the folder, within a run's, that holds the captures cut from one's own recordings."""


@own_first
@dataclass(frozen=True)
class EvaluateConfig(SourceFlags):
    """The paper's protocol on simulated captures, or your own recordings with --captures."""

    out: Path = Path("runs/evaluation")
    """Folder for predictions.jsonl, metrics.json, tables.md and report.html. If it holds an
    unfinished run of the same settings, that run goes on. A folder that holds another run, or that
    another process is writing, is refused."""
    quick: bool = False
    """Decode at most 4 frame pairs in each cell, and fewer values in each sweep, which takes three
    minutes on two cores."""
    methods: tuple[str, ...] = OF_PAIRS
    """Decoders to compare, or "package.module:Class" for your own (docs/extend.md); by default all
    that read frame pairs, or all decoders where films are decoded. Options follow the name, as in
    oorc:C=0.1."""
    ablation: bool = False
    """Compare the parts of the learned decoder instead of --methods: parts are added to plain OORC,
    and removed from the full decoder (reports/ablation/switches.py)."""
    captures: Path | None = None
    """Decode recordings instead of the simulation: a folder of captures with a manifest.jsonl or,
    with --sent, a film (a video, or a folder of its frames), a folder of several films, or
    photographs."""
    sent: Path | None = None
    """With --captures: what the display showed, which is the player's .html or the folder of states
    that python -m sender wrote. For several films it can be a folder of these, named as the
    films."""
    photos: bool = False
    """With --sent: --captures holds photographs, one of each state in order, once or several
    times."""
    camera: str | None = None
    """With --sent: name of camera and display, by which tables group; by default the name of the
    film."""
    view: Annotated[float | None, tyro.conf.arg(name="view")] = None
    """With --sent: angle between the camera and the display's normal, degrees; by default the
    number before "deg" in the film's name."""
    fps: float | None = None
    """With --sent: frames a second of the films, if their own times are wrong, as in slow
    motion."""
    show: Path | None = None
    """With --captures: folder for annotated pictures, one for each frame pair and method."""
    films: tuple[str, ...] = ()
    """Decode simulated films instead of frame pairs, each named PRESET or PRESET:FPS, such as
    hidden:30. Each cell has --frames films, and one window of each is decoded. Layout and kappa are
    the preset's."""
    pairs: tuple[str, ...] = tuple(PAIRS)
    """Camera-display pairs, or "today" for all of data_gen/today.py."""
    views: tuple[float, ...] = (0.0, 45.0)
    """Angles of observation, degrees."""
    kappas: tuple[int, ...] = (5, 3)
    """Gray levels added for a bit 1."""
    frames: int = 15
    """Number of frame pairs in each cell; the paper has 25 (text) to 75 (15 pictures with 5
    messages each)."""
    sweeps: tuple[str, ...] | None = None
    """Sweeps to add, by their names in reports/evaluation/sweeps.py; by default all of them where
    the paper's 36 cells are compared, and none elsewhere."""
    protocol: str = "fair"
    """Rule for thresholds: "fair" sets them anew in each frame pair, "paper" fixes them as the
    paper does."""
    benchmark: bool = False
    """Compare under the fixed conditions of reports/benchmark.py instead of others, and write
    benchmark.json, by which results of different authors can be compared (docs/benchmark.md)."""
    run: Path | None = None
    """Checkpoint of the method "learned": by default the shipped one for the layout of each frame
    pair, trained on all pairs."""
    report: Path | None = None
    """Build the report of this finished run again, without decoding; all other flags are
    ignored."""
    compare: tuple[Path, Path] | None = None
    """Compare two finished runs on the same captures, the second against the first."""
    html: bool = True
    """Write report.html and the pictures in it; with --no-html, --report can do so later."""
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
        config = replace(config, frames=min(config.frames, QUICK_FRAMES))
    if config.captures is not None and config.layout() != EvaluateConfig().layout():
        raise InputError("--captures: has layouts of its own; leave out the flags of the layout")
    meta = {"photos": config.photos or None, "pair": config.camera, "view_deg": config.view}
    door = own_recordings(config.captures, config.sent, fps=config.fps, **meta)
    if config.ablation and config.methods != OF_PAIRS:
        raise InputError("--ablation: compares parts of one decoder; leave out --methods")
    windows = config.benchmark or config.films or holds_windows(config.captures, door)
    if config.methods == OF_PAIRS and not config.ablation and windows:
        config = replace(config, methods=tuple(DECODERS))
    comparisons, backend = checked_flags(config)
    rows = ablation_methods(config.run) if config.ablation else []
    methods = apply_protocol(config.protocol, rows or methods_for(config.methods, config.run))
    if door is not None:
        layouts = door.layouts
    else:
        entries = read_manifest(config.captures) if config.captures else []
        layouts = list(dict.fromkeys(entry.layout for entry in entries)) or [config.layout()]
    folder = RunFolder(config.out)
    with locked(config.out):
        settings = decisive_settings(config, methods, layouts)
        folder.claim(settings | ({"recorded": door.digest} if door else {}))
        failed = []
        if config.benchmark:
            failed = run_benchmark(methods, folder, backend)
        elif config.films:
            run = (comparisons, methods, folder, backend, config.seed)
            failed = compare_on(*run, film_tables)
        elif config.captures is None:
            sweeps, amount = chosen_sweeps(config, config.sweeps), {"quick": config.quick}
            amount["html"] = config.html
            failed = evaluate_simulated(comparisons[0], methods, folder, backend, sweeps, **amount)
        else:
            captures, notes = config.captures, []
            if door is not None:
                captures = config.out / CAPTURES
                notes = door.record(captures)
            folder_run = (captures, methods, folder, config.seed, backend, config.html)
            failed = evaluate_folder(*folder_run, notes)
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


def checked_flags(config: EvaluateConfig) -> tuple[list[Condition], Backend]:
    """Return what is compared and where it runs, or refuse wrong flags before any work."""
    at_least(1, frames=config.frames, jobs=config.jobs)
    if config.benchmark:
        check_benchmark(config)
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
