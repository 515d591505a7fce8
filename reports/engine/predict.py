"""The one way of every study: conditions -> cells -> records.

A cell's observations are made and decoded in one place (`decode_cell`). Each prediction is stored
once, as a line of JSON that bears the digest of all that decides it (`fingerprint`). So a run that
was cut off goes on with what is missing or damaged, and a method that is new or has changed costs
no other method its results.
"""

import platform
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import singledispatch
from pathlib import Path
from typing import Any, Protocol

import pandas as pd

from data_gen.channel.optics import check_view
from data_gen.frame_pair import Cell, FramePair, Source
from data_gen.pairs import get_pair
from link.captures import KnownWindow, load_entry, read_manifest
from link.embed import check_kappa
from link.errors import InputError, UnsuitedError, each_once
from link.files.lock import locked
from link.images import write_bytes
from link.layout import Layout
from link.observation import Observation
from reports.engine.backends import Backend, one_thread, run_tasks
from reports.engine.checked import seal
from reports.engine.digest import (
    code_digest,
    file_digest,
    outside_digest,
    package_versions,
    short_digest,
)
from reports.engine.methods import Method
from reports.engine.records import (
    Truth,
    key_of,
    stored_predictions,
    to_line,
    to_records,
    truth_of,
    write_predictions,
)

STORED_VERSION = 3
"""Raise it when `decode_cell` changes what it returns, so that older results are not read again."""
Line = dict[str, Any]
Found = dict[tuple[Any, ...], Line]
"""Predictions by what `key_of` says of each."""


@dataclass(frozen=True)
class Condition:
    """Cells of the comparison under one setting of the channel."""

    name: str
    """Tells conditions of a study apart; "" where there is one."""
    source: Any
    """An `ObservationSource`: pictures, seed, and the channel as it is set."""
    cells: tuple[Cell, ...]
    """Camera-display pairs, views and kappas that are decoded."""
    frames: int
    """Number of observations of each cell: frame pairs, or windows of as many films."""
    without: tuple[str, ...] = ()
    """Labels of methods that do not suit its layout, and so do not decode it."""


@dataclass(frozen=True)
class Predicted:
    """What a study decoded."""

    records: pd.DataFrame
    """The table of predictions, with conditions, cells and observations in the order given."""
    failed: list[str]
    """One line for each cell that failed, with the file of its traceback."""


@dataclass(frozen=True)
class Task:
    """A cell, and the methods that are to decode it."""

    condition: Condition
    """Setting of the channel."""
    cell: Cell
    """One of the condition's cells."""
    methods: tuple[Method, ...]
    """Methods with different labels."""
    marks: Mapping[str, str]
    """`fingerprint` of each method, by its label, on the machine that asks."""

    def __str__(self) -> str:
        cell, name = self.cell, self.condition.name
        return f"{name + ', ' if name else ''}{cell.pair}, {cell.view_deg:g}°, kappa {cell.kappa}"

    def key(self, method: Method, index: int) -> tuple[Any, ...]:
        """What `key_of` says of the prediction of one observation."""
        cell, label = self.cell, method.label
        place = self.condition.name, label, cell.pair, cell.view_deg, cell.kappa, index
        return *place, self.marks[label]

    def without(self, found: Found) -> "Task":
        """The task of the methods alone that lack a prediction."""
        frames = range(self.condition.frames)
        lack = [m for m in self.methods if any(self.key(m, i) not in found for i in frames)]
        return replace(self, methods=tuple(lack))


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
    conditions: Sequence[Condition], methods: Sequence[Method], file: Path, backend: Backend
) -> Predicted:
    """Decode every cell of every condition with every method, and store the predictions.

    They are added to ``file``.part, cell by cell, from where a run goes on that was cut off. In the
    end ``file`` holds them in order, and nothing else. The result is the same from any backend, and
    workers need not see the file. Methods that are shown the same thing see the same captures.

    Args:
        conditions: conditions with different names.
        methods: methods with different labels.
        file: predictions, one line of JSON each. What it holds already is not decoded again, unless
            something has changed that decides it.
        backend: where cells are decoded.

    Returns:
        the table of predictions without the cells that failed, methods that are shown equalised
        pictures last, and what failed; the next run tries the failed cells again.

    Raises:
        InputError: no cell could be decoded, the backend cannot be had, or another process writes
            the folder.
    """
    ordered = tuple(sorted(methods, key=lambda method: method.card.equalised))
    tasks = []
    for condition in conditions:
        mine = tuple(method for method in ordered if method.label not in condition.without)
        marks = {m.label: fingerprint(condition, m) for m in mine}
        tasks += [Task(condition, cell, mine, marks) for cell in condition.cells]
    part = file.with_name(f"{file.name}.part")
    with locked(file.parent):
        stored = [*stored_predictions(file), *stored_predictions(part)]
        found = {key_of(line): line for line in stored}
        failed = _decode_missing(tasks, found, part, backend)
        whole = [task for task in tasks if str(task) not in failed]
        lines = [
            found[task.key(method, index)]
            for task in whole
            for index in range(task.condition.frames)
            for method in task.methods
        ]
        if whole or not tasks:
            write_predictions(file, lines)
        part.unlink()
    if failed and not whole:
        raise InputError(next(iter(failed.values())))
    return Predicted(to_records(lines), sorted(f"{task}: {why}" for task, why in failed.items()))


