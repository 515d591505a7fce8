"""Write a loop as one HTML file that plays it in any browser, refresh by refresh.

The page holds each picture once, and for each frame pair no more than the bits of its blocks. It
computes the states itself, by the rule of `sender.compact`, exact to the gray level: on the
graphics card, at the size at which they are shown, or where that is not exact by the processor, at
the picture's own size.
"""

import base64
import json
from collections.abc import Iterator, Mapping
from hashlib import sha256
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from link.errors import InputError, ParameterError
from link.images import write_bytes
from link.images.video import VideoReader
from link.loop import Loop
from link.placement import Placement
from link.ratex import draw_patches
from sender.compact import (
    EMBEDDED_BYTES,
    MAX_FILM_BYTES,
    PLACE,
    TEMPLATE,
    Compact,
    film_page,
    packed,
    rule_page,
)

T = TypeVar("T")
BAR_AFTER_S = 2.0
"""Seconds of writing after which a bar shows how far it is."""
PLAYED = {
    ".mp4": "video/mp4",
    ".m4v": "video/mp4",
    ".mov": "video/mp4",
    ".webm": "video/webm",
    ".ogv": "video/ogg",
}
"""Media types by the suffix of a video file, for videos that browsers can play."""
PART_BYTES = 3 * 2**23
"""Size of the parts of a film that lies beside its page."""
SCRIPTS = "script-src 'unsafe-inline'"
"""Scripts that the page's Content-Security-Policy allows. A page with a film in parts also allows
the files beside it."""
MOST_BLOCK_PIXELS = 2**14 - 1
"""Largest number of pixels of a block whose light a page adds up in whole numbers of 32 bits."""
MAX_DECODED_BYTES = 2**30
"""Largest memory for pictures as a browser holds them: 3 bytes for each pixel."""


def with_bar(items: Iterator[T], count: int, unit: str) -> Iterator[T]:
    """Give items, with a bar on a terminal's error output where they take long.

    Args:
        items: what is written, one at a time.
        count: how many there are, at least.
        unit: word for one of them.
    """
    from tqdm import tqdm  # what is imported for its tables does without

    yield from tqdm(items, None, count, False, unit=unit, disable=None, delay=BAR_AFTER_S)


def write_player(path: Path, loop: Loop, state_hz: float, flickers: Mapping[float, str]) -> None:
    """Write the player, one HTML file that needs no other.

    Args:
        path: the .html file.
        loop: what to show; all its carriers are taken.
        state_hz: states a second. The page holds each state for as many whole refreshes of the
            display that it meets as do not make it slower, at least one, and says so if the rate
            is another.
        flickers: by states a second "seen" or "flashes", of which the page warns before it plays at
            such a rate, or "" for neither, as `sender.hiding.Hiding.flickers` says it.

    Raises:
        InputError: more pixels than a browser can be asked to hold, or the file is not writable.
    """
    _write_page(path, player_page(loop, state_hz, flickers))


def player_page(loop: Loop, state_hz: float, flickers: Mapping[float, str]) -> dict[str, Any]:
    """Describe a loop to the page that plays it, in JSON's types.

    Args:
        loop: what to show; all its carriers are taken.
        state_hz: states a second.
        flickers: as `write_player` takes them.

    Raises:
        InputError: more pixels than a browser can be asked to hold.
    """
    layout = loop.shown_layout
    rule = Compact(layout, loop.kappa)
    bits: list[str] = []
    pictures: list[str] = []
    steps: list[str | None] = []
    shown: list[int] = []
    numbers: dict[bytes, int] = {}
    last = None
    for carrier in with_bar(loop.carriers(), len(loop.bits), "pair"):
        bits.append((ord("0") + carrier.bits).tobytes().decode())
        if carrier.picture is not last:
            last = carrier.picture
            picture = rule.picture(last, carrier.steps)
            number = numbers.setdefault(sha256(picture.tobytes()).digest(), len(pictures))
            if number == len(pictures):
                gray = (picture == picture[:, :, :1]).all()
                pictures.append(packed(picture[:, :, 0] if gray else picture))
                steps.append(None if carrier.steps is None else packed(carrier.steps))
        shown.append(number)
        if 3 * len(pictures) * layout.width * layout.height > MAX_DECODED_BYTES:
            raise InputError(
                f"the player has more than {MAX_DECODED_BYTES >> 20} MiB of pixels; "
                "write a video, or use fewer pictures or a smaller size"
            )
    more = {"bits": bits, "pictures": pictures, "steps": steps, "shown": shown}
    return _page(loop, rule, state_hz, flickers, more)


