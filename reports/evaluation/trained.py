"""What a training ends with: the ONNX file, and the comparison on held-out pictures and draws."""

from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

from data_gen.frame_pair import Source
from export.parity import Parity
from export.to_onnx import export
from link.layout import Layout
from models import DECODERS
from models.neural.decoder import PhiDecoder
from reports.engine.conditions import condition_names
from reports.engine.methods import methods_for
from reports.engine.predict import Condition, paper_cells, predict_all
from reports.engine.provenance import provenance
from reports.render.tables import Table, summary_table
from reports.score.accuracy import score, write_scores

PARITY_FRAMES = 30
"""Number of synthetic frame pairs on which torch and onnxruntime must agree after the export."""
ON_PILOTS = ("naive", "oorc", "learned")
"""Methods that the final evaluation compares on layouts with pilots."""


def export_and_evaluate(
    module: PhiDecoder,
    folder: Path,
    layouts: Sequence[Layout],
    pairs: Sequence[str],
    settings: Mapping[str, object],
    *,
    name: str,
    frames: int,
    seed: int,
    jobs: int,
) -> tuple[list[Table], Parity]:
    """Export a trained decoder, and compare it on the paper's cells of each of its layouts.

    Args:
        module: the trained decoder, on the CPU.
        folder: holds its checkpoint; takes decoder.onnx, metrics.json, and the folder evaluation.
        layouts: for which it was trained.
        pairs: names of camera-display pairs.
        settings: of the training, which the ONNX file carries.
        name: says in the tables' titles which pairs these are, such as "all".
        frames: number of held-out frame pairs in each cell.
        seed: of the evaluation's draws.
        jobs: number of processes.

    Returns:
        a table for each layout, and how well torch and onnxruntime agree.
    """
    conditions = [
        Condition(name, Source(layout, "test", seed), paper_cells(tuple(pairs)), frames)
        for name, layout in zip(condition_names(layouts), layouts, strict=True)
    ]
    methods = methods_for(ON_PILOTS if layouts[0].pilots else tuple(DECODERS), folder)
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:  # torch exports with one thread
        model = folder / "decoder.onnx"
        exported = pool.submit(export, module, model, folder.name, PARITY_FRAMES, settings)
        records = predict_all(conditions, methods, folder / "evaluation", jobs)
        parity = exported.result()
    scores = score(records)
    write_scores(folder / "metrics.json", scores, provenance(seed, simulated=True))
    title = f"{name}: 0° and 45°, κ 5 and 3, held-out pictures and channel draws, simulated"
    tables = []
    for condition in conditions:
        of_condition = scores[scores["condition"] == condition.name]
        if condition.source.layout.pilots:  # the paper printed no such cells
            of_condition = of_condition.assign(paper=float("nan"))
        tables.append(summary_table(of_condition, f"{title}{condition.name}"))
    return tables, parity
