"""The CDTF that each method finds, against the one that the simulated frame pair really had."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from data_gen.frame_pair import Cell, FramePair
from link.geometry import rectify
from link.images import intensity
from link.images.equalise import uniform_mapping
from link.ratex import training_pixels
from link.types import Real
from models.paper.common import tile_mean
from models.paper.oorc import inverse_response
from models.paper.two_step import fit_inverse_response
from reports.engine.checked import write_json
from reports.engine.methods import Method
from reports.engine.predict import Condition
from reports.run import RESPONSES, Response, RunFolder

LEVELS = tuple(range(0, 256, 15))
"""Displayed gray levels of the uniform frames that are filmed."""
SPREAD = (10, 90)
"""Percentiles over the picture between which the true response is said to lie."""
SCALELESS = ("straight", "phi")
"""Ways of finding a response that leave its scale and offset open; the ratex tiles set them."""
PHI_WEIGHTS = 4
"""Degree of g, which is the number of its coefficients in the paper's Φ."""
MARGIN_PX = 8
"""Pixels at each side of the picture that are left out: the blur mixes in what is beside it."""
CELLS, FRAMES = 6, 3
"""Number of cells in which responses are measured, and of frame pairs in each of them."""


def write_responses(folder: RunFolder, comparison: Condition, methods: Sequence[Method]) -> None:
    """Measure what each method finds of the transfer function, where patches show it."""
    if not comparison.source.layout.ratex:
        return
    cells = response_cells(comparison.cells)[:CELLS]
    pairs = [
        FramePair(comparison.source, cell, index)
        for cell in cells
        for index in range(min(FRAMES, comparison.frames))
    ]
    write_json(folder.path / RESPONSES, [measure_response(pair, methods) for pair in pairs])


def response_cells(cells: Sequence[Cell]) -> list[Cell]:
    """Choose the cells whose responses are measured: some unlike pairs, at the largest kappa.

    >>> response_cells([Cell("canon-lg", 0.0, 3), Cell("canon-lg", 0.0, 5)])
    [Cell(pair='canon-lg', view_deg=0.0, kappa=5)]
    """
    kappa = max(cell.kappa for cell in cells)
    mine = [cell for cell in cells if cell.kappa == kappa]
    pairs = list(dict.fromkeys(cell.pair for cell in mine))
    wanted = pairs[:: max(1, len(pairs) // 3 + 1)] if len(pairs) > 3 else pairs
    return [cell for pair in wanted for cell in mine if cell.pair == pair]


def measure_response(filmed: FramePair, methods: Sequence[Method]) -> Response:
    """Film uniform frames through a frame pair's channel, and let each method find the response.

    Args:
        filmed: a frame pair with ratex patches.
        methods: methods, of which those that find no response are left out, and so is OORC's twin
            beside OORC.
    """
    layout, cell = filmed.layout, filmed.cell
    shot = filmed.shots[0]
    seen = []
    for level in LEVELS:
        gray = np.full((layout.height, layout.width, 3), level, np.uint8)
        stored = shot.develop(shot.expose(gray), None)
        seen.append(rectify(stored, shot.H_captured_from_display, layout.width, layout.height))
    inside_px = np.s_[MARGIN_PX:-MARGIN_PX, MARGIN_PX:-MARGIN_PX]
    luma = 255.0 * np.array([intensity(frame)[inside_px] for frame in seen], np.float64)
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
    compared = {method.name for method in methods}
    for method in methods:
        if not method.card.inverse_response or method.card.twin_of in compared:
            continue
        g = found_inverse(method, filmed)
        if method.card.inverse_response in SCALELESS:
            g = scaled_to_tiles(g, tiles, shown)
        found[method.label] = [
            (round(float(v), 2), round(255 * float(i), 2))
            for i, v in zip(grid, g(grid), strict=True)
        ]
        left = g(median[inside] / 255) - np.array(LEVELS)[inside]
        if left.size:
            error[method.label] = round(float(np.sqrt(np.mean(left**2))), 3)

    def rounded(curve: Sequence[float] | Real) -> list[float]:
        return [round(float(level), 2) for level in curve]

    return Response(
        pair=cell.pair,
        view_deg=cell.view_deg,
        kappa=cell.kappa,
        index=filmed.index,
        displayed=rounded(LEVELS),
        median=rounded(median),
        low=rounded(low),
        high=rounded(high),
        found=found,
        error=error,
    )


def found_inverse(method: Method, filmed: FramePair) -> Callable[[Real], Any]:
    """Captured intensity in [0, 1] to displayed gray level, as a method finds it in a frame pair.

    Args:
        method: its card says how it finds the response.
        filmed: a frame pair with ratex patches; its hidden twin is filmed where the method reads
            the picture's histogram.
    """
    pair = filmed.rectified
    match method.card.inverse_response:
        case "straight":
            return lambda i: i
        case "fitted":
            pixels = training_pixels(pair.layout, pair.ratex_toggle or 0)
            return fit_inverse_response(pair, pixels, PHI_WEIGHTS)
        case "histogram":
            mapping = uniform_mapping(replace(filmed, equalised=True).rectified.original)
            return lambda i: np.interp(255 * i, np.arange(256), mapping)
        case _:
            head = method.build().decode(pair).head
            assert head is not None, f"{method.name}: its card promises the weights of a head"
            return inverse_response(head[:PHI_WEIGHTS])


def scaled_to_tiles(g: Callable[[Real], Any], tiles: Real, shown: Real) -> Callable[[Real], Any]:
    """``g`` with the scale and offset that fit it to the ratex tiles."""
    slope, offset = np.polyfit(g(tiles), shown, 1)
    return lambda i: slope * g(i) + offset
