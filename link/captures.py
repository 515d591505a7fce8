"""The Captures format: a folder, and a manifest of its frame pairs and windows of film."""

import hashlib
import io
import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from link.embed import MAX_KAPPA
from link.errors import InputError
from link.files.together import written_together
from link.frames import Captured
from link.geometry import as_corners
from link.images import write_bytes, write_image
from link.images.files import read_image
from link.layout import Layout
from link.observation import Mixture, Observation
from link.outside import inside, is_file, read_json_lines

MANIFEST = "manifest.jsonl"
"""Name of the file that lists what a folder holds, one JSON object a line."""
KNOWN = {
    "original",
    "embedded",
    "window",
    "layout",
    "corners",
    "corners_embedded",
    "bits",
    "kappa",
    "sha256",
}
"""Keys of a manifest line that the format defines; `link.frames.Captured.meta` takes all others."""
BELOW = {"view_deg": 90.0, "time_s": math.inf, "end_s": math.inf}
"""Further keys that hold numbers, and what these, with a minus or without, are below."""


@dataclass(frozen=True)
class KnownWindow:
    """A window of film, and the bits that it shows."""

    observation: Observation
    """T frames of P frame pairs."""
    bits: NDArray[np.integer]
    """(P, n_bits) bits that were sent, 0 or 1, and -1 where one is not known."""
    kappa: int | None = None
    """Gray levels added where the bit is 1; None where they are not known."""
    meta: dict[str, object] = field(default_factory=dict)
    """Further keys of the manifest, such as pair, view_deg, film and time_s."""

    @property
    def layout(self) -> Layout:
        """Layout that the window shows."""
        return self.observation.layout

    def rectified(self) -> Observation:
        """The capture as decoders take it: the counterpart of `link.frames.Captured.rectified`."""
        return self.observation


def save_captures(folder: Path, captures: Iterable[Captured | KnownWindow]) -> int:
    """Write frame pairs and windows, and the manifest; they appear once all are written.

    Args:
        folder: made if it is not there.
        captures: frame pairs, written as PNG files, and windows of film, as .npz files.

    Returns:
        the number of frame pairs and windows.

    Raises:
        InputError: the folder holds captures, or cannot be written; no file is added to it.
    """
    lines: list[str] = []
    with written_together(folder, MANIFEST, folder.glob("[0-9]*_*.[pn][np][gz]")) as temporary:
        for number, captured in enumerate(captures):
            if isinstance(captured, KnownWindow):
                entry = _write_window(temporary, f"{number:05d}", captured)
            else:
                entry = _write_pair(temporary, f"{number:05d}", captured)
            entry["layout"] = captured.layout.to_dict()
            if captured.kappa is not None:
                entry["kappa"] = captured.kappa
            lines.append(json.dumps({**entry, **captured.meta}))
        write_bytes(temporary / MANIFEST, ("\n".join(lines) + "\n").encode())
    return len(lines)


def _write_pair(folder: Path, stem: str, captured: Captured) -> dict[str, Any]:
    """Write both frames of a pair; give its keys of the manifest."""
    names = [f"{stem}_{kind}.png" for kind in ("original", "embedded")]
    digest = hashlib.sha256()
    for name, frame in zip(names, (captured.original, captured.embedded), strict=True):
        write_image(folder / name, frame)
        digest.update((folder / name).read_bytes())
    entry: dict[str, Any] = {
        "original": names[0],
        "embedded": names[1],
        "corners": captured.corners.round(3).tolist(),
        "corners_embedded": captured.corners_embedded.round(3).tolist(),
        "sha256": digest.hexdigest(),
    }
    if captured.bits is not None:
        entry["bits"] = [None if bit < 0 else int(bit) for bit in captured.bits]
    return entry


def _write_window(folder: Path, stem: str, window: KnownWindow) -> dict[str, Any]:
    """Write a window; give its keys of the manifest."""
    name, data = f"{stem}_window.npz", pack_windows([window])
    write_bytes(folder / name, data)
    return {"window": name, "sha256": hashlib.sha256(data).hexdigest()}


def pack_windows(windows: Sequence[KnownWindow]) -> bytes:
    """Pack windows of one layout as the bytes of an .npz file; gray levels become float16."""
    arrays: dict[str, Any] = {}
    for number, window in enumerate(windows):
        seen, mixture = window.observation, window.observation.mixture
        frames = np.stack(seen.frames).astype(np.float16)
        parts = {"frames": frames, "seen": seen.blocks_seen, "bits": window.bits.astype(np.int8)}
        parts |= {"shares": mixture.shares, "pair": mixture.pair}
        arrays |= {f"{name}_{number}": values for name, values in parts.items()}
    packed = io.BytesIO()
    np.savez(packed, count=len(windows), **arrays)
    return packed.getvalue()


def unpack_windows(file: Path, layout: Layout) -> list[KnownWindow]:
    """Read the windows of a file that holds what `pack_windows` made.

    Raises:
        InputError: the file is missing or damaged, or its windows do not fit the layout.
    """
    try:
        with np.load(file, allow_pickle=False) as stored:
            return [_window(stored, number, layout) for number in range(int(stored["count"]))]
    except (OSError, ValueError, KeyError, EOFError, BadZipFile) as error:
        raise InputError(f"{file}: is no window of film, or a damaged one ({error})") from None


