"""Decode once -> predictions; scoring them is `reports.score.metrics`."""

import hashlib
import json
import platform
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

from tqdm import tqdm

from data_gen.frame_pair import Cell, Source, simulate
from data_gen.ideal import observe
from link.captures import load_capture, read_manifest
from link.errors import InputError, UnsuitedError
from link.frames import Captured, Rectified, SoftBits
from link.images import write_bytes
from models import DECODERS, PRETRAINED, Decoder, make_decoder
from reports.engine.backends import Backend, one_thread, run_tasks

PREDICTIONS = "predictions.jsonl"
OBSERVERS: dict[str, Callable[..., SoftBits]] = {
    "ideal": observe,
    "ideal_change": partial(observe, change=True),
}
"""Floors under the decoders, on simulated captures."""
METHODS = {**DECODERS, **dict.fromkeys(OBSERVERS, "data_gen.ideal")}
"""Methods by name."""
SHIPPED = {"cnn": PRETRAINED.with_name("pretrained_cnn")}
"""Checkpoints of methods that find their own."""
PACKAGES = ("numpy", "scipy", "opencv-python-headless", "scikit-image", "scikit-learn", "torch")
"""Those that decide the result of a cell."""


class Ideal:
    """Stands for one of `OBSERVERS` among decoders: it decides from the draw, not a pair."""

    needs_ratex = True

    def __init__(self, name: str) -> None:
        self.name = name

    def decode(self, pair: Rectified) -> SoftBits:
        """Raise an `UnsuitedError`."""
        raise UnsuitedError("needs the simulation's true channel")


@dataclass(frozen=True)
class Method:
    """A decoder by name, with its options: cheap to send to another process."""

    name: str
    options: tuple[tuple[str, Any], ...] = ()
    label: str = ""
    """In tables, in place of the name."""

    def digest(self) -> str:
        """Of the checkpoint's files, where the method has a checkpoint; else empty."""
        folder = dict(self.options).get("checkpoint", SHIPPED.get(self.name))
        if folder is None:
            return ""
        return digest_files([Path(folder) / name for name in ("config.json", "decoder.pt")])

    def build(self) -> Decoder:
        """The decoder itself."""
        if self.name in OBSERVERS:
            return Ideal(self.name)
        return make_decoder(self.name, **dict(self.options))


def digest_files(files: Iterable[Path]) -> str:
    """SHA-256 over the files that exist, in the order given."""
    digest = hashlib.sha256()
    for file in files:
        digest.update(file.read_bytes() if file.is_file() else b"missing")
    return digest.hexdigest()


def methods_for(names: Sequence[str], checkpoint: Path) -> list[Method]:
    """The named methods; ``learned`` gets the checkpoint."""
    options = {"learned": (("checkpoint", checkpoint),)}
    return [Method(name, options.get(name, ())) for name in names]


def paper_cells(
    pairs: Sequence[str], views: Sequence[float] = (0.0, 45.0), kappas: Sequence[int] = (5, 3)
) -> list[Cell]:
    """The paper's protocol: every pair at every view and kappa, ordered as its tables are."""
    return [Cell(pair, view, kappa) for kappa in kappas for view in views for pair in pairs]


def to_entry(name: str, soft: SoftBits, captured: Captured) -> dict[str, Any]:
    """One line of predictions.jsonl."""
    unknown = [-1] * captured.layout.n_bits
    return {
        "method": name,
        "pair": captured.meta.get("pair", "captures"),
        "view_deg": captured.meta.get("view_deg"),
        "kappa": captured.kappa,
        "picture": captured.meta.get("picture"),
        "scores": [float(f"{score:.6g}") for score in soft.scores],
        "bits": unknown if captured.bits is None else [int(bit) for bit in captured.bits],
    }


def decode_cell(
    source: Source, cell: Cell, frames: int, methods: Sequence[Method]
) -> list[dict[str, Any]]:
    """Simulate a cell's captures and decode each with every method.

    Methods that train on ratex patches and those that want an equalised picture see the same draws.
    """
    decoders = [(method.label or method.name, method.build()) for method in methods]
    one_thread()
    lines = []
    for index in range(frames):
        for hidden in (False, True):
            chosen = [(name, d) for name, d in decoders if d.needs_ratex != hidden]
            if not chosen:
                continue
            captured = simulate(source, cell, index, hidden)
            pair = captured.rectified()
            for name, decoder in chosen:
                try:
                    if isinstance(decoder, Ideal):
                        soft = OBSERVERS[decoder.name](captured, source, cell, index)
                    else:
                        soft = decoder.decode(pair)
                    lines.append({**to_entry(name, soft, captured), "index": index})
                except UnsuitedError as error:
                    raise InputError(f"method {name}: {error}") from None
    return lines


def decode_cells(
    source: Source,
    cells: Sequence[Cell],
    frames: int,
    methods: Sequence[Method],
    folder: Path,
    jobs: int,
) -> list[dict[str, Any]]:
    """`decode_each` by ``jobs`` processes; an `InputError` where a cell failed."""
    lines, failed = decode_each(source, cells, frames, methods, folder, Backend(jobs))
    if failed:
        raise InputError(f"{len(failed)} of {len(cells)} cells failed: {failed[0]}")
    return lines


