"""End of a training: the ONNX file, and the comparison on held-out pictures and draws."""

from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pandas as pd

from data_gen.frame_pair import Source
from export.to_onnx import export
from link.captures import read_manifest
from link.errors import InputError
from link.layout import Layout
from models import OF_PAIRS
from models.phi.decoder import PhiDecoder
from reports.captured.training_set import OwnSet
from reports.engine.backends import Backend
from reports.engine.conditions import condition_names
from reports.engine.methods import Method, methods_for
from reports.engine.predict import Condition, paper_cells, predict, predict_all, recorded_conditions
from reports.engine.provenance import provenance
from reports.evaluation.page import write_report
from reports.render.tables import summary_table
from reports.run import PREDICTIONS, RunFolder
from reports.score.accuracy import score
from reports.score.paired import compare_methods

PARITY_FRAMES = 30
"""Number of synthetic frame pairs on which torch and onnxruntime must agree after the export."""
BEFORE = "before"
"""Label of the decoder before training, and name of the folder, in that of the run, that has it."""
FEW = ("naive", "oorc", "learned")
"""Methods that are compared on layouts with pilots, and on own captures."""


@dataclass(frozen=True)
class FinalTest:
    """The held-out frame pairs on which a trained decoder is compared with the other methods."""

    name: str
    """Word of the tables' titles for the pairs, such as "all"."""
    pairs: tuple[str, ...]
    """Names of the camera-display pairs."""
    frames: int
    """Number of held-out frame pairs in each cell."""
    seed: int
    """Seed of every random draw."""
    jobs: int
    """Number of processes that decode."""


def export_and_evaluate(
    module: PhiDecoder,
    layouts: Sequence[Layout],
    test: FinalTest,
    folder: Path,
    settings: Mapping[str, object],
) -> str:
    """Export a trained decoder, and compare it on the paper's cells of each of its layouts.

    Args:
        module: the trained decoder, on the CPU.
        layouts: layouts for which it was trained.
        test: frame pairs on which it is compared.
        folder: holds its checkpoint; takes decoder.onnx, predictions.jsonl and metrics.json.
        settings: settings of the training, which the ONNX file carries.

    Returns:
        a table for each layout, and a line on how well torch and onnxruntime agree.
    """
    conditions = [
        Condition(name, Source(layout, "test", test.seed), paper_cells(test.pairs), test.frames)
        for name, layout in zip(condition_names(layouts), layouts, strict=True)
    ]
    methods = [
        *methods_for(FEW if layouts[0].pilots else OF_PAIRS, folder),
        untrained(folder),
    ]
    model = folder / "decoder.onnx"
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:  # torch exports with one thread
        exported = pool.submit(export, module, model, folder.name, PARITY_FRAMES, settings)
        records = predict_all(conditions, methods, folder / PREDICTIONS, Backend(test.jobs))
        parity = exported.result()
    title = f"{test.name}: 0° and 45°, κ 5 and 3, held-out pictures and channel draws, simulated"
    lines = []
    for condition in conditions:
        mine = records[records["condition"] == condition.name]
        scores = score(mine, in_paper=not condition.source.layout.pilots)
        lines.append(summary_table(scores, f"{title}{condition.name}").markdown())
    lines.append(
        f"\n{model}: torch and onnxruntime agree on all {parity.bits} bits of {parity.frames} "
        f"synthetic frame pairs, scores within {parity.max_difference:.1e}"
    )
    write_page(folder, records, "\n".join(lines), settings, test.seed, simulated=True)
    return "\n".join(lines)


def evaluate_own(
    module: PhiDecoder, captures: Path, own: OwnSet, folder: Path, settings: Mapping[str, object]
) -> str:
    """Export a decoder that was trained on own captures, and compare it on those held out.

    Args:
        module: the trained decoder, on the CPU.
        captures: folder with the captures.
        own: which of them are held out.
        folder: holds the checkpoints; takes decoder.onnx and the files of a run.
        settings: settings of the training, which the ONNX file carries.

    Returns:
        a table, and a line on what training has changed.
    """
    export(module, folder / "decoder.onnx", folder.name, PARITY_FRAMES, settings)
    methods = [*methods_for(FEW, folder), untrained(folder)]
    conditions = recorded_conditions(read_manifest(captures), own.held_out)
    predicted = predict(conditions, methods, folder / PREDICTIONS, Backend())
    if predicted.failed:
        raise InputError(predicted.failed[0])
    records = predicted.records
    text = "\n".join([held_out_table(records, "learned"), *predicted.left_out])
    write_page(folder, records, text, settings, 0, simulated=False, captures=str(captures))
    return text


def untrained(folder: Path) -> Method:
    """Name the decoder as it was before the training of a folder."""
    return Method("learned", (("checkpoint", folder / BEFORE),), BEFORE)


def held_out_table(records: pd.DataFrame, trained: str) -> str:
    """Tabulate held-out captures, and say what training has changed, with its interval.

    Args:
        records: predictions, by `BEFORE` among others.
        trained: label of the trained decoder.
    """
    paired = compare_methods(records, trained, BEFORE, np.random.default_rng(0))
    title = f"Held-out recordings; points and errors of {trained} against {BEFORE}"
    against = {str(m): paired if m == trained else None for m in records["method"].unique()}
    return summary_table(score(records), title, against).markdown()


def write_page(
    folder: Path,
    records: pd.DataFrame,
    tables: str,
    settings: Mapping[str, object],
    seed: int,
    *,
    simulated: bool,
    **stated: str,
) -> None:
    """Write metrics.json, tables.md, run.json and report.html beside a training's predictions."""
    meta = provenance(seed, simulated=simulated)
    run = RunFolder(folder)
    run.settings = dict(settings)
    run.write_comparison(records, meta, tables)
    run.finish(meta, {}, [f"{BEFORE}: the decoder before this training"], **stated)
    write_report(folder)
