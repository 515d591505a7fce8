"""Measure how many camera frames a second the receiver takes: python -m receiver.bench INPUT.

INPUT is a folder of images or a video, such as `python -m data_gen.video` writes. All frames are
read before; then each is pushed through the receiver, and one cv2.warpPerspective of the frame to
the layout's size is timed beside it, so that what else the machine does meets both.
"""

import json
from time import perf_counter

import cv2
import numpy as np

from link.cli import Parser, add_pixel_limit, check_flags, run_cli
from link.errors import InputError, at_least
from link.markdown import markdown_table
from receiver.decoders import add_model_flag, open_decoders
from receiver.receiver import Receiver
from receiver.sources import FPS_HELP, open_source

H_CAPTURED_FROM_DISPLAY = np.array([[2.0, 0.1, 100], [0.05, 1.8, 60], [1e-4, 1e-4, 1]])
"""Homography of the warp that is timed for comparison."""


def main() -> None:
    """Print a table of stages and one JSON line."""
    parser = Parser(prog="python -m receiver.bench", description="Speed of the whole receiver.")
    parser.add_argument("input", metavar="INPUT", help="a folder of images or a video file")
    add_model_flag(parser)
    parser.add_argument("--fps", type=float, help=FPS_HELP)
    parser.add_argument("--frames", type=int, default=300, help="at most")
    parser.add_argument("--threads", type=int, default=2, help="of onnxruntime and OpenCV")
    add_pixel_limit(parser)
    args = check_flags(parser.parse_args())
    at_least(1, threads=args.threads, frames=args.frames)
    cv2.setNumThreads(args.threads)
    source = open_source(args.input, args.fps)
    frames = [frame for _, frame in zip(range(args.frames), source.frames, strict=False)]
    decoders, film = open_decoders(args.model, args.threads)
    receiver = Receiver(decoders, source.fps, film)
    size = receiver.layout.width, receiver.layout.height
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    pushed, warped = [], []
    clocked = len(frames)
    for number, frame in enumerate(frames):
        start = perf_counter()
        cv2.warpPerspective(frame.image, H_CAPTURED_FROM_DISPLAY, size, flags=flags)
        warped.append(perf_counter() - start)
        start = perf_counter()
        receiver.push(frame.image, frame.time)
        pushed.append(perf_counter() - start)
        if receiver.synchronised:
            clocked = min(clocked, number)
    if receiver.decoded == 0:
        raise InputError(f"{args.input}: no frame pair was decoded; nothing to time")
    warp = float(np.median(warped))
    height, width = frames[0].image.shape[:2]
    print(f"{len(frames)} frames of {width}x{height}, {args.threads} threads; ", end="")
    print(f"one warpPerspective: {1e3 * warp:.2f} ms\n")
    rows = []
    for stage, seconds in receiver.timing.spent.items():
        count = receiver.timing.count[stage]
        each, share = seconds / count, seconds / len(frames)
        numbers = f"{1e3 * each:.2f}", str(count), f"{1e3 * share:.2f}", f"{share / warp:.2f}"
        rows.append([stage, *numbers])
    heads = ["stage", "ms a call", "calls", "ms a camera frame", "warps a camera frame"]
    print(markdown_table(heads, rows))
    rates = len(frames) / np.sum(pushed)
    steady = 1 / np.mean(pushed[len(pushed) // 4 :])
    result = {
        "frames": len(frames),
        "frames_per_second": round(float(rates), 1),
        "after_first_quarter": round(float(steady), 1),
        "slowest_frame_ms": round(1e3 * float(np.max(pushed)), 1),
        "slowest_with_clock_ms": round(1e3 * float(np.max(pushed[clocked:])), 1),
        "warp_ms": round(1e3 * warp, 3),
    }
    print(f"\n{json.dumps(result)}")


if __name__ == "__main__":
    run_cli(main)
