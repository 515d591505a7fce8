"""Film a display that shows a message, and write the frames and the truth about them.

python -m data_gen.video --pair canon-lg --view 45 --kappa 3 --message TEXT --out DIR (or FILE.mkv)
"""

import json
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import tyro
from numpy.typing import NDArray
from tqdm import tqdm
from tyro.conf import OmitArgPrefixes

from data_gen.film.stream import VideoSettings, film
from data_gen.flags import CellFlags
from data_gen.frame_pair import shuffled_pictures
from link.code.framing import encode
from link.errors import ParameterError, at_least, read_flags, run_cli
from link.files.lock import locked
from link.files.together import written_together
from link.images import write_bytes, write_image
from link.loop import Loop
from link.video import write_video

TRUTH = "truth.jsonl"
"""Name of the file, in a folder of frames, that holds the truth about each of them."""

MAX_SHOWN_BYTES = 2**30
"""Largest memory, in bytes, for all states that the display shows."""


@dataclass(frozen=True, kw_only=True)
class FilmConfig(CellFlags):
    """A simulated camera stream of a display that shows a message over and over."""

    out: Path
    """Folder for PNGs named by frame number and truth.jsonl, or a lossless .mkv or .avi, beside
    which the truth lies as .jsonl; in a video file, a lost frame leaves no gap."""
    message: str
    """Text that the display sends."""
    kappa: int = 3
    """Gray levels of [0, 255] added where a bit is 1."""
    shown: int = 1
    """Pictures that the display shows in turn, a frame pair each; 1 for a static picture."""
    first: int = 0
    """Number of the first picture that the display shows."""
    stream: OmitArgPrefixes[VideoSettings] = field(
        default_factory=lambda: VideoSettings(seconds=10.0)
    )
    """Rates, camera, room, and what disturbs the stream; None is drawn at random."""


def main() -> None:
    """Film, and write frames and truth."""
    config = read_flags(lambda: tyro.cli(FilmConfig))
    at_least(0, first=config.first)
    at_least(1, shown=config.shown)
    settings, cell, source = config.stream, config.cell(), config.source()
    seconds = settings.seconds or 0.0
    if not 0 < seconds <= 3600:
        raise ParameterError("seconds", f"need more than 0 and at most 3600, got {seconds:g}")
    shown_bytes = 6 * config.shown * source.layout.width * source.layout.height
    if shown_bytes > MAX_SHOWN_BYTES:
        raise ParameterError(
            "shown",
            f"{config.shown} pictures of this size need {shown_bytes / 2**30:.1f} GiB; "
            f"show fewer, for at most {MAX_SHOWN_BYTES / 2**30:g} GiB",
        )
    if config.out.suffix not in ("", ".mkv", ".avi"):
        raise ParameterError("out", f"need a folder, or a file .mkv or .avi, got {config.out}")
    pair, pictures = source.pair(cell.pair), shuffled_pictures(source)
    chosen = [pictures[(config.first + k) % len(pictures)].rgb for k in range(config.shown)]
    settings = replace(settings, scene=replace(settings.scene, pictures=pictures))
    message = config.message.encode()
    loop = Loop(
        source.layout, cell.kappa, encode(message, source.layout.n_bits), lambda: iter(chosen)
    )
    name = f"film/{config.split}/{cell.pair}/{cell.view_deg:g}"
    rng = np.random.default_rng([config.seed, zlib.crc32(name.encode())])
    stream = film(list(loop.states()), source.layout, pair, cell.view_deg, settings, rng)
    folder = config.out if config.out.suffix == "" else config.out.parent
    truth = folder / TRUTH if config.out.suffix == "" else config.out.with_suffix(".jsonl")
    lines: list[str] = []

    def frames(folder: Path) -> Iterator[NDArray[np.uint8]]:
        for frame in stream:
            file = None if config.out.suffix else f"{frame.number:06d}.png"
            if file:
                write_image(folder / file, frame.rgb)
            lines.append(frame.truth(file))
            yield frame.rgb
            bar.update()

    with locked(folder, truth.name if config.out.suffix else ""):
        if truth.exists():
            raise ParameterError("out", f"{truth} is there already; choose another name")
        with (
            written_together(folder, truth.name) as hidden,
            tqdm(total=int(seconds * settings.fps), unit="frame") as bar,  # errors begin a new line
        ):
            if config.out.suffix:
                write_video(hidden / config.out.name, frames(hidden), settings.fps)
            else:
                for _ in frames(hidden):
                    pass
            write_bytes(hidden / truth.name, ("\n".join(lines) + "\n").encode())
    report = {
        "out": str(config.out),
        "truth": str(truth),
        "camera_frames": len(lines),
        "simulated": True,
        **loop.report(len(message), settings.state_hz),
    }
    print(json.dumps(report))


if __name__ == "__main__":
    run_cli(main)
