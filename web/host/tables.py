"""Tables of each preset for the pages, as numbers that Python works out.

Places of pilots, sizes of maps, tiles of patches, dither and room for it are worked out here once,
so that the pages do not repeat it.

The page that sends shows every preset. The page that reads knows those that the film decoder reads,
which have pilots; `paper` is read by ``python -m receiver``.
"""

from typing import Any

from link.code.framing import longest_message
from link.layout import Layout
from link.presets import Preset, needed_camera_fps
from link.ratex import TILES, shown_levels
from models.film.window import reads_films
from receiver.pilots.motion import map_size
from receiver.pilots.search.all_blocks import block_maps
from receiver.timing.toggles import PilotToggles
from sender.compact import Compact, film_page, rule_page
from sender.hiding import Hiding, Onlooker


def layout_table(layout: Layout) -> dict[str, Any]:
    """Describe a layout with pilots for `Layout` of web/port/link/layout.js, in JSON's types.

    >>> from link.layout import make_layout
    >>> layout_table(make_layout(4, 4, modulation="antipodal", pilots=4))["pilot_bits"]
    [0, 1, 0, 1]
    """
    toggles, maps = PilotToggles(layout), block_maps(layout)
    return {
        "rows": layout.rows,
        "cols": layout.cols,
        "width": layout.width,
        "height": layout.height,
        "code_signs": layout.code.signs.tolist(),
        "pilot_blocks": layout.pilot_blocks.tolist(),
        "pilot_bits": layout.pilot_bits.tolist(),
        "parts": toggles.parts.tolist(),
        "part_places": toggles.places.ravel().tolist(),
        "map_size": map_size(layout),
        "block_maps": [maps.inner, maps.margin],
    }


def send_preset(name: str, preset: Preset) -> dict[str, Any]:
    """Describe a preset to the page that sends: the numbers that make its states, and its texts."""
    layout, kappa, state_hz = preset.layout, preset.kappa, preset.state_hz
    rule = Compact(layout, kappa)
    hiding = Hiding(layout, state_hz, Onlooker(distance=preset.distance_m), preset.even)
    still = len(rule.changes) + 1
    original, embedded = (shown_levels(layout, kappa, embedded=each) for each in (False, True))
    return {
        "name": name,
        "purpose": preset.purpose,
        "read_by_page": reads_films(layout),
        "needs_fps": preset.needs_camera_fps,
        "better_fps": needed_camera_fps(2 * state_hz),
        "seen": round(hiding.seen(kappa), 3),
        "distance_m": preset.distance_m,
        "n_bits": layout.n_bits,
        "longest_bytes": longest_message(layout.n_bits),
        "size": [layout.width, layout.height],
        "even": preset.even,
        "film": film_page(rule, preset.even),
        "ratex": layout.ratex,
        "tiles": original.reshape(-1, TILES**2).tolist(),
        "changes": (still + (embedded - original) // kappa).reshape(-1, TILES**2).tolist(),
        "loop": rule_page(rule, state_hz, hiding.flickers(kappa)),
    }
