"""Write simulated captures: python -m data_gen --pair canon-lg --view 45 --kappa 3 --out DIR."""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro
from tqdm import tqdm

from data_gen.channel.optics import check_view
from data_gen.effects import parse_settings
from data_gen.frame_pair import Cell, FramePair, Source
from link.captures import MANIFEST, save_captures
from link.embed import check_kappa
from link.errors import ParameterError, at_least, run_cli
from link.frames import Captured
from link.images import make_folder
from link.layout import make_layout
from link.quality import psnr, ssim


@dataclass(frozen=True)
class DataGenConfig:
    """Simulated captures, written in the Captures format (`link.captures`)."""

    out: Path
    """Folder for the PNGs and manifest.jsonl."""
    pair: str = "canon-lg"
    """Camera and display: canon|nikon|sony - imac|lg|samsung."""
    view: float = 0.0
    """Angle of observation, degrees from the display's normal."""
    kappa: int = 5
    """Gray levels of [0, 255] added where a bit is 1."""
    frames: int = 15
    """Number of frame pairs."""
    seed: int = 0
    """Seed of every random draw."""
    split: str = "test"
    """Split whose pictures and channel draws are used: "train" or "test"."""
    pictures: Path | None = None
    """Folder with your own pictures."""
    hidden: bool = False
    """Show equalised pictures without ratex patches, for hidden_ratex."""
    rows: int = 8
    """Rows of message blocks."""
    cols: int = 8
    """Columns of message blocks."""
    width: int = 512
    """Width of the displayed picture, pixels."""
    height: int = 384
    """Height of the displayed picture, pixels."""
    ratex: int = 5
    """Number of ratex patches: 0, 1, 2, 3 or 5."""
    without: tuple[str, ...] = ()
    """Effects of the channel to switch off, such as drift or moire (data_gen/effects.py)."""
    set: tuple[str, ...] = ()
    """Parameters to set, such as drift=0.1 jpeg_quality=70 (data_gen/parameters.py)."""
    pyramid_level: int = 0
    """Add the message at this coarser pyramid level; 0 for plain blocks."""


def main() -> None:
    """Simulate, save, and report how visible the message is."""
    config = tyro.cli(DataGenConfig)
    check_view(config.view, "view")
    check_kappa(config.kappa)
    at_least(1, frames=config.frames)
    at_least(0, seed=config.seed)
    layout = make_layout(config.rows, config.cols, config.width, config.height, config.ratex)
    source = Source(
        layout,
        config.split,
        config.seed,
        config.pyramid_level,
        config.pictures,
        without=config.without,
        parameters=parse_settings(config.set),
    )
    source.pair(config.pair)
    make_folder(config.out)
    if (config.out / MANIFEST).exists():
        raise ParameterError("out", f"{config.out} already holds captures; choose another folder")
    cell = Cell(config.pair, config.view, config.kappa)

    visibility = []

    def captures() -> Iterator[Captured]:
        for index in tqdm(range(config.frames), unit="pair"):
            pair = FramePair(source, cell, index, config.hidden)
            frames = pair.displayed.original, pair.displayed.embedded
            visibility.append((psnr(*frames), ssim(*frames)))
            yield pair.captured

    count = save_captures(config.out, captures())
    psnr_db, similarity = np.mean(visibility, axis=0)
    report = {"psnr_db": round(psnr_db, 2), "ssim": round(similarity, 4), "simulated": True}
    print(json.dumps({"out": str(config.out), "frame_pairs": count, **report}))


if __name__ == "__main__":
    run_cli(main)
