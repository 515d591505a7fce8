"""What an endless stream costs the receiver: python -m reports.films.endless.

Streams that no receiver should choke on are pushed through it frame by frame: noise, a display that
stands still, and a film that begins again and again. Memory and the time of a frame are measured on
the way, each stream in a process of its own.

Simulated scores of a message that goes on and on, and then changes, go to the collector alone: how
often does it begin to collect anew for nothing, and how soon does the other message come?
"""

import json
import multiprocessing
import os
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from itertools import cycle, islice
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import tyro
from numpy.typing import NDArray

from data_gen.film.scenes import SceneSettings
from data_gen.film.stream import VideoSettings, film
from data_gen.frame_pair import Source, shuffled_pictures
from export.receive.receiver import Receiver
from export.runtime import OWN_TIME_LIMIT_S, Decoder
from link.cli import read_flags, run_cli
from link.code.collect import make_collector
from link.code.framing import encode
from link.embed import embed
from link.errors import InputError, at_least, choose, each_once
from link.files.lock import locked
from link.images import write_bytes
from link.layout import make_layout
from models import PRETRAINED
from reports.engine.backends import one_thread
from reports.engine.provenance import provenance
from reports.render.charts import (
    SPARE_COLOURS,
    Point,
    Series,
    draw_series,
    in_style,
    new_panels,
    save_png,
)
from reports.render.tables import Table

SIZE = (320, 240)
"""Width and height of the frames, pixels."""
FPS = 30.0
"""Number of frames that the camera takes a second."""
PAIR, KAPPA, COVERAGE = "canon-lg", 3, 0.6
"""Camera-display pair, gray levels added for a 1, and share of the image that is display."""
MESSAGE = b"again"
"""Message of the film."""
PLAYS = 6
"""Number of plays of the message's loop in the film, before the film begins again."""
N_BYTES = 100
"""Length of the messages whose scores are simulated."""
WRONG_BITS = (0.02, 0.05, 0.1, 0.15, 0.2)
"""Shares of wrong bits in simulated scores."""
NOISY_LOOP = 4
"""One loop in so many is noise in the last row of the table of simulated scores."""
SHOWN_LOOPS = 50
"""Number of loops of a message before it changes."""
BLOCKS = 100
"""Number of blocks into which a stream is cut; each is a point of the charts."""
STATM = Path("/proc/self/statm")
"""File in which Linux says how much memory the process holds, in pages."""

Images = Iterator[NDArray[np.uint8]]


@dataclass(frozen=True)
class EndlessConfig:
    """Memory and time of the receiver over long streams (simulated)."""

    frames: int = 20_000
    """Number of frames in each stream."""
    streams: tuple[str, ...] = ("noise", "still", "film")
    """Streams: "noise", "still" (a display that shows one state), "film" (played in a loop)."""
    scores: int = 6_000
    """Number of frames of simulated scores for each share of wrong bits."""
    changes: int = 20
    """Number of changes of the message for each share of wrong bits."""
    seed: int = 0
    """Seed of all draws."""
    out: Path = Path("runs/endless")
    """Folder of endless.json and endless.png."""


@dataclass(frozen=True)
class StreamBlock:
    """What the receiver needed for some frames in a row."""

    last: int
    """Number of frames pushed until the block's end."""
    mean_ms: float
    """Mean time of a frame, milliseconds."""
    slowest_ms: float
    """Longest time of a frame, milliseconds."""
    memory_mib: float
    """Memory that the process held at the block's end, MiB."""
    attempts: int
    """Number of times that a message was decoded, with or without success, since the start."""
    messages: int
    """Number of messages delivered since the start."""


def noise_images(rng: np.random.Generator) -> Images:
    """Give images of independent random pixels without end."""
    while True:
        yield rng.integers(0, 256, (SIZE[1], SIZE[0], 3), dtype=np.uint8)


def filmed_images(rng: np.random.Generator) -> Images:
    """Give the frames of one film of a hand-held camera, again and again, without end."""
    layout = make_layout()
    source = Source(layout, "test", 0)
    pictures = shuffled_pictures(source)
    pairs = [embed(pictures[0].rgb, bits, layout, KAPPA) for bits in encode(MESSAGE, layout.n_bits)]
    states = [state for pair in pairs for state in (pair.original, pair.embedded)]
    scene = SceneSettings(size=SIZE, coverage=COVERAGE, pictures=pictures, centred=True)
    settings = VideoSettings(scene, fps=FPS, seconds=PLAYS * len(states) / VideoSettings.state_hz)
    frames = film(states, layout, source.pair(PAIR), 0.0, settings, rng)
    yield from cycle([frame.rgb for frame in frames])


def still_images(rng: np.random.Generator) -> Images:
    """Give one frame of the film without end, each time with other noise of a gray level."""
    first = next(filmed_images(rng)).astype(np.float32)
    while True:
        noisy = first + rng.standard_normal(first.shape, np.float32)
        yield np.clip(noisy + 0.5, 0, 255).astype(np.uint8)


