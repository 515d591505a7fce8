"""The one loop of every study: conditions x methods -> predictions, stored cell by cell.

Each cell of each method is one file, named after all that decides what it holds (`fingerprint`).
A run that was cut off goes on with the cells that are missing or damaged, and a method that is new
or has changed costs no other method its results.
"""

import hashlib
import platform
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pandas as pd
from tqdm import tqdm

from data_gen.channel.optics import check_view
from data_gen.frame_pair import Cell, FramePair, Source
from link.captures import load_capture, read_manifest
from link.embed import check_kappa
from link.errors import InputError, UnsuitedError, each_once
from link.files.lock import locked
from link.images import write_bytes
from link.layout import Layout
from reports.engine.backends import Backend, one_thread, run_tasks
from reports.engine.digest import code_digest, file_digest, outside_digest, package_versions
from reports.engine.methods import Method
from reports.engine.records import read_sealed, seal_lines, to_line, to_records

STORED_VERSION = 2
"""Raise it when `decode_cell` changes what it stores, so that older files are not read again."""
Line = dict[str, Any]


@dataclass(frozen=True)
class Condition:
    """Cells of the comparison under one setting of the channel."""

    name: str
    """Tells conditions of a study apart; "" where there is one."""
    source: Source
    """Pictures, seed, and the channel as it is set."""
    cells: tuple[Cell, ...]
    """Camera-display pairs, views and kappas that are decoded."""
    frames: int
    """Number of frame pairs of each cell."""


@dataclass(frozen=True)
class Predicted:
    """What a study decoded."""

    records: pd.DataFrame
    """The table of predictions, with conditions, cells and frame pairs in the order given."""
    failed: list[str]
    """One line for each cell that failed, with the file of its traceback."""


@dataclass(frozen=True)
class _Task:
    """One cell, and the methods whose predictions of it are not stored yet."""

    condition: Condition
    cell: Cell
    methods: tuple[Method, ...]
    marks: tuple[str, ...]
    """The methods' fingerprints on the machine that asks; empty where that machine decodes."""


def paper_cells(
    pairs: Sequence[str], views: Sequence[float] = (0.0, 45.0), kappas: Sequence[int] = (5, 3)
) -> tuple[Cell, ...]:
    """The paper's protocol: every pair at every view and kappa, ordered as its tables are.

    Raises:
        ParameterError: a list is empty or names a value twice, or a view or kappa is out of range.

    >>> [(cell.view_deg, cell.kappa) for cell in paper_cells(["canon-lg"])]
    [(0.0, 5), (45.0, 5), (0.0, 3), (45.0, 3)]
    """
    each_once(pairs=pairs, views=views, kappas=kappas)
    for view in views:
        check_view(view, "views")
    for kappa in kappas:
        check_kappa(kappa, "kappas")
    return tuple(Cell(pair, view, kappa) for kappa in kappas for view in views for pair in pairs)


def predict(
    conditions: Sequence[Condition],
    methods: Sequence[Method],
    folder: Path,
    backend: Backend,
) -> Predicted:
    """Decode every cell of every condition with every method; a run that was cut off goes on.

    Files are written as cells are done, into ``folder``/cells. The result is the same from any
    backend, and workers need not see ``folder``. Methods that are shown the same thing see the same
    captures.

    Args:
        conditions: conditions with different names.
        methods: methods with different labels.
        folder: folder of the stored cells.
        backend: where cells are decoded.

    Returns:
        the table of predictions without the cells that failed, methods that are shown equalised
        pictures last, and what failed; the next run tries the failed cells again.

    Raises:
        InputError: no cell could be decoded, the backend cannot be had, or another process writes
            the folder.
    """
    with locked(folder):
        found, failed = _decode_missing(conditions, methods, folder, backend)
    total = sum(len(condition.cells) for condition in conditions)
    if total and len(failed) == total:
        raise InputError(next(iter(failed.values())))
    ordered = sorted(methods, key=lambda method: method.card.equalised)
    tables = []
    for condition in conditions:
        lines = [
            line
            for cell in condition.cells
            if (condition.name, cell) not in failed
            for line in _by_frame({m.label: found[condition.name, cell, m.label] for m in ordered})
        ]
        tables.append(to_records(lines, condition.name))
    reports = [
        f"{name + ', ' if name else ''}{cell.pair}, {cell.view_deg:g}°, kappa {cell.kappa}: {why}"
        for (name, cell), why in failed.items()
    ]
    records = pd.concat(tables, ignore_index=True) if tables else to_records([])
    return Predicted(records, sorted(reports))


