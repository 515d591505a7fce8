"""Compare decoders: python evaluate.py --out DIR, or --captures FILM --sent PLAYER.

Predict, score, render: every frame pair is decoded once to predictions.jsonl, which is scored to
metrics.json and shown beside the paper's numbers in tables and in report.html. --report DIR builds
the page again, --compare A B compares two runs. All flags, and their checks, are `EvaluateConfig`
in reports/evaluation/settings.py.
"""

import sys
from dataclasses import replace

import tyro

from data_gen.frame_pair import shuffled_pictures
from data_gen.pairs import pair_names
from link.captures import read_manifest
from link.cli import check_flags, run_cli
from link.errors import InputError
from link.files.lock import locked
from models import DECODERS, OF_PAIRS
from reports.ablation.switches import ROWS, row_method
from reports.benchmark import run_benchmark
from reports.captured.door import open_recordings
from reports.engine.backends import make_backend
from reports.engine.methods import apply_protocol, methods_for
from reports.engine.predict import Condition, paper_cells
from reports.evaluation.comparison import (
    Bench,
    evaluate_folder,
    evaluate_simulated,
    film_conditions,
    film_tables,
)
from reports.evaluation.page import write_report
from reports.evaluation.settings import (
    EvaluateConfig,
    check_settings,
    decisive_settings,
)
from reports.evaluation.versus import compare_runs
from reports.render.annotated import write_annotated
from reports.run import RunFolder

CAPTURES = "captures"
"""Name of the folder, within a run's, that holds the captures cut from one's own recordings."""


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
    check_settings(config)
    backend = make_backend(config.backend, config.jobs, config.scheduler)
    comparisons = compared(config)
    door, entries = None, []
    if config.captures is not None and config.sent is not None:
        meta = {"pair": config.camera, "view_deg": config.view}
        door = open_recordings(config.captures, config.sent, config.photos, meta, config.fps)
    elif config.captures is not None:
        entries = read_manifest(config.captures)
    layouts = door.layouts if door else list(dict.fromkeys(entry.layout for entry in entries))
    films = door.are_windows if door else any(entry.is_window for entry in entries)
    films = films or config.benchmark or bool(config.films)
    if config.methods == OF_PAIRS and films and not config.ablation:
        config = replace(config, methods=tuple(DECODERS))
    rows = [row_method(row, config.run) for row in (*ROWS, "learned")] if config.ablation else []
    methods = apply_protocol(config.protocol, rows or methods_for(config.methods, config.run))
    bench = Bench(methods, RunFolder(config.out), backend, config.html)
    with locked(config.out):
        settings = decisive_settings(config, methods, layouts or [config.layout()])
        bench.folder.claim(settings | ({"recorded": door.digest} if door else {}))
        if config.benchmark:
            failed = run_benchmark(bench)
        elif config.films:
            failed = bench.compare(comparisons, config.seed, film_tables)
        elif config.captures is None:
            failed = evaluate_simulated(bench, comparisons[0])
        else:
            captures = config.out / CAPTURES if door else config.captures
            notes = door.record(captures) if door else []
            failed = evaluate_folder(bench, captures, config.seed, notes)
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


def compared(config: EvaluateConfig) -> list[Condition]:
    """Return what is simulated and compared, or refuse wrong values of its flags.

    Args:
        config: settings; those of the simulation are checked where captures are decoded, too.
    """
    source = config.source()
    for pair in config.pairs:
        source.pair(pair)
    cells = paper_cells(config.pairs, config.views, config.kappas)
    if config.pictures is not None and config.captures is None:
        shuffled_pictures(source)
    if not config.films:
        return [Condition("", source, cells, config.frames)]
    return film_conditions(config.films, config.pairs, config.views, config.frames, config.seed)


if __name__ == "__main__":
    run_cli(main)
