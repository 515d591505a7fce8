"""What turning red against green costs decoders and spares the eye: a block of docs/visibility.md.

python -m reports.visibility.colours

Frame pairs are simulated, at two camera-display pairs and angles, with antipodal blocks and pilots.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import tyro
from joblib import Parallel, delayed

from data_gen.frame_pair import Cell, FramePair, Source
from export.visibility.viewing import COLOUR_LEVELS, PICTURE_LEVELS
from link.cli import read_flags, run_cli
from link.errors import at_least
from link.layout import COLOURS, make_layout
from link.presets import Preset
from models import make_decoder
from reports.render.tables import Table, write_blocks
from reports.visibility.presets import check_seconds, seen_of

GRIDS = {(8, 8): 4, (24, 32): 1}
"""Grids, as rows and columns, and for each by which factor more frame pairs are decoded; coarse
grids have fewer bits a frame pair."""
KAPPAS = {"gray": (3, 5), "chroma": (3, 5, 10)}
"""Kappas by colour direction; the eye takes more of chroma."""
VIEWPOINTS = (("canon-lg", 0.0), ("nikon-samsung", 45.0))
"""Camera-display pairs, and angles of observation in degrees."""
METHODS = ("oorc", "blind", "learned")
"""Decoders that read chroma."""


@dataclass(frozen=True)
class ColoursConfig:
    """Decode frame pairs of both colour directions, and write the table."""

    page: Path = Path("docs/visibility.md")
    """Page whose block is written."""
    frames: int = 6
    """Number of frame pairs of the finest grid for each kappa and camera-display pair."""
    seconds: float = 40.0
    """Length of the random messages whose visibility is worked out, in seconds."""
    seed: int = 0
    """Seed of the messages and of the channel."""
    jobs: int = 1
    """Number of processes."""


@dataclass(frozen=True)
class ColourSetting:
    """A row of the table."""

    grid: tuple[int, int]
    """Number of rows and of columns."""
    colour: str
    """Key of `link.layout.COLOURS`."""
    kappa: int
    """Gray levels by which blocks change."""

    def source(self, seed: int) -> Source:
        """Return held-out pictures, with antipodal blocks and pilots."""
        layout = make_layout(
            *self.grid,
            modulation="antipodal",
            pilots="auto",
            colour=self.colour,
        )
        return Source(layout, "test", seed)

    def right_bits(self, seed: int, viewpoint: tuple[str, float], index: int) -> list[int]:
        """Count the right bits of each of `METHODS` in one frame pair."""
        pair = FramePair(self.source(seed), Cell(*viewpoint, self.kappa), index)
        decided = (make_decoder(name).decode(pair.rectified).bits for name in METHODS)
        return [int((bits == pair.displayed.bits).sum()) for bits in decided]


def all_settings() -> Iterator[ColourSetting]:
    """Give the rows of the table, from top to bottom."""
    for grid in GRIDS:
        for colour in COLOURS:
            for kappa in KAPPAS[colour]:
                yield ColourSetting(grid, colour, kappa)


def colour_row(setting: ColourSetting, config: ColoursConfig, parallel: Parallel) -> list[str]:
    """Work out a row of the table: visibility at 60 states a second, and right bits."""
    layout = setting.source(config.seed).layout
    preset = Preset(layout, setting.kappa, 60, "toggle")
    worst = [
        max(seen_of(preset, config.seed, config.seconds, level=level).mean for level in levels)
        for levels in (PICTURE_LEVELS, COLOUR_LEVELS)
    ]
    frames = range(config.frames * GRIDS[setting.grid])
    bits = len(frames) * layout.n_bits
    shares = []
    for viewpoint in VIEWPOINTS:
        count = partial(setting.right_bits, config.seed, viewpoint)
        right = parallel(delayed(count)(index) for index in frames)
        shares += [f"{100 * sum(each) / bits:.2f}" for each in zip(*right, strict=True)]
    rows, cols = setting.grid
    middle = seen_of(preset, config.seed, config.seconds).mean
    name = [f"{rows} × {cols}", setting.colour, str(setting.kappa)]
    return [*name, *(f"{seen:.2f}" for seen in (middle, *worst)), *shares, f"{bits:,}"]


def main() -> None:
    """Decode, print, and write the block."""
    config = read_flags(lambda: tyro.cli(ColoursConfig))
    at_least(1, frames=config.frames, jobs=config.jobs)
    check_seconds(config.seconds)
    parallel = Parallel(n_jobs=config.jobs)
    rows = [colour_row(setting, config, parallel) for setting in all_settings()]
    heads = ["grid", "colour", "κ", "gray 128", "worst gray", "worst colour"]
    heads += [f"{name}, {pair} {view:g}°" for pair, view in VIEWPOINTS for name in METHODS]
    table = Table([*heads, "bits a cell"], rows, left=2).markdown()
    print(table)
    write_blocks(config.page, {"visibility_colour": table})
    print(f"written: {config.page}")


if __name__ == "__main__":
    run_cli(main)
