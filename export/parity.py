"""Compare torch and onnxruntime on unseen frames and sizes, down to the bits.

python -m export.parity RUN --frames 1000
"""

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import torch
import tyro
from numpy.typing import NDArray
from tqdm import tqdm

from export.film_graph import FilmGraph
from export.region_graph import RegionGraph
from export.runtime import Decoder
from link.captures import KnownWindow
from link.cli import check_flags, run_cli
from link.clock import DisplayClock
from link.embed import block_changes, embed
from link.errors import InputError, at_least
from link.layout import MAX_PIXELS, MAX_SIDE_PX, MIN_BLOCK_PX, Layout, make_layout
from link.observation import Observation, mixture_of_exposures
from models.film.decoder import FilmDecoder
from models.film.methods import decode_film_with
from models.film.window import SHRINK
from models.phi.checkpoint import load_checkpoint
from models.phi.decoder import PhiDecoder
from models.phi.methods import decode_with
from models.region.region import DisplayRegion

TOLERANCE = 1e-3
"""Largest difference of a score, a log-likelihood ratio, between torch and onnxruntime."""
FILM_TOLERANCE = 0.1
"""Largest difference of a score of the film decoder, in log-likelihood units: its rounds are in
float32. Bits of smaller scores may differ."""
FILM_WINDOWS, FILM_SEED = 9, 1
"""Number of the windows of film that are compared, and their seed."""
FILM_GRIDS = ((16, 16), (24, 32), (48, 64))
"""Rows and columns of the grids of the windows that are compared."""
REGION_BOUND = 10.0
"""Bound beyond which the log-odds of a map count as the bound: cells beyond are as sure as any."""
REGION_SIZES = ((3, 96, 128), (13, 360, 640), (9, 357, 203))
"""Number, height and width of the frames of which maps are compared."""
REGION_NOISE, REGION_CHANGE = 3.0, 6
"""Standard deviation of the noise of these frames, and by how much they toggle, gray levels."""
NOISE_RANGE = (10.0, 100.0)
"""Least and largest standard deviation of a pixel, gray levels: so much that most scores stay clear
of their bound, where all are alike, at `FAINT`."""
FAINT = 3
"""Largest kappa of the compared frame pairs."""
Both = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Scores of one observation by torch and by onnxruntime."""


@dataclass(frozen=True)
class Parity:
    """Result of a comparison of torch and onnxruntime."""

    frames: int
    """Number of frame pairs."""
    bits: int
    """Number of bits in all frame pairs."""
    different_bits: int
    """Number of bits that differ."""
    max_difference: float
    """Largest difference of a score, in log-likelihood units."""
    largest_score: float
    """Largest absolute score, in log-likelihood units."""
    median_score: float
    """Median of the absolute scores; it should be well below the largest, where a bound makes all
    scores alike."""
    tolerance: float = TOLERANCE
    """Largest difference of a score that is allowed, in log-likelihood units."""

    @property
    def holds(self) -> bool:
        """Whether every bit is equal and every score within the tolerance."""
        return self.different_bits == 0 and self.max_difference <= self.tolerance


def compare_with_torch(module: PhiDecoder, decoder: Decoder, frames: int, seed: int) -> Parity:
    """Decode synthetic frame pairs with both, every third at a size other than the exported one.

    Args:
        module: the decoder in torch.
        decoder: the decoder in onnxruntime.
        frames: number of frame pairs.
        seed: seed of the frame pairs.
    """
    rng = np.random.default_rng(seed)
    module.eval()

    def both() -> Iterator[Both]:
        for index in tqdm(range(frames), desc="parity", unit="pair"):
            scale = rng.uniform(0.5, 1.5) if index % 3 == 2 else 1.0
            noise = np.exp(rng.uniform(*np.log(NOISE_RANGE)))
            pair = synthetic_pair(resized_layout(module.layout, scale), rng, noise, FAINT)
            theirs = decoder.decode(pair.original, pair.embedded)
            yield decode_with(module, pair).scores, theirs.scores

    return _compared(both(), TOLERANCE, clear=0.0)


def compare_films(module: FilmDecoder, graph: FilmGraph) -> Parity:
    """Decode synthetic windows of film with both, on grids and of lengths that differ.

    Args:
        module: the film decoder in torch.
        graph: the film decoder in onnxruntime.

    Returns:
        what was found; bits count as different where their scores exceed `FILM_TOLERANCE`.
    """
    rng = np.random.default_rng(FILM_SEED)
    module.eval()

    def both() -> Iterator[Both]:
        for index in range(FILM_WINDOWS):
            rows, cols = FILM_GRIDS[index % len(FILM_GRIDS)]
            layout = make_layout(rows, cols, modulation="antipodal", pilots="auto")
            window = synthetic_window(layout, rng, frames=8 + 3 * index)[0].observation
            yield decode_film_with(module, window).scores, graph.decode(window).scores

    return _compared(both(), FILM_TOLERANCE, clear=FILM_TOLERANCE)


def compare_regions(module: DisplayRegion, graph: RegionGraph) -> Parity:
    """Map frames with both, of sizes and numbers that differ: noise, and a half that toggles.

    Args:
        module: the map of displays in torch.
        graph: the map of displays in onnxruntime.

    Returns:
        what was found; log-odds count as `REGION_BOUND` says, and cells count as different bits
        where they exceed `TOLERANCE`.
    """
    rng = np.random.default_rng(FILM_SEED)
    module.eval()

    def both() -> Iterator[Both]:
        for size in REGION_SIZES:
            noise = rng.integers(0, 256, size, np.uint8)
            toggling = rng.normal(100, REGION_NOISE, size)
            toggling[1::2, :, : size[2] // 2] += REGION_CHANGE
            for stills in (noise, toggling.astype(np.uint8)):
                with torch.no_grad():
                    ours = module(torch.from_numpy(stills).float()[:, None]).numpy()
                maps = np.clip([ours, graph.log_odds(stills)], -REGION_BOUND, REGION_BOUND)
                yield maps[0].ravel(), maps[1].ravel()

    return _compared(both(), TOLERANCE, clear=TOLERANCE)


def _compared(both: Iterator[Both], tolerance: float, clear: float) -> Parity:
    """Compare scores of observations; bits count where one of both scores is beyond ``clear``."""
    scores, differences, different, count = [], [], 0, 0
    for ours, theirs in both:
        count += 1
        scores.append(np.abs(ours))
        differences.append(float(np.abs(ours - theirs).max()))
        decided = np.maximum(np.abs(ours), np.abs(theirs)) > clear
        different += int((((ours > 0) != (theirs > 0)) & decided).sum())
    score = np.concatenate(scores)
    largest, median = float(score.max()), float(np.median(score))
    return Parity(
        count, score.size, different, float(np.max(differences)), largest, median, tolerance
    )


def synthetic_window(
    layout: Layout,
    rng: np.random.Generator,
    frames: int = 24,
    noise: float = 40.0,
    shutter_s: float = 0.01,
) -> tuple[KnownWindow, DisplayClock]:
    """Make a window of film: a picture that stands still, a clock, mixed exposures, and noise.

    Args:
        layout: grid with pilots, of the modulation "antipodal".
        rng: draws everything else.
        frames: number of frames.
        noise: standard deviation of a shrunk pixel, gray levels.
        shutter_s: time for which each place is exposed, seconds.

    Returns:
        the window with its bits, and the clock of the display.
    """
    height, width = layout.height // SHRINK, layout.width // SHRINK
    coarse = rng.uniform(40, 215, (6, 8)).astype(np.float32)
    picture = cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC)
    period = 1 / 30
    start, delay_y = rng.uniform(0, period), rng.uniform(-0.01, 0.01)
    clock = DisplayClock(period, start, 0.002, delay_y, shutter_s)
    times = np.arange(frames) / 60 + 0.1
    first, last = (int((clock.number(times[at]) + more) // 2) for at, more in ((0, -1), (-1, 2)))
    bits = rng.integers(0, 2, (last + 1 - first, layout.n_bits))
    grid = layout.rows, layout.cols
    y, x = np.mgrid[: layout.rows, : layout.cols]
    places = np.stack([(x + 0.5) / layout.cols, (y + 0.5) / layout.rows], axis=-1).reshape(-1, 2)
    shown = []
    for time in times:
        signal = np.zeros(grid)
        for number, row in enumerate(bits, first):
            before, after = (clock.shares(time, places, 2 * number + which) for which in (0, 1))
            signal += (after - before).reshape(grid) / 2 * block_changes(row, layout)
        blocks = cv2.resize(signal, (width, height), interpolation=cv2.INTER_NEAREST)
        shown.append(picture + 2 * blocks + noise * rng.standard_normal(picture.shape))
    mixture = mixture_of_exposures(clock, times, layout, first, len(bits))
    images = tuple(np.asarray(each, np.float32) for each in shown)
    observation = Observation(images, layout, mixture, times=tuple(times.tolist()))
    return KnownWindow(observation, bits), clock


def synthetic_pair(
    layout: Layout, rng: np.random.Generator, noise: float = 1.5, kappa_max: int = 10
) -> Observation:
    """Make a frame pair that looks filmed: clouds of colour behind a curve, drift, motion, noise.

    Enough to exercise every part of the graph; accuracy is measured on the channel, not here.

    Args:
        layout: grid and ratex patches of the frames.
        rng: draws everything else.
        noise: standard deviation of a pixel, gray levels.
        kappa_max: largest kappa; kappa is drawn from 1 to this.
    """
    size = (layout.width, layout.height)
    coarse = rng.integers(0, 256, (12, 16, 3), dtype=np.uint8)
    picture = cv2.resize(coarse, size, interpolation=cv2.INTER_CUBIC)
    kappa = int(rng.integers(1, kappa_max + 1))
    shown = embed(np.asarray(picture, np.uint8), rng.integers(0, 2, layout.n_bits), layout, kappa)
    gamma, gain = rng.uniform(0.6, 1.6), np.exp(0.04 * rng.standard_normal())
    frames = []
    for frame, factor, shift in ((shown.original, 1.0, 0.0), (shown.embedded, gain, 0.15)):
        motion = np.column_stack([np.eye(2), shift * rng.standard_normal(2)])
        moved = cv2.warpAffine(frame, motion, size, borderMode=cv2.BORDER_REPLICATE)
        filmed = 240 * factor * (moved / 255.0) ** gamma + noise * rng.standard_normal(moved.shape)
        frames.append(np.clip(filmed.round(), 0, 255).astype(np.uint8))
    return Observation.still(frames[0], frames[1], layout, kappa)


def resized_layout(layout: Layout, scale: float) -> Layout:
    """Spread a layout over a frame of about ``scale`` times its size, within what layouts allow."""
    scale = min(scale, max(1.0, (MAX_PIXELS / (layout.width * layout.height)) ** 0.5 - 0.01))
    smallest = {"width": layout.cols * MIN_BLOCK_PX, "height": layout.rows * MIN_BLOCK_PX}
    size = {
        side: min(MAX_SIDE_PX, max(low, round(scale * getattr(layout, side))))
        for side, low in smallest.items()
    }
    return replace(layout, **size)


@dataclass(frozen=True)
class ParityConfig:
    """Compare a run's decoder.onnx with its checkpoint on synthetic frame pairs."""

    run: tyro.conf.Positional[Path]
    """Folder with decoder.pt, config.json and decoder.onnx."""
    frames: int = 1000
    """Number of synthetic frame pairs."""
    seed: int = 1
    """Seed of the frame pairs."""


def main() -> None:
    """Print the comparison as JSON; exit status 2 where parity fails."""
    config = check_flags(tyro.cli(ParityConfig, prog="python -m export.parity"))
    at_least(1, frames=config.frames)
    module, decoder = load_checkpoint(config.run), Decoder(config.run / "decoder.onnx")
    parity = compare_with_torch(module, decoder, config.frames, config.seed)
    print(json.dumps(asdict(parity)))
    if not parity.holds:
        raise InputError(f"{config.run}: torch and onnxruntime disagree; export again")


if __name__ == "__main__":
    run_cli(main)
