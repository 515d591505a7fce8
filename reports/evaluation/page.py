"""The page of a run: report.html, one file that needs nothing else, the same bytes every time."""

import base64
from collections.abc import Callable
from pathlib import Path
from typing import Any

from markupsafe import Markup
from matplotlib.figure import Figure

from link.errors import InputError
from link.files.lock import locked
from link.images import write_bytes
from link.outside import inside, is_file, read_bounded
from models import DECODERS
from reports.ablation.page import ablation_figure, ablation_tables
from reports.ablation.results import Ablation, compare_rows
from reports.evaluation import exhibits
from reports.evaluation.html import render
from reports.evaluation.settings import OF_SIMULATION
from reports.evaluation.versus import MAIN
from reports.render.charts import look_of, to_svg
from reports.render.reliability import SHOWN_BITS, calibration_table, reliability_figure
from reports.render.tables import (
    FAR,
    Table,
    cell_tables,
    information_table,
    summary_table,
    tables_by,
)
from reports.run import CSV, MAX_PICTURE_BYTES, REPORT, Run, RunFolder
from reports.score.accuracy import pool
from reports.score.paired import REFERENCES, Paired, against_references
from reports.score.reliability import Curves, reliability_curves

SECTIONS = {
    "summary": "Summary",
    "ablation": "Ablation",
    "films": "Films",
    "by": "By angle, picture and pair",
    "paper": "The paper’s tables",
    "reliability": "Reliability",
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
    curves, kind = llr_curves(run), "simulated" if run.simulated else "recorded"
    parts = run.by_condition
    content: dict[str, Any] = {
        "ablation": ablation_of(run) if run.about.settings.get("ablation") else None,
        "films": run.films,
        "by": {name: mine for name, part in parts.items() if (mine := tables_by(part.records))},
        "paper": paper_tables(run),
        "reliability": curves,
        "pictures": run.stories,
    }
    return render(
        "report.html.j2",
        {method: look_of(method).colour for method in (*DECODERS, *run.methods)},
        run=run,
        kind=kind,
        sections={name: title for name, title in SECTIONS.items() if content.get(name, True)},
        summaries=[
            summary_table(part.scores, name, ranked_comparisons(part))
            for name, part in parts.items()
        ],
        references=REFERENCES,
        settings=shown_settings(run),
        far=FAR,
        csv=CSV,
        reliability_bits=SHOWN_BITS,
        most_films=MOST_FILMS,
        chart=chart,
        exhibits=exhibits,
        ablation_figure=ablation_figure,
        ablation_tables=ablation_tables,
        information_table=information_table,
        reliability_figure=reliability_figure,
        calibration_table=calibration_table,
        picture=lambda file: picture_data(run.folder, file),
        **content,
    )


def chart(title: str, draw: Callable[..., Figure], *shown: object) -> Markup:
    """Draw a chart for the template, which says where it stands.

    Args:
        title: read out in place of the picture.
        draw: function that draws.
        *shown: its arguments.
    """
    return to_svg(draw(*shown), title)


def ranked_comparisons(run: Run) -> dict[str, Paired | None]:
    """Compare every method with its reference; the best first, those without known bits last."""
    against = against_references(run.records, run.seed)
    accuracy = pool(run.scores).set_index("method")["accuracy"]
    best_first = accuracy.sort_values(ascending=False, kind="stable")
    return {str(method): against[str(method)] for method in best_first.index}


def ablation_of(run: Run) -> Ablation:
    """Compare the rows of an ablation on the frame pairs whose bits are known."""
    return Ablation(compare_rows(run.records[run.records["known"] > 0], run.seed))


def shown_settings(run: Run) -> dict[str, object]:
    """Settings that decided the numbers of a run, but for the checkpoints."""
    left_out = ("checkpoints", *(OF_SIMULATION if run.from_folder else ()))
    return {name: value for name, value in run.about.settings.items() if name not in left_out}


def paper_tables(run: Run) -> list[Table]:
    """Tables of the cells that the paper has."""
    in_paper = run.scores.groupby(["kappa", "view_deg"], dropna=False)["paper"].transform("count")
    return cell_tables(run.scores[in_paper > 0])


def llr_curves(run: Run) -> Curves:
    """Bins of confidence of the methods whose scores are log-likelihood ratios."""
    named = run.records.assign(condition=run.records["condition"].replace("", MAIN))
    return reliability_curves(named, [name for name, card in DECODERS.items() if card.llr])


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
