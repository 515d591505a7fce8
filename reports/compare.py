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
from link.captures import load_capture, read_manifest
from link.errors import InputError, UnsuitedError
from link.frames import Captured, Rectified
from link.images import write_bytes
from models import Decoder, make_decoder

PREDICTIONS = "predictions.jsonl"


@dataclass(frozen=True)
class Method:
    """A decoder by name, with its options: cheap to send to another process."""

    name: str
    options: tuple[tuple[str, Any], ...] = ()
    label: str = ""
    """In tables, in place of the name."""

    def digest(self) -> str:
        """Of the checkpoint's weights, where the method has a checkpoint; else empty."""
        folder = dict(self.options).get("checkpoint")
        file = Path(folder) / "decoder.pt" if folder else None
        return hashlib.sha256(file.read_bytes()).hexdigest() if file and file.is_file() else ""

    def build(self) -> Decoder:
        """The decoder itself."""
        return make_decoder(self.name, **dict(self.options))


def decode(decoder: Decoder, name: str, pair: Rectified, captured: Captured) -> dict[str, Any]:
    """One line of predictions.jsonl."""
    soft = decoder.decode(pair)
    unknown = [-1] * pair.layout.n_bits
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
            lines += [{**decode(d, name, pair, captured), "index": index} for name, d in chosen]
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

    Each finished cell is one file under ``folder``/cells, used again only with the same source,
    frames, methods and checkpoints; at the end predictions.jsonl holds them all, in the order of
    ``cells`` whatever the number of jobs.
    """
    settings = repr((source, frames, [(method, method.digest()) for method in methods])).encode()
    settings_file = folder / "cells" / "settings.txt"
    if not settings_file.is_file() or settings_file.read_bytes() != settings:
        for stale in (folder / "cells").glob("*.jsonl"):
            stale.unlink()
        write_bytes(settings_file, settings)
    files = [folder / "cells" / f"{c.pair}_{c.view_deg:g}_{c.kappa}.jsonl" for c in cells]

    def work(cell: Cell, file: Path) -> None:
        write_bytes(file, _to_lines(decode_cell(source, cell, frames, methods)))

    todo = [(cell, file) for cell, file in zip(cells, files, strict=True) if not file.is_file()]
    with parallel_config("loky", n_jobs=jobs, inner_max_num_threads=1):
        results = Parallel(return_as="generator_unordered")(
            delayed(work)(cell, file) for cell, file in todo
        )
        done = len(cells) - len(todo)
        for _ in tqdm(results, total=len(cells), initial=done, unit="cell", desc="decode"):
            pass
    write_bytes(folder / PREDICTIONS, b"".join(file.read_bytes() for file in files))
    return list(read_predictions(folder))


def decode_captures(
    captures: Path, methods: Sequence[Method], folder: Path
) -> tuple[list[dict[str, Any]], list[str]]:
    """Decode a folder of captures.

    Returns:
        the predictions, and a line for each method that was left out.

    Raises:
        InputError: the folder or a frame pair is no good, or no method suits it.
    """
    entries = read_manifest(captures)
    lines: list[dict[str, Any]] = []
    skipped: dict[str, str] = {}
    decoders = [(method.label or method.name, method.build()) for method in methods]
    for index, entry in enumerate(tqdm(entries, unit="pair", desc="decode")):
        captured = load_capture(captures, entry)
        pair = captured.rectified()
        for name, decoder in decoders:
            try:
                lines.append({**decode(decoder, name, pair, captured), "index": index})
            except UnsuitedError as error:
                skipped[name] = f"{name}: left out, {error}"
    if not lines:
        raise InputError(f"{captures}: no method fits; {'; '.join(skipped.values())}")
    write_bytes(folder / PREDICTIONS, _to_lines(lines))
    return lines, list(skipped.values())


def read_predictions(folder: Path) -> Iterator[dict[str, Any]]:
    """The entries of predictions.jsonl."""
    for line in (folder / PREDICTIONS).read_text().splitlines():
        yield json.loads(line)


def _to_lines(entries: Iterable[dict[str, Any]]) -> bytes:
    return "".join(json.dumps(entry) + "\n" for entry in entries).encode()
