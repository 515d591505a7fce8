"""The comparison of methods on simulated frame pairs, with what the report shows beside it."""

from collections.abc import Sequence

from reports.engine.backends import Backend
from reports.engine.methods import Method, suited_methods
from reports.engine.predict import Condition, predict
from reports.engine.provenance import provenance
from reports.evaluation.evidence import Stopwatch, simulated_pictures, write_responses
from reports.evaluation.sweeps import sweep_conditions, swept_methods
from reports.render.tables import cell_tables, summary_table
from reports.run import PREDICTIONS, SWEPT, RunFolder
from reports.score.accuracy import score


def evaluate_simulated(
    comparison: Condition,
    methods: Sequence[Method],
    folder: RunFolder,
    backend: Backend,
    sweeps: Sequence[str],
    *,
    quick: bool,
    html: bool,
) -> list[str]:
    """Decode, score, print and write.

    Args:
        comparison: cells that are compared.
        methods: methods; those that do not suit are left out, and a line says so.
        folder: folder of the run; its settings are written already.
        backend: where cells are decoded.
        sweeps: names of the sweeps that are measured for the report.
        quick: whether sweeps have fewer values.
        html: whether to measure what report.html shows beside the predictions.

    Returns:
        a line for each cell that failed.
    """
    clock = Stopwatch()
    suited, left_out = suited_methods(methods, comparison.source.layout)
    print(*left_out, sep="\n", end="\n" * bool(left_out))
    with clock.time("decoding"):
        predicted = predict([comparison], suited, folder.path / PREDICTIONS, backend)
    failed = predicted.failed
    meta = {**provenance(comparison.source.seed, simulated=True), "failed_cells": failed}
    scores = score(predicted.records)
    kind = "held-out pictures" if comparison.source.pictures is None else "your own pictures"
    title = f"All cells (simulated captures, {kind})"
    tables = [table.markdown() for table in (*cell_tables(scores), summary_table(scores, title))]
    folder.write_comparison(predicted.records, meta, "\n\n".join(tables))
    print(*tables, f"written: {folder.path}/predictions.jsonl, metrics.json, tables.md", sep="\n\n")
    if html:
        records = predicted.records
        with clock.time("sweeps"):
            fewer = max(1, 2 * comparison.frames // 3)
            conditions = sweep_conditions(sweeps, comparison.source, fewer, quick)
            swept = predict(conditions, swept_methods(suited), folder.path / SWEPT, backend)
        with clock.time("pictures"):
            simulated_pictures(folder, comparison, records, suited)
        with clock.time("responses"):
            write_responses(folder, comparison, suited)
        failed = failed + swept.failed
    folder.finish(meta, clock.seconds, [*left_out, *failed])
    return failed
