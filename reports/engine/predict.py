"""The one way of every study: conditions -> cells -> records.

A cell's observations are made and decoded in one place (`decode_cell`). Each prediction is stored
once, as a line of JSON that bears the digest of all that decides it (`fingerprint`). So a run that
was cut off goes on with what is missing or damaged, and a method that is new or has changed costs
no other method its results.
"""

import platform
import shutil
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pandas as pd

from data_gen.channel.optics import check_view
from data_gen.frame_pair import Cell
from data_gen.pairs import get_pair
from link.captures import Entry
from link.embed import check_kappa
from link.errors import InputError, UnsuitedError, each_once
from link.files.lock import locked
from link.images import write_bytes
from link.layout import Layout
from reports.engine.backends import Backend, one_thread
from reports.engine.checked import write_sealed
from reports.engine.digest import (
    code_digest,
    file_digest,
    outside_digest,
    package_versions,
    short_digest,
)
from reports.engine.methods import Method
from reports.engine.records import (
    CELL,
    key_of,
    stored_predictions,
    to_line,
    to_records,
)
from reports.engine.stored import resume

STORED_VERSION = 3
"""Version of what `decode_cell` returns; raise it when that changes, so that older results are not
read again."""
Line = dict[str, Any]
Decoded = tuple[list[Line], dict[str, str]]
"""Predictions of a cell, and by label why methods do not suit it."""
Found = dict[tuple[Any, ...], Line]
"""Predictions by what `key_of` says of each."""


@dataclass(frozen=True)
class Condition:
    """Cells of the comparison under one setting of the channel."""

    name: str
    """Name that tells conditions of a study apart; "" where there is only one."""
    source: Any
    """Pictures, seed, and the channel as it is set; its method ``observe`` makes observations. It
    has the ``layout`` of the displayed pictures and, unless it is an `Entry`, as ``pictures`` the
    folder of the user's own ones, or None."""
    cells: tuple[Any, ...]
    """Camera-display pairs, views and kappas that are decoded: `Cell`s of a simulation, or the one
    `Entry` of a folder of captures that is the source, too."""
    frames: int
    """Number of observations of each cell: frame pairs, or windows of as many films."""
    start: int = 0
    """Number of the first observation."""
    called: str = ""
    """Name of its only cell in messages; if empty, they name condition, pair, view and kappa."""
    same_captures: bool = False
    """Whether methods that do without ratex patches decode the captures of all others, too."""

    @property
    def indices(self) -> range:
        """Numbers of the observations of each cell."""
        return range(self.start, self.start + self.frames)

    def equalises(self, method: Method) -> bool:
        """Whether a method is shown equalised pictures without patches in place of patches."""
        has_patches = bool(self.source.layout.ratex)
        return method.card.equalised and has_patches and not self.same_captures


@dataclass(frozen=True)
class Predicted:
    """Predictions of a study."""

    records: pd.DataFrame
    """The table of predictions, with conditions, cells and observations in the order given."""
    failed: list[str]
    """One line for each cell that failed, with the file of its traceback."""
    left_out: list[str]
    """One line for each method and condition of which it left out cells that it does not suit."""


