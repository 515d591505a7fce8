"""Film a display that shows a message, and write the frames and the truth about them.

python -m data_gen.video --pair canon-lg --view 45 --kappa 3 --message TEXT --out DIR (or FILE.mkv,
or FILE.mp4 for a film as phones store it)
"""

import json
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import tyro
from tqdm import tqdm
from tyro.conf import OmitArgPrefixes

from data_gen.film.codec import (
    COMPRESSED_SUFFIXES,
    CodecSettings,
    through_codec,
    write_film,
)
from data_gen.film.frame import VideoFrame
from data_gen.film.stream import States, VideoSettings, film
from data_gen.flags import CellFlags
from data_gen.frame_pair import shuffled_pictures
from data_gen.pictures.carriers import STILL, check_carriers, open_carrier
from link.cli import check_flags, run_cli
from link.code.framing import encode
from link.errors import ParameterError, choose
from link.files.lock import locked
from link.files.together import written_together
from link.images import write_bytes, write_image
from link.images.video import write_video
from link.loop import LoopStates, MovingStates, loop_of_picture
from link.outside import is_file
from link.pilot_code import PLAIN
from link.presets import PRESETS

TRUTH = "truth.jsonl"
"""Name of the file, in a folder of frames, that holds the truth about each of them."""
LOSSLESS_SUFFIXES = (".mkv", ".avi")
"""Endings of the video files that hold every level as it is, where no codec is named."""
FILMED_PRESET = "paper"
"""Name of the preset that is filmed where no other is asked for: the quickest to simulate."""
FILMED = VideoSettings(scene=replace(VideoSettings().scene, coverage=0.35), seconds=10.0)
"""Stream where flags are absent. The display covers a third of the image, as where somebody wants
its message; so large, the receiver reads every preset at 0°."""


@dataclass(frozen=True, kw_only=True)
class FilmConfig(CellFlags):
    """A simulated camera stream of a display that shows a message over and over."""

    out: Path
    """Folder for PNGs named by frame number and truth.jsonl, or a video file, beside which the
    truth lies as .jsonl. A .mkv or .avi is lossless and without times, so that a lost frame leaves
    no gap. A .mp4 or .mov, or a .mkv where a codec is named, is compressed and has the frames'
    times."""
    message: str
    """Text that the display sends."""
    preset: str = FILMED_PRESET
    """What the display shows, and at which rate: paper, hidden, fast or robust. The other flags
    change single numbers of it; --fps is two frames a state where it is absent."""
    kappa: int = 3
    """Gray levels of [0, 255] added where a bit is 1."""
    carriers: str = STILL
    """What carries the message: "still" for pictures that stand still, "moving" for a scene drawn
    at random, or the name of a scene (data_gen/pictures/moving.py). A video that is given as
    --pictures is played in place of it."""
    first: int = 3
    """Number of the picture that the display shows; number 0 is a mostly black poster, which
    carries little."""
    stream: OmitArgPrefixes[VideoSettings] = FILMED
    """Rates, camera, room, and what disturbs the stream; None is drawn at random."""
    codec: CodecSettings = field(default_factory=CodecSettings)
    """Codec of a compressed file, h264 if none is named; a folder gets what it leaves."""

    @classmethod
    def of_preset(cls, name: str) -> "FilmConfig":
        """Return what the flags are where they are absent, beside those that must be there.

        Raises:
            InputError: there is no preset of this name; the message lists them.
        """
        preset = choose(PRESETS, name, "preset")
        layout, state_hz = preset.layout, preset.state_hz
        return cls(
            out=tyro.MISSING,
            message=tyro.MISSING,
            preset=name,
            rows=layout.rows,
            cols=layout.cols,
            width=layout.width,
            height=layout.height,
            modulation=layout.modulation,
            pilots="auto" if layout.pilots else "0",
            code=layout.code != PLAIN,
            kappa=preset.kappa,
            even=preset.even,
            stream=replace(FILMED, fps=2 * state_hz, state_hz=state_hz),
        )

    def file_codec(self) -> CodecSettings:
        """Return the codec, which a .mp4 or .mov has even where none is named.

        Raises:
            ParameterError: a setting is out of its range, or the file cannot hold the codec.
        """
        suffix, codec = self.out.suffix, self.codec
        if suffix in COMPRESSED_SUFFIXES and suffix not in LOSSLESS_SUFFIXES and not codec.on:
            codec = replace(codec, name="h264")
        codec.check()
        known = ("", *COMPRESSED_SUFFIXES) if codec.on else ("", *LOSSLESS_SUFFIXES)
        if suffix not in known:
            files = ", ".join(dict.fromkeys((*LOSSLESS_SUFFIXES, *COMPRESSED_SUFFIXES)))
            raise ParameterError(
                "out", f"need a folder, or a file of {files} that suits the codec, got {self.out}"
            )
        return codec


