"""Camera frames to a message: python -m export.receive INPUT --model M.

INPUT is a folder of images, a video file or a camera's number; two images are one frame pair.
Prints JSON lines: display, clock, pair, message, end.
"""

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from export.locate.find import locate
from export.receive.receiver import Pair, Receiver, Step
from export.receive.show import draw_pair
from export.receive.sources import Frame, open_source
from export.receive.track import Tracked
from export.runtime import Decoder
from link.code.collect import Message
from link.errors import InputError, at_least, run_cli
from link.images import make_folder, read_image, write_bytes, write_image

MODEL = Path(__file__).parents[2] / "models" / "neural" / "pretrained" / "decoder.onnx"
SHOWN = 50
"""Annotated pictures kept; later ones replace the oldest, so that an endless stream fits a disk."""


def main() -> None:
    """Print JSON lines until the message is whole or the frames end."""
    parser = argparse.ArgumentParser(prog="python -m export.receive", description=__doc__)
    parser.add_argument("input", nargs="+", metavar="INPUT")
    parser.add_argument("--model", type=Path, default=MODEL, help="an .onnx file")
    parser.add_argument("--fps", type=float, help="camera frames a second, where INPUT is silent")
    parser.add_argument("--show", type=Path, help="folder for annotated pictures")
    parser.add_argument("--out", type=Path, help="file for the message's bytes")
    parser.add_argument("--scores", action="store_true", help="print each pair's scores, too")
    parser.add_argument("--threads", type=int, default=2, help="of onnxruntime")
    parser.add_argument(
        "--keep-on", action="store_true", help="go on after a message: for messages that change"
    )
    args = parser.parse_args()
    at_least(1, threads=args.threads)
    decoder = Decoder(args.model, args.threads)
    if args.show is not None:
        make_folder(args.show)
    if len(args.input) > 2:
        raise InputError("INPUT: give one folder, video or camera, or two images")
    if len(args.input) == 2:
        read_pair(decoder, *args.input)
    else:
        read_stream(decoder, args)


def say(event: str, **what: Any) -> None:
    """One JSON line."""
    print(json.dumps({"event": event, **what}), flush=True)


def read_pair(decoder: Decoder, first: str, second: str) -> None:
    """Two images: either order, the display anywhere in each."""
    frames = [read_image(path) for path in (first, second)]
    corners = []
    for path, image in zip((first, second), frames, strict=True):
        found = locate(image, decoder.layout)
        if found is None:
            raise InputError(f"{path}: no display with this layout's ratex patches in view")
        corners.append(found.corners)
        say("display", image=path, corners=found.corners.round(2).tolist())
    receiver = Receiver(decoder)
    pair = receiver.pair(frames[0], frames[1], corners[0], corners[1])
    say("pair", **describe(pair, scores=True))


def describe(pair: Pair, scores: bool) -> dict[str, Any]:
    """What is printed of a pair."""
    entry: dict[str, Any] = {
        "pair": pair.number,
        "time": round(pair.time, 4),
        "bits": "".join(map(str, pair.soft.bits)),
        "erased": int((pair.soft.scores == 0).sum()),
        "confidence": round(float(np.mean(1 / (1 + np.exp(-np.abs(pair.soft.scores))))), 4),
        "frames": [pair.original.frames, pair.embedded.frames],
        "progress": round(pair.progress, 4),
    }
    if scores:
        entry["scores"] = [round(float(score), 3) for score in pair.soft.scores]
    return entry


def read_stream(decoder: Decoder, args: argparse.Namespace) -> None:
    """A folder, a video or a camera."""
    source = open_source(args.input[0], args.fps)
    receiver = Receiver(decoder, source.fps)
    in_view = clocked = False
    message: Message | None = None
    last: Frame | None = None
    view: Tracked | None = None
    shown = 0
    try:
        for frame in source.frames:
            step = receiver.push(frame.image, frame.time)
            last = frame
            if (step.tracked is not None) != in_view:
                in_view = step.tracked is not None
                place = step.tracked.corners.round(2).tolist() if step.tracked else None
                say("display", time=round(frame.time, 4), frame=frame.name, corners=place)
            if receiver.synchronised != clocked:
                clocked = receiver.synchronised
                rate = receiver.state_hz
                say("clock", time=round(frame.time, 4), state_hz=rate and round(rate, 3))
            view = step.tracked or view
            shown = draw(args.show, shown, step, frame.image, view, decoder)
            message = report(step, args) or message
            if message is not None and not args.keep_on:
                break
        else:
            step = receiver.finish()
            if last is not None:
                draw(args.show, shown, step, last.image, view, decoder)
            message = report(step, args) or message
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
    finish(receiver, message, last)


def draw(
    folder: Path | None,
    number: int,
    step: Step,
    image: NDArray[np.uint8],
    view: Tracked | None,
    decoder: Decoder,
) -> int:
    """Write a picture of each pair; the number of the next."""
    if folder is None or view is None:
        return number
    for pair in step.pairs:
        picture = draw_pair(image, view, pair, decoder.layout)
        write_image(folder / f"pair_{number % SHOWN:03d}.png", picture)
        number += 1
    return number


def report(step: Step, args: argparse.Namespace) -> Message | None:
    """Print what a step brought; the message, if it came."""
    for pair in step.pairs:
        say("pair", **describe(pair, args.scores))
    message = step.message
    if message is not None:
        say(
            "message",
            text=message.text,
            hex=message.data.hex(),
            loop_frames=message.frames,
            pairs_used=message.seen,
            confidence=round(message.agreement, 4),
        )
        if args.out is not None:
            write_bytes(args.out, message.data)
    return message


def finish(receiver: Receiver, message: Message | None, last: Frame | None) -> None:
    """The closing line, and why there is no message."""
    timing = {
        stage: round(1e3 * seconds / receiver.timing.count[stage], 2)
        for stage, seconds in receiver.timing.spent.items()
    }
    say(
        "end",
        frames=receiver.frames,
        frames_with_display=receiver.found,
        seconds=round(last.time, 3) if last else 0.0,
        message=message.text if message else None,
        milliseconds=timing,
    )
    if message is not None:
        return
    if receiver.found == 0:
        reason = (
            f"no display with this layout's ratex patches in any of {receiver.frames} frames; "
            "check the model's layout, focus, exposure, and that the whole display is in view"
        )
    elif receiver.decoded == 0:
        reason = (
            f"the display is in view in {receiver.found} of {receiver.frames} frames, but its "
            "ratex patches do not change; is the sender playing, and is --fps right?"
        )
    else:
        reason = (
            f"no message after {receiver.decoded} frame pairs, {receiver.progress:.0%} of the "
            "information received; film longer, closer, or with a larger --kappa"
        )
    raise InputError(reason)


if __name__ == "__main__":
    run_cli(main)
