"""Hide a message in pictures and write what a display shows.

python -m sender PICTURE --message TEXT --out player.html
"""

import argparse
import json
import math
import sys
import time
from functools import partial
from pathlib import Path
from typing import Any

from link.cli import Parser, add_pixel_limit, check_flags, read_size, run_cli
from link.code.authenticate import read_key, sign
from link.code.fine import MAX_MESSAGE
from link.code.framing import encode, frames_needed
from link.embed import check_kappa
from link.errors import InputError, ParameterError, at_least
from link.files.lock import locked
from link.layout import MODULATIONS, Layout, read_layout
from link.loop import Loop
from link.outside import read_bounded
from link.placement import FITS
from link.presets import DEFAULT_PRESET, PRESETS, Preset, least_camera_fps, needed_camera_fps
from sender.bench import SECONDS, write_bench
from sender.carrying import CARRIED, DARK, DIM, carried_share
from sender.hiding import Hiding, Onlooker
from sender.pictures import is_film, note_coarse, open_pictures
from sender.player import PLAYED
from sender.write import output_kind, write_loop

GRID_FLAGS = ("rows", "cols", "width", "height", "ratex", "modulation", "pilots")
"""Flags that describe a layout; those that are absent have the preset's values."""
BENCH_FLAGS = ("bench", "pictures", "out", "size", "fit", "refresh", "max_megapixels")
"""Flags that --bench takes, by their names in Python."""
USUAL_REFRESH = 60.0
"""Refreshes of the display in a second where --refresh is absent."""
SAME_RATE = 0.02
"""Share by which a rate may be slower than was asked for and still be it, as in player.html."""
NEEDED = "note: {:g} states a second need a camera of {:g} frames a second{}"
"""Note about the camera that reads the message."""
BETTER = ", and one of {:g} reads them better; preset robust is for slow cameras"
"""Note that is printed where a faster camera helps."""
FLICKER = {
    "seen": "note: the flicker is plain to see ({:.3g} times the threshold of sight), which may "
    "disturb people who are sensitive to it",
    "flashes": "warning: the blocks flash more strongly than WCAG 2.2 (2.3.1) allows, which may "
    "cause seizures; choose a smaller --kappa",
}
"""Notes about flicker, by the result of `Hiding.flicker`."""


def message_of(text: str | None, file: Path | None) -> bytes:
    """Take the bytes of --message, as UTF-8, or of --file.

    Raises:
        InputError: both or neither is given, or the file cannot be read.
    """
    if (text is None) == (file is None):
        raise InputError("give the message with either --message TEXT or --file FILE")
    if text is not None:
        return text.encode("utf-8", "surrogateescape")
    assert file is not None
    try:
        return read_bounded(file, MAX_MESSAGE)
    except InputError as error:
        raise ParameterError("file", str(error)) from None


def protected_message(message: bytes, key: Path | None, counter: int | None) -> bytes:
    """Sign a message with the key in a file; without one, return it as it is.

    Args:
        message: bytes to send.
        key: value of --key, None where absent.
        counter: value of --counter, None where absent: the stamp is then the time.

    Raises:
        InputError: the key or the counter is no good, or there is a counter without a key.
    """
    if key is None:
        if counter is not None:
            raise ParameterError("counter", "only a message with a key has one; give --key, too")
        return message
    return sign(message, read_key(key), int(time.time()) if counter is None else counter)


def choose_layout(preset: Preset, file: Path | None, grid: dict[str, Any]) -> Layout:
    """Read the layout in a JSON file, or take the preset's with what the flags change.

    Args:
        preset: layout that the flags change.
        file: holds a layout; None where --layout is absent.
        grid: values of the flags in `GRID_FLAGS`, None where absent.

    Raises:
        InputError: file and flags are given together, the file holds no layout, or the numbers make
            none.
    """
    given = {name: value for name, value in grid.items() if value is not None}
    if file is None:
        return preset.changed(**given)
    if given:
        raise InputError(f"--{next(iter(given))} and --layout: give one of them")
    return read_layout(file)


