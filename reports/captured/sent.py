"""Read what a display showed from the sender's files: a player, or a folder of states."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from link.embed import check_kappa
from link.errors import InputError
from link.images import intensity
from link.images.files import read_image
from link.layout import Layout, block_mean
from link.outside import is_file, parse_json, read_bounded, read_json
from link.presets import PRESETS
from reports.engine.digest import file_digest
from sender.compact import Compact
from sender.write import SENT

MOST_BYTES = 2**30
"""Largest size of a player that is read, bytes."""
BEGIN, END = '<script type="application/json" id="loop">', "</script>"
"""Text before and after the loop in the page of a player."""


@dataclass(frozen=True)
class Sent:
    """A loop that a display shows over and over."""

    layout: Layout
    """Grid of blocks, patches and pilots."""
    kappa: int
    """Gray levels added where a bit is 1."""
    bits: NDArray[np.int64]
    """(loop pairs, n_bits) bits of the loop's frame pairs, 0 or 1."""
    digest: str
    """SHA-256 of the files that say so."""
    part: str = ""
    """Name of the part of a bench that shows it; empty where nothing else is shown."""
    state_hz: float | None = None
    """States shown in a second; None where that is not known."""


def read_sent(path: Path) -> tuple[Sent, ...]:
    """Read what was sent from a player's HTML, a folder of states, or its sent.json.

    Returns:
        the loop, or those of a bench (`sender.bench`), which are shown one after another.

    Raises:
        InputError: it is none of these, or damaged.
    """
    if path.suffix.lower() in (".html", ".htm"):
        return _of_page(path)
    folder = path.parent if path.name == SENT else path
    layout, kappa = read_settings(folder)
    states = sorted(folder.glob("state_*.png"))
    if not states or len(states) % 2:
        raise InputError(f"--sent: {folder} holds {len(states)} states; need two a frame pair")
    bits = []
    for number in range(len(states) // 2):
        shown = states[2 * number : 2 * number + 2]
        bits.append(sent_bits(shown[:: layout.code.sign(number)], layout, kappa))
    return (Sent(layout, kappa, np.stack(bits), file_digest([folder / SENT, *states])),)


def read_settings(folder: Path) -> tuple[Layout, int]:
    """Read layout and kappa of what was shown from sent.json.

    Raises:
        InputError: the file is missing or damaged.
    """
    file = folder / SENT
    try:
        report = read_json(file)
        if not isinstance(report, dict) or type(report.get("kappa")) is not int:
            raise InputError(f"{file}: need layout and kappa")
        return Layout.from_dict(report.get("layout")), check_kappa(report["kappa"])
    except InputError as error:
        raise InputError(
            f"--sent: {file} is missing or damaged ({error}); python -m sender PICTURE "
            f"--message TEXT --out {folder} writes it, and a player's .html will do"
        ) from None


def sent_bits(states: Sequence[Path], layout: Layout, kappa: int) -> NDArray[np.intp]:
    """Read the bits of a frame pair from its two states: 1 where the second is brighter.

    Args:
        states: files of the original and of the embedded state.
        layout: layout of what was shown.
        kappa: gray levels added to a block that carries a 1.

    Returns:
        (n_bits,) of 0 or 1.

    Raises:
        InputError: the pilots of the states are not those of the layout.
    """
    original, embedded = (intensity(read_image(state)) for state in states)
    change = block_mean((255 * (embedded - original)).astype(np.float64), layout.rows, layout.cols)
    ones = change > (kappa / 2 if layout.modulation == "on_off" else 0)
    if (ones.reshape(-1)[layout.pilot_blocks] != layout.pilot_bits).any():
        raise InputError(
            f"--sent: {states[0]} does not show the layout upright and over the whole state; "
            "give the player's .html instead"
        )
    return np.asarray(ones[layout.message_mask], np.intp)


def _of_page(path: Path) -> tuple[Sent, ...]:
    """Read the loop that the page of a player holds, or those of a bench."""
    if not is_file(path):
        raise InputError(f"--sent: {path}: no such file")
    text = read_bounded(path, MOST_BYTES).decode("utf-8", "replace")
    _, _, rest = text.partition(BEGIN)
    try:
        page = parse_json(rest.partition(END)[0], "its loop")
        digest = file_digest([path])
        if "parts" not in page:
            return (_of_loop(page, _layout_of(page), digest),)
        return tuple(
            _of_loop(part["loop"], Layout.from_dict(part["layout"]), digest, part["name"])
            for part in page["parts"]
        )
    except (InputError, ValueError, KeyError, TypeError) as error:
        raise InputError(f"--sent: {path} is no player of python -m sender ({error})") from None


def _of_loop(page: Any, layout: Layout, digest: str, part: str = "") -> Sent:
    """Take what is sent from what a page plays, as JSON has it."""
    bits = np.array([list(map(int, pair)) for pair in page["bits"]], np.int64)
    if bits.ndim != 2 or bits.shape[1] != layout.n_bits or not np.isin(bits, (0, 1)).all():
        raise ValueError("bits that do not fit its grid")
    return Sent(layout, check_kappa(page["kappa"]), bits, digest, part, float(page["state_hz"]))


def _layout_of(page: Any) -> Layout:
    """Find the preset whose grid, modulation, pilots and code the page of a player shows."""
    for preset in PRESETS.values():
        layout = preset.layout
        order = "".join("0" if sign > 0 else "1" for sign in layout.code.signs)
        stated = page["rows"], page["cols"], page["known"], page["order"]
        if stated == (layout.rows, layout.cols, Compact(layout, preset.kappa).known, order):
            return layout
    raise InputError("a grid of no preset; write the states to a folder and name that")


def sent_of(path: Path, film: Path) -> Path:
    """Name what was sent in one film: ``path``, or what bears the film's name in that folder.

    >>> sent_of(Path("player.html"), Path("films/a.mp4")).name
    'player.html'
    """
    if path.is_dir() and not is_file(path / SENT):
        for own in (path / f"{film.stem}.html", path / film.stem):
            if own.exists():
                return own
        raise InputError(
            f"--sent: {path} holds no {SENT}, and neither {film.stem}.html nor {film.stem}/"
        )
    return path
