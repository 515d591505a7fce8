"""Film a display that shows a message, and write the frames and the truth about them.

python -m data_gen.video --pair canon-lg --view 45 --kappa 3 --message TEXT --out DIR (or FILE.mkv)
"""

import json
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
import tyro
from numpy.typing import NDArray
from tqdm import tqdm

from data_gen.channel.optics import check_view
from data_gen.effects import parse_settings
from data_gen.film.scenes import SceneSettings
from data_gen.film.stream import VideoSettings, film
from data_gen.frame_pair import Source, shuffled_pictures
from link.code.framing import encode
from link.embed import check_kappa
from link.errors import ParameterError, at_least, run_cli
from link.images import make_folder, write_bytes, write_image
from link.layout import make_layout
from link.loop import Loop
from link.video import write_video

TRUTH = "truth.jsonl"
"""Name of the file, in a folder of frames, that holds the truth about each of them."""


@dataclass(frozen=True)
class FilmConfig:
    """A simulated camera stream of a display that shows a message over and over."""

    out: Path
    """Folder for PNGs named by frame number and truth.jsonl, or a lossless .mkv or .avi, beside
    which the truth lies as .jsonl; in a video file, a lost frame leaves no gap."""
    message: str
    """Text that the display sends."""
    pair: str = "canon-lg"
    """Camera and display: canon|nikon|sony - imac|lg|samsung."""
    view: float = 0.0
    """Angle of observation, degrees from the display's normal."""
    kappa: int = 3
    """Gray levels of [0, 255] added where a bit is 1."""
    fps: float = 30.0
    """Camera frames a second."""
    state_hz: float = 15.0
    """States that the display shows a second: original, embedded, original, ..."""
    seconds: float = 10.0
    """Length of the stream, seconds."""
    seed: int = 0
    """Seed of every random draw."""
    split: str = "test"
    """Split whose pictures and draws are used: "train" or "test"."""
    pictures: Path | None = None
    """Folder with your own pictures."""
    shown: int = 1
    """Pictures that the display shows in turn, a frame pair each; 1 for a static picture."""
    first: int = 0
    """Number of the first picture that the display shows."""
    size: tuple[int, int] = (1280, 720)
    """Width and height of a camera frame, pixels."""
    coverage: float | None = None
    """Share of the image that the picture covers, 0.05 to 0.9; drawn where absent."""
    turn: float | None = None
    """Rotation of the camera about its axis, degrees; drawn where absent."""
    room: str | None = None
    """Light of the room: "dark", "office" or "bright"; drawn where absent."""
    second_display: bool | None = None
    """Whether another lit display stands beside; drawn where absent."""
    hand: float = 1.0
    """Motion of the hand relative to the usual; 0 for a tripod."""
    clock_error: float | None = None
    """Share by which the camera's second is longer; drawn within ±0.01 where absent."""
    start_s: float | None = None
    """Time of the loop, seconds, at which the camera joins; drawn where absent."""
    jumps_hz: float = 0.0
    """Jumps of the exposure a second."""
    drop: float = 0.0
    """Probability that a camera frame is lost."""
    duplicate: float = 0.0
    """Probability that a camera frame repeats the one before."""
    passer_s: tuple[float, float] | None = None
    """Times, seconds, between which someone crosses the image."""
    away_s: tuple[float, float] | None = None
    """Times, seconds, between which the camera looks elsewhere."""
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
    """Parameters of the channel to set, such as metering=1 glare=0.1 (data_gen/parameters.py)."""


def chosen_settings(config: FilmConfig, source: Source) -> VideoSettings:
    """Return the stream that the command line asks for, in a room with the source's pictures."""
    names = {entry.name for entry in fields(VideoSettings)} & {f.name for f in fields(config)}
    try:
        scene = SceneSettings(
            size=config.size,
            coverage=config.coverage,
            turn_deg=config.turn,
            room=config.room,
            second_display=config.second_display,
            pictures=shuffled_pictures(source),
            free=0.03,
        )
    except ParameterError as error:
        flag = {"turn_deg": "turn"}.get(error.parameter, error.parameter)
        raise ParameterError(flag, error.problem) from None
    return VideoSettings(scene=scene, **{name: getattr(config, name) for name in names})


def main() -> None:
    """Film, and write frames and truth."""
    config = tyro.cli(FilmConfig)
    check_view(config.view, "view")
    kappa = check_kappa(config.kappa)
    at_least(0, seed=config.seed, first=config.first)
    at_least(1, shown=config.shown)
    if not 0 < config.seconds <= 3600:
        raise ParameterError(
            "seconds", f"need more than 0 and at most 3600, got {config.seconds:g}"
        )
    if config.out.suffix not in ("", ".mkv", ".avi"):
        raise ParameterError("out", f"need a folder, or a file .mkv or .avi, got {config.out}")
    layout = make_layout(config.rows, config.cols, config.width, config.height, config.ratex)
    source = Source(
        layout,
        config.split,
        config.seed,
        pictures=config.pictures,
        without=config.without,
        parameters=parse_settings(config.set),
    )
    pair, settings = source.pair(config.pair), chosen_settings(config, source)
    chosen = [
        settings.scene.pictures[(config.first + k) % len(settings.scene.pictures)].rgb
        for k in range(config.shown)
    ]
    bits = encode(config.message.encode(), layout.n_bits)
    loop = Loop(layout, kappa, bits, lambda: iter(chosen))
    states = list(loop.states())
    name = f"film/{config.split}/{config.pair}/{config.view:g}"
    rng = np.random.default_rng([config.seed, zlib.crc32(name.encode())])
    stream = film(states, layout, pair, config.view, settings, rng)
    folder = config.out if config.out.suffix == "" else config.out.parent
    make_folder(folder)
    truth = folder / TRUTH if config.out.suffix == "" else config.out.with_suffix(".jsonl")
    if truth.exists():
        raise ParameterError("out", f"{truth} is there already; choose another name")
    lines: list[str] = []

    def frames() -> Iterator[NDArray[np.uint8]]:
        for frame in tqdm(stream, total=int(config.seconds * config.fps), unit="frame"):
            file = None if config.out.suffix else f"{frame.number:06d}.png"
            if file:
                write_image(config.out / file, frame.rgb)
            lines.append(frame.truth(file))
            yield frame.rgb

    if config.out.suffix:
        write_video(config.out, frames(), config.fps)
    else:
        for _ in frames():
            pass
    write_bytes(truth, ("\n".join(lines) + "\n").encode())
    report = {
        "out": str(config.out),
        "truth": str(truth),
        "camera_frames": len(lines),
        "simulated": True,
        **loop.report(len(config.message.encode()), config.state_hz),
    }
    print(json.dumps(report))


if __name__ == "__main__":
    run_cli(main)
