"""Write what a display shows, a loop of frame pairs, as a player, a video or a folder of images."""

import json
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from link.errors import InputError, ParameterError
from link.files.lock import locked
from link.files.together import lent_folder
from link.images import MAX_NAME_BYTES, write_bytes, write_image
from link.images.video import write_video
from link.loop import Loop
from link.types import Image
from sender.likeness import likeness_of
from sender.player import PLAYED, with_bar, write_film_player, write_player
from sender.sound import add_sound

KINDS = ("", ".html", ".avi", ".mkv")
"""Endings of an output's name: none for a folder of images, then the player, then two videos."""
SENT = "sent.json"
"""Name of the file, in a folder of images, that says what was sent."""


def output_kind(out: Path) -> str:
    """Check that an output's name is short enough and has a known ending.

    Returns:
        the ending in lower case, one of `KINDS`.

    Raises:
        InputError: the ending is unknown, or the name is longer than file systems take.
    """
    kind = out.suffix.lower()
    if len(os.fsencode(out.name)) > MAX_NAME_BYTES:
        raise InputError(f"{out}: the name has more than {MAX_NAME_BYTES} bytes; shorten it")
    if not out.name:
        raise ParameterError("out", f"{out} has no name; choose a new file or folder")
    if kind not in KINDS or (not kind and "." in out.name):  # as in ".html"
        raise ParameterError(
            "out",
            f"{out} must end in .html, .avi or .mkv, which lose nothing, or be a folder with no "
            "dot in its name",
        )
    return kind


def write_states(folder: Path, states: Iterable[Image]) -> None:
    """Write state_00000.png, state_00001.png, ... in the order in which a display shows them.

    Args:
        folder: made if it is not there.
        states: an `Image` each.
    """
    for number, state in enumerate(states):
        write_image(folder / f"state_{number:05d}.png", state)


def write_loop(
    loop: Loop,
    out: Path,
    message_bytes: int,
    state_hz: float,
    film: Path | None = None,
    *,
    flickers: Mapping[float, str],
    more: Mapping[str, Any],
) -> dict[str, Any]:
    """Write a loop to a file or folder.

    Args:
        loop: what to show.
        out: its ending is one of `KINDS`.
        message_bytes: length of the message.
        state_hz: states shown in a second, by a video, or by the player where the display's
            refreshes allow it.
        film: video that the loop shows: a player plays it, and a video gets its sound.
        flickers: what a player warns of, as `Hiding.flickers` says it.
        more: values of JSON's types that are reported beside the loop's own.

    Returns:
        counts, seconds and bit/s (`link.loop.Loop.report`), how much the picture changes
        (`sender.likeness.likeness_of`), and ``more``.

    Raises:
        InputError: a picture or the output is no good, or something but an empty folder is there
            already; nothing is left behind.
    """
    kind = output_kind(out)

    def report() -> dict[str, Any]:
        return {**loop.report(message_bytes, state_hz), **likeness, **more}

    with locked(out.parent, out.name):
        if out.exists() and not (kind == "" and out.is_dir() and not any(out.iterdir())):
            raise ParameterError("out", f"{out} is already there; remove it or choose another name")
        likeness = likeness_of(loop)
        states = with_bar(loop.states(), 2 * len(loop.bits), "state")
        if kind == ".html" and film is not None and film.suffix.lower() in PLAYED:
            write_film_player(out, loop, film, state_hz, flickers)
        elif kind == ".html":
            write_player(out, loop, state_hz, flickers)
        elif kind:
            write_video(out, states, state_hz)
            if film is not None:
                add_sound(out, film, 2 * loop.n_pictures / state_hz)
        else:
            place = Path(os.path.realpath(out))
            with lent_folder(place, out) as folder:
                write_states(folder, states)
                write_bytes(folder / SENT, json.dumps(report(), indent=1).encode())
                if place.is_dir():
                    place.rmdir()
                folder.replace(place)
    return report()
