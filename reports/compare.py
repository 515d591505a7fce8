"""Decode once -> predictions; scoring them is `reports.metrics`."""

import hashlib
import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
from joblib import Parallel, delayed, parallel_config
from tqdm import tqdm

from data_gen.dataset import Cell, Source, simulate
from data_gen.ideal import observe
from link.captures import load_capture, read_manifest
from link.errors import InputError, UnsuitedError
from link.frames import Captured, Rectified, SoftBits
from link.images import write_bytes
from models import DECODERS, Decoder, make_decoder

PREDICTIONS = "predictions.jsonl"
METHODS = {**DECODERS, "ideal": "data_gen.ideal:observe"}
"""Methods by name: the decoders, and the floor under them on simulated captures."""


class Ideal:
    """Stands for `data_gen.ideal.observe` among decoders: it decides from the draw, not a pair."""

    needs_ratex = True

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
        folder = dict(self.options).get("checkpoint")
        if folder is None:
            return ""
        return digest_files([Path(folder) / name for name in ("config.json", "decoder.pt")])

    def build(self) -> Decoder:
        """The decoder itself."""
        return Ideal() if self.name == "ideal" else make_decoder(self.name, **dict(self.options))


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
    cv2.setNumThreads(1)
    decoders = [(method.label or method.name, method.build()) for method in methods]
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
                        soft = observe(captured, source, cell, index)
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
    """Decode every cell, in parallel; a run that was cut off goes on where it stopped.

    Each finished cell is one file in a subfolder of ``folder``/cells that is named after all that
    decides the result: source and pictures, frames, methods, checkpoints and code. At the end
    predictions.jsonl holds them all, in the order of ``cells`` whatever the number of jobs.
    """
    key = repr((source, frames, [(method, method.digest()) for method in methods]))
    key += code_digest() + digest_files(
        sorted(source.pictures.glob("*")) if source.pictures else []
    )
    cache = folder / "cells" / hashlib.sha256(key.encode()).hexdigest()[:16]
    files = [cache / f"{c.pair}_{c.view_deg:g}_{c.kappa}.jsonl" for c in cells]

    def work(cell: Cell, file: Path) -> None:
        write_bytes(file, _to_lines(decode_cell(source, cell, frames, methods)))

    expected = frames * len(methods)
    todo = [pair for pair in zip(cells, files, strict=True) if not _is_whole(pair[1], expected)]
    with parallel_config("loky", n_jobs=jobs, inner_max_num_threads=1):
        results = Parallel(return_as="generator_unordered")(
            delayed(work)(cell, file) for cell, file in todo
        )
        done = len(cells) - len(todo)
        for _ in tqdm(results, total=len(cells), initial=done, unit="cell", desc="decode"):
            pass
    write_bytes(folder / PREDICTIONS, b"".join(file.read_bytes() for file in files))
    return list(read_predictions(folder))


def code_digest() -> str:
    """Of the code that makes and decodes captures, and of the fitted parameters."""
    root = Path(__file__).parent.parent
    files = sorted(f for p in ("link", "data_gen", "models") for f in (root / p).rglob("*.py"))
    return digest_files([*files, root / "data_gen" / "nuisances.json", Path(__file__)])


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
