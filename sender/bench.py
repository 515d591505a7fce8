"""A bench for one's own display and camera: a page that shows presets and grids in turn.

The film of it tells which of them this camera reads from this display at this distance
(evaluate.py --captures FILM --sent bench.html). The message of each part is another one, so that
what was read says which part it was.
"""

import json
from functools import partial
from pathlib import Path

import cv2
import numpy as np

from link.code.framing import encode
from link.images import write_bytes
from link.loop import Loop, Pictures
from link.presets import PRESETS
from link.types import Image
from sender.compact import PLACE, TEMPLATE
from sender.player import player_page

BENCH = TEMPLATE.with_name("bench.html")
"""Page of the bench."""
PARTS = {
    "robust": ("robust", 3, 15.0),
    "hidden": ("hidden", 1, 60.0),
    "hidden, kappa 2": ("hidden", 2, 60.0),
    "hidden, 30 states": ("hidden", 1, 30.0),
    "fast": ("fast", 3, 30.0),
    "paper": ("paper", 3, 15.0),
    "paper, kappa 5": ("paper", 5, 15.0),
}
"""Settings that are shown, by name: the preset whose grid is taken, kappa in gray levels, and
states a second."""
SECONDS = 6
"""Time for which each part is shown, seconds: the display is found in the first of them."""
MESSAGE_BYTES = 120
"""Length of the random message of a part, bytes."""


def bench_picture() -> Image:
    """Draw a picture of soft colours and a little texture, an `Image` of 1024 x 768 pixels."""
    rng = np.random.default_rng(0)
    soft = rng.uniform(60, 200, (6, 8, 3)).astype(np.float32)
    large = cv2.resize(soft, (1024, 768), interpolation=cv2.INTER_CUBIC)
    texture = cv2.resize(rng.normal(0, 12, (192, 256, 1)).astype(np.float32), (1024, 768))
    return np.asarray(np.clip(large + texture[..., None], 0, 255), np.uint8)


def write_bench(
    path: Path, pictures: Pictures | None, size: tuple[int, int] | None, fit: str, refresh: float
) -> list[str]:
    """Write the page, one HTML file that needs no other.

    Args:
        path: the .html file.
        pictures: pictures of which the first carries all parts; None for `bench_picture`.
        size: width and height of the display, pixels; None for the picture's.
        fit: how the picture lies on the display, a key of `link.placement.FITS`.
        refresh: refreshes of the display in a second; parts that would be quicker are left out.

    Returns:
        names of the parts.

    Raises:
        InputError: the picture is no good, or the file is not writable.
    """
    picture = next(pictures()) if pictures else bench_picture()
    parts = []
    for number, (name, (preset_name, kappa, state_hz)) in enumerate(PARTS.items()):
        preset = PRESETS[preset_name]
        if state_hz > 1.02 * refresh:
            continue
        message = np.random.default_rng(number).bytes(MESSAGE_BYTES)
        bits = encode(message, preset.layout.n_bits)
        show = partial(iter, [picture])
        loop = Loop(preset.layout, kappa, bits, show, size, fit, preset.even)
        # the bench itself warns of flicker, before all parts
        shown = {"loop": player_page(loop, state_hz, flickers={})}
        parts.append({"name": name, "layout": preset.layout.to_dict(), **shown})
    page = {"seconds": SECONDS, "player": TEMPLATE.read_text("utf-8"), "parts": parts}
    text = json.dumps(page, separators=(",", ":")).replace("<", "\\u003c")
    write_bytes(path, BENCH.read_text("utf-8").replace(PLACE, f">{text}<").encode())
    return [str(part["name"]) for part in parts]