def _decode_missing(
    conditions: Sequence[Condition], methods: Sequence[Method], folder: Path, backend: Backend
) -> tuple[dict[tuple[str, Cell, str], list[Line]], dict[tuple[str, Cell], str]]:
    """Decode the cells that are not stored yet, or whose files are damaged, and store them.

    Returns:
        predictions by the condition's name, the cell and the method's label; and for each cell that
        failed the reason, with the file of its traceback.
    """
    marks = {
        (condition.name, method.label): fingerprint(condition.source, condition.frames, method)
        for condition in conditions
        for method in methods
    }

    def file_of(condition: Condition, cell: Cell, method: Method) -> Path:
        mark = marks[condition.name, method.label][:16]
        return folder / "cells" / mark / f"{cell.pair}_{cell.view_deg:g}_{cell.kappa}.jsonl"

    found: dict[tuple[str, Cell, str], list[Line]] = {}
    tasks = []
    for condition in conditions:
        for cell in condition.cells:
            for method in methods:
                stored = _stored(file_of(condition, cell, method), condition, cell, method)
                if stored is not None:
                    found[condition.name, cell, method.label] = stored
            missing = tuple(m for m in methods if (condition.name, cell, m.label) not in found)
            if missing:
                own = tuple(marks[condition.name, m.label] for m in missing)
                tasks.append(_Task(condition, cell, missing, own if backend.scheduler else ()))
    total = sum(len(condition.cells) for condition in conditions)
    failed: dict[tuple[str, Cell], str] = {}
    bar = tqdm(
        total=total, initial=total - len(tasks), unit="cell", desc="decode", disable=not total
    )
    with bar as progress:  # an error begins a new line
        for outcome in run_tasks(decode_cell, tasks, backend):
            task = tasks[outcome.index]
            trace = folder / "failed" / _trace_name(task)
            if outcome.failure is not None:
                write_bytes(trace, outcome.failure.trace.encode())
                failed[task.condition.name, task.cell] = f"{outcome.failure.reason} ({trace})"
            else:
                for method, lines in zip(task.methods, outcome.result or (), strict=True):
                    write_bytes(file_of(task.condition, task.cell, method), seal_lines(lines))
                    found[task.condition.name, task.cell, method.label] = lines
                trace.unlink(missing_ok=True)
            progress.update()
    return found, failed


def predict_all(
    conditions: Sequence[Condition], methods: Sequence[Method], folder: Path, backend: Backend
) -> pd.DataFrame:
    """`predict` for studies that need every cell.

    Raises:
        InputError: a cell failed; the others are stored.
    """
    predicted = predict(conditions, methods, folder, backend)
    if predicted.failed:
        total = sum(len(condition.cells) for condition in conditions)
        raise InputError(f"{len(predicted.failed)} of {total} cells failed: {predicted.failed[0]}")
    return predicted.records


def decode_cell(task: _Task) -> list[list[Line]]:
    """Simulate a cell's frame pairs and decode each with the methods, in this process.

    Returns:
        for each method its predictions, one a frame pair.

    Raises:
        InputError: this machine differs from the one that asks, or a method does not suit.
    """
    source, frames = task.condition.source, task.condition.frames
    for method, mark in zip(task.methods, task.marks, strict=False):
        if fingerprint(source, frames, method) != mark:
            raise InputError(
                f"worker {platform.node()} has other code, packages, checkpoints or pictures at "
                "these paths than this machine; install the same there and restart its worker"
            )
    decoders = [method.build() for method in task.methods]
    one_thread()
    lines: list[list[Line]] = [[] for _ in task.methods]
    for index in range(frames):
        for equalised in {method.card.equalised for method in task.methods}:
            pair = FramePair(source, task.cell, index, equalised)
            for method, decoder, mine in zip(task.methods, decoders, lines, strict=True):
                if method.card.equalised != equalised:
                    continue
                try:
                    soft = decoder.decode(pair.rectified)
                    mine.append(to_line(method.label, index, soft, pair.captured))
                except UnsuitedError as error:
                    raise InputError(f"method {method.label}: {error}") from None
    return lines


