"""Time what it takes to fit and decide one frame pair: python -m export.bench MODEL.

Every round times all candidates one after another on the same frame pair, so that what else the
machine does meets all of them; a ratio is taken within each round.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass
from time import perf_counter

import cv2
import numpy as np
import tyro
from numpy.typing import NDArray
from sklearn.svm import SVC, LinearSVC
from tqdm import trange

from export.parity import synthetic_pair
from export.runtime import Decoder
from link.cli import check_flags, run_cli
from link.errors import at_least
from link.images import as_batch, intensity
from link.markdown import markdown_table
from link.observation import Observation
from models import find_graph
from models.paper.common import require_ratex
from models.paper.oorc import OORC, explicit_map

REFERENCE = "two warpPerspective"
"""Name of the reference by whose time all times are divided."""
CAPTURE = (720, 960)
"""Rows and columns of the capture that the two reference warps rectify."""


@dataclass(frozen=True)
class BenchConfig:
    """Compare the exported decoder with two warps and with scikit-learn's SVM."""

    model: tyro.conf.Positional[str] = "paper"
    """The .onnx file of the decoder, or the name of a preset, whose decoder ships."""
    rounds: int = 200
    """Number of timed rounds."""
    warmup: int = 20
    """Number of rounds before the timed ones."""
    threads: int = 2
    """Number of threads of onnxruntime, and of OpenCV."""
    seed: int = 0
    """Seed of the synthetic frame pairs."""


def main() -> None:
    """Print a table of median times and ratios, and one JSON line."""
    config = check_flags(tyro.cli(BenchConfig, prog="python -m export.bench"))
    at_least(1, rounds=config.rounds, threads=config.threads)
    cv2.setNumThreads(config.threads)
    decoder = Decoder(find_graph(config.model), config.threads)
    rng = np.random.default_rng(config.seed)
    times: dict[str, list[float]] = {}
    for number in trange(config.warmup + config.rounds, desc="bench", unit="round"):
        for name, action in timed_actions(
            decoder, synthetic_pair(decoder.layout, rng), rng
        ).items():
            start = perf_counter()
            action()
            if number >= config.warmup:
                times.setdefault(name, []).append(1e3 * (perf_counter() - start))
    measured = {name: np.array(values) for name, values in times.items()}
    print(ratio_table(measured, config))
    ratios = {name: quartiles(value / measured[REFERENCE]) for name, value in measured.items()}
    print(json.dumps({"rounds": config.rounds, "threads": config.threads, "ratios": ratios}))


def timed_actions(
    decoder: Decoder, pair: Observation, rng: np.random.Generator
) -> dict[str, Callable[[], object]]:
    """Prepare what is timed on one frame pair.

    Args:
        decoder: the exported decoder.
        pair: rectified frames.
        rng: draws the capture that the two warps rectify.

    Returns:
        functions without arguments, by name.
    """
    layout = pair.layout
    capture = rng.integers(0, 256, (*CAPTURE, 3), dtype=np.uint8)
    H_captured_from_display = np.array([[1.6, 0.1, 40], [0.05, 1.6, 30], [1e-4, 1e-4, 1]])
    size = (layout.width, layout.height)
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    batches = as_batch(pair.original), as_batch(pair.embedded)

    def two_warps() -> None:
        for _ in range(2):
            cv2.warpPerspective(capture, H_captured_from_display, size, flags=flags)

    actions: dict[str, Callable[[], object]] = {
        REFERENCE: two_warps,
        "decoder.onnx, fit and decision": lambda: decoder.run(*batches),
        "method oorc, fit and decision": lambda: OORC().decode(pair),
    }
    return actions | (fits_of_svms(pair) if layout.ratex else {})


def fits_of_svms(pair: Observation) -> dict[str, Callable[[], object]]:
    """Prepare fits of scikit-learn's SVMs to the single pixels of a frame pair's ratex patches."""
    pixels = require_ratex(pair)
    maps = explicit_map(intensity(pair.original), intensity(pair.embedded))
    u = maps[pixels.y, pixels.x]
    u = u / np.sqrt((u**2).mean(axis=0))
    linear = LinearSVC(loss="squared_hinge", dual=False, tol=1e-6, max_iter=5000)
    return {
        "scikit-learn LinearSVC, fit alone": lambda: linear.fit(u, pixels.label),
        "scikit-learn SVC (linear), fit alone": lambda: SVC(kernel="linear").fit(u, pixels.label),
    }


def quartiles(values: NDArray[np.float64]) -> list[float]:
    """Compute the lower quartile, the median and the upper quartile, rounded to 3 digits."""
    return [round(float(v), 3) for v in np.quantile(values, [0.25, 0.5, 0.75])]


def ratio_table(times: dict[str, NDArray[np.float64]], config: BenchConfig) -> str:
    """Write a Markdown table of median times, and of ratios to `REFERENCE` with their quartiles.

    Args:
        times: milliseconds of each round, by name.
        config: says how many rounds and threads there were.
    """
    rows = []
    for name, values in times.items():
        low, middle, high = quartiles(values / times[REFERENCE])
        rows.append([name, f"{np.median(values):.2f}", f"{middle:.2f}", f"{low:.2f} – {high:.2f}"])
    table = markdown_table(["what", "ms, median", "times two warps", "quartiles"], rows)
    title = f"{config.rounds} rounds, {config.threads} threads, ratios within each round"
    return f"{title}\n\n{table}"


if __name__ == "__main__":
    run_cli(main)
