"""End of a training: the ONNX file, and the comparison on held-out pictures and draws."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from data_gen.frame_pair import Source
from export.to_onnx import export
from link.errors import InputError
from link.layout import Layout
from models import OF_PAIRS
from models.phi.decoder import PhiDecoder
from reports.engine.backends import Backend
from reports.engine.conditions import condition_names
from reports.engine.methods import Method, methods_for
from reports.engine.predict import Condition, paper_cells, predict
from reports.engine.provenance import provenance
from reports.evaluation.page import write_report
from reports.render.tables import summary_table
from reports.run import PREDICTIONS, RunFolder
from reports.score.accuracy import score
from reports.score.paired import compare_methods

BEFORE = "before"
"""Label of the decoder before training, and name of the folder, in that of the run, that has it."""
FEW = ("naive", "oorc", "learned")
"""Methods that are compared on layouts with pilots, and on own captures."""


def simulated_test(
    pairs: Sequence[str], layouts: Sequence[Layout], frames: int, seed: int
) -> list[Condition]:
    """Make a condition of the paper's cells, held out, for each layout of a trained decoder.

    Args:
        pairs: names of the camera-display pairs.
        layouts: layouts for which the decoder was trained.
        frames: number of held-out frame pairs in each cell.
        seed: seed of every random draw.
    """
    return [
        Condition(words, Source(layout, "test", seed), paper_cells(pairs), frames)
        for words, layout in zip(condition_names(layouts), layouts, strict=True)
    ]


def export_and_evaluate(
    module: PhiDecoder,
    conditions: Sequence[Condition],
    folder: Path,
    settings: Mapping[str, object],
    captures: Path | None,
    seed: int,
    jobs: int,
) -> str:
    """Export a trained decoder, and compare it with the one before and with other methods.

    Args:
        module: the trained decoder, on the CPU.
        conditions: held-out observations, each with a table of its own.
        folder: holds the checkpoints; takes decoder.onnx and the files of a run.
        settings: settings of the training, which the ONNX file carries.
        captures: folder of the own captures; None where they are simulated.
        seed: seed of every random draw.
        jobs: number of processes that decode.

    Returns:
        a table for each condition, and a line on how well torch and onnxruntime agree.
    """
    model = folder / "decoder.onnx"
    parity = export(module, model, folder.name, settings)
    simulated = captures is None
    in_paper = simulated and not module.layout.pilots
    methods = [*methods_for(OF_PAIRS if in_paper else FEW, folder), untrained(folder)]
    predicted = predict(conditions, methods, folder / PREDICTIONS, Backend(jobs))
    if predicted.failed:
        raise InputError(predicted.failed[0])
    records = predicted.records
    title = "Held-out recordings"
    if simulated:
        words = "0° and 45°, κ 5 and 3, held-out pictures and channel draws, simulated"
        title = f"{settings['pair']}: {words}"
    tables = [
        held_out_table(mine, "learned", f"{title}{name}", in_paper=in_paper)
        for name, mine in records.groupby("condition", sort=False)
    ]
    agree = (
        f"{model}: torch and onnxruntime agree on all {parity.bits} bits of {parity.frames} "
        f"synthetic frame pairs, scores within {parity.max_difference:.1e}"
    )
    text = "\n\n".join([*tables, *predicted.left_out, agree])
    stated = {} if simulated else {"captures": str(captures)}
    write_page(folder, records, text, settings, seed, simulated=simulated, **stated)
    return text


def untrained(folder: Path) -> Method:
    """Name the decoder as it was before the training of a folder."""
    return Method("learned", (("checkpoint", folder / BEFORE),), BEFORE)


def held_out_table(
    records: pd.DataFrame,
    trained: str,
    title: str = "Held-out recordings",
    *,
    in_paper: bool = True,
) -> str:
    """Tabulate held-out captures, and say what training has changed, with its interval.

    Args:
        records: predictions, by `BEFORE` among others.
        trained: label of the trained decoder.
        title: beginning of the table's title.
        in_paper: whether cells may be the paper's.
    """
    paired = compare_methods(records, trained, BEFORE, np.random.default_rng(0))
    words = f"{title}; points and errors of {trained} against {BEFORE}"
    against = {str(m): paired if m == trained else None for m in records["method"].unique()}
    return summary_table(score(records, in_paper=in_paper), words, against).markdown()


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
    run = RunFolder(folder, dict(settings))
    run.write_comparison(records, meta, tables)
    run.finish(meta, {}, [f"{BEFORE}: the decoder before this training"], **stated)
    write_report(folder)