def _window(stored: Any, number: int, layout: Layout) -> KnownWindow:
    frames, seen, bits, shares, pair = (
        stored[f"{name}_{number}"] for name in ("frames", "seen", "bits", "shares", "pair")
    )
    grid = layout.rows, layout.cols
    fits = frames.ndim == 3 and seen.shape == (len(frames), *grid) and pair.ndim == 2
    fits = fits and shares.shape == (*pair.shape, *grid) and len(pair) == len(frames)
    if not fits or bits.ndim != 2 or bits.shape[1] != layout.n_bits or not len(frames):
        raise ValueError("its arrays do not fit the layout")
    if not all(np.isfinite(values).all() for values in (frames, seen, shares)):
        raise ValueError("it holds what is no number")
    if pair.min() < -1 or pair.max() >= len(bits) or not np.isin(bits, (-1, 0, 1)).all():
        raise ValueError("its bits are wrong")
    mixture = Mixture(shares.astype(np.float32), pair.astype(np.int64), len(bits))
    grays = tuple(frames.astype(np.float32))
    observation = Observation(grays, layout, mixture, seen.astype(np.float32))
    return KnownWindow(observation, bits.astype(np.int64))


@dataclass(frozen=True)
class Entry:
    """An entry of a manifest: a frame pair, or a window of film."""

    where: str
    """Path of the manifest, and number of the line."""
    content: dict[str, Any]
    """The line of the manifest."""
    files: tuple[Path, ...]
    """Both frames of a pair, or the file of a window; within the folder."""
    layout: Layout
    """Layout that the display shows."""
    kappa: int | None
    """Gray levels added where a bit is 1; None where they are not known."""
    meta: dict[str, Any]
    """Further keys, such as pair, view_deg, film and time_s."""

    @property
    def is_window(self) -> bool:
        """Whether it is a window of film, and not a frame pair."""
        return len(self.files) == 1

    @property
    def pair(self) -> str:
        """Name of the camera-display pair; "captures" where it is not known."""
        return str(self.meta.get("pair", "captures"))

    @property
    def view_deg(self) -> float | None:
        """Angle of observation, degrees; None where it is not known."""
        return self.meta.get("view_deg")

    def load(self) -> Captured | KnownWindow:
        """Read the frames.

        Raises:
            InputError: a file is missing, unreadable or differs from its sha256, or a field is
                wrong.
        """
        try:
            loaded = self._load_window() if self.is_window else self._load_pair()
        except InputError as error:
            raise InputError(f"{self.where}: {error}") from None
        digest = hashlib.sha256(b"".join(file.read_bytes() for file in self.files)).hexdigest()
        if self.content.get("sha256", digest) != digest:
            names = " or ".join(file.name for file in self.files)
            raise InputError(f"{self.where}: {names}: differs from the manifest's sha256")
        return loaded

    def observe(self, *_: object) -> Captured | KnownWindow:
        """Read the frames: the one observation, which is there already."""
        return self.load()

    def _load_window(self) -> KnownWindow:
        windows = unpack_windows(self.files[0], self.layout)
        if len(windows) != 1:
            raise InputError(f"holds {len(windows)} windows of film; write a file for each")
        return replace(windows[0], kappa=self.kappa, meta=self.meta)

    def _load_pair(self) -> Captured:
        original, embedded = map(read_image, self.files)
        content = self.content
        return Captured(
            original=original,
            embedded=embedded,
            layout=self.layout,
            corners=as_corners(content["corners"]),
            corners_embedded=as_corners(content.get("corners_embedded", content["corners"])),
            bits=_bits(content.get("bits"), self.layout),
            kappa=self.kappa,
            meta=self.meta,
        )


def read_manifest(folder: Path) -> list[Entry]:
    """Read the manifest's entries, each checked to be a JSON object with the keys it needs.

    Raises:
        InputError: no manifest, an empty one, a line that is neither frame pair nor window, a file
            that lies outside the folder, or a field by which tables are grouped is wrong.
    """
    file = folder / MANIFEST
    if not is_file(file):
        raise InputError(
            f"{file}: not found; a folder of captures needs a {MANIFEST}, and a film or "
            "photographs need --sent, what was shown"
        )
    entries = [_entry(folder, content, where) for where, content in read_json_lines(file)]
    if not entries:
        raise InputError(f"{file}: lists no frame pair or window; make captures first")
    return entries


def _entry(folder: Path, content: Any, where: str) -> Entry:
    if not isinstance(content, dict):
        raise InputError(f"{where}: need a JSON object, got {content!r:.60}")
    keys = ("window",) if "window" in content else ("original", "embedded")
    missing = {*keys, "layout", *(() if "window" in content else ("corners",))} - set(content)
    if missing:
        raise InputError(f"{where}: lacks {', '.join(sorted(missing))}")
    files = tuple(inside(folder, content[key], f"{where}, {key}") for key in keys)
    try:
        layout, kappa = Layout.from_dict(content["layout"]), _kappa(content.get("kappa"))
        return Entry(where, content, files, layout, kappa, _meta(content))
    except InputError as error:
        raise InputError(f"{where}: {error}") from None


def _kappa(value: Any) -> int | None:
    if value is not None and (type(value) is not int or not 1 <= value <= MAX_KAPPA):
        raise InputError(f"kappa must be a whole number from 1 to {MAX_KAPPA}, got {value!r:.60}")
    return value


def _meta(entry: dict[str, Any]) -> dict[str, Any]:
    """The further keys, those that tables are grouped by checked."""
    meta = {key: value for key, value in entry.items() if key not in KNOWN}
    for key in ("pair", "picture", "film"):
        if not isinstance(meta.get(key, ""), str):
            raise InputError(f"{key} must be text, got {meta[key]!r:.60}")
    for key, most in BELOW.items():
        number = meta.get(key)
        if number is not None and not (type(number) in (int, float) and abs(number) < most):
            raise InputError(f"{key} must be a number below {most:g}, got {number!r:.60}")
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
