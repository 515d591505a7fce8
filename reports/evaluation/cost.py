"""Time to fit and decide a frame pair, by method, as a multiple of two warps in the same round."""

import json
from collections.abc import Sequence
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from data_gen.frame_pair import Cell, FramePair, Source
from link.images import write_bytes
from reports.engine.backends import one_thread
from reports.engine.predict import Ideal, Method

COST_JSON = "cost.json"
REFERENCE = "two warps"


def measure(
    source: Source, cell: Cell, rounds: int, methods: Sequence[Method], folder: Path
) -> dict[str, Any]:
    """Time every method on the same frame pairs, one thread, and write cost.json.

    What else the machine does in a round meets all methods; a ratio is taken within each round.
    """
    one_thread()
    decoders = [(method.label or method.name, method.build()) for method in methods]
    decoders = [(name, decoder) for name, decoder in decoders if not isinstance(decoder, Ideal)]
    captured = [[FramePair(source, cell, i, h).captured for i in range(3)] for h in (False, True)]
    times: dict[str, list[float]] = {}
    for number in range(rounds + 1):
        pairs = [kind[number % 3].rectified() for kind in captured]
        start = perf_counter()
        captured[0][number % 3].rectified()
        taken = {REFERENCE: perf_counter() - start}
        for name, decoder in decoders:
            pair = pairs[0 if decoder.needs_ratex else 1]
            start = perf_counter()
            decoder.decode(pair)
            taken[name] = perf_counter() - start
        if number:  # the first warms up
            for name, seconds in taken.items():
                times.setdefault(name, []).append(seconds)
    reference = np.array(times[REFERENCE])
    ratios = {
        name: [round(float(q), 3) for q in np.quantile(np.array(t) / reference, (0.25, 0.5, 0.75))]
        for name, t in times.items()
    }
    result = {
        "rounds": rounds,
        "reference": REFERENCE,
        "reference_ms": round(1e3 * float(np.median(reference)), 3),
        "ratios": ratios,
    }
    write_bytes(folder / COST_JSON, (json.dumps(result, indent=1) + "\n").encode())
    return result


def read_cost(folder: Path) -> dict[str, Any] | None:
    """What `measure` wrote; None where there is no such file."""
    file = folder / COST_JSON
    return dict(json.loads(file.read_text())) if file.is_file() else None
