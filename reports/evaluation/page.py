"""The page of a run: report.html, one file that needs nothing else, the same bytes every time."""

import base64
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd
from markupsafe import Markup

from link.errors import InputError
from link.files.lock import locked
from link.images import write_bytes
from link.outside import inside, is_file, read_bounded
from models import DECODERS
from reports.ablation.page import ablation_figure, ablation_tables
from reports.ablation.results import Ablation, compare_rows
from reports.captured.evidence import FilmEvidence
from reports.evaluation import exhibits
from reports.evaluation.html import render
from reports.evaluation.settings import OF_SIMULATION
from reports.evaluation.sweeps import Sweep, swept_accuracies
from reports.evaluation.versus import MAIN
from reports.render.charts import colour_of, to_svg
from reports.render.reliability import SHOWN_BITS, calibration_table, reliability_figure
from reports.render.tables import (
    FAR,
    Table,
    cell_tables,
    information_table,
    summary_table,
    tables_by,
)
from reports.run import CSV, MAX_PICTURE_BYTES, REPORT, Response, Run, RunFolder
from reports.score.accuracy import pool
from reports.score.paired import REFERENCES, Paired, against_references
from reports.score.reliability import Curves, reliability_curves

SECTIONS = {
    "summary": "Summary",
    "ablation": "Ablation",
    "films": "Films",
    "by": "By angle, picture and pair",
    "paper": "The paper’s tables",
    "sweeps": "Sweeps",
    "reliability": "Reliability",
    "cdtf": "CDTF",
    "pictures": "Worst read",
    "provenance": "Provenance",
}
"""Titles of the report's sections by anchor, in the order of the page; those that a run has nothing
for are left out."""
MOST_FILMS = 6
"""Largest number of films that the page draws one by one."""


def write_report(folder: Path) -> Path:
    """Build report.html from what a run left in its folder.

    Args:
        folder: folder of a finished run.

    Returns:
        the page.

    Raises:
        InputError: the folder holds no finished run, or a damaged one, or another process writes
            it.
    """
    path = folder / REPORT
    page = report_page(RunFolder(folder).read())
    with locked(folder):
        write_bytes(path, page.encode())
    return path


def report_page(run: Run) -> str:
    """Fill the report's template with a run.

    Raises:
        InputError: a picture of a story is missing, or lies outside the run's folder.
    """
    swept = swept_accuracies(run.swept)
    curves, kind = llr_curves(run), "simulated" if run.simulated else "recorded"
    content: dict[str, Any] = {
        "ablation": ablation_exhibits(run) if run.about.settings.get("ablation") else None,
        "films": film_exhibits(run, run.films) if run.films else None,
        "by": breakdowns(run),
        "paper": paper_tables(run),
        "sweeps": sweep_charts(swept),
        "reliability": calibration_table(curves, kind) if curves else None,
        "cdtf": response_charts(run.responses),
        "pictures": run.stories,
    }
    return render(
        "report.html.j2",
        {method: colour_of(method) for method in (*DECODERS, *run.methods)},
        run=run,
        sections={name: title for name, title in SECTIONS.items() if content.get(name, True)},
        summaries=summaries(run),
        references=REFERENCES,
        settings=shown_settings(run),
        far=FAR,
        csv=CSV,
        reliability_chart=to_svg(reliability_figure(curves), "Reliability") if curves else None,
        reliability_bits=SHOWN_BITS,
        response_errors=exhibits.response_table(run.responses),
        picture=lambda file: picture_data(run.folder, file),
        **content,
    )


def summaries(run: Run) -> list[Table]:
    """Tabulate each condition of a run by itself, since conditions have different captures.

    Returns:
        a table for each condition, the best method first; its title is the condition's name.
    """
    tables = []
    for name, records in run.records.groupby("condition", sort=False):
        one = replace(run, records=records, scores=run.scores[run.scores["condition"] == name])
        tables.append(summary_table(one.scores, str(name), ranked_comparisons(one)))
    return tables


def breakdowns(run: Run) -> dict[str, list[Table]]:
    """Break each condition's accuracies down by what varies in it: tables by condition."""
    tables = {
        str(name): tables_by(records)
        for name, records in run.records.groupby("condition", sort=False)
    }
    return {name: mine for name, mine in tables.items() if mine}


