"""Regenerate the README's numbers and pictures: python -m reports.readme (about three minutes)."""

import os
from dataclasses import dataclass
from pathlib import Path

import tyro

from data_gen.dataset import Cell, Source, prepare, simulate
from data_gen.pairs import PAIRS
from link.errors import at_least, run_cli
from link.images import write_image
from link.layout import make_layout
from models import DECODERS, PRETRAINED, make_decoder
from models.neural.decoder import FULL
from reports.compare import Method, decode_cells, methods_for, paper_cells
from reports.delivery import readme_block as delivery_block
from reports.figures import overview, plot_inverse_responses
from reports.metrics import provenance, read_metrics, score, write_metrics
from reports.tables import replace_block, summary_table

METRICS = Path("docs/metrics.json")
DELIVERY = Path("docs/delivery")
"""Copies of what `python -m reports.delivery` writes."""
UNTRAINED = Method("phi", (("config", FULL),), "learned, untrained")


@dataclass(frozen=True)
class ReadmeConfig:
    """The paper's 36 cells with the shipped decoder, and three pictures."""

    frames: int = 15
    """Frame pairs a cell, one a test picture."""
    seed: int = 0
    jobs: int = os.cpu_count() or 1
    checkpoint: Path = PRETRAINED


def readme_table(metrics: Path) -> str:
    """The README's table from stored metrics."""
    rows, meta = read_metrics(metrics)
    frames = {row.frames for row in rows}
    title = (
        f"Simulated: {len({row.pair for row in rows})} camera–display pairs × 0°, 45° × κ 5, 3; "
        f"{frames.pop()} frame pairs a cell, held-out pictures and channel draws, "
        f"seed {meta['seed']}."
    )
    return summary_table(rows, title)


def main() -> None:
    """Decode, score, draw, and rewrite the table in README.md."""
    config = tyro.cli(ReadmeConfig)
    source = Source(make_layout(), "test", config.seed)
    at_least(1, frames=config.frames, jobs=config.jobs)
    methods = methods_for(tuple(DECODERS), config.checkpoint)
    methods.insert(tuple(DECODERS).index("learned"), UNTRAINED)
    cells, folder = paper_cells(tuple(PAIRS)), Path("runs/readme")
    rows = score(decode_cells(source, cells, config.frames, methods, folder, config.jobs))
    write_metrics(METRICS, rows, provenance(config.seed, simulated=True))
    draw_pictures(source, config.checkpoint)
    table = readme_table(METRICS)
    replace_block(Path("README.md"), "table", table)
    replace_block(Path("README.md"), "receiver", delivery_block(DELIVERY))
    print(table)


def draw_pictures(source: Source, checkpoint: Path) -> None:
    """docs/overview.jpg and docs/inverse_response.png."""
    learned = make_decoder("learned", checkpoint=checkpoint)
    cell = Cell("canon-lg", 45.0, 3)
    index = next(i for i in range(15) if prepare(source, cell, i).picture == "photo/astronaut/0")
    captured = simulate(source, cell, index)
    pair = captured.rectified()
    shown = prepare(source, cell, index).displayed.original
    picture = overview(shown, captured, pair, learned.decode(pair))
    write_image(Path("docs/overview.jpg"), picture)
    cases = {}
    for name, view in (("canon-lg", 0.0), ("canon-lg", 45.0), ("canon-samsung", 45.0)):
        pair = simulate(source, Cell(name, view, 5), 0).rectified()
        heads = {}
        for method, decoder in (("oorc", make_decoder("oorc")), ("learned", learned)):
            head = decoder.decode(pair).head
            assert head is not None
            heads[method] = head[: FULL.degree]
        cases[f"{name}, {view:g}°"] = (pair, heads)
    plot_inverse_responses(Path("docs/inverse_response.png"), cases)


if __name__ == "__main__":
    run_cli(main)