def states_per_second(usual: float, hold: int | None, refresh: float, kind: str) -> float:
    """Work out how many states are shown in a second: --refresh / --hold, or usual.

    A player (".html") holds states for whole refreshes, so that it takes the least rate that the
    display has and that is not slower than the usual one, which would be seen more.

    Args:
        usual: states a second where no flag says more, as in a preset.
        hold: value of --hold, refreshes that a state stays, None where absent.
        refresh: refreshes of the display in a second.
        kind: ending of the output's name.

    Raises:
        InputError: the rate is no number from 0.1 to 1000.
    """
    if hold is not None:
        at_least(1, hold=hold)
    wanted = usual if hold is None else refresh / hold
    if not refresh >= 0.1:
        raise ParameterError("refresh", f"need 0.1 or more a second, got {refresh:g}")
    if not 0.1 <= wanted <= 1000:
        raise InputError(f"--refresh, --hold: need 0.1 to 1000 a second, got {wanted:g}")
    if kind != ".html" or hold is not None:
        return wanted
    return refresh / max(1, math.floor(refresh / wanted + SAME_RATE))


def choose_kappa(usual: int, kappa: int | None, limit: float | None, hiding: Hiding) -> int:
    """Take --kappa, or the largest kappa that stays below --visibility, or the preset's.

    Args:
        usual: kappa where neither is given.
        kappa: value of --kappa, None where absent.
        limit: value of --visibility, None where absent.
        hiding: the message before the eyes of an onlooker.

    Raises:
        InputError: both are given, kappa is out of range, or even a kappa of 1 is too visible.
    """
    if limit is None:
        return check_kappa(usual if kappa is None else kappa)
    if kappa is not None:
        raise InputError("--visibility and --kappa: give one of them")
    return hiding.largest_kappa(limit)


def send_parser() -> Parser:
    """Make the parser of the command line."""
    parser = Parser(prog="python -m sender", description=main.__doc__)
    add, usual = parser.add_argument, Onlooker()
    add("pictures", type=Path, nargs="?", help="an image, a folder of images, or a video")
    add("--message", help="text to send")
    add("--file", type=Path, help="file to send, instead of --message")
    add("--out", type=Path, required=True, help="new .html, .avi, .mkv or folder")
    purposes = "; ".join(
        f"{name} (best filmed at {2 * preset.state_hz:g} frames/s): {preset.purpose[:-1]}"
        for name, preset in PRESETS.items()
    )
    preset = f"settings that the other flags change ({DEFAULT_PRESET}). {purposes}"
    add("--preset", choices=list(PRESETS), default=DEFAULT_PRESET, help=preset)
    sizes = "of the display, as in 3840x2160 (the picture's own, at most 1920x1080)"
    add("--size", type=read_size, help=sizes)
    fits = "how the picture lies on it: contain (with --size), cover (without) or stretch"
    add("--fit", choices=list(FITS), help=fits)
    add("--seconds", type=float, help="for which each image of a folder stays (a frame pair)")
    add("--key", type=Path, help="sign the message with this file, 16 to 4096 random bytes")
    add("--counter", type=int, help="number that rises with each signed message (the time)")
    bench = "show presets and grids in turn, to find what a camera reads (no message; docs)"
    add("--bench", action="store_true", help=bench)
    add_pixel_limit(parser)
    add = parser.add_argument_group("strength, and who looks on").add_argument
    add("--kappa", type=int, help="gray levels added for a 1, instead of the preset's")
    evened = "stronger where the picture hides more (as the preset)"
    add("--even", action=argparse.BooleanOptionalAction, help=evened)
    add("--visibility", type=float, help="take the largest kappa that is seen less than this")
    add("--diagonal", type=float, default=usual.diagonal, help="of the shown picture, inches (24)")
    add("--luminance", type=float, default=usual.luminance, help="of white, cd/m2 (200)")
    add("--distance", type=float, help="of the eye, metres, instead of the preset's")
    add = parser.add_argument_group("the layout, in place of the preset's").add_argument
    for name in ("rows", "cols", "width", "height"):
        add(f"--{name}", type=int, help="in blocks" if name[0] in "rc" else "in pixels")
    add("--ratex", type=int, help="patches: 0, 1, 2, 3 or 5, instead of pilots")
    add("--modulation", choices=list(MODULATIONS), help="how bits change blocks")
    add("--pilots", help="share of blocks with known bits in place of patches, or auto")
    add("--layout", type=Path, help="JSON file with a layout, or sent.json, instead of these seven")
    add = parser.add_argument_group("rates, in place of the preset's").add_argument
    add("--hold", type=int, help="refreshes that a state stays, instead of the preset's rate")
    add("--refresh", type=float, default=USUAL_REFRESH, help="of the display, Hz (60)")
    return parser


