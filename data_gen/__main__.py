"""Write simulated captures: python -m data_gen --pair canon-lg --view 45 --kappa 3 --out DIR."""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro
from tqdm import tqdm

from data_gen.flags import CellFlags
from data_gen.frame_pair import FramePair, shuffled_pictures
from link.captures import MANIFEST, save_captures
from link.cli import check_flags, run_cli
from link.errors import ParameterError, at_least
from link.files.lock import locked
from link.frames import Captured
from link.images.quality import psnr, ssim


@dataclass(frozen=True, kw_only=True)
class DataGenConfig(CellFlags):
    """Simulated captures, written in the Captures format (`link.captures`)."""

    out: Path
    """Folder for the PNGs and manifest.jsonl."""
    frames: int = 15
    """Number of frame pairs."""
    hidden: bool = False
    """Show equalised pictures without ratex patches, for hidden_ratex."""


def main() -> None:
    """Simulate, save, and report how visible the message is."""
    config = check_flags(tyro.cli(DataGenConfig, prog="python -m data_gen"))
    at_least(1, frames=config.frames)
    cell = config.cell()
    source = config.source(config.split)
    source.pair(cell.pair)
    shuffled_pictures(source)  # a wrong folder of pictures is refused before any work
    visibility = []

    def captures() -> Iterator[Captured]:
        for index in range(config.frames):
            pair = FramePair(source, cell, index, config.hidden)
            frames = pair.displayed.original, pair.displayed.embedded
            visibility.append((psnr(*frames), ssim(*frames)))
            yield pair.captured
            bar.update()

    with locked(config.out):
        if (config.out / MANIFEST).exists():
            raise ParameterError(
                "out", f"{config.out} already holds captures; choose another folder"
            )
        with tqdm(total=config.frames, unit="pair") as bar:  # an error begins a new line
            count = save_captures(config.out, captures())
    psnr_db, similarity = np.mean(visibility, axis=0)
    report = {"psnr_db": round(psnr_db, 2), "ssim": round(similarity, 4), "simulated": True}
    print(json.dumps({"out": str(config.out), "frame_pairs": count, **report}))


if __name__ == "__main__":
    run_cli(main)
