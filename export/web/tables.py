"""What the page's receiver knows of each preset, as numbers that Python works out.

Places of pilots and tiles of patches are drawn here once, so that the page does not repeat it.
"""

import base64
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from export.film_graph import reads_films
from export.locate.patches import DRAWN_KAPPA
from export.locate.spots import template_bank
from link.layout import Layout
from link.presets import Preset
from link.ratex import tile_labels, tile_levels

LEADING = 24
"""Number of directions in the space of windows along which the page compares all templates of
patches. The rest of a window and the rest of a template have lengths, which bound what the rest can
add to the correlation; only where that could make a match is the whole window compared."""


def layout_table(layout: Layout) -> dict[str, Any]:
    """Describe a layout for `Layout` of export/web/src/link/layout.js, in JSON's types.

    >>> from link.layout import make_layout
    >>> layout_table(make_layout(4, 4, modulation="antipodal", pilots=4))["pilot_bits"]
    [0, 1, 0, 1]
    """
    return {
        **layout.to_dict(),
        "reads_films": reads_films(layout),
        "pilot_blocks": layout.pilot_blocks.tolist(),
        "pilot_bits": layout.pilot_bits.tolist(),
        "tile_levels": tile_levels(layout, 0).tolist(),
        "tile_levels_toggled": tile_levels(layout, DRAWN_KAPPA).tolist(),
        "tile_labels": tile_labels(layout).tolist(),
        "bank_directions": base64.b64encode(bank_directions(layout).tobytes()).decode(),
    }


@lru_cache(maxsize=8)
def bank_directions(layout: Layout) -> NDArray[np.float32]:
    """Find the orthonormal directions along which the templates of a layout's patches vary most.

    Returns:
        (`LEADING`, WINDOW_PX**2) float32; empty where the layout has no patches.
    """
    if not layout.ratex:
        return np.empty((0, 0), np.float32)
    templates, _ = template_bank(layout)
    directions = np.linalg.svd(templates.astype(np.float64), full_matrices=False)[2][:LEADING]
    return directions.astype(np.float32)


def page_preset(name: str, preset: Preset, model: str) -> dict[str, Any]:
    """Describe a preset for the page.

    Args:
        name: name of the preset.
        preset: what the display shows.
        model: file name of the graph that reads its layout.
    """
    return {"name": name, "model": model, "layout": layout_table(preset.layout)}