def ranked_comparisons(run: Run) -> dict[str, Paired | None]:
    """Compare every method with its reference; the best first, those without known bits last."""
    against = against_references(run.records, run.seed)
    accuracy = pool(run.scores).set_index("method")["accuracy"]
    best_first = accuracy.sort_values(ascending=False, kind="stable")
    return {str(method): against[str(method)] for method in best_first.index}


def ablation_exhibits(run: Run) -> tuple[Markup, list[Table]]:
    """Draw and tabulate what each part of the decoder is worth."""
    known = run.records[run.records["known"] > 0]
    ablation = Ablation(compare_rows(known, run.seed))
    kind = "simulated captures" if run.simulated else "recorded captures"
    figure = to_svg(ablation_figure(ablation, kind), "What each part is worth")
    return figure, ablation_tables(ablation)


def film_exhibits(run: Run, films: FilmEvidence) -> dict[str, Any]:
    """Tables and charts of films, by the names that the template has for them."""
    names = list(dict.fromkeys(entry.film for entry in films.times))[:MOST_FILMS]
    found = [film for film in films.seen if film.places]
    times = [(name, [entry for entry in films.times if entry.film == name]) for name in names]
    return {
        "told": information_table(run.records, films.blocks_s),
        "seen": exhibits.seen_table(films.seen) if found else None,
        "times": [
            (name, to_svg(exhibits.wrong_bits_figure(mine, "seconds"), f"Over time, {name}"))
            for name, mine in times
            if len({entry.value for entry in mine}) > 1
        ],
        "levels": to_svg(
            exhibits.wrong_bits_figure(films.levels, "captured gray level"), "By gray level"
        ),
        "places": [
            (film.film, to_svg(exhibits.places_figure(film), f"Display in {film.film}"))
            for film in found[:MOST_FILMS]
        ],
        "maps": films.maps,
    }


def shown_settings(run: Run) -> dict[str, object]:
    """Settings that decided the numbers of a run, but for the checkpoints."""
    left_out = ("checkpoints", *(OF_SIMULATION if run.from_folder else ()))
    return {name: value for name, value in run.about.settings.items() if name not in left_out}


def paper_tables(run: Run) -> list[Table]:
    """Tables of the cells that the paper has."""
    in_paper = run.scores.groupby(["kappa", "view_deg"], dropna=False)["paper"].transform("count")
    return cell_tables(run.scores[in_paper > 0])


def sweep_charts(
    swept: Sequence[tuple[Sweep, pd.DataFrame]],
) -> list[tuple[Sweep, Markup, Table, pd.DataFrame]]:
    """For each sweep what was swept, its chart, its table, and its accuracies."""
    return [
        (
            sweep,
            to_svg(exhibits.sweep_figure(sweep, mine), f"Accuracy by {sweep.axis}"),
            exhibits.sweep_table(sweep, mine),
            mine,
        )
        for sweep, mine in swept
    ]


def llr_curves(run: Run) -> Curves:
    """Bins of confidence of the methods whose scores are log-likelihood ratios."""
    named = run.records.assign(condition=run.records["condition"].replace("", MAIN))
    return reliability_curves(named, [name for name, card in DECODERS.items() if card.llr])


def response_charts(responses: Sequence[Response]) -> list[tuple[Response, Markup]]:
    """The first frame pair of each cell, and its chart."""
    return [
        (
            response,
            to_svg(
                exhibits.response_figure(response),
                f"CDTF, {response.pair}, {response.view_deg:g}°",
            ),
        )
        for response in responses
        if response.index == responses[0].index
    ]


def picture_data(folder: Path, file: str) -> str:
    """A picture of a run as a data URL.

    Raises:
        InputError: it is missing, too large, or lies outside the run's folder.
    """
    path = inside(folder, file, f"{folder}, stories.json")
    if not is_file(path):
        raise InputError(f"{folder}: {file} is not there; a run shows pictures of its own folder")
    picture = read_bounded(path, MAX_PICTURE_BYTES)
    return f"data:image/jpeg;base64,{base64.b64encode(picture).decode()}"
