"""Write a loop as one HTML file that plays it in any browser, refresh by refresh.

The page holds each picture once, and for each frame pair no more than the bits of its blocks, or
the change of its pixels where blocks have soft edges. It computes the states itself, by the rule of
`sender.compact`, exact to the gray level: on the graphics card, at the size at which they are
shown, or where that is not exact by the processor, at the picture's own size.
"""

import json
from collections.abc import Iterator
from hashlib import sha256
from pathlib import Path
from typing import TypeVar

from link.errors import InputError
from link.images import write_bytes
from link.loop import Loop
from sender.compact import PLACE, TEMPLATE, Compact, packed, rule_page

T = TypeVar("T")
BAR_AFTER_S = 2.0
"""Seconds of writing after which a bar shows how far it is."""
MAX_DECODED_BYTES = 2**30
"""Largest memory for pictures and changes as a browser holds them: 3 bytes for each pixel of a
picture, and 1 byte for each pixel of a frame pair's soft changes."""


def with_bar(items: Iterator[T], count: int, unit: str) -> Iterator[T]:
    """Give items, with a bar on a terminal's error output where they take long.

    Args:
        items: what is written, one at a time.
        count: how many there are, at least.
        unit: word for one of them.
    """
    from tqdm import tqdm  # what is imported for its tables does without

    yield from tqdm(items, None, count, False, unit=unit, disable=None, delay=BAR_AFTER_S)


def write_player(path: Path, loop: Loop, state_hz: float, flicker: str = "") -> None:
    """Write the player, one HTML file that needs no other.

    Args:
        path: the .html file.
        loop: what to show; all its carriers are taken.
        state_hz: states a second. The page holds each state for as many whole refreshes of the
            display that it meets as do not make it slower, at least one, and says so if the rate
            is another.
        flicker: "seen" or "flashes", of which the page warns before it plays; "" for neither.

    Raises:
        InputError: more pixels than a browser can be asked to hold, or the file is not writable.
    """
    layout = loop.shown_layout
    rule = Compact(layout, loop.kappa, loop.pyramid_level)
    bits: list[str] = []
    pictures: list[str] = []
    steps: list[str | None] = []
    changes: list[str] = []
    shown: list[int] = []
    numbers: dict[bytes, int] = {}
    last = None
    for carrier in with_bar(loop.carriers(), len(loop.bits), "pair"):
        bits.append((ord("0") + carrier.bits).tobytes().decode())
        if rule.soft:
            changes.append(packed(rule.cells(carrier.bits)))
        if carrier.picture is not last:
            last = carrier.picture
            picture = rule.picture(last, carrier.steps)
            number = numbers.setdefault(sha256(picture.tobytes()).digest(), len(pictures))
            if number == len(pictures):
                gray = (picture == picture[:, :, :1]).all()
                pictures.append(packed(picture[:, :, 0] if gray else picture))
                steps.append(None if carrier.steps is None else packed(carrier.steps))
        shown.append(number)
        pixels = layout.width * layout.height
        if (3 * len(pictures) + len(changes)) * pixels > MAX_DECODED_BYTES:
            raise InputError(
                f"the player has more than {MAX_DECODED_BYTES >> 20} MiB of pixels; "
                "write a video, or use fewer pictures or a smaller size"
            )
    page = {
        **rule_page(rule, state_hz, flicker),
        "width": layout.width,
        "height": layout.height,
        "turned": loop.placement.turns(loop.layout),
        "patches": packed(rule.patches) if layout.ratex else None,
        "bits": bits,
        "pictures": pictures,
        "steps": steps,
        "shown": shown,
        "changes": changes,
    }
    text = f">{json.dumps(page, separators=(',', ':'))}<"
    text = TEMPLATE.read_text("utf-8").replace(PLACE, text)
    write_bytes(path, text.encode())
