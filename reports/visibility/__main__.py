"""Tabulate visibility, compare line codes, write docs/visibility.md: python -m reports.visibility.

Everything is computed in about a minute; nothing is stored but the page's blocks and its chart.
"""

from dataclasses import dataclass
from pathlib import Path

import tyro

from link.cli import read_flags, run_cli
from link.errors import ParameterError, at_least
from reports.render.charts import save_png
from reports.render.tables import write_blocks
from reports.visibility.codes import code_figure, code_table, compare_codes
from reports.visibility.presets import check_seconds, kappa_table, preset_table, square_wave_table

KEPT = ("toggle", "hold2", "soft2")
"""Line codes of the table of largest kappas."""


@dataclass(frozen=True)
class VisibilityConfig:
    """Compute the visibility of presets and line codes, and write the page."""

    page: Path = Path("docs/visibility.md")
    """Page whose blocks are written; its chart is put beside it."""
    grid: tuple[int, int] = (48, 64)
    """Rows and columns of the grid on which line codes are compared."""
    limit: float = 1.0
    """Contrast over threshold at which line codes are compared; 1 is just seen."""
    seconds: float = 40.0
    """Length of the random messages, in seconds, at least 1."""
    seed: int = 0
    """Seed of the random messages."""


def main() -> None:
    """Compute, print, and write the blocks and the chart."""
    config = read_flags(lambda: tyro.cli(VisibilityConfig))
    at_least(0, seed=config.seed)
    check_seconds(config.seconds)
    if min(config.grid) < 1:
        raise ParameterError("grid", f"need at least one row and column, got {config.grid}")
    if not config.limit > 0:
        raise ParameterError("limit", f"need a number above 0, got {config.limit}")
    results = compare_codes(config.grid, config.limit, config.seed, config.seconds)
    blocks = {
        "visibility_presets": preset_table(config.seed, config.seconds),
        "visibility_square": square_wave_table(),
        "visibility_kappa": kappa_table(config.seed, config.seconds, KEPT, config.limit),
        "visibility_codes": code_table(results),
    }
    texts = {name: table.markdown() for name, table in blocks.items()}
    for text in texts.values():
        print(text, end="\n\n")
    write_blocks(config.page, texts)
    save_png(code_figure(results), config.page.with_name("visibility_codes.png"))
    print(f"written: {config.page}, {config.page.with_name('visibility_codes.png')}")


if __name__ == "__main__":
    run_cli(main)
