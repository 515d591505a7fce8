"""Write a loop as one HTML file that plays it in any browser, refresh by refresh.

The page holds each picture once, and for each frame pair no more than the bits of its blocks, or
the change of its pixels where blocks have soft edges. It computes the states itself, by the rule of
`export.send.compact`, exact to the gray level: on the graphics card, at the size at which they are
shown, or where that is not exact by the processor, at the picture's own size.
"""

import base64
import json
from collections.abc import Callable, Iterator
from hashlib import sha256
from pathlib import Path
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from export.send.compact import TILE, Compact
from link.errors import InputError
from link.images import write_bytes
from link.loop import Loop

T = TypeVar("T")
BAR_AFTER_S = 2.0
"""Seconds of writing after which a bar shows how far it is."""
PACKING = 4
"""How hard pictures are packed, 0 to 9. Level 6 makes them 5 % smaller and takes three times as
long: half a second for 1920 x 1080 pixels."""
TEMPLATE = Path(__file__).with_name("player.html")
"""Page of the player, with `__LOOP__` where the loop goes as JSON."""
MAX_DECODED_BYTES = 2**30
"""Largest memory for pictures and changes as a browser holds them: 3 bytes for each pixel of a
picture, and 1 byte for each cell of a frame pair's changes."""


def with_bar(items: Iterator[T], count: int, unit: str) -> Iterator[T]:
    """Give items, with a bar on a terminal's error output where they take long.

    Args:
        items: what is written, one at a time.
        count: how many there are, at least.
        unit: word for one of them.
    """
    yield from tqdm(items, None, count, False, unit=unit, disable=None, delay=BAR_AFTER_S)


class _Texts:
    """Arrays as texts, each of which a page holds once, however often it is shown."""

    def __init__(self, write: Callable[[NDArray[np.uint8]], str]) -> None:
        self.texts: list[str] = []
        self._write = write
        self._numbers: dict[bytes, int] = {}

    def number(self, array: NDArray[np.uint8]) -> int:
        """Find the number of an array's text, which is written where the array is new."""
        key = sha256(array.tobytes()).digest()
        if key not in self._numbers:
            self._numbers[key] = len(self.texts)
            self.texts.append(self._write(array))
        return self._numbers[key]


def write_player(path: Path, loop: Loop, state_hz: float, flicker: str = "") -> None:
    """Write the player, one HTML file that needs no other.

    Args:
        path: the .html file.
        loop: what to show; all its carriers are taken.
        state_hz: states a second. The page holds each state for as many whole refreshes of the
            display that it meets as come closest, at least one, and says so if the rate is another.
        flicker: "seen" or "flashes", of which the page warns before it plays; "" for neither.

    Raises:
        InputError: more pixels than a browser can be asked to hold, or the file is not writable.
    """
    layout = loop.shown_layout
    rule = Compact(layout, loop.kappa, loop.pyramid_level)
    pictures, changes = _Texts(_png), _Texts(_png if rule.soft else _bits)
    steps: list[str | None] = []
    order: list[tuple[int, int]] = []
    last = None
    for carrier in with_bar(loop.carriers(), len(loop.bits), "pair"):
        cells = rule.cells(carrier.bits)
        same = carrier.picture is last
        shown = None if same else rule.picture(carrier.picture, carrier.steps)
        picture = order[-1][0] if shown is None else pictures.number(shown)
        if picture == len(steps):
            steps.append(None if carrier.steps is None else _png(carrier.steps))
        order.append((picture, changes.number(cells)))
        last = carrier.picture
        pixels = layout.width * layout.height
        if 3 * len(pictures.texts) * pixels + len(changes.texts) * cells.size > MAX_DECODED_BYTES:
            raise InputError(
                f"the player has more than {MAX_DECODED_BYTES >> 20} MiB of pixels; "
                "write a video, or use fewer pictures or a smaller size"
            )
    page = {
        "width": layout.width,
        "height": layout.height,
        "turned": loop.placement.turns(loop.layout),
        "rows": layout.rows,
        "cols": layout.cols,
        "stateHz": state_hz,
        "flicker": flicker,
        "soft": rule.soft,
        "offsets": _png(np.asarray(128 + rule.offsets.reshape(-1, TILE * TILE, 3), np.uint8)),
        "patches": _png(rule.patches) if layout.ratex else None,
        "pairs": order,
        "changes": changes.texts,
        "pictures": pictures.texts,
        "steps": steps,
    }
    text = TEMPLATE.read_text("utf-8").replace("__LOOP__", json.dumps(page, separators=(",", ":")))
    write_bytes(path, text.encode())


def _bits(cells: NDArray[np.uint8]) -> str:
    """Pack cells that are 0 or 1, row-major, the first one in the highest bit, as base64."""
    return base64.b64encode(np.packbits(cells).tobytes()).decode()


def _png(image: NDArray[np.uint8]) -> str:
    """Write an image as PNG of one channel, or of three where they differ, as base64."""
    if image.ndim == 3 and (image == image[:, :, :1]).all():
        image = image[:, :, 0]
    bgr = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
    _, data = cv2.imencode(".png", bgr, [cv2.IMWRITE_PNG_COMPRESSION, PACKING])
    return base64.b64encode(bytes(data)).decode()