def show_bench(args: argparse.Namespace, kind: str) -> None:
    """Write the page of the bench, and print its parts as one line of JSON.

    Raises:
        InputError: a flag is given that the bench does not take, or the output is no good.
    """
    usual = vars(send_parser().parse_args(["--out", "bench.html"]))
    for name, value in vars(args).items():
        if value != usual[name] and name not in BENCH_FLAGS:
            raise ParameterError(name, "--bench has settings of its own; leave it out")
    if kind != ".html":
        raise ParameterError("out", "--bench writes a page; name a new .html")
    with locked(args.out.parent, args.out.name):
        if args.out.exists():
            raise ParameterError("out", f"{args.out} is already there; choose another name")
        pictures = open_pictures(args.pictures, 1.0) if args.pictures else None
        parts = write_bench(args.out, pictures, args.size, args.fit, args.refresh)
    print(json.dumps({"out": str(args.out), "seconds": SECONDS * len(parts), "parts": parts}))


def main() -> None:
    """Hide a message in pictures and write what a display shows: a player, a video or images.

    Prints one line of JSON: size and capacity of the loop, time, bit/s, PSNR, SSIM, by how much the
    picture's mean over time changed (CIEDE2000), the preset, and how visible the message is to the
    eye, as contrast over threshold (docs/visibility.md), and of a still picture which share of the
    bits is expected to come through.
    """
    args = check_flags(send_parser().parse_args())
    kind = output_kind(args.out)
    args.fit = args.fit or ("cover" if args.size is None else "contain")
    if args.bench:
        show_bench(args, kind)
        return
    if args.pictures is None:
        raise InputError("name a picture, a folder of pictures or a video")
    message = message_of(args.message, args.file)
    preset = PRESETS[args.preset]
    layout = choose_layout(preset, args.layout, {name: getattr(args, name) for name in GRID_FLAGS})
    distance = preset.distance_m if args.distance is None else args.distance
    onlooker = Onlooker(args.diagonal, args.luminance, distance)
    state_hz = states_per_second(preset.state_hz, args.hold, args.refresh, kind)
    layout.code.check_rate(state_hz)
    pictures = open_pictures(args.pictures, state_hz, args.seconds)
    protected = protected_message(message, args.key, args.counter)
    given = "message" if args.file is None else "file"
    frames_needed(len(protected), layout.n_bits, given)  # refuses what is too long
    bits = encode(protected, layout.n_bits, signed=args.key is not None)
    even = preset.even if args.even is None else args.even
    even = even and layout.modulation == "antipodal"
    moving = is_film(args.pictures)
    if kind == ".html" and moving and args.pictures.suffix.lower() in PLAYED:
        first = next(pictures())  # the page makes the states of the others
        pictures = partial(iter, [first])
    loop = Loop(layout, preset.kappa, bits, pictures, args.size, args.fit, even, moving)
    note_coarse(loop.placement.given_size, loop.placement.picture_size)
    hiding = Hiding(loop.shown_layout, state_hz, onlooker, even)
    loop.kappa = choose_kappa(preset.kappa, args.kappa, args.visibility, hiding)
    camera_fps = needed_camera_fps(least_camera_fps(layout, state_hz))
    better_fps = needed_camera_fps(2 * state_hz)
    flickers = hiding.flickers(loop.kappa) if kind == ".html" else {}
    flicker = hiding.flicker(loop.kappa)
    more = {
        "preset": args.preset,
        "needs_camera_fps": camera_fps,
        "flicker": flicker,
        "visibility_block": round(hiding.seen(loop.kappa), 3),
        "visibility_screen": round(hiding.seen(loop.kappa, "screen"), 3),
        "visibility_moving": round(hiding.seen_in_motion(loop.kappa), 3),
    }
    carried = None
    usual = (layout, loop.kappa, even) == (preset.layout, preset.kappa, preset.even)
    if args.preset in CARRIED and usual and not moving:
        carried = carried_share(next(loop.carriers()).picture, args.preset)
        more["carried_share"] = round(carried, 3)
        expected = carried * layout.n_bits * state_hz / 2
        more["expected_bit_per_s"] = round(expected, 2)
    film = args.pictures if moving else None
    report = write_loop(loop, args.out, len(message), state_hz, film, flickers=flickers, more=more)
    print(json.dumps({"out": str(args.out), **report}))
    better = BETTER.format(better_fps) if better_fps > camera_fps else ""
    if carried is not None and carried < DIM:
        print(DARK.format(carried, expected), file=sys.stderr)
    print(NEEDED.format(state_hz, camera_fps, better), file=sys.stderr)
    if flicker:
        print(FLICKER[flicker].format(hiding.seen(loop.kappa)), file=sys.stderr)


if __name__ == "__main__":
    run_cli(main)
