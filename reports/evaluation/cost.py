"""Time to fit and decide a frame pair, by method, as a multiple of two warps in the same round."""

from collections.abc import Sequence
from time import perf_counter

import numpy as np

from data_gen.frame_pair import Cell, FramePair, Source
from reports.engine.backends import one_thread
from reports.engine.methods import Method
from reports.run import Cost

REFERENCE = "two warps"
"""What a frame pair's time is compared with: rectifying its two frames."""
FRAME_PAIRS = 3
"""Number of frame pairs on which the rounds take turns."""


def measure_cost(source: Source, cell: Cell, rounds: int, methods: Sequence[Method]) -> Cost:
    """Time every decoder on the same frame pairs, with one thread.

    What else the machine does in a round meets all methods; a ratio is taken within each round.

    Args:
        source: pictures, seed and channel.
        cell: the frame pairs that are timed are the first ones of this cell.
        rounds: number of times that every method is timed.
        methods: all that are timed.
    """
    one_thread()
    decoders = [(method, method.build()) for method in methods]
    captured = {
        equalised: [FramePair(source, cell, i, equalised).captured for i in range(FRAME_PAIRS)]
        for equalised in (False, True)
    }
    times: dict[str, list[float]] = {}
    for number in range(rounds + 1):
        mine = {equalised: kind[number % FRAME_PAIRS] for equalised, kind in captured.items()}
        pairs = {equalised: frames.rectified() for equalised, frames in mine.items()}
        start = perf_counter()
        mine[False].rectified()
        taken = {REFERENCE: perf_counter() - start}
        for method, decoder in decoders:
            start = perf_counter()
            decoder.decode(pairs[method.card.equalised])
            taken[method.label] = perf_counter() - start
        if number:  # the first warms up
            for name, seconds in taken.items():
                times.setdefault(name, []).append(seconds)
    reference = np.array(times[REFERENCE])
    return Cost(
        rounds=rounds,
        reference=REFERENCE,
        reference_ms=round(1e3 * float(np.median(reference)), 3),
        ratios={name: _quartiles(np.array(mine) / reference) for name, mine in times.items()},
    )


def _quartiles(values: np.ndarray) -> tuple[float, float, float]:
    """Lower quartile, median and upper quartile."""
    low, middle, high = (round(float(q), 3) for q in np.quantile(values, (0.25, 0.5, 0.75)))
    return low, middle, high
