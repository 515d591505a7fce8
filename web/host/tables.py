"""What the pages know of each preset, as numbers that Python works out.

Places of pilots, tiles of patches, dither and room for it are drawn here once, so that the pages do
not repeat it.
"""

import base64
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from link.code.framing import longest_message
from link.embed import levels_by_step, with_head_room
from link.layout import Layout
from link.presets import Preset, needed_camera_fps
from link.ratex import TILES, shown_levels, tile_labels, tile_levels
from models.film.window import reads_films
from receiver.locate.patches import DRAWN_KAPPA
from receiver.locate.spots import template_bank
from sender.compact import Compact, rule_page
from sender.hiding import Hiding, Onlooker

LEADING = 24
"""Number of directions in the space of windows along which the page compares all templates of
patches. The rest of a window and the rest of a template have lengths, which bound what the rest can
add to the correlation; only where that could make a match is the whole window compared."""


def layout_table(layout: Layout) -> dict[str, Any]:
    """Describe a layout for `Layout` of web/port/link/layout.js, in JSON's types.

    >>> from link.layout import make_layout
    >>> layout_table(make_layout(4, 4, modulation="antipodal", pilots=4))["pilot_bits"]
    [0, 1, 0, 1]
    """
    return {
        **layout.to_dict(),
        "reads_films": reads_films(layout),
        "code_signs": layout.code.signs.tolist(),
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


def send_preset(name: str, preset: Preset) -> dict[str, Any]:
    """Describe a preset to the page that sends: what makes its states, and what is said of it."""
    layout, kappa, state_hz = preset.layout, preset.kappa, preset.state_hz
    rule = Compact(layout, kappa)
    hiding = Hiding(layout, state_hz, Onlooker(distance=preset.distance_m), preset.even)
    strengths = levels_by_step(kappa) if preset.even else [float(kappa)]
    ramp = np.arange(256, dtype=np.uint8)[None]
    room = [
        with_head_room(ramp, kappa, layout.modulation, np.full(ramp.shape, each))
        for each in strengths
    ]
    still = len(rule.changes) + 1
    original, embedded = (shown_levels(layout, kappa, embedded=each) for each in (False, True))
    return {
        "name": name,
        "purpose": preset.purpose,
        "needs_fps": preset.needs_camera_fps,
        "better_fps": needed_camera_fps(2 * state_hz),
        "seen": round(hiding.seen(kappa), 3),
        "distance_m": preset.distance_m,
        "n_bits": layout.n_bits,
        "longest_bytes": longest_message(layout.n_bits),
        "size": [layout.width, layout.height],
        "even": preset.even,
        "room": base64.b64encode(np.concatenate(room).tobytes()).decode(),
        "ratex": layout.ratex,
        "tiles": original.reshape(-1, TILES**2).tolist(),
        "changes": (still + (embedded - original) // kappa).reshape(-1, TILES**2).tolist(),
        "loop": rule_page(rule, state_hz, hiding.flicker(kappa)),
    }
