"""Read a message from camera frames: python -m export.receive INPUT.

INPUT is a folder of images, a video file or a camera's number; two images are one frame pair.
Prints JSON lines: display, clock, pair, message, refused, end.
"""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from export.receive.decoders import PairDecoder, open_decoders
from export.receive.diagnosis import explain_silence
from export.receive.inbox import Inbox, say
from export.receive.reader import DecodedPair
from export.receive.receiver import Receiver, ReceiverStep
from export.receive.show import draw_decoded_pair
from export.receive.sources import FPS_HELP, CameraFrame, open_source
from export.receive.tracking.patches import Tracked
from export.receive.two_images import find_in_both
from link.cli import add_pixel_limit, read_flags, run_cli
from link.code.authenticate import Verifier, read_key
from link.errors import InputError, ParameterError, at_least
from link.frames import check_same_size
from link.images import make_folder, read_image, write_image
from link.layout import Layout
from link.presets import preset_name
from models import find_graph

OF_FILMS = ("fps", "show", "out", "keep_on", "key", "max_age")
"""Flags that have no meaning for two images."""
MAX_PRINTED_BITS = 256
"""Largest number of bits of a frame pair that are printed without --scores."""
KEPT_PICTURES = 50
"""Number of annotated pictures that are kept; later ones replace the oldest, so that an endless
stream fits a disk."""


def main() -> None:
    """Print JSON lines until the message is whole or the frames end."""
    parser = argparse.ArgumentParser(prog="python -m export.receive", description=__doc__)
    kinds = "folder of images, video, or camera's number such as 0; or two images of a frame pair"
    parser.add_argument("input", nargs="+", metavar="INPUT", help=kinds)
    parser.add_argument(
        "--model",
        type=find_graph,
        action="append",
        help="an .onnx file, or a preset's name, which says what display to look for; may be given "
        "several times; by default those that ship, one for each preset of export.send",
    )
    parser.add_argument("--fps", type=float, help=FPS_HELP)
    parser.add_argument("--show", type=Path, help="folder for annotated pictures")
    parser.add_argument("--out", type=Path, help="file for the message's bytes")
    parser.add_argument("--scores", action="store_true", help="print each pair's scores, too")
    parser.add_argument("--threads", type=int, default=2, help="of onnxruntime")
    parser.add_argument(
        "--keep-on", action="store_true", help="go on after a message: for messages that change"
    )
    parser.add_argument("--key", type=Path, help="deliver only what was sent with this key")
    parser.add_argument("--max-age", type=float, help="of a message with a key, seconds")
    add_pixel_limit(parser)
    args = read_flags(parser.parse_args)
    at_least(1, threads=args.threads)
    if len(args.input) > 2:
        raise InputError("INPUT: give one folder, video or camera, or two images")
    if len(args.input) == 2:
        for flag in OF_FILMS:
            if getattr(args, flag) != parser.get_default(flag):
                raise ParameterError(flag, "two images are one frame pair, and hold no message")
        decoders = open_decoders(args.model, args.threads)
        return read_two_images(decoders, args.input[0], args.input[1], args.max_megapixels)
    inbox = Inbox(args.out, make_verifier(args.key, args.max_age))
    decoders = open_decoders(args.model, args.threads)
    if args.show is not None:
        make_folder(args.show)
    read_stream(decoders, args, inbox)


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


def read_two_images(
    decoders: Sequence[PairDecoder], first: str, second: str, max_megapixels: float | None
) -> None:
    """Decode two images in either order, with the display anywhere in each.

    Raises:
        InputError: an image is unreadable, they are of unlike size, no display is in both, or both
            show one state.
    """
    receivers = {decoder.layout: Receiver(decoder) for decoder in decoders}
    frames = [read_image(path, max_megapixels) for path in (first, second)]
    check_same_size(frames[0], frames[1])
    found = find_in_both(frames[0], frames[1], list(receivers))
    if found is None:
        sought = ", ".join(preset_name(layout) or "--model" for layout in receivers)
        raise InputError(
            f"{first}, {second}: no display is in both whose blocks change from one to the other "
            f"({sought} looked for); take one image of each state, from one place"
        )
    for path, corners in zip((first, second), found.corners, strict=True):
        what = {"preset": preset_name(found.layout), "corners": corners.round(2).tolist()}
        say("display", image=path, **what)
    pair = receivers[found.layout].decode_images(frames[0], frames[1], *found.corners)
    say("pair", **pair_values(pair, scores=True))


