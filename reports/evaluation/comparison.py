"""A run of evaluate.py: decode, score, then sweeps, pictures, responses, cost, and the report."""

import contextlib
import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter
from typing import Any

from data_gen.frame_pair import Cell, Source
from link.captures import MANIFEST, read_manifest
from link.errors import InputError
from link.images import write_bytes
from models import DECODERS, make_decoder
from reports.engine.backends import Backend
from reports.engine.predict import Method, decode_captures, decode_each, digest_files
from reports.engine.scores import CONFIG, write_scores
from reports.evaluation import cost, response
from reports.evaluation.stories import save, tell, tell_captures
from reports.render.annotated import show
from reports.render.page import write_report
from reports.run import finish
from reports.score.findings import REFERENCES, leaders_of
from reports.score.metrics import provenance, score
from reports.studies.sweeps import Place, decode_sweeps


@dataclass(frozen=True)
class Amount:
    """How much goes into a report beside the predictions."""

    strips: int = 3
    failures: int = 8
    response_cells: int = 6
    response_frames: int = 3
    cost_rounds: int = 30


USUAL, QUICK = Amount(), Amount(2, 6, 2, 1, 8)


@dataclass(frozen=True)
class Task:
    """What is compared, and where it goes."""

    out: Path
    methods: list[Method]
    settings: bytes
    """All that decides the result, as the text of config.json."""
    seed: int
    html: bool
    """Write report.html, and what it shows beside the predictions."""


@dataclass
class Clock:
    """Seconds by what took them."""

    seconds: dict[str, float] = field(default_factory=dict)

    @contextlib.contextmanager
    def time(self, name: str) -> Iterator[None]:
        """Add what the block takes."""
        start = perf_counter()
        yield
        self.seconds[name] = self.seconds.get(name, 0.0) + perf_counter() - start


def run_captures(task: Task, captures: Path, pictures: Path | None) -> None:
    """Decode and score a folder of captures; ``pictures``: folder for annotated ones."""
    clock = Clock()
    with clock.time("decoding"):
        predictions, notes = decode_captures(captures, task.methods, task.out)
    print(*notes, sep="\n")
    simulated = all(bool(entry.get("simulated")) for entry in read_manifest(captures))
    write_bytes(task.out / CONFIG, task.settings)
    meta = provenance(task.seed, simulated)
    kind = "simulated captures" if simulated else "real captures"
    write_scores(task.out, predictions, meta, f"All cells ({kind})", False)
    if task.html:
        finish_captures(task.out, captures, predictions, clock)
        digest = digest_files([captures / MANIFEST])[:16]
        about = {**json.loads(task.settings), "captures": f"manifest {digest}"}
        print(f"written: {close(task.out, meta, about, clock, notes)}")
    if pictures is not None:
        show(captures, task.methods, pictures)


def run_simulated(
    task: Task,
    source: Source,
    cells: Sequence[Cell],
    frames: int,
    sweeps: Sequence[str],
    quick: bool,
    backend: Backend,
) -> None:
    """Decode and score simulated captures, and the sweeps beside them.

    Args:
        task: methods and folder.
        source: of the main comparison.
        cells: of the main comparison.
        frames: frame pairs a cell.
        sweeps: names of `sweeps.SWEEPS`.
        quick: less of everything but the main comparison.
        backend: where cells are decoded.

    Raises:
        InputError: cells failed; all others are decoded and reported.
    """
    clock = Clock()
    with clock.time("decoding"):
        predictions, failed = decode_each(source, cells, frames, task.methods, task.out, backend)
    write_bytes(task.out / CONFIG, task.settings)
    meta = {**provenance(task.seed, True), "failed_cells": failed}
    kind = "held-out pictures" if source.pictures is None else "your own pictures"
    write_scores(task.out, predictions, meta, f"All cells (simulated captures, {kind})", True)
    if task.html:
        failed += finish_simulated(
            task, source, cells, predictions, sweeps, frames, quick, backend, clock
        )
        print(f"written: {close(task.out, meta, json.loads(task.settings), clock, failed)}")
    for line in failed:
        print(f"failed: {line}", file=sys.stderr)
    if failed:
        raise InputError(
            f"{len(failed)} cells failed, as listed above; the others are in {task.out}, and the "
            "same command tries the failed ones again"
        )


def finish_simulated(
    task: Task,
    source: Source,
    cells: Sequence[Cell],
    predictions: list[dict[str, Any]],
    sweeps: Sequence[str],
    frames: int,
    quick: bool,
    backend: Backend,
    clock: Clock,
) -> list[str]:
    """Decode the sweeps and write all that the report shows; a line for each cell that failed.

    Arguments as of `run_simulated`, and the main comparison's ``predictions``; sweeps have two
    thirds of its ``frames``. ``clock`` gets the times.
    """
    folder, methods = task.out, task.methods
    amount = QUICK if quick else USUAL
    with clock.time("sweeps"):
        swept = max(1, 2 * frames // 3)
        places, failed = decode_sweeps(source, sweeps, methods, swept, quick, folder, backend)
    places.insert(0, Place("", None, source, predictions))
    with clock.time("pictures"):
        best = leaders_of(predictions, [score(place.predictions) for place in places[1:]])
        names = {method.label or method.name: method for method in methods}
        shown = [m for m in REFERENCES[:1] if m in names and m not in best] + best[::-1]
        hidden = [n for n in shown if n in names and _is_hidden(names[n])]
        tell(places, shown, best, hidden, folder, amount.strips, amount.failures)
    with clock.time("responses"):
        if source.layout.ratex:
            where = response_cells(cells)[: amount.response_cells]
            response.measure(source, where, amount.response_frames, methods, folder)
    with clock.time("cost"):
        cost.measure(source, cells[0], amount.cost_rounds, methods, folder)
    return failed


def response_cells(cells: Sequence[Cell]) -> list[Cell]:
    """Cells of the largest kappa: for each of some unlike pairs every view."""
    kappa = max(cell.kappa for cell in cells)
    mine = [cell for cell in cells if cell.kappa == kappa]
    pairs = list(dict.fromkeys(cell.pair for cell in mine))
    wanted = pairs[:: max(1, len(pairs) // 3 + 1)] if len(pairs) > 3 else pairs
    return [cell for pair in wanted for cell in mine if cell.pair == pair]


def finish_captures(
    folder: Path, captures: Path, predictions: list[dict[str, Any]], clock: Clock
) -> None:
    """Write the pictures of a folder of captures."""
    with clock.time("pictures"):
        decoded = list(dict.fromkeys(line["method"] for line in predictions))
        best = leaders_of(predictions, [])[:1] or decoded[-1:]
        shown = [m for m in REFERENCES if m in decoded and m not in best][:1] + best
        tell_captures(captures, predictions, shown, folder, USUAL.strips, USUAL.failures)


def close(
    folder: Path,
    meta: Mapping[str, Any],
    settings: Mapping[str, Any],
    clock: Clock,
    notes: Sequence[str],
) -> Path:
    """Mark the run as finished and write its report."""
    if not (folder / "stories.json").is_file():
        save(folder, [])
    finish(folder, meta, settings, clock.seconds, notes)
    return write_report(folder)


def _is_hidden(method: Method) -> bool:
    if method.name not in DECODERS:
        return False
    return not make_decoder(method.name, **dict(method.options)).needs_ratex
