"""What the page's receiver knows of each preset, as numbers that Python works out.

Places of pilots and tiles of patches are drawn here once, so that the page does not repeat it.
"""

from typing import Any

from export.locate.patches import DRAWN_KAPPA
from link.layout import Layout
from link.presets import Preset
from link.ratex import tile_labels, tile_levels


def layout_table(layout: Layout) -> dict[str, Any]:
    """Describe a layout for `Layout` of export/web/src/link/layout.js, in JSON's types.

    >>> from link.layout import make_layout
    >>> layout_table(make_layout(4, 4, modulation="antipodal", pilots=4))["pilot_bits"]
    [0, 1, 0, 1]
    """
    return {
        **layout.to_dict(),
        "pilot_blocks": layout.pilot_blocks.tolist(),
        "pilot_bits": layout.pilot_bits.tolist(),
        "tile_levels": tile_levels(layout, 0).tolist(),
        "tile_levels_toggled": tile_levels(layout, DRAWN_KAPPA).tolist(),
        "tile_labels": tile_labels(layout).tolist(),
    }


def page_preset(name: str, preset: Preset, model: str) -> dict[str, Any]:
    """Describe a preset for the page.

    Args:
        name: name of the preset.
        preset: what the display shows.
        model: file name of the graph that reads its layout.
    """
    return {"name": name, "model": model, "layout": layout_table(preset.layout)}
