"""Hide a message in pictures and write what a display shows.

python -m export.send PICTURE --message TEXT --out player.html
"""

import argparse
import contextlib
import json
import math
import os
import shutil
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from export.send.pictures import open_pictures
from export.send.player import write_player
from link.code.framing import encode
from link.embed import check_kappa
from link.errors import InputError, at_least, run_cli
from link.images import make_folder, write_bytes, write_image
from link.layout import Layout, make_layout
from link.loop import Loop
from link.video import write_video

KINDS = ("", ".html", ".avi", ".mkv")
"""Suffixes of --out: a folder of images, the player, or a video."""
REPORT = "sent.json"
GRID = {"rows": 8, "cols": 8, "width": 512, "height": 384, "ratex": 5}
MAX_SCALE = 64


class Parser(argparse.ArgumentParser):
    """A parser whose errors are `InputError`."""

    def error(self, message: str) -> NoReturn:
        """Raise an `InputError`."""
        raise InputError(f"{message}; see --help")


def read_message(text: str | None, file: Path | None) -> bytes:
    """The bytes of --message, as UTF-8, or of --file.

    Raises:
        InputError: both or neither is given, or the file cannot be read.
    """
    if (text is None) == (file is None):
        raise InputError("give the message with either --message TEXT or --file FILE")
    if text is not None:
        return text.encode("utf-8", "surrogateescape")
    assert file is not None
    try:
        return file.read_bytes()
    except OSError as error:
        raise InputError(f"--file: {file} cannot be read ({error.strerror})") from None


def choose_layout(file: Path | None, grid: dict[str, int | None]) -> Layout:
    """The layout in a JSON file, or the usual one with the given numbers.

    Args:
        file: holds rows, cols, width, height, ratex.
        grid: values of the flags of the same names, None where absent.

    Raises:
        InputError: file and flags are given together, the file holds no layout, or see `Layout`.
    """
    given = {name: value for name, value in grid.items() if value is not None}
    if file is None:
        return make_layout(**(GRID | given))
    if given:
        raise InputError(f"--{next(iter(given))} and --layout: give one of them")
    try:
        return Layout.from_dict(json.loads(file.read_text()))
    except (OSError, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise InputError(f"{file}: no layout there ({error})") from None


def check_out(out: Path) -> str:
    """The kind of output, one of `KINDS`; an `InputError` where something is there already."""
    kind = out.suffix.lower()
    if kind not in KINDS:
        raise InputError(
            f"--out: {out} must end in .html, .avi or .mkv, or be a folder with no dot in its name"
        )
    empty = kind == "" and out.is_dir() and not any(out.iterdir())
    if out.exists() and not empty:
        raise InputError(f"--out: {out} is already there; remove it or choose another name")
    return kind


@contextlib.contextmanager
def unfinished(out: Path) -> Iterator[Path]:
    """A temporary name beside ``out``, which is renamed at the end, or removed on an error."""
    temporary = out.with_name(f".{out.stem}.{os.getpid()}.tmp{out.suffix}")
    make_folder(out.parent)
    try:
        yield temporary
        if out.is_dir():
            out.rmdir()
        temporary.replace(out)
    except OSError as error:
        raise InputError(f"--out: {out} cannot be written ({error.strerror})") from None
    finally:
        if temporary.is_dir():
            shutil.rmtree(temporary)
        else:
            temporary.unlink(missing_ok=True)


def write_states(folder: Path, states: Iterable[NDArray[np.uint8]]) -> None:
    """Write state_00000.png, state_00001.png, ... in the order in which a display shows them."""
    for number, state in enumerate(states):
        write_image(folder / f"state_{number:05d}.png", state)


def send(loop: Loop, out: Path, message_bytes: int, state_hz: float, player: dict[str, int]) -> Any:
    """Write the loop and return its report (see `Loop.report`).

    Args:
        loop: what to show.
        out: its suffix is one of `KINDS`.
        message_bytes: length of the message.
        state_hz: states shown in a second.
        player: ``hold`` and ``scale`` of `export.send.player.write_player`.

    Raises:
        InputError: a picture or the output is no good; nothing is left behind.
    """
    kind = check_out(out)
    with unfinished(out) as path:
        if kind == ".html":
            write_player(path, loop.pairs(), **player)
        elif kind:
            write_video(path, loop.states(), state_hz)
        else:
            write_states(path, loop.states())
        report = loop.report(message_bytes, state_hz)
        if not kind:
            write_bytes(path / REPORT, json.dumps(report, indent=1).encode())
    return report


def rate(hold: int, refresh: float, state_hz: float | None, kind: str) -> float:
    """States a second: --state-hz, or --refresh / --hold."""
    at_least(1, hold=hold)
    wanted = refresh / hold if state_hz is None else state_hz
    if not (math.isfinite(wanted) and 0 < wanted <= 1000):
        raise InputError(f"--refresh, --state-hz: need up to 1000 states a second, got {wanted:g}")
    if kind == ".html" and not math.isclose(wanted, refresh / hold, rel_tol=1e-3):
        raise InputError(
            f"--state-hz: the player holds a state for whole refreshes; {refresh:g} Hz with "
            f"--hold {hold} is {refresh / hold:g}"
        )
    return wanted


def parser() -> Parser:
    """The command line."""
    it = Parser(prog="python -m export.send", description=main.__doc__)
    it.add_argument("pictures", type=Path, help="an image, a folder of images, or a video")
    it.add_argument("--message", help="text to send")
    it.add_argument("--file", type=Path, help="file to send, instead of --message")
    it.add_argument("--out", type=Path, required=True, help="new .html, .avi, .mkv or folder")
    it.add_argument("--kappa", type=int, default=3, help="gray levels added for a 1 (3)")
    for name, default in GRID.items():
        it.add_argument(f"--{name}", type=int, help=f"of the layout ({default})")
    it.add_argument("--layout", type=Path, help="JSON file with a layout, instead of these five")
    it.add_argument("--pyramid-level", type=int, default=0, help="soften the edges of blocks (0)")
    it.add_argument("--hold", type=int, default=4, help="refreshes that a state stays (4)")
    it.add_argument("--refresh", type=float, default=60.0, help="of the display, Hz (60)")
    it.add_argument("--state-hz", type=float, help="states a second, if not refresh / hold")
    it.add_argument("--scale", type=int, default=0, help="of the player; 0: largest that fits (0)")
    return it


def main() -> None:
    """Hide a message in pictures and write what a display shows: a player, a video or images.

    Prints one line of JSON: size and capacity of the loop, time, bit/s, PSNR and SSIM.
    """
    args = parser().parse_args()
    kind = check_out(args.out)
    message = read_message(args.message, args.file)
    layout = choose_layout(args.layout, {name: getattr(args, name) for name in GRID})
    check_kappa(args.kappa)
    if not 0 <= args.scale <= MAX_SCALE:
        raise InputError(f"--scale: need 0 to {MAX_SCALE}, got {args.scale}")
    state_hz = rate(args.hold, args.refresh, args.state_hz, kind)
    loop = Loop(
        layout,
        args.kappa,
        encode(message, layout.n_bits),
        open_pictures(args.pictures, state_hz / 2),
        args.pyramid_level,
    )
    player = {"hold": args.hold, "scale": args.scale}
    report = send(loop, args.out, len(message), state_hz, player)
    print(json.dumps({"out": str(args.out), **report}))


if __name__ == "__main__":
    run_cli(main)
