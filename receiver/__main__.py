"""Read a message from camera frames: python -m receiver INPUT.

INPUT is a folder of images, a video file, a camera (0, /dev/video0) or a stream (rtsp://, http://);
two images are one frame pair.
Prints JSON lines: display, clock, pair, message, refused, end.
"""

import argparse
import json
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from link.cli import Parser, add_pixel_limit, check_flags, read_size, run_cli
from link.code.authenticate import Verifier, read_key
from link.errors import InputError, ParameterError, at_least
from link.frames import check_same_size
from link.images import make_folder, write_bytes, write_image
from link.images.files import read_image
from link.outside import is_no_file
from link.presets import preset_name
from receiver.cameras import HIGHEST_FPS, SIZE, CameraFrame
from receiver.decoders import PairDecoder, WindowDecoder, add_model_flag, open_decoders
from receiver.events import Event, PlacedEvent
from receiver.seen import SeenFrame
from receiver.show import draw_decoded_pair
from receiver.sources import FPS_HELP, open_source
from receiver.stream import EventStream, pair_event
from receiver.tracking.two_images import decode_in_both, find_in_both

OF_FILMS = ("fps", "camera_size", "camera_fps", "show", "out", "keep_on", "key", "max_age")
"""Flags that have no meaning for two images."""
MIRRORED_S = 4.0
"""Seconds, from its beginning, of a film without a display that are looked through once more,
mirrored."""
MIRRORED = (
    "note: the film is mirrored, as by a mirror or a front camera; corners are told as in a frame "
    "that is mirrored back"
)
"""Note that is printed for a film that is read mirrored."""
KEPT_PICTURES = 50
"""Number of annotated pictures that are kept; later ones replace the oldest, so that an endless
stream fits a disk."""


def main() -> None:
    """Print JSON lines until the message is whole or the frames end."""
    parser = Parser(prog="python -m receiver", description=__doc__)
    kinds = "folder of images, video, camera such as 0 or /dev/video0, or address of a stream such "
    kinds += "as rtsp://HOST/PATH; or two images of a frame pair"
    parser.add_argument("input", nargs="+", metavar="INPUT", help=kinds)
    parser.add_argument("--out", type=Path, help="file for the message's bytes")
    parser.add_argument("--fps", type=float, help=FPS_HELP)
    parser.add_argument(
        "--keep-on", action="store_true", help="go on after a message: for messages that change"
    )
    parser.add_argument("--key", type=Path, help="deliver only what was sent with this key")
    parser.add_argument("--max-age", type=float, help="of a message with a key, seconds")
    parser.add_argument("--show", type=Path, help="folder for annotated pictures")
    parser.add_argument("--scores", action="store_true", help="print each pair's scores, too")
    usual = "x".join(map(str, SIZE))
    parser.add_argument("--camera-size", type=read_size, help=f"asked of a camera ({usual})")
    asked = f"frames a second asked of a camera (the highest that it has, to {HIGHEST_FPS:g})"
    parser.add_argument("--camera-fps", type=float, help=asked)
    add_model_flag(parser)
    parser.add_argument("--threads", type=int, default=2, help="of onnxruntime")
    add_pixel_limit(parser)
    args = check_flags(parser.parse_args())
    at_least(1, threads=args.threads)
    if len(args.input) > 2:
        raise InputError("INPUT: give one folder, video, camera or stream, or two images")
    if len(args.input) == 2:
        for flag in OF_FILMS:
            if getattr(args, flag) != parser.get_default(flag):
                raise ParameterError(flag, "two images are one frame pair, and hold no message")
        decoders, _ = open_decoders(args.model, args.threads)
        return read_two_images(decoders, args.input[0], args.input[1])
    if args.out is not None and (not args.out.name or is_no_file(args.out)):
        raise ParameterError("out", f"{args.out} is a folder or a device; name a file")
    verifier = make_verifier(args.key, args.max_age)
    decoders, film = open_decoders(args.model, args.threads)
    if args.show is not None:
        make_folder(args.show)
    read_stream(decoders, film, args, verifier)


def make_verifier(key: Path | None, max_age_s: float | None) -> Verifier | None:
    """Make what judges messages, from --key and --max-age; None where there is no key.

    Raises:
        InputError: the key or the age is no good, or there is an age without a key.
    """
    if key is not None:
        return Verifier(read_key(key), max_age_s)
    if max_age_s is not None:
        raise ParameterError("max_age", "only a message with a key has an age; give --key, too")
    return None