def write_film_player(
    path: Path, loop: Loop, film: Path, state_hz: float, flickers: Mapping[float, str]
) -> None:
    """Write the player of a film, which works out all states from the film as it plays.

    The page holds a film of up to `EMBEDDED_BYTES`. A larger one lies beside it, in scripts of the
    page's name, as browsers give a page that is opened from a disk no other file.

    Args:
        path: the .html file.
        loop: message and layout; its pictures show the film's size.
        film: video file of a kind in `PLAYED`.
        state_hz: states a second, as `write_player` takes them.
        flickers: as `write_player` takes them.

    Raises:
        InputError: the film or what it would take is too large, or a file beside the page is there
            already or is not writable.
    """
    layout = loop.shown_layout
    rule = Compact(layout, loop.kappa)
    width, height = loop.placement.given_size
    left, top, wide, tall = window_of(width, height, loop.placement)
    if loop.even and wide * tall > MOST_BLOCK_PIXELS * layout.rows * layout.cols:
        raise InputError(f"{film}: its blocks are too large to even them out; use --no-even")
    VideoReader(film).check_end()
    size = film.stat().st_size
    if size > MAX_FILM_BYTES:
        most = f"{MAX_FILM_BYTES >> 20} MiB"
        raise InputError(f"{film}: a player holds films of up to {most}; cut it or compress it")
    black = np.zeros((layout.height, layout.width), np.uint8)
    draw_patches(black, layout, loop.kappa, embedded=False)
    page = {
        **film_page(rule, loop.even),
        "type": PLAYED[film.suffix.lower()],
        "size": [width, height],
        "view": [left, top, wide, tall],
        "patches": packed(black) if layout.ratex else None,
    }
    if size <= EMBEDDED_BYTES:
        page["data"] = base64.b64encode(film.read_bytes()).decode()
    else:
        page["parts"] = _write_parts(path, film)
    bits = [(ord("0") + each.bits).tobytes().decode() for each in loop.carriers()]
    more = {"bits": bits, "pictures": [], "steps": [None], "shown": [0] * len(bits)}
    _write_page(path, _page(loop, rule, state_hz, flickers, {**more, "film": page}))


def window_of(width: int, height: int, placement: Placement) -> tuple[int, int, int, int]:
    """Say which part of a picture is shown: left, top, width and height, in its pixels.

    >>> window_of(200, 60, Placement((32, 24), "cover", (200, 60)))
    (60, 0, 80, 60)
    """
    if placement.fit != "cover":
        return 0, 0, width, height
    scale = min(width / placement.display_size[0], height / placement.display_size[1])
    wide, tall = (max(1, round(scale * side)) for side in placement.display_size)
    return (width - wide) // 2, (height - tall) // 2, wide, tall


def _write_parts(path: Path, film: Path) -> list[str]:
    """Write a film as scripts beside a page; their names."""
    names: list[str] = []
    with film.open("rb") as data:
        while piece := data.read(PART_BYTES):
            names.append(f"{path.stem}.film-{len(names):02d}.js")
            if path.with_name(names[-1]).exists():
                raise ParameterError("out", f"{names[-1]} is already there; choose another name")
            script = b'takePart("' + base64.b64encode(piece) + b'")'
            write_bytes(path.with_name(names[-1]), script)
    return names


def _page(
    loop: Loop,
    rule: Compact,
    state_hz: float,
    flickers: Mapping[float, str],
    more: dict[str, Any],
) -> dict[str, Any]:
    """Say how a page shows a loop, with what it shows, in JSON's types."""
    layout = rule.layout
    return {
        **rule_page(rule, state_hz, flickers),
        "width": layout.width,
        "height": layout.height,
        "turned": loop.placement.turns(loop.layout),
        "patches": packed(rule.patches) if layout.ratex else None,
        **more,
    }


def _write_page(path: Path, page: dict[str, Any]) -> None:
    """Write a player's page with what it shows."""
    text = f">{json.dumps(page, separators=(',', ':'))}<"
    template = TEMPLATE.read_text("utf-8")
    if "parts" in page.get("film", {}):
        template = template.replace(SCRIPTS, f"{SCRIPTS} 'self' file:", 1)
    text = template.replace(PLACE, text)
    write_bytes(path, text.encode())