def image_name(frame: VideoFrame) -> str:
    """Name of a frame's image in a folder."""
    return f"{frame.number:06d}.png"


def main() -> None:
    """Film, and write frames and truth."""
    prog = "python -m data_gen.video"
    usual = FilmConfig.of_preset(tyro.cli(FilmConfig, prog=prog).preset)
    config = check_flags(tyro.cli(FilmConfig, prog=prog, default=usual))
    settings, cell, source = config.stream, config.cell(), config.source(config.split)
    seconds = settings.seconds or 0.0
    if not 0 < seconds <= 3600:
        raise ParameterError("seconds", f"need more than 0 and at most 3600, got {seconds:g}")
    codec = config.file_codec()
    pair, pictures = source.pair(cell.pair), shuffled_pictures(source)
    played = config.pictures is not None and is_file(config.pictures)
    carriers = str(config.pictures) if played else config.carriers
    check_carriers(carriers)
    picture = pictures[config.first % len(pictures)].rgb
    settings = replace(settings, scene=replace(settings.scene, pictures=pictures))
    layout, message = source.layout, config.message.encode()
    bits = encode(message, layout.n_bits)
    loop = loop_of_picture(layout, cell.kappa, bits, picture, source.even)
    name = f"film/{config.split}/{cell.pair}/{cell.view_deg:g}"
    rng = np.random.default_rng([config.seed, zlib.crc32(name.encode())])
    states: States = LoopStates(loop)
    if carriers != STILL:
        carrier = open_carrier(carriers, pictures, rng.spawn(1)[0])
        states = MovingStates(loop, carrier, settings.state_hz)
    stream = film(states, layout, pair, cell.view_deg, settings, rng)
    folder = config.out if config.out.suffix == "" else config.out.parent
    truth = folder / TRUTH if config.out.suffix == "" else config.out.with_suffix(".jsonl")
    lines: list[str] = []

    def frames() -> Iterator[VideoFrame]:
        for frame in stream:
            lines.append(frame.truth(None if config.out.suffix else image_name(frame)))
            yield frame
            bar.update()

    with locked(folder, truth.name if config.out.suffix else ""):
        there = [config.out] if config.out.suffix else folder.glob("[0-9]*.png")
        with (
            written_together(folder, truth.name, there) as hidden,
            tqdm(total=int(seconds * settings.fps), unit="frame") as bar,  # errors begin a new line
        ):
            if not config.out.suffix:
                for frame in through_codec(frames(), codec, settings.fps):
                    write_image(hidden / image_name(frame), frame.rgb)
            elif codec.on:
                write_film(hidden / config.out.name, frames(), codec, settings.fps)
            else:
                images = (frame.rgb for frame in frames())
                write_video(hidden / config.out.name, images, settings.fps)
            write_bytes(hidden / truth.name, ("\n".join(lines) + "\n").encode())
    report = {
        "out": str(config.out),
        "truth": str(truth),
        "camera_frames": len(lines),
        "simulated": True,
        "preset": config.preset,
        **loop.report(len(message), settings.state_hz),
    }
    print(json.dumps(report))


if __name__ == "__main__":
    run_cli(main)
