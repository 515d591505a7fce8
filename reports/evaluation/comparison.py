"""The comparison of methods: on simulated frame pairs, on simulated films, on a folder of captures.

Each decodes, scores, prints and writes in the same way (`Bench.compare`), and adds what its report
shows beside the predictions.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from link.captures import MANIFEST, read_manifest
from link.errors import at_least
from receiver.sight import StageTimes
from reports.captured.door import FILMS
from reports.captured.evidence import film_evidence
from reports.engine.backends import Backend
from reports.engine.checked import write_json
from reports.engine.digest import file_digest
from reports.engine.methods import Method
from reports.engine.predict import (
    Condition,
    Predicted,
    paper_cells,
    predict,
    recorded_conditions,
)
from reports.engine.provenance import provenance
from reports.evaluation.stories import simulated_pictures, worst_stories
from reports.films import FilmSource, film_settings
from reports.render.tables import Table, cell_tables, information_table, summary_table
from reports.run import PREDICTIONS, STORIES, RunFolder
from reports.score.accuracy import score

Beside = Callable[[Predicted, StageTimes], None]
"""Writes more beside what was decoded."""


@dataclass(frozen=True)
class Bench:
    """Methods that are compared, and where: what all kinds of comparisons share."""

    methods: Sequence[Method]
    """Methods; one that does not suit is left out, and a line says so."""
    folder: RunFolder
    """Folder of the run; its settings are written before anything is compared."""
    backend: Backend
    """Processes or cluster that decode cells."""
    html: bool = True
    """Whether to measure and draw what report.html shows beside the predictions."""

    def compare(
        self,
        conditions: Sequence[Condition],
        seed: int,
        tabulate: Callable[[pd.DataFrame], Sequence[Table]],
        *,
        simulated: bool = True,
        beside: Beside = lambda predicted, clock: None,
        notes: Sequence[str] = (),
        **stated: str,
    ) -> list[str]:
        """Decode, score, print and write.

        Args:
            conditions: what is decoded.
            seed: seed that is written beside the results.
            tabulate: makes the tables of the predictions.
            simulated: whether all captures are simulated.
            beside: writes more, once the predictions and their scores are written.
            notes: what a reader must know of the captures.
            **stated: settings that run.json says otherwise than config.json.

        Returns:
            a line for each cell that failed.
        """
        clock, folder = StageTimes(), self.folder
        with clock.stage("decoding"):
            predicted = predict(conditions, self.methods, folder.path / PREDICTIONS, self.backend)
        notes = [*notes, *predicted.left_out]
        tables = [table.markdown() for table in tabulate(predicted.records)]
        meta = provenance(seed, simulated) | {"failed_cells": predicted.failed}
        folder.write_comparison(predicted.records, meta, "\n\n".join(tables))
        print(*notes, sep="\n", end="\n" * bool(notes))
        written = f"written: {folder.path}/predictions.jsonl, metrics.json, tables.md"
        print(*tables, written, sep="\n\n")
        beside(predicted, clock)
        folder.finish(meta, clock.spent, [*notes, *predicted.failed], **stated)
        return predicted.failed


def evaluate_simulated(bench: Bench, comparison: Condition) -> list[str]:
    """Compare methods on simulated frame pairs, with `Bench.compare`.

    Args:
        bench: methods, folder and backend.
        comparison: cells that are compared.
    """
    source = comparison.source

    def tabulate(records: pd.DataFrame) -> list[Table]:
        scores = score(records)
        kind = "held-out pictures" if source.pictures is None else "your own pictures"
        title = f"All cells (simulated captures, {kind})"
        return [*cell_tables(scores), summary_table(scores, title)]

    def beside(predicted: Predicted, clock: StageTimes) -> None:
        if bench.html:
            with clock.stage("pictures"):
                simulated_pictures(bench.folder, comparison, predicted.records, bench.methods)

    return bench.compare([comparison], source.seed, tabulate, beside=beside)


def film_conditions(
    names: Sequence[str], pairs: Sequence[str], views: Sequence[float], frames: int, seed: int
) -> list[Condition]:
    """Make a condition of each kind of film.

    Args:
        names: what is shown and filmed, "PRESET" or "PRESET:FPS".
        pairs: camera-display pairs.
        views: angles of observation, degrees.
        frames: number of films of each cell, of which one window is decoded.
        seed: seed of every random draw.

    Raises:
        InputError: a name, pair or view is wrong; the message says which.
    """
    at_least(0, seed=seed)
    conditions = []
    for name in names:
        settings = film_settings(name)
        cells = paper_cells(pairs, views, (settings.kappa,))
        conditions.append(Condition(name, FilmSource(settings, seed), cells, frames))
    return conditions


def film_tables(records: pd.DataFrame) -> list[Table]:
    """Tabulate accuracies and information of each kind of film."""
    tables = []
    for name, mine in records.groupby("condition", sort=False):
        title = f"{name}: windows of films (simulated, held-out pictures)"
        scores = score(mine, in_paper=False)
        tables += [summary_table(scores, title), information_table(mine)]
    return tables


def evaluate_folder(
    bench: Bench, captures: Path, seed: int, notes: Sequence[str] = ()
) -> list[str]:
    """Compare methods on a folder of captures, with `Bench.compare`.

    Args:
        bench: methods, folder and backend.
        captures: folder with a manifest.
        seed: seed of the paired comparisons' resamples.
        notes: what a reader must know of how the captures were recorded.
    """
    entries, folder = read_manifest(captures), bench.folder
    simulated = all(bool(entry.meta.get("simulated")) for entry in entries)

    def tabulate(records: pd.DataFrame) -> list[Table]:
        kind = "simulated captures" if simulated else "recorded captures"
        tables = [summary_table(score(records), f"All cells ({kind})")]
        windows = any(entry.is_window for entry in entries)
        return [*tables, information_table(records)] if windows else tables

    def beside(predicted: Predicted, clock: StageTimes) -> None:
        records = predicted.records
        if any("time_s" in entry.meta for entry in entries):
            with clock.stage("counting"):
                seen = film_evidence(captures, records, folder.path, bench.html)
                write_json(folder.path / FILMS, seen)
        if bench.html:
            with clock.stage("pictures"):
                stories = worst_stories(
                    records, lambda row: entries[row["index"]].load(), folder.path
                )
                write_json(folder.path / STORIES, stories)

    unlike = any(entry.layout.ratex and not entry.meta.get("equalised") for entry in entries)
    if unlike and any(method.label == "hidden_ratex" for method in bench.methods):
        notes = [*notes, "hidden_ratex: these pictures were not equalised for it"]
    return bench.compare(
        recorded_conditions(entries),
        seed,
        tabulate,
        simulated=simulated,
        beside=beside,
        notes=notes,
        captures=f"manifest {file_digest([captures / MANIFEST])[:16]}",
    )