def _decode_missing(
    tasks: Sequence[Task], found: Found, part: Path, backend: Backend
) -> dict[str, str]:
    """Decode what is not found yet, and add it to ``found`` and to the file ``part``.

    Returns:
        for each task that failed the reason, with the file of its traceback.
    """
    missing = [lack for task in tasks if (lack := task.without(found)).methods]
    run = decode_cell if backend.scheduler is None else decode_cell_elsewhere
    done, failed = len(tasks) - len(missing), {}
    with part.open("a", encoding="utf-8") as stream:
        for outcome in run_tasks(run, missing, backend, "decode", done):
            task = str(missing[outcome.index])
            trace = part.parent / "failed" / f"{task.replace('/', '_')}.txt"
            if outcome.failure is not None:
                write_bytes(trace, outcome.failure.trace.encode())
                failed[task] = f"{outcome.failure.reason} ({trace})"
                continue
            for line in outcome.result:
                found[key_of(line)] = line
                stream.write(seal(line))
            stream.flush()
            trace.unlink(missing_ok=True)
    return failed


def predict_all(
    conditions: Sequence[Condition], methods: Sequence[Method], file: Path, backend: Backend
) -> pd.DataFrame:
    """`predict` for studies that need every cell.

    Raises:
        InputError: a cell failed; the others are stored.
    """
    predicted = predict(conditions, methods, file, backend)
    if predicted.failed:
        total = sum(len(condition.cells) for condition in conditions)
        raise InputError(f"{len(predicted.failed)} of {total} cells failed: {predicted.failed[0]}")
    return predicted.records


def decode_cell(task: Task) -> list[Line]:
    """Make a cell's observations and decode each with the methods, in this process.

    Returns:
        a prediction for each observation and method.

    Raises:
        InputError: a method does not suit.
    """
    condition, lines = task.condition, []
    decoders = {method: method.build() for method in task.methods}
    one_thread()
    for index in range(condition.frames):
        for equalised in {method.card.equalised for method in decoders}:
            seen, truth = observe(condition.source, task.cell, index, equalised)
            for method, decoder in decoders.items():
                if method.card.equalised != equalised:
                    continue
                try:
                    line = to_line(method.label, index, decoder.decode(seen), truth)
                except UnsuitedError as error:
                    raise InputError(f"method {method.label}: {error}") from None
                lines.append(line | {"condition": condition.name, "mark": task.marks[method.label]})
    return lines


def decode_cell_elsewhere(task: Task) -> list[Line]:
    """`decode_cell` on a machine that must first be found to be like the one that asks."""
    for method in task.methods:
        own = fingerprint(task.condition, method)
        if own != task.marks[method.label]:
            raise InputError(
                f"worker {platform.node()} has other code, packages, checkpoints or pictures at "
                "these paths than this machine; install the same there and restart its worker"
            )
    return decode_cell(task)


class ObservationSource(Protocol):
    """Where observations come from; `observe` knows how each kind makes them."""

    @property
    def layout(self) -> Layout:
        """Layout of the displayed pictures."""

    @property
    def pictures(self) -> Path | None:
        """Folder of the user's own pictures, in place of the built-in ones."""


@singledispatch
def observe(source: Any, cell: Cell, index: int, equalised: bool) -> tuple[Observation, Truth]:
    """Make one observation as decoders take it, and what is known of it.

    Each kind of source registers how it does so.

    Args:
        source: pictures, seed, and the channel.
        cell: pair, view and kappa.
        index: number of the observation in its cell.
        equalised: whether equalised pictures without ratex patches are shown.
    """
    raise TypeError(f"no way to observe {source!r}")


@observe.register
def _(source: Source, cell: Cell, index: int, equalised: bool) -> tuple[Observation, Truth]:
    pair = FramePair(source, cell, index, equalised)
    return pair.rectified, truth_of(pair.captured)


def fingerprint(condition: Condition, method: Method) -> str:
    """First digits of the SHA-256 of all that decides a method's predictions of a cell.

    Processors are left out, and so are the names of the method and of the condition.
    """
    source = condition.source
    files = sorted({cell.pair for cell in condition.cells if cell.pair.endswith(".json")})
    pictures = file_digest(sorted(source.pictures.glob("*")) if source.pictures else [])
    seen = source, condition.frames, [get_pair(file) for file in files], pictures
    return _mark(method, seen, type(source).__module__, source.layout)


def checkpoint_digest(method: Method, *layouts: Layout) -> str:
    """SHA-256 of the files of a method's checkpoints for some layouts; empty where it has none."""
    folders = dict.fromkeys(method.checkpoint(layout) for layout in layouts)
    names = ("config.json", "decoder.pt")
    files = [folder / name for folder in folders if folder is not None for name in names]
    return file_digest(files) if files else ""