def pair_values(pair: DecodedPair, scores: bool) -> dict[str, Any]:
    """Collect what is printed of a pair, with its scores where ``scores`` is true."""
    entry: dict[str, Any] = {
        "pair": pair.number,
        "time": round(pair.time, 4),
        "erased": int((pair.soft.scores == 0).sum()),
        "confidence": round(float(np.mean(1 / (1 + np.exp(-np.abs(pair.soft.scores))))), 4),
        "frames": [pair.original.frames, pair.embedded.frames],
        "progress": round(pair.progress, 4),
    }
    if scores or pair.soft.scores.size <= MAX_PRINTED_BITS:
        entry["bits"] = "".join(map(str, pair.soft.bits))
    if scores:
        entry["scores"] = [round(float(score), 3) for score in pair.soft.scores]
    return entry


def read_stream(decoders: Sequence[PairDecoder], args: argparse.Namespace, inbox: Inbox) -> None:
    """Receive from a folder, a video or a camera until the message is whole or frames end."""
    source = open_source(args.input[0], args.fps, args.max_megapixels)
    receiver = Receiver(decoders, source.fps)
    in_view = clocked = False
    last: CameraFrame | None = None
    view: Tracked | None = None
    shown = 0
    try:
        for frame in source.frames:
            step = receiver.push(frame.image, frame.time)
            last = frame
            elsewhere = in_view and step.tracked is not None and step.tracked.anew
            if (step.tracked is not None) != in_view or elsewhere:
                in_view = step.tracked is not None
                place = step.tracked.corners.round(2).tolist() if step.tracked else None
                what = {"preset": preset_name(receiver.layout)} if in_view else {}
                say("display", time=round(frame.time, 4), frame=frame.name, corners=place, **what)
            if receiver.synchronised != clocked:
                clocked = receiver.synchronised
                rate = receiver.state_hz
                say("clock", time=round(frame.time, 4), state_hz=rate and round(rate, 3))
            view = step.tracked or view
            shown = write_pictures(args.show, shown, step, frame.image, view, receiver.layout)
            if print_step(step, args.scores, inbox) and not args.keep_on:
                break
        else:
            step = receiver.finish()
            if last is not None:
                write_pictures(args.show, shown, step, last.image, view, receiver.layout)
            print_step(step, args.scores, inbox)
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
    print_end(receiver, inbox, last)


def write_pictures(
    folder: Path | None,
    number: int,
    step: ReceiverStep,
    image: NDArray[np.uint8],
    view: Tracked | None,
    layout: Layout,
) -> int:
    """Write an annotated picture of each pair that a camera frame brought.

    Args:
        folder: folder of the pictures; None for no pictures.
        number: number of the next picture.
        step: what the camera frame brought.
        image: the camera frame.
        view: the display where it was last seen, or None.
        layout: layout of the display.

    Returns:
        the number of the next picture.
    """
    if folder is None or view is None:
        return number
    for pair in step.pairs:
        picture = draw_decoded_pair(image, view, pair, layout)
        write_image(folder / f"pair_{number % KEPT_PICTURES:03d}.png", picture)
        number += 1
    return number


def print_step(step: ReceiverStep, scores: bool, inbox: Inbox) -> bool:
    """Print what a camera frame brought; true where a message was delivered."""
    for pair in step.pairs:
        say("pair", **pair_values(pair, scores))
    return step.message is not None and inbox.take(step.message)


def print_end(receiver: Receiver, inbox: Inbox, last: CameraFrame | None) -> None:
    """Print the closing line.

    Raises:
        InputError: there is no message; says why.
    """
    timing = {
        stage: round(1e3 * seconds / receiver.timing.count[stage], 2)
        for stage, seconds in receiver.timing.spent.items()
    }
    say(
        "end",
        frames=receiver.frames,
        frames_with_display=receiver.found,
        seconds=round(last.time, 3) if last else 0.0,
        message=inbox.last.text if inbox.last else None,
        milliseconds=timing,
    )
    if inbox.last is not None:
        return
    raise InputError(explain_silence(replace(receiver.observations, refused=inbox.refused)))


if __name__ == "__main__":
    run_cli(main)
