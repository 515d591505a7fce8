"""The Captures format: a folder of PNG files and a manifest with a line for each frame pair."""

import hashlib
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from link.embed import MAX_KAPPA
from link.errors import InputError
from link.files.together import written_together
from link.frames import Captured
from link.geometry import as_corners
from link.images import read_image, write_bytes, write_image
from link.layout import Layout
from link.outside import inside, is_file, read_json_lines

MANIFEST = "manifest.jsonl"
"""Name of the file that lists the frame pairs of a folder, one JSON object a line."""
KNOWN = {
    "original",
    "embedded",
    "layout",
    "corners",
    "corners_embedded",
    "bits",
    "kappa",
    "ratex_kappa",
    "sha256",
}
"""Keys of a manifest line that the format defines; `link.frames.Captured.meta` takes all others."""


def save_captures(folder: Path, captures: Iterator[Captured]) -> int:
    """Write frame pairs as PNG files and the manifest; they appear once all are written.

    Args:
        folder: made if it is not there.
        captures: the frame pairs.

    Returns:
        the number of frame pairs.

    Raises:
        InputError: the folder holds captures, or cannot be written; no picture is added to it.
    """
    lines: list[str] = []
    with written_together(folder, MANIFEST, folder.glob("[0-9]*_*.png")) as temporary:
        for number, captured in enumerate(captures):
            names = [f"{number:05d}_{kind}.png" for kind in ("original", "embedded")]
            digest = hashlib.sha256()
            for name, frame in zip(names, (captured.original, captured.embedded), strict=True):
                write_image(temporary / name, frame)
                digest.update((temporary / name).read_bytes())
            entry: dict[str, Any] = {
                "original": names[0],
                "embedded": names[1],
                "layout": captured.layout.to_dict(),
                "corners": captured.corners.round(3).tolist(),
                "corners_embedded": captured.corners_embedded.round(3).tolist(),
            }
            if captured.bits is not None:
                entry["bits"] = [None if bit < 0 else int(bit) for bit in captured.bits]
            if captured.kappa is not None:
                entry["kappa"] = captured.kappa
            if captured.ratex_kappa is not None:
                entry["ratex_kappa"] = captured.ratex_kappa
            lines.append(json.dumps({**entry, **captured.meta, "sha256": digest.hexdigest()}))
        write_bytes(temporary / MANIFEST, ("\n".join(lines) + "\n").encode())
    return len(lines)


def read_manifest(folder: Path) -> list[dict[str, Any]]:
    """Read the manifest's entries, each checked to be a JSON object with the keys it needs.

    Raises:
        InputError: no manifest, an empty one, a line that is not a frame pair, or a picture that
            lies outside the folder.
    """
    file = folder / MANIFEST
    if not is_file(file):
        raise InputError(f"{file}: not found; a folder of captures needs a {MANIFEST}")
    entries: list[dict[str, Any]] = []
    for where, entry in read_json_lines(file):
        if not isinstance(entry, dict):
            raise InputError(f"{where}: need a JSON object, got {entry!r:.60}")
        missing = {"original", "embedded", "layout", "corners"} - set(entry)
        if missing:
            raise InputError(f"{where}: lacks {', '.join(sorted(missing))}")
        for key in ("original", "embedded"):
            inside(folder, entry[key], f"{where}, {key}")
        entries.append(entry)
    if not entries:
        raise InputError(f"{file}: lists no frame pair")
    return entries


def read_layouts(folder: Path) -> list[Layout]:
    """Read the layouts of a folder's frame pairs, each once.

    Raises:
        InputError: the manifest is no good, or a frame pair has no layout.
    """
    found: dict[Layout, None] = {}
    for entry in read_manifest(folder):
        try:
            found[Layout.from_dict(entry["layout"])] = None
        except InputError as error:
            raise InputError(f"{folder / MANIFEST}, {entry['original']}: {error}") from None
    return list(found)


def load_capture(folder: Path, entry: dict[str, Any]) -> Captured:
    """Read the frame pair of one manifest entry.

    Raises:
        InputError: a file is missing, unreadable or outside the folder, differs from its sha256, or
            a field is wrong.
    """
    file = folder / MANIFEST
    paths = [inside(folder, entry[key], f"{file}, {key}") for key in ("original", "embedded")]
    frames = [read_image(path) for path in paths]
    if "sha256" in entry:
        digest = hashlib.sha256(b"".join(path.read_bytes() for path in paths)).hexdigest()
        if digest != entry["sha256"]:
            raise InputError(f"{paths[0]} or {paths[1].name}: differs from the manifest's sha256")
    try:
        layout = Layout.from_dict(entry["layout"])
        return Captured(
            original=frames[0],
            embedded=frames[1],
            layout=layout,
            corners=as_corners(entry["corners"]),
            corners_embedded=as_corners(entry.get("corners_embedded", entry["corners"])),
            bits=_bits(entry.get("bits"), layout),
            kappa=_kappa(entry.get("kappa")),
            ratex_kappa=_kappa(entry.get("ratex_kappa"), "ratex_kappa"),
            meta=_meta(entry),
        )
    except InputError as error:
        raise InputError(f"{file}, {entry['original']}: {error}") from None


def _kappa(value: Any, key: str = "kappa") -> int | None:
    if value is not None and (type(value) is not int or not 1 <= value <= MAX_KAPPA):
        raise InputError(f"{key} must be a whole number from 1 to {MAX_KAPPA}, got {value!r:.60}")
    return value


def _meta(entry: dict[str, Any]) -> dict[str, Any]:
    """The further keys, those that tables are grouped by checked."""
    meta = {key: value for key, value in entry.items() if key not in KNOWN}
    for key in ("pair", "picture"):
        if not isinstance(meta.get(key, ""), str):
            raise InputError(f"{key} must be text, got {meta[key]!r:.60}")
    view = meta.get("view_deg")
    if view is not None and (type(view) not in (int, float) or not np.isfinite(view)):
        raise InputError(f"view_deg must be a finite number, got {view!r:.60}")
    return meta


def _bits(value: Any, layout: Layout) -> NDArray[np.intp] | None:
    if value is None:
        return None
    if not isinstance(value, list) or any(bit not in (0, 1, None) for bit in value):
        raise InputError(f"bits: need a list of 0, 1 or null, got {value!r:.100}")
    if len(value) != layout.n_bits:
        raise InputError(
            f"bits: the layout carries {layout.n_bits}, the manifest lists {len(value)}"
        )
    return np.array([-1 if bit is None else bit for bit in value], np.intp)
