"""What a training ends with: the ONNX file, and the comparison on held-out pictures and draws."""

from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

from data_gen.frame_pair import Source
from export.to_onnx import export
from link.layout import Layout
from models import OF_PAIRS
from models.phi.decoder import PhiDecoder
from reports.engine.backends import Backend
from reports.engine.conditions import condition_names
from reports.engine.methods import methods_for
from reports.engine.predict import Condition, paper_cells, predict_all
from reports.engine.provenance import provenance
from reports.render.tables import summary_table
from reports.run import PREDICTIONS
from reports.score.accuracy import score, write_scores

PARITY_FRAMES = 30
"""Number of synthetic frame pairs on which torch and onnxruntime must agree after the export."""
ON_PILOTS = ("naive", "oorc", "learned")
"""Methods that the final evaluation compares on layouts with pilots."""


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
    methods = methods_for(ON_PILOTS if layouts[0].pilots else OF_PAIRS, folder)
    model = folder / "decoder.onnx"
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:  # torch exports with one thread
        exported = pool.submit(export, module, model, folder.name, PARITY_FRAMES, settings)
        records = predict_all(conditions, methods, folder / PREDICTIONS, Backend(test.jobs))
        parity = exported.result()
    scores = score(records)
    write_scores(folder / "metrics.json", scores, provenance(test.seed, simulated=True))
    title = f"{test.name}: 0° and 45°, κ 5 and 3, held-out pictures and channel draws, simulated"
    lines = []
    for condition in conditions:
        of_condition = scores[scores["condition"] == condition.name]
        if condition.source.layout.pilots:  # the paper printed no such cells
            of_condition = of_condition.assign(paper=float("nan"))
        lines.append(summary_table(of_condition, f"{title}{condition.name}").markdown())
    lines.append(
        f"\n{model}: torch and onnxruntime agree on all {parity.bits} bits of {parity.frames} "
        f"synthetic frame pairs, scores within {parity.max_difference:.1e}"
    )
    return "\n".join(lines)