STREAMS: dict[str, Callable[[np.random.Generator], Images]] = {
    "noise": noise_images,
    "still": still_images,
    "film": filmed_images,
}
"""Streams by their names; each is made from a generator of random numbers."""

COLOURS = dict(zip(STREAMS, SPARE_COLOURS, strict=False))
"""Colours of the streams in the charts."""


def memory_mib() -> float:
    """Memory that this process holds, in MiB.

    Raises:
        InputError: the system is not Linux.
    """
    try:
        pages = int(STATM.read_text().split()[1])
    except OSError:
        raise InputError(f"{STATM}: not there; this study measures memory on Linux alone") from None
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


def measure_stream(stream: str, frames: int, seed: int) -> list[StreamBlock]:
    """Push a stream through the receiver and measure.

    Args:
        stream: one of `STREAMS`.
        frames: number of frames, at least `BLOCKS`.
        seed: seed of all draws.

    Returns:
        `BLOCKS` blocks in order.
    """
    one_thread()
    images = choose(STREAMS, stream, "stream")(np.random.default_rng(seed))
    receiver = Receiver(Decoder(PRETRAINED / "decoder.onnx", 1, OWN_TIME_LIMIT_S), FPS)
    blocks: list[StreamBlock] = []
    spent: list[float] = []
    messages = 0
    for number, image in enumerate(islice(images, frames), 1):
        start = perf_counter()
        step = receiver.push(image, number / FPS)
        spent.append(1e3 * (perf_counter() - start))
        messages += step.message is not None
        if number * BLOCKS // frames > len(blocks):
            mean, slowest = float(np.mean(spent)), max(spent)
            blocks.append(
                StreamBlock(number, mean, slowest, memory_mib(), receiver.decode_attempts, messages)
            )
            spent = []
    return blocks


def growth_mib(blocks: list[StreamBlock]) -> float:
    """Say by how much memory grew from the second fifth of a stream to the last, in MiB.

    The first fifth is left out, because buffers fill there.
    """
    fifth = len(blocks) // 5
    memory = [block.memory_mib for block in blocks]
    return float(np.median(memory[-fifth:]) - np.median(memory[fifth : 2 * fifth]))