def decode_each(
    source: Source,
    cells: Sequence[Cell],
    frames: int,
    methods: Sequence[Method],
    folder: Path,
    backend: Backend,
) -> tuple[list[dict[str, Any]], list[str]]:
    """Decode every cell, in parallel; a run that was cut off goes on where it stopped.

    Each cell is one file in a subfolder of ``folder``/cells that is named after all that decides
    the result, and is written when the cell is done. At the end predictions.jsonl holds them all,
    in the order of ``cells``: the same bytes from any backend. Workers need not see ``folder``.

    Returns:
        the predictions, and a line for each cell that failed; its traceback is beside the others'
        files, and the next run tries it again.

    Raises:
        InputError: no cell could be decoded, or the backend cannot be had.
    """
    mark = fingerprint(source, frames, methods)
    cache = folder / "cells" / mark[:16]
    files = [cache / f"{c.pair}_{c.view_deg:g}_{c.kappa}.jsonl" for c in cells]
    expected = frames * len(methods)
    todo = [i for i, file in enumerate(files) if not _is_whole(file, expected)]
    task = partial(_decode_to_bytes, source, frames, methods, mark if backend.scheduler else None)
    failed: dict[int, str] = {}
    outcomes = run_tasks(task, [cells[i] for i in todo], backend)
    done = len(cells) - len(todo)
    for outcome in tqdm(outcomes, total=len(cells), initial=done, unit="cell", desc="decode"):
        number = todo[outcome.index]
        if outcome.failure is not None:
            failed[number] = outcome.failure.reason
            write_bytes(files[number].with_suffix(".txt"), outcome.failure.trace.encode())
            continue
        assert outcome.result is not None
        write_bytes(files[number], outcome.result)
        files[number].with_suffix(".txt").unlink(missing_ok=True)
    if len(failed) == len(cells):
        raise InputError(failed[0])
    whole = [file for i, file in enumerate(files) if i not in failed]
    write_bytes(folder / PREDICTIONS, b"".join(file.read_bytes() for file in whole))
    reports = [
        f"{cells[i].pair}, {cells[i].view_deg:g}°, kappa {cells[i].kappa}: {failed[i]} "
        f"({files[i].with_suffix('.txt')})"
        for i in sorted(failed)
    ]
    return list(read_predictions(folder)), reports


def _decode_to_bytes(
    source: Source, frames: int, methods: Sequence[Method], mark: str | None, cell: Cell
) -> bytes:
    """A cell's file; an `InputError` on a machine whose `fingerprint` is not ``mark``."""
    if mark is not None and fingerprint(source, frames, methods) != mark:
        raise InputError(
            f"worker {platform.node()} has other code, packages, checkpoints or pictures at these "
            "paths than this machine; install the same there and restart its worker"
        )
    return _to_lines(decode_cell(source, cell, frames, methods))


def fingerprint(source: Source, frames: int, methods: Sequence[Method]) -> str:
    """SHA-256 of all that decides what a cell's file holds, except the processor's rounding."""
    key = [repr((source, frames, [(method, method.digest()) for method in methods])), code_digest()]
    key += [f"{package} {version(package)}" for package in PACKAGES]
    key += [digest_files(sorted(source.pictures.glob("*")) if source.pictures else [])]
    return hashlib.sha256("\n".join(key).encode()).hexdigest()


@lru_cache(maxsize=1)
def code_digest() -> str:
    """Of the code that makes and decodes captures, and of the fitted parameters.

    Read once a process: a worker that runs on keeps the code that it started with.
    """
    root = Path(__file__).parents[2]
    files = sorted(f for p in ("link", "data_gen", "models") for f in (root / p).rglob("*.py"))
    here = [Path(__file__), Path(__file__).with_name("backends.py")]
    return digest_files([*files, root / "data_gen" / "nuisances.json", *here])


def _is_whole(file: Path, lines: int) -> bool:
    """Whether a cell's file is there and readable to the end."""
    try:
        return len([json.loads(line) for line in file.read_text().splitlines()]) == lines
    except (OSError, ValueError):
        return False


def decode_captures(
    captures: Path, methods: Sequence[Method], folder: Path
) -> tuple[list[dict[str, Any]], list[str]]:
    """Decode a folder of captures.

    Returns:
        the predictions, and a line for each method that was left out or does not suit.

    Raises:
        InputError: the folder or a frame pair is no good, or no method suits it.
    """
    entries = read_manifest(captures)
    lines: list[dict[str, Any]] = []
    notes: dict[str, str] = {}
    left_out: dict[str, int] = {}
    decoders = [(method.label or method.name, method.build()) for method in methods]
    for index, entry in enumerate(tqdm(entries, unit="pair", desc="decode")):
        captured = load_capture(captures, entry)
        pair = captured.rectified()
        if pair.layout.ratex and not captured.meta.get("equalised"):
            notes["hidden_ratex"] = "hidden_ratex: these pictures were not equalised for it"
        for name, decoder in decoders:
            try:
                lines.append({**to_entry(name, decoder.decode(pair), captured), "index": index})
            except UnsuitedError as error:
                left_out[name] = left_out.get(name, 0) + 1
                notes[name] = f"{name}: left out of {left_out[name]} of {len(entries)}, {error}"
    if not lines:
        raise InputError(f"{captures}: no method fits; {'; '.join(notes.values())}")
    write_bytes(folder / PREDICTIONS, _to_lines(lines))
    used = {method.name for method in methods}
    return lines, [note for name, note in notes.items() if name in used]


def read_predictions(folder: Path) -> Iterator[dict[str, Any]]:
    """The entries of predictions.jsonl."""
    for line in (folder / PREDICTIONS).read_text().splitlines():
        yield json.loads(line)


def _to_lines(entries: Iterable[dict[str, Any]]) -> bytes:
    return "".join(json.dumps(entry) + "\n" for entry in entries).encode()
