"""Which grid of coded pilots carries most for what is seen of it: python -m lab.grids.

Films of 24 x 32, 48 x 64 and 96 x 128 blocks with the code of `hidden`, kappa 1, at 60 states a
second, before cameras of 30, 60 and 120 frames a second. Windows of film are read by the decoder
that ships, which reads any grid, and frame pairs, where the picture moves, by OORC.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import tyro

from export.film_graph import FilmGraph
from export.send.hiding import Hiding, Onlooker
from lab.films.film import ReferenceDecoder
from lab.films.rates import HIDDEN
from lab.films.trial import FilmReading, Take, film_message
from lab.study import Workshop
from link.cli import read_flags, run_cli
from link.files.lock import locked
from link.presets import PRESETS
from models import FILM_GRAPH
from reports.engine.backends import Backend, one_thread
from reports.score.reliability import binned_information

GRIDS = {"coarse": (24, 32), "usual": (48, 64), "fine": (96, 128)}
"""Rows and columns of blocks by name."""
PRESETS |= {
    name: replace(PRESETS["hidden"], layout=PRESETS["hidden"].changed(rows=rows, cols=cols))
    for name, (rows, cols) in GRIDS.items()
}


@dataclass(frozen=True)
class GridsConfig:
    """Film each grid before each camera."""

    pairs: tuple[str, ...] = ("canon-lg", "nikon-samsung", "sony-imac")
    """Camera-display pairs."""
    views: tuple[float, ...] = (0.0, 45.0)
    """Angles between the camera and the normal of the display, degrees."""
    rates: tuple[float, ...] = (30.0, 60.0, 120.0)
    """Numbers of frames that the camera takes a second."""
    states: int = 150
    """Length of each film, in states of the display."""
    seed: int = 0
    """Seed of every random draw."""
    jobs: int = 2
    """Number of processes that film."""
    out: Path = Path("runs/grids")
    """Folder of the results."""


@dataclass(frozen=True)
class Item:
    """A film of one grid."""

    take: Take
    """The film."""
    seconds: float
    """Its length."""


def read(item: Item) -> dict[str, Any]:
    """Film, read, and say how much is known a second."""
    one_thread()
    take, filmed = item.take, film_message(item.take)
    layout = take.settings.layout
    reading = FilmReading(filmed, ReferenceDecoder(layout), FilmGraph(FILM_GRAPH, 1))
    for frame in filmed.frames:
        if frame.time_s > item.seconds:
            break
        reading.push(frame)
    reading.finish()
    found = reading.delivery()
    told = binned_information(found.bins, found.bits) if found.bits else 0.0
    return {
        "grid": take.settings.preset,
        "fps": take.settings.fps,
        "view": take.view,
        "pair": take.pair,
        "bits": told,
        "pairs_read": found.bits / layout.n_bits,
        "kbit_s": 1e-3 * told * layout.n_bits * take.settings.state_hz / 2,
        "wrong": found.bits_wrong / max(1, found.bits),
    }


def main() -> None:
    """Film all, print a line each."""
    config = read_flags(lambda: tyro.cli(GridsConfig))
    for name in GRIDS:
        layout = PRESETS[name].layout
        seen = [Hiding(layout, 60.0, Onlooker(distance=far)).seen(1) for far in (0.6, 1.0)]
        print(name, layout.n_bits, "bits a pair; contrast at 0.6 and 1 m", np.round(seen, 2))
    items = {}
    for grid in GRIDS:
        for fps in config.rates:
            settings = replace(HIDDEN, preset=grid, fps=fps)
            for view in config.views:
                for pair in config.pairs:
                    take = Take(settings, pair, view, 0, config.seed)
                    items[f"{grid} {fps:g} {take.name}"] = Item(take, config.states / 60.0)
    with locked(config.out):
        found = Workshop(config.out, Backend(config.jobs)).each(read, items, [FILM_GRAPH])
    table = pd.DataFrame(list(found.values()))
    for (grid, fps, view), cell in table.groupby(["grid", "fps", "view"], sort=False):
        values = []
        for name in ("kbit_s", "bits", "wrong"):
            low, middle, high = cell[name].min(), cell[name].median(), cell[name].max()
            values.append(f"{middle:.3f} ({low:.3f}-{high:.3f})")
        read_pairs = cell["pairs_read"].round().tolist()
        print(grid, fps, view, "kbit/s, bits a block, wrong:", *values, "pairs", read_pairs)


if __name__ == "__main__":
    run_cli(main)