def read_two_images(decoders: Sequence[PairDecoder], first: str, second: str) -> None:
    """Decode two images in either order, with the display anywhere in each.

    Raises:
        InputError: an image is unreadable, they are of unlike size, no display is in both, or both
            show one state.
    """
    by_layout = {decoder.layout: decoder for decoder in decoders}
    frames = [read_image(path) for path in (first, second)]
    check_same_size(frames[0], frames[1])
    found = find_in_both(frames[0], frames[1], list(by_layout))
    if found is None:
        sought = ", ".join(preset_name(layout) or "--model" for layout in by_layout)
        raise InputError(
            f"{first}, {second}: no display is in both whose blocks change from one to the other "
            f"({sought} looked for); take one image of each state, from one place"
        )
    for path, corners in zip((first, second), found.corners, strict=True):
        place: list[list[float]] = corners.round(2).tolist()
        preset = preset_name(found.layout)
        say([PlacedEvent(event="display", image=path, preset=preset, corners=place)])
    pair = decode_in_both(by_layout[found.layout], frames[0], frames[1], found.corners)
    say([pair_event(pair, scores=True)])


def read_stream(
    decoders: Sequence[PairDecoder],
    film: WindowDecoder,
    args: argparse.Namespace,
    verifier: Verifier | None,
) -> None:
    """Receive from a folder, a video or a camera until the message is whole or frames end.

    Raises:
        InputError: there is no message; says why.
    """
    asked = args.fps, args.camera_size, args.camera_fps
    source = open_source(args.input[0], *asked)
    new_stream = partial(EventStream, decoders, source.fps, verifier, args.scores, film)
    stream = new_stream()
    try:
        read_frames(stream, source.frames, args)
        if stream.receiver.frames and not stream.receiver.found and not source.live:
            turned = new_stream()
            read_frames(turned, mirrored(open_source(args.input[0], *asked).frames, turned), args)
            if turned.receiver.found:
                print(MIRRORED, file=sys.stderr)
                stream = turned
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
    say([stream.end()])
    if stream.inbox.last is None:
        raise InputError(stream.explanation)


def mirrored(frames: Iterable[CameraFrame], stream: EventStream) -> Iterator[CameraFrame]:
    """Mirror frames, until no display has been found in them for `MIRRORED_S`."""
    for frame in frames:
        if frame.time > MIRRORED_S and not stream.receiver.found:
            return
        yield replace(frame, image=np.ascontiguousarray(frame.image[:, ::-1]))


def read_frames(
    stream: EventStream, frames: Iterable[CameraFrame], args: argparse.Namespace
) -> None:
    """Read frames until the message is whole or frames end, and print what they bring."""
    image: NDArray[np.uint8] | None = None
    view: SeenFrame | None = None
    shown = 0
    for frame in frames:
        image = frame.image
        is_delivered = say(stream.push(image, frame.time, frame.name), args.out)
        view = stream.step.tracked or view
        shown = write_pictures(args.show, shown, stream, image, view)
        if is_delivered and not args.keep_on:
            return
    say(stream.finish(), args.out)
    if image is not None:
        write_pictures(args.show, shown, stream, image, view)


def say(events: Sequence[Event], out: Path | None = None) -> bool:
    """Print events, and write the bytes of a message to a file; true where there was a message.

    Raises:
        InputError: the file cannot be written.
    """
    is_delivered = False
    for event in events:
        print(json.dumps(event), flush=True)
        if event["event"] == "message":
            is_delivered = True
            if out is not None:
                write_bytes(out, bytes.fromhex(event["hex"]))
    return is_delivered


def write_pictures(
    folder: Path | None,
    number: int,
    stream: EventStream,
    image: NDArray[np.uint8],
    view: SeenFrame | None,
) -> int:
    """Write an annotated picture of each pair that a camera frame brought.

    Args:
        folder: folder of the pictures; None for no pictures.
        number: number of the next picture.
        stream: what has read the camera frame.
        image: the camera frame.
        view: the display where it was last seen, or None.

    Returns:
        the number of the next picture.
    """
    if folder is None or view is None:
        return number
    for pair in stream.step.pairs:
        picture = draw_decoded_pair(image, view, pair, stream.receiver.layout)
        write_image(folder / f"pair_{number % KEPT_PICTURES:03d}.png", picture)
        number += 1
    return number


if __name__ == "__main__":
    run_cli(main)
