"""The benchmark: fixed conditions on which decoders are compared, whoever wrote them.

`evaluate.py --benchmark` decodes them, prints one table, and writes benchmark.json, which names
each decoder with the digests of its code and checkpoint, and what was simulated by the digest of
its first frames. Results of the same version, with the same digests of frames, can be compared.
"""

import hashlib
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from data_gen.frame_pair import Source
from data_gen.pairs import PAIRS, TODAY
from link.layout import make_layout
from link.presets import PRESETS
from receiver.sight import StageTimes
from reports.engine.backends import run_tasks
from reports.engine.checked import write_json
from reports.engine.digest import code_digest
from reports.engine.methods import Method
from reports.engine.predict import (
    Condition,
    Predicted,
    checkpoint_digest,
    paper_cells,
)
from reports.engine.provenance import provenance
from reports.evaluation.comparison import Bench, film_conditions
from reports.render.tables import Table, TableCell, percent, share_interval
from reports.score.accuracy import pool, score

VERSION = 2
"""Version of the benchmark: raised where a condition or what is simulated changes."""
SEED = 0
"""Seed of every random draw."""
RESULT = "benchmark.json"
"""Name of the file, in the folder of the run, with the result."""
FILMS = ("paper:30", "robust:30", "hidden:30", "hidden:60", "robust:30:moving", "hidden:60:moving")
"""Films: preset, frames a second, and what carries the message."""
FILMED = ("phone-laptop", "phone-oled", "webcam-laptop")
"""Pairs by which films are taken."""


def benchmark_conditions() -> list[Condition]:
    """List the conditions: stills of both kinds of pairs, and films of still and moving pictures.

    All decoders see the same captures.

    >>> [condition.name for condition in benchmark_conditions()][:3]
    ['stills', 'stills, weak', 'stills, today']
    """
    paper, hidden = Source(make_layout(), seed=SEED), Source(PRESETS["hidden"].layout, seed=SEED)
    some = tuple(PAIRS)[::4] + FILMED
    stills = [
        Condition("stills", paper, paper_cells(tuple(PAIRS), kappas=(3,)), 3),
        Condition("stills, weak", paper, paper_cells(tuple(PAIRS), (45.0,), (1,)), 4),
        Condition("stills, today", paper, paper_cells(tuple(TODAY), kappas=(3,)), 3),
        Condition("stills, hidden", hidden, paper_cells(some, kappas=(1,)), 2),
    ]
    films = film_conditions(FILMS, FILMED, (0.0, 45.0), 1, SEED)
    return [replace(condition, same_captures=True) for condition in (*stills, *films)]


def frames_digest(condition: Condition) -> str:
    """First digits of the SHA-256 of the frames of a condition's first observation."""
    seen = condition.source.observe(condition.cells[0], 0, False).rectified()
    digest = hashlib.sha256()
    for frame in seen.frames:
        digest.update(np.ascontiguousarray(frame).tobytes())
    return digest.hexdigest()[:16]


def run_benchmark(bench: Bench) -> list[str]:
    """Decode all conditions, print the table, and write the result; a run that was cut off goes on.

    Args:
        bench: decoders, each of which is left out of the conditions that do not suit it, folder
            and backend.

    Returns:
        a line for each cell that failed.
    """
    conditions = benchmark_conditions()

    def pooled(records: pd.DataFrame) -> pd.DataFrame:
        return pool(score(records), by=("condition", "method"))

    def tabulate(records: pd.DataFrame) -> list[Table]:
        return [benchmark_table(pooled(records), [condition.name for condition in conditions])]

    def write_result(predicted: Predicted, clock: StageTimes) -> None:
        with clock.stage("digests"):
            digests = {
                conditions[outcome.index].name: outcome.result or "failed"
                for outcome in run_tasks(
                    frames_digest, conditions, bench.backend, "digest of frames"
                )
            }
        pools = pooled(predicted.records)
        result = {
            "benchmark": VERSION,
            "made_by": provenance(SEED, simulated=True),
            "conditions": {
                each.name: {
                    "frames": digests[each.name],
                    "observations": each.frames * len(each.cells),
                }
                for each in conditions
            },
            "decoders": [decoder_result(method, conditions, pools) for method in bench.methods],
            "failed_cells": predicted.failed,
        }
        write_json(bench.folder.path / RESULT, result)

    return bench.compare(conditions, SEED, tabulate, beside=write_result)


def benchmark_table(pooled: pd.DataFrame, names: Sequence[str]) -> Table:
    """Tabulate wrong bits in per cent, with 95 % intervals: a row a decoder, a column a condition.

    Args:
        pooled: accuracies by condition and method.
        names: names of the conditions.
    """
    cells = {
        (row.condition, row.method): TableCell(
            percent(1 - row.accuracy), share_interval(1 - row.high, 1 - row.low)
        )
        for row in pooled.itertuples()
    }
    rows = [
        [method, *(cells.get((name, method), TableCell("–")) for name in names)]
        for method in dict.fromkeys(pooled["method"])
    ]
    return Table(("decoder", *names), rows, f"Benchmark {VERSION}: wrong bits in per cent:")


def decoder_result(
    method: Method, conditions: Sequence[Condition], pooled: pd.DataFrame
) -> dict[str, Any]:
    """Name a decoder and its digests, and count its wrong bits in each condition it decoded."""
    rows = pooled[pooled["method"] == method.label]
    layouts = dict.fromkeys(condition.source.layout for condition in conditions)
    return {
        "decoder": method.label,
        "class": method.card.target,
        "options": {name: str(value) for name, value in method.options},
        "code": code_digest(method.card.target.partition(":")[0]),
        "checkpoint": checkpoint_digest(method, *layouts),
        "wrong": {
            row.condition: {
                "errors": int(row.errors),
                "bits": int(row.bits),
                "share": round(1 - row.accuracy, 6),
                "interval": [round(1 - row.high, 6), round(1 - row.low, 6)],
            }
            for row in rows.itertuples()
        },
    }