@dataclass(frozen=True)
class Task:
    """A cell, and the methods that are to decode it."""

    condition: Condition
    """Setting of the channel."""
    cell: Any
    """One of the condition's cells."""
    methods: tuple[Method, ...]
    """Methods with different labels."""
    marks: Mapping[str, str]
    """`fingerprint` of each method, by its label, on the machine that asks."""

    def __str__(self) -> str:
        cell, name = self.cell, self.condition.name
        if self.condition.called:
            return self.condition.called
        return f"{name + ', ' if name else ''}{cell.pair}, {cell.view_deg:g}°, kappa {cell.kappa}"

    def key(self, method: Method, index: int) -> tuple[Any, ...]:
        """Key of the prediction of one observation, as `key_of` makes it."""
        cell, label = self.cell, method.label
        place = self.condition.name, label, cell.pair, cell.view_deg, cell.kappa, index
        return *place, self.marks[label]

    def without(self, found: Found) -> "Task":
        """The task of the methods alone that lack a prediction."""
        indices = self.condition.indices
        lack = [m for m in self.methods if any(self.key(m, i) not in found for i in indices)]
        return replace(self, methods=tuple(lack))

    @property
    def name(self) -> str:
        """Name that says all that decides the task's predictions."""
        return f"{self} {short_digest(*(self.marks[method.label] for method in self.methods))}"


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
        InputError: no cell could be decoded, no method suits, the backend cannot be had, or another
            process writes the folder.
    """
    ordered = tuple(sorted(methods, key=lambda method: method.card.equalised))
    tasks = []
    for condition in conditions:
        marks = {m.label: fingerprint(condition, m) for m in methods}
        tasks += [Task(condition, cell, ordered, marks) for cell in condition.cells]
    part = file.with_name(f"{file.name}.part")
    traces = file.parent / "failed"
    with locked(file.parent):
        found = {key_of(line): line for line in stored_predictions(file)}
        lacking = [lack for task in tasks if (lack := task.without(found)).methods]
        missing = {task.name: task for task in lacking}
        results, failures = resume(decode_cell, missing, part, backend, "decode")
        shutil.rmtree(traces, ignore_errors=True)
        left_out: dict[tuple[str, str], list[str]] = {}
        for name, (lines, unsuited) in results.items():
            found |= {key_of(line): line for line in lines}
            for label, reason in unsuited.items():
                left_out.setdefault((missing[name].condition.name, label), []).append(reason)
        failed = {}
        for name, failure in failures.items():
            task = str(missing[name])
            trace = traces / f"{task.replace('/', '_')}.txt"
            write_bytes(trace, failure.trace.encode())
            failed[task] = f"{failure.reason} ({trace})"
        whole = [task for task in tasks if str(task) not in failed]
        keys = [
            task.key(method, index)
            for task in whole
            for index in task.condition.indices
            for method in task.methods
        ]
        predictions = [found[key] for key in keys if key in found]
        if whole or not tasks:
            write_sealed(file, predictions)
        part.unlink()
    if failed and not whole:
        raise InputError(next(iter(failed.values())))
    cells = Counter(task.condition.name for task in tasks)
    notes = [
        f"{name}{': ' * bool(name)}{label}: left out of {len(why)} of {cells[name]}, {why[-1]}"
        for (name, label), why in left_out.items()
    ]
    if tasks and not predictions:
        raise InputError(f"no method suits what is decoded; {'; '.join(notes)}")
    reports = sorted(f"{task}: {why}" for task, why in failed.items())
    return Predicted(to_records(predictions), reports, notes)


def predict_all(
    conditions: Sequence[Condition], methods: Sequence[Method], file: Path, backend: Backend
) -> pd.DataFrame:
    """`predict` for studies that need every cell.

    Raises:
        InputError: a cell failed, or a method does not suit one; the others are stored.
    """
    predicted = predict(conditions, methods, file, backend)
    if predicted.left_out:
        raise InputError(predicted.left_out[0])
    if predicted.failed:
        total = sum(len(condition.cells) for condition in conditions)
        raise InputError(f"{len(predicted.failed)} of {total} cells failed: {predicted.failed[0]}")
    return predicted.records


def decode_cell(task: Task) -> Decoded:
    """Make a cell's observations and decode each with the methods, in this process.

    Returns:
        a prediction for each observation and method that suits, and why others do not.

    Raises:
        InputError: an observation is no good, or this machine is not like the one that asks.
    """
    condition, lines, unsuited = task.condition, [], {}
    for method in task.methods:
        if fingerprint(condition, method) != task.marks[method.label]:
            raise InputError(
                f"worker {platform.node()} has other code, packages, checkpoints or pictures at "
                "these paths than this machine; install the same there and restart its worker"
            )
    decoders = {method: method.build() for method in task.methods}
    place = {name: getattr(task.cell, name) for name in CELL}  # a capture need not know its own
    one_thread()
    for index in condition.indices:
        for equalised in {condition.equalises(method) for method in decoders}:
            captured = condition.source.observe(task.cell, index, equalised)
            seen = captured.rectified()
            for method, decoder in decoders.items():
                if condition.equalises(method) != equalised:
                    continue
                try:
                    if method.card.frames == "window" and seen.is_pair:
                        raise UnsuitedError("it reads windows of film")
                    line = to_line(method.label, index, decoder.decode(seen), captured)
                except UnsuitedError as error:
                    unsuited[method.label] = str(error)
                    continue
                line |= place | {"condition": condition.name, "mark": task.marks[method.label]}
                lines.append(line)
    return lines, unsuited


def what_decides(condition: Condition) -> object:
    """Give what decides observations beside code, as an object whose text tells it."""
    source = condition.source
    if isinstance(source, Entry):
        return source.content
    files = sorted({cell.pair for cell in condition.cells if cell.pair.endswith(".json")})
    pictures = file_digest(sorted(source.pictures.glob("*")) if source.pictures else [])
    pairs = [get_pair(file) for file in files]
    return source, condition.frames, condition.same_captures, pairs, pictures


def fingerprint(condition: Condition, method: Method) -> str:
    """First digits of the SHA-256 of all that decides a method's predictions of a cell.

    Processors are left out, and so are the names of the method and of the condition.
    """
    source, module = condition.source, method.card.target.partition(":")[0]
    options: list[Any] = [option for option in method.options if option[0] != "checkpoint"]
    options += ["by pairs"] * method.by_pairs
    return short_digest(
        repr((STORED_VERSION, what_decides(condition), method.name, options)),
        code_digest(type(source).__module__, module),
        outside_digest(module),
        checkpoint_digest(method, source.layout),
        *package_versions(),
    )


def checkpoint_digest(method: Method, *layouts: Layout) -> str:
    """SHA-256 of the files of a method's checkpoints for some layouts; empty where it has none."""
    folders = dict.fromkeys(method.checkpoint(layout) for layout in layouts)
    names = ("config.json", "decoder.pt")
    files = [folder / name for folder in folders if folder is not None for name in names]
    return file_digest(files) if files else ""


def recorded_conditions(
    entries: Sequence[Entry], only: Collection[int] | None = None
) -> list[Condition]:
    """Make a condition of each entry of a manifest.

    Args:
        entries: all entries, in order.
        only: numbers of the entries that are decoded; None for all.
    """
    return [
        Condition("", entry, (entry,), 1, start=index, called=f"entry {index}")
        for index, entry in enumerate(entries)
        if only is None or index in only
    ]