def simulated_scores(
    bits: NDArray[np.uint8], wrong: float, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Draw log-likelihood ratios of hard decisions of which a share is wrong.

    Args:
        bits: (n_bits,) of 0 or 1.
        wrong: probability of a wrong decision, above 0 and below 0.5.
        rng: draws the wrong ones.

    Returns:
        (n_bits,) scores, positive for 1.
    """
    signs = (2.0 * bits - 1) * np.where(rng.random(bits.shape) < wrong, -1, 1)
    return np.asarray(np.log((1 - wrong) / wrong) * signs)


@dataclass(frozen=True)
class FalseStarts:
    """What a collector does while a display shows the message that was delivered."""

    wrong: float
    """Share of wrong bits."""
    noisy_loops: bool
    """Whether one loop in `NOISY_LOOP` is noise."""
    starts: float
    """Number of times, of 1,000 frames, that collecting began for nothing."""
    collecting: float
    """Share of the frames that were collected for nothing."""
    attempts: float
    """Number of times, of 1,000 frames, that what was collected was decoded."""
    again: int
    """Number of messages that were returned after the first, which should be none."""


def false_starts(wrong: float, noisy_loops: bool, frames: int, seed: int) -> FalseStarts:
    """Count what a collector does while a display shows the message that was delivered."""
    rng = np.random.default_rng([seed, round(1000 * wrong), noisy_loops])
    n_bits = make_layout().n_bits
    loop = encode(rng.bytes(N_BYTES), n_bits)
    collector = make_collector(n_bits)
    delivered = starts = collected = again = attempts = count = 0
    while delivered < frames:
        noise = noisy_loops and count // len(loop) % NOISY_LOOP == NOISY_LOOP - 1
        scores = simulated_scores(loop[count % len(loop)], wrong, rng)
        before = collector.collecting
        message = collector.add(rng.normal(0, 6, n_bits) if noise else scores, count)
        count += 1
        if delivered == 0:  # the frames are counted from the first message on
            delivered, attempts = int(message is not None), collector.attempts
            continue
        delivered += 1
        again += message is not None
        collected += collector.collecting
        starts += collector.collecting and not before
    per_thousand = 1000 / frames
    tried = per_thousand * (collector.attempts - attempts)
    return FalseStarts(wrong, noisy_loops, per_thousand * starts, collected / frames, tried, again)


def loops_until_changed(wrong: float, changes: int, seed: int) -> list[float]:
    """Return for each change how many loops of the new message passed until it came.

    Both messages have the same length, and the new one begins anywhere in its loop.
    """
    rng = np.random.default_rng([seed, round(1000 * wrong), 2])
    n_bits = make_layout().n_bits
    collector, shown = make_collector(n_bits), encode(rng.bytes(N_BYTES), n_bits)
    found, count = [], 0
    for change in range(changes + 1):
        if change:
            shown = encode(rng.bytes(N_BYTES), n_bits)
        first, came = int(rng.integers(len(shown))), np.inf
        for frame in range(SHOWN_LOOPS * len(shown)):
            bits = shown[(first + frame) % len(shown)]
            message = collector.add(simulated_scores(bits, wrong, rng), count)
            count += 1
            if message is not None:
                came = min(came, (frame + 1) / len(shown))
        found.append(came)
    return found[1:]


def collector_tables(starts: list[FalseStarts], delays: dict[float, list[float]]) -> list[Table]:
    """Make the table of false starts and that of changed messages."""
    rows = [
        [
            f"{100 * found.wrong:g} %"
            + (f", one loop in {NOISY_LOOP} is noise" if found.noisy_loops else ""),
            f"{found.starts:.1f}",
            f"{100 * found.collecting:.2f} %",
            f"{found.attempts:.1f}",
            str(found.again),
        ]
        for found in starts
    ]
    heads = ["wrong bits", "false starts of 1,000 frames", "frames collected for nothing"]
    heads += ["decodes of 1,000 frames", "returned again"]
    changed = [
        [f"{100 * wrong:g} %", f"{np.median(loops):.2f}", f"{max(loops):.2f}"]
        for wrong, loops in delays.items()
    ]
    return [
        Table(heads, rows),
        Table(["wrong bits", "loops until a changed message, median", "largest"], changed),
    ]


def main() -> None:
    """Measure, print, write endless.json and endless.png."""
    config = read_flags(lambda: tyro.cli(EndlessConfig))
    each_once(streams=config.streams)
    at_least(BLOCKS, frames=config.frames)
    at_least(1, scores=config.scores, changes=config.changes)
    at_least(0, seed=config.seed)
    for stream in config.streams:
        choose(STREAMS, stream, "stream")
    with locked(config.out):
        _run(config)


def _run(config: EndlessConfig) -> None:
    """Measure, print, write, while no other process writes the folder."""
    found: dict[str, list[StreamBlock]] = {}
    spawned = multiprocessing.get_context("spawn")
    for stream in config.streams:
        with ProcessPoolExecutor(1, spawned) as process:
            found[stream] = process.submit(
                measure_stream, stream, config.frames, config.seed
            ).result()
    cases = [*((wrong, False) for wrong in WRONG_BITS), (WRONG_BITS[0], True)]
    starts = [false_starts(*case, config.scores, config.seed) for case in cases]
    delays = {w: loops_until_changed(w, config.changes, config.seed) for w in WRONG_BITS[:3]}
    tables = [endless_table(found, config.frames), *collector_tables(starts, delays)]
    page = "\n\n".join(table.markdown() for table in tables)
    content: dict[str, Any] = {
        "meta": provenance(config.seed, simulated=True),
        "frames": config.frames,
        "size": SIZE,
        "false_starts": [asdict(case) for case in starts],
        "loops_until_changed": delays,
        "streams": {name: [asdict(block) for block in blocks] for name, blocks in found.items()},
    }
    write_bytes(config.out / "endless.json", (json.dumps(content, indent=1) + "\n").encode())
    draw_endless(found, config.out / "endless.png")
    print(page)


def endless_table(found: dict[str, list[StreamBlock]], frames: int) -> Table:
    """Make a table of the streams: times, memory, attempts to decode, messages."""
    heads = ["stream", "ms a frame, first fifth", "last fifth", "slowest frame, ms"]
    heads += ["memory, MiB", "growth, MiB", "decoded, of 1,000 frames", "messages"]
    rows = []
    for stream, blocks in found.items():
        fifth, last = len(blocks) // 5, blocks[-1]
        times = [block.mean_ms for block in blocks]
        rows.append(
            [
                stream,
                f"{np.median(times[:fifth]):.1f}",
                f"{np.median(times[-fifth:]):.1f}",
                f"{max(block.slowest_ms for block in blocks):.0f}",
                f"{last.memory_mib:.0f}",
                f"{growth_mib(blocks):+.1f}",
                f"{1000 * last.attempts / frames:.2f}",
                str(last.messages),
            ]
        )
    return Table(heads, rows)


@in_style
def draw_endless(found: dict[str, list[StreamBlock]], path: Path) -> None:
    """Draw the time of a frame and the memory against the number of frames, and write the PNG."""
    figure, panels = new_panels(2, legend=1.0, size=(7.3, 2.8))
    labels = {"mean_ms": "mean time of a frame, ms", "memory_mib": "memory, MiB"}
    for panel, (key, label) in zip(panels, labels.items(), strict=True):
        lines = []
        for name, blocks in found.items():
            values = [(block.last, float(getattr(block, key))) for block in blocks]
            lines.append(Series(name, [Point(x, y, y, y) for x, y in values], COLOURS[name]))
        highest = max(point.y for line in lines for point in line.points)
        end = max(point.x for line in lines for point in line.points)
        panel.set(xlim=(0, end), ylim=(0, 1.1 * highest), xlabel="frames", ylabel=label)
        draw_series(panel, lines, markers=False)
    save_png(figure, path)


if __name__ == "__main__":
    run_cli(main)