def fingerprint(source: Source, frames: int, method: Method) -> str:
    """SHA-256 of all that decides what a method's file of a cell holds, processors apart."""
    options = [option for option in method.options if option[0] != "checkpoint"]
    parts = [
        repr((STORED_VERSION, source, frames, method.name, options)),
        code_digest("data_gen.frame_pair", method.card.target.partition(":")[0]),
        outside_digest(method.card.target.partition(":")[0]),
        checkpoint_digest(method, source.layout),
        file_digest(sorted(source.pictures.glob("*")) if source.pictures else []),
        *package_versions(),
    ]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


def checkpoint_digest(method: Method, *layouts: Layout) -> str:
    """SHA-256 of the files of a method's checkpoints for some layouts; empty where it has none."""
    folders = dict.fromkeys(method.checkpoint(layout) for layout in layouts)
    names = ("config.json", "decoder.pt")
    files = [folder / name for folder in folders if folder is not None for name in names]
    return file_digest(files) if files else ""


def decode_captures(captures: Path, methods: Sequence[Method]) -> tuple[pd.DataFrame, list[str]]:
    """Decode a folder of captures.

    Returns:
        the table of predictions, and a line for each method that was left out or does not suit.

    Raises:
        InputError: the folder or a frame pair is no good, or no method suits it.
    """
    entries = read_manifest(captures)
    lines: list[Line] = []
    notes: dict[str, str] = {}
    left_out: dict[str, int] = {}
    decoders = {m.label: m.build() for m in methods}
    for index, entry in enumerate(tqdm(entries, unit="pair", desc="decode")):
        captured = load_capture(captures, entry)
        pair = captured.rectified()
        if pair.layout.ratex and not captured.meta.get("equalised"):
            notes["hidden_ratex"] = "hidden_ratex: these pictures were not equalised for it"
        for name, decoder in decoders.items():
            try:
                lines.append(to_line(name, index, decoder.decode(pair), captured))
            except UnsuitedError as error:
                left_out[name] = left_out.get(name, 0) + 1
                notes[name] = f"{name}: left out of {left_out[name]} of {len(entries)}, {error}"
    if not lines:
        raise InputError(f"{captures}: no method fits; {'; '.join(notes.values())}")
    return to_records(lines), [note for name, note in notes.items() if name in decoders]


def _stored(file: Path, condition: Condition, cell: Cell, method: Method) -> list[Line] | None:
    """A method's stored predictions of a cell; None where they are missing or damaged."""
    lines = read_sealed(file)
    layout = condition.source.layout
    n_bits = (replace(layout, ratex=()) if method.card.equalised else layout).n_bits
    expected = [(cell.pair, cell.view_deg, cell.kappa, i, n_bits) for i in range(condition.frames)]
    found = [
        (line["pair"], line["view_deg"], line["kappa"], line["index"], len(line["bits"]))
        for line in lines or ()
    ]
    return lines if found == expected else None


def _by_frame(by_method: dict[str, list[Line]]) -> list[Line]:
    """Predictions of one cell by label, ordered by frame pair, then as ``by_method``."""
    named = [[{**line, "method": label} for line in mine] for label, mine in by_method.items()]
    return [line for frame in zip(*named, strict=True) for line in frame]


def _trace_name(task: _Task) -> str:
    """Name of the file for the traceback of a task."""
    cell = task.cell
    name = f"{task.condition.name}_{cell.pair}_{cell.view_deg:g}_{cell.kappa}.txt"
    return name.replace("/", "_").lstrip("_")
