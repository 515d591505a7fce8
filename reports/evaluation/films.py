"""The comparison of methods on simulated films, as a receiver finds, follows and times them."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from link.errors import at_least
from reports.engine.backends import Backend
from reports.engine.methods import Method, suited_methods, suited_to_films
from reports.engine.predict import Condition, Predicted, paper_cells, predict
from reports.engine.provenance import provenance
from reports.evaluation.evidence import Stopwatch
from reports.films import FilmSource, film_settings
from reports.render.tables import information_table, summary_table
from reports.run import PREDICTIONS, RunFolder
from reports.score.accuracy import score


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


def predict_suited(
    conditions: Sequence[Condition], methods: Sequence[Method], file: Path, backend: Backend
) -> tuple[Predicted, list[str]]:
    """Decode each condition, of films or frame pairs, with the methods that suit it.

    Args:
        conditions: conditions with different names.
        methods: methods with different labels.
        file: takes the predictions.
        backend: where cells are decoded.

    Returns:
        what was decoded, and a line for each method that was left out of a condition; the lines are
        printed, too.
    """
    suited, notes = [], []
    for condition in conditions:
        source = condition.source
        choose_suited = suited_to_films if isinstance(source, FilmSource) else suited_methods
        mine, left_out = choose_suited(methods, source.layout)
        without = tuple(method.label for method in methods if method not in mine)
        suited.append(replace(condition, without=without))
        notes += [f"{condition.name}: {line}" for line in left_out]
    print(*notes, sep="\n", end="\n" * bool(notes))
    return predict(suited, methods, file, backend), notes


def evaluate_films(
    conditions: Sequence[Condition],
    methods: Sequence[Method],
    folder: RunFolder,
    seed: int,
    backend: Backend,
) -> list[str]:
    """Decode, score, print and write.

    Args:
        conditions: a condition for each kind of film.
        methods: methods; those that do not suit are left out, and a line says so.
        folder: folder of the run; its settings are written already.
        seed: seed that is written beside the results.
        backend: where cells are decoded.

    Returns:
        a line for each cell that failed.
    """
    clock = Stopwatch()
    with clock.time("decoding"):
        predicted, notes = predict_suited(conditions, methods, folder.path / PREDICTIONS, backend)
    records, tables = predicted.records, []
    for condition in conditions:
        mine = records[records["condition"] == condition.name]
        title = f"{condition.name}: windows of films (simulated, held-out pictures)"
        scores = score(mine).assign(paper=float("nan"))  # the paper decoded no films
        tables.append(summary_table(scores, title).markdown())
        tables.append(information_table(mine).markdown())
    meta = {**provenance(seed, simulated=True), "failed_cells": predicted.failed}
    folder.write_comparison(records, meta, "\n\n".join(tables))
    folder.finish(meta, clock.seconds, [*notes, *predicted.failed])
    print(*tables, f"written: {folder.path}/predictions.jsonl, metrics.json, tables.md", sep="\n\n")
    return predicted.failed
