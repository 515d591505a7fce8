"""The CDTF that each method finds, against the one that the simulated frame pair really had."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data_gen.frame_pair import FramePair
from link.equalise import uniform_mapping
from link.geometry import rectify
from link.images import intensity
from link.ratex import training_pixels
from models.classical.common import tile_mean
from models.classical.oorc import inverse_response
from models.classical.two_step import fit_inverse_response
from reports.engine.methods import Method
from reports.run import Response

Array = NDArray[np.floating[Any]]
LEVELS = tuple(range(0, 256, 15))
"""Displayed gray levels of the uniform frames that are filmed."""
SPREAD = (10, 90)
"""Percentiles over the picture between which the true response is said to lie."""
MARGIN_PX = 8
"""Pixels at each side of the picture that are left out: the blur mixes in what is beside it."""


def measure_response(filmed: FramePair, methods: Sequence[Method]) -> Response:
    """Film uniform frames through a frame pair's channel, and let each method find the response.

    Args:
        filmed: a frame pair with ratex patches.
        methods: those that find no response are left out, and so is OORC's twin beside OORC.
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
    twin = "oorc" in [method.name for method in methods]
    for method in methods:
        if twin and method.name == "phi":
            continue
        g = found_inverse(method, filmed)
        if g is None:
            continue
        if method.name not in ("two_step", "hidden_ratex"):  # g up to scale and offset
            g = scaled_to_tiles(g, tiles, shown)
        found[method.label] = [
            (round(float(v), 2), round(255 * float(i), 2))
            for i, v in zip(grid, g(grid), strict=True)
        ]
        left = g(median[inside] / 255) - np.array(LEVELS)[inside]
        if left.size:
            error[method.label] = round(float(np.sqrt(np.mean(left**2))), 3)

    def rounded(curve: Sequence[float] | Array) -> list[float]:
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


def found_inverse(method: Method, filmed: FramePair) -> Callable[[Array], Any] | None:
    """Captured intensity in [0, 1] to displayed gray level; None where a method finds none."""
    pair = filmed.rectified
    if method.name == "naive":
        return lambda i: i
    if method.name == "two_step":
        return fit_inverse_response(pair, training_pixels(pair.layout, pair.ratex_toggle or 0), 4)
    if method.name == "hidden_ratex":
        hidden = replace(filmed, hidden=True).rectified
        mapping = uniform_mapping(hidden.original)
        return lambda i: np.interp(255 * i, np.arange(256), mapping)
    weights = method.card.inverse_response_weights
    head = method.build().decode(pair).head if weights else None
    return None if head is None else inverse_response(head[:weights])


def scaled_to_tiles(
    g: Callable[[Array], Any], tiles: Array, shown: Array
) -> Callable[[Array], Any]:
    """``g`` with the scale and offset that fit it to the ratex tiles."""
    slope, offset = np.polyfit(g(tiles), shown, 1)
    return lambda i: slope * g(i) + offset
