"""The CDTF that each method finds, against the one that the simulated frame pair really had."""

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data_gen.frame_pair import Cell, FramePair, Source
from link.equalise import uniform_mapping
from link.geometry import rectify
from link.images import intensity, write_bytes
from link.ratex import training_pixels
from models.classical.common import tile_mean
from models.classical.oorc import inverse_response
from models.classical.two_step import fit_inverse_response
from reports.engine.predict import Method

Array = NDArray[np.floating[Any]]
LEVELS = tuple(range(0, 256, 15))
RESPONSE_JSON = "response.json"
NEEDED = {"learned": 4, "phi": 4, "oorc": 4}
"""Methods whose head begins with so many weights of Phi."""
SPREAD = (10, 90)
"""Percentiles over the picture of the true response."""


@dataclass(frozen=True)
class Response:
    """One frame pair."""

    pair: str
    view_deg: float
    kappa: int
    index: int
    displayed: list[float]
    """`LEVELS`."""
    median: list[float]
    """Captured luma of uniform frames of these levels, gray levels: median over the picture."""
    low: list[float]
    """10th percentile over the picture."""
    high: list[float]
    """90th."""
    found: dict[str, list[tuple[float, float]]]
    """By method: (displayed, captured), over what the ratex tiles cover."""
    error: dict[str, float]
    """Rms of displayed gray levels that the method finds for the true curve's captured levels."""


def measure(
    source: Source, cells: Sequence[Cell], frames: int, methods: Sequence[Method], folder: Path
) -> list[Response]:
    """Measure ``frames`` frame pairs of each cell and write response.json."""
    curves = [one(FramePair(source, cell, i), methods) for cell in cells for i in range(frames)]
    content = json.dumps([asdict(curve) for curve in curves])
    write_bytes(folder / RESPONSE_JSON, f"{content}\n".encode())
    return curves


def read_responses(folder: Path) -> list[Response]:
    """What `measure` wrote; none where there is no such file."""
    file = folder / RESPONSE_JSON
    return [Response(**entry) for entry in json.loads(file.read_text())] if file.is_file() else []


def one(filmed: FramePair, methods: Sequence[Method]) -> Response:
    """Film uniform frames through a frame pair's draw, and let each method find the response."""
    layout, cell = filmed.layout, filmed.cell
    shot = filmed.shots[0]
    quiet = replace(shot, noise_scale=0.0)
    seen = []
    for level in LEVELS:
        gray = np.full((layout.height, layout.width, 3), level, np.uint8)
        stored = quiet.develop(quiet.expose(gray), np.random.default_rng(0))
        seen.append(rectify(stored, shot.H_captured_from_display, layout.width, layout.height))
    luma = 255.0 * np.array([intensity(frame)[8:-8, 8:-8] for frame in seen], np.float64)
    flat = luma.reshape(len(LEVELS), -1)
    low, high = np.percentile(flat, SPREAD, axis=1)
    median = np.median(flat, axis=1)
    pair = filmed.rectified
    pixels = training_pixels(layout, pair.ratex_toggle or 0)
    tiles = tile_mean(intensity(pair.original)[pixels.y, pixels.x].astype(np.float64))
    shown = tile_mean(pixels.rho)
    grid = np.linspace(tiles.min(), tiles.max(), 33)
    inside = (median / 255 >= tiles.min()) & (median / 255 <= tiles.max())
    found: dict[str, list[tuple[float, float]]] = {}
    error: dict[str, float] = {}
    twin = "oorc" in [method.name for method in methods]
    for method in methods:
        if twin and method.name == "phi":
            continue
        g = inverse(method, filmed)
        if g is None:
            continue
        if method.name not in ("two_step", "hidden_ratex"):  # g up to scale and offset
            g = fitted(g, tiles, shown)
        name = method.label or method.name
        found[name] = [
            (round(float(v), 2), round(255 * float(i), 2))
            for i, v in zip(grid, g(grid), strict=True)
        ]
        left = g(median[inside] / 255) - np.array(LEVELS)[inside]
        if left.size:
            error[name] = round(float(np.sqrt(np.mean(left**2))), 3)
    curves = [[round(float(v), 2) for v in curve] for curve in (LEVELS, median, low, high)]
    displayed, middle, lowest, highest = curves
    return Response(
        cell.pair,
        cell.view_deg,
        cell.kappa,
        filmed.index,
        displayed,
        middle,
        lowest,
        highest,
        found,
        error,
    )


def inverse(method: Method, filmed: FramePair) -> Callable[[Array], Any] | None:
    """Captured intensity in [0, 1] -> displayed gray level; None where a method finds none."""
    pair = filmed.rectified
    if method.name == "naive":
        return lambda i: i
    if method.name == "two_step":
        return fit_inverse_response(pair, training_pixels(pair.layout, pair.ratex_toggle or 0), 4)
    if method.name == "hidden_ratex":
        hidden = replace(filmed, hidden=True).rectified
        mapping = uniform_mapping(hidden.original)
        return lambda i: np.interp(255 * i, np.arange(256), mapping)
    if method.name in NEEDED:
        head = method.build().decode(pair).head
        return None if head is None else inverse_response(head[: NEEDED[method.name]])
    return None


def fitted(g: Callable[[Array], Any], tiles: Array, shown: Array) -> Callable[[Array], Any]:
    """``g`` with the scale and offset that fit the ratex tiles."""
    slope, offset = np.polyfit(g(tiles), shown, 1)
    return lambda i: slope * g(i) + offset