@dataclass(frozen=True)
class EntryTask:
    """An entry of a folder of captures, and the methods that are to decode it."""

    captures: Path
    """Folder with a manifest."""
    index: int
    """Number of the entry in the manifest."""
    entry: dict[str, Any]
    """The entry."""
    methods: tuple[Method, ...]
    """Methods with different labels."""
    marks: Mapping[str, str]
    """`captures_mark` of each method, by its label."""


def decode_entry(task: EntryTask) -> tuple[list[Line], dict[str, str]]:
    """Decode an entry of a folder of captures with the methods, in this process.

    Returns:
        a prediction for each method that suits, and why the others do not, by their labels.

    Raises:
        InputError: the entry is no good.
    """
    decoders = {method.label: method.build() for method in task.methods}
    one_thread()
    captured = load_entry(task.captures, task.entry)
    film = isinstance(captured, KnownWindow)
    seen = captured.observation if isinstance(captured, KnownWindow) else captured.rectified()
    truth, lines, unsuited = truth_of(captured), [], {}
    for method in task.methods:
        try:
            if method.card.frames == "window" and not film:
                raise UnsuitedError("it reads windows of film")
            line = to_line(method.label, task.index, decoders[method.label].decode(seen), truth)
        except UnsuitedError as error:
            unsuited[method.label] = str(error)
            continue
        lines.append(line | {"condition": "", "mark": task.marks[method.label]})
    return lines, unsuited


def captures_mark(method: Method, entry: dict[str, Any], layout: Layout) -> str:
    """First digits of the SHA-256 of all that decides a method's prediction of a capture."""
    return _mark(method, entry, "link.captures", layout)


def _mark(method: Method, seen: object, reader: str, layout: Layout) -> str:
    """First digits of the SHA-256 of a method and of what it decodes.

    Args:
        method: what decodes.
        seen: what is decoded; its text says all that decides it, but for code.
        reader: name of the module that makes or loads it.
        layout: layout for which a checkpoint is taken.
    """
    module = method.card.target.partition(":")[0]
    options: list[Any] = [option for option in method.options if option[0] != "checkpoint"]
    options += ["by pairs"] * method.by_pairs
    return short_digest(
        repr((STORED_VERSION, seen, method.name, options)),
        code_digest(reader, module),
        outside_digest(module),
        checkpoint_digest(method, layout),
        *package_versions(),
    )


def decode_captures(
    captures: Path,
    methods: Sequence[Method],
    file: Path,
    backend: Backend,
    only: Collection[int] | None = None,
) -> tuple[pd.DataFrame, list[str]]:
    """Decode a folder of captures, and store the predictions.

    They are added to ``file``.part, entry by entry, from where a run goes on that was cut off.

    Args:
        captures: folder with a manifest.
        methods: methods with different labels.
        file: takes the predictions.
        backend: where entries are decoded.
        only: numbers of the entries that are decoded; None for all.

    Returns:
        the table of predictions, and a line for each method that was left out or does not suit.

    Raises:
        InputError: the folder or a capture is no good, or no method suits it.
    """
    every = read_manifest(captures)
    entries = {at: entry for at, entry in enumerate(every) if only is None or at in only}
    part = file.with_name(f"{file.name}.part")
    stored = [*stored_predictions(file), *stored_predictions(part)]
    found = {(line["index"], line["method"], line["mark"]): line for line in stored}
    tasks, keys = [], []
    for index, entry in entries.items():
        layout = Layout.from_dict(entry["layout"])
        marks = {m.label: captures_mark(m, entry, layout) for m in methods}
        keys += [(index, label, mark) for label, mark in marks.items()]
        lack = tuple(m for m in methods if (index, m.label, marks[m.label]) not in found)
        tasks += [EntryTask(captures, index, entry, lack, marks)] if lack else []
    notes: dict[str, str] = {}
    left_out: dict[str, int] = {}
    done = len(entries) - len(tasks)
    with locked(file.parent), part.open("a", encoding="utf-8") as stream:
        for outcome in run_tasks(decode_entry, tasks, backend, "decode", done):
            if outcome.failure is not None:
                raise InputError(outcome.failure.reason)
            lines, unsuited = outcome.result
            for line in lines:
                found[line["index"], line["method"], line["mark"]] = line
                stream.write(seal(line))
            stream.flush()
            for label, why in unsuited.items():
                left_out[label] = left_out.get(label, 0) + 1
                notes[label] = f"{label}: left out of {left_out[label]} of {len(entries)}, {why}"
    wanted = [found[key] for key in keys if key in found]
    if not wanted:
        raise InputError(f"{captures}: no method fits; {'; '.join(notes.values())}")
    write_predictions(file, wanted)
    part.unlink()
    if any(entry["layout"].get("ratex") and not entry.get("equalised") for entry in every):
        notes.setdefault("hidden_ratex", "hidden_ratex: these pictures were not equalised for it")
    labels = {method.label for method in methods}
    return to_records(wanted), [note for label, note in notes.items() if label in labels]
