"""End of a training: the ONNX file, and the comparison on held-out pictures and draws."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
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
from reports.engine.predict import Condition, paper_cells, predict, recorded_conditions
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
    """The held-out observations on which a trained decoder is compared with other methods."""

    title: str
    """Beginning of the tables' titles, which the names of conditions end."""
    conditions: Sequence[Condition]
    """Frame pairs that are decoded; one condition's table stands for itself."""
    methods: Sequence[str]
    """Names of the other methods."""
    in_paper: bool
    """Whether cells may be the paper's, which have patches."""
    seed: int = 0
    """Seed of every random draw."""
    jobs: int = 1
    """Number of processes that decode."""
    captures: str = ""
    """Folder of the own captures; empty where they are simulated."""


def simulated_test(
    name: str,
    pairs: tuple[str, ...],
    layouts: Sequence[Layout],
    frames: int,
    seed: int,
    jobs: int,
) -> FinalTest:
    """Test a decoder on the paper's cells of each of its layouts.

    Args:
        name: word for the pairs, such as "all".
        pairs: names of the camera-display pairs.
        layouts: layouts for which the decoder was trained.
        frames: number of held-out frame pairs in each cell.
        seed: seed of every random draw.
        jobs: number of processes that decode.
    """
    conditions = [
        Condition(words, Source(layout, "test", seed), paper_cells(pairs), frames)
        for words, layout in zip(condition_names(layouts), layouts, strict=True)
    ]
    title = f"{name}: 0° and 45°, κ 5 and 3, held-out pictures and channel draws, simulated"
    patches = not layouts[0].pilots
    return FinalTest(title, conditions, OF_PAIRS if patches else FEW, patches, seed, jobs)


def own_test(captures: Path, own: OwnSet) -> FinalTest:
    """Test a decoder on those of a folder of own captures that were held out."""
    conditions = recorded_conditions(read_manifest(captures), own.held_out)
    patches = not own.test[0].layout.pilots
    return FinalTest("Held-out recordings", conditions, FEW, patches, captures=str(captures))


def export_and_evaluate(
    module: PhiDecoder, test: FinalTest, folder: Path, settings: Mapping[str, object]
) -> str:
    """Export a trained decoder, and compare it with the one before and with other methods.

    Args:
        module: the trained decoder, on the CPU.
        test: what it is compared on.
        folder: holds the checkpoints; takes decoder.onnx and the files of a run.
        settings: settings of the training, which the ONNX file carries.

    Returns:
        a table for each condition, and a line on how well torch and onnxruntime agree.
    """
    model = folder / "decoder.onnx"
    parity = export(module, model, folder.name, PARITY_FRAMES, settings)
    methods = [*methods_for(test.methods, folder), untrained(folder)]
    predicted = predict(test.conditions, methods, folder / PREDICTIONS, Backend(test.jobs))
    if predicted.failed:
        raise InputError(predicted.failed[0])
    records = predicted.records
    tables = [
        held_out_table(mine, "learned", f"{test.title}{name}", in_paper=test.in_paper)
        for name, mine in records.groupby("condition", sort=False)
    ]
    agree = (
        f"{model}: torch and onnxruntime agree on all {parity.bits} bits of {parity.frames} "
        f"synthetic frame pairs, scores within {parity.max_difference:.1e}"
    )
    text = "\n\n".join([*tables, *predicted.left_out, agree])
    stated = {"captures": test.captures} if test.captures else {}
    simulated = not test.captures
    write_page(folder, records, text, settings, test.seed, simulated=simulated, **stated)
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
