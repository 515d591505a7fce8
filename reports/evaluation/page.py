"""The page of a run: report.html, one file that needs nothing else, the same bytes every time."""

import base64
from collections.abc import Sequence
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
from reports.evaluation.findings import (
    REFERENCES,
    WELL_READ,
    Standing,
    SweptAccuracy,
    standings,
    swept_accuracies,
)
from reports.evaluation.glance import find_glance
from reports.evaluation.html import render
from reports.evaluation.settings import OF_SIMULATION
from reports.render.charts import colour_of, to_svg
from reports.render.reliability import SHOWN_BITS, calibration_table, reliability_figure
from reports.render.tables import (
    FAR,
    Table,
    cell_tables,
    summary_table,
    tables_by,
)
from reports.run import (
    CSV,
    MAX_PICTURE_BYTES,
    REPORT,
    Cost,
    Response,
    Run,
    RunFolder,
    SweepCurve,
)
from reports.score.paired import MIN_FRAMES
from reports.score.reliability import ALL, Curves, reliability_curves

SECTIONS = {
    "glance": "At a glance",
    "summary": "Summary",
    "ablation": "Ablation",
    "films": "Films",
    "by": "By angle, picture and pair",
    "paper": "The paper’s tables",
    "sweeps": "Sweeps",
    "reliability": "Reliability",
    "cdtf": "CDTF",
    "pictures": "Pictures",
    "failures": "Worst failures",
    "cost": "Cost",
    "elsewhere": "Measured elsewhere",
    "provenance": "Provenance",
}
"""Titles of the report's sections by anchor, in the order of the page; those that a run has nothing
for are left out."""
MOST_FILMS = 6
"""Largest number of films that the page draws one by one."""
MAIN, SWEPT = "main comparison", "all sweeps"
"""Names of the two conditions whose reliability the page shows."""


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
    ranked, swept = standings(run), swept_accuracies(run)
    known = any(standing.accuracy is not None for standing in ranked)
    curves = llr_curves(run)
    paper, sweeps = paper_tables(run), sweep_charts(run, swept)
    kinds = {story.kind for story in run.stories}
    cost = exhibits.cost_table(run.cost) if run.cost else None
    by, kind = tables_by(run.records), "simulated" if run.simulated else "recorded"
    filled: dict[str, object] = {
        "ablation": run.about.settings.get("ablation"),
        "films": run.films,
        "by": by,
        "paper": paper,
        "sweeps": sweeps,
        "reliability": curves,
        "cdtf": run.responses,
        "pictures": "strip" in kinds,
        "failures": "failure" in kinds,
        "cost": cost and cost.rows,
    }
    return render(
        "report.html.j2",
        {method: colour_of(method) for method in (*DECODERS, *run.methods)},
        run=run,
        sections={name: title for name, title in SECTIONS.items() if filled.get(name, True)},
        ranked=ranked,
        glance=find_glance(run, ranked, swept) if known else None,
        summary=summary_table(run.scores, against={s.method: s.against for s in ranked}),
        summary_chart=summary_chart(ranked) if known else None,
        references=REFERENCES,
        settings=shown_settings(run),
        well_read=WELL_READ,
        min_frames=MIN_FRAMES,
        far=FAR,
        ablation=ablation_exhibits(run) if run.about.settings.get("ablation") else None,
        films=film_exhibits(run.films) if run.films else None,
        paper=paper,
        sweeps=sweeps,
        by=by,
        csv=CSV,
        reliability=calibration_table(curves, kind) if curves else None,
        reliability_charts=reliability_charts(curves),
        reliability_bits=SHOWN_BITS,
        responses=response_charts(run.responses),
        response_errors=exhibits.response_table(run.responses),
        cost=cost,
        cost_chart=cost_chart(run.cost) if run.cost else None,
        story_table=exhibits.story_table,
        picture=lambda file: picture_data(run.folder, file),
    )


def summary_chart(ranked: Sequence[Standing]) -> Markup:
    """The accuracy of each method as dots."""
    figure = exhibits.summary_figure(ranked)
    return to_svg(figure, "Accuracy of each method with its interval")


def ablation_exhibits(run: Run) -> tuple[Markup, list[Table]]:
    """Draw and tabulate what each part of the decoder is worth."""
    known = run.records[run.records["known"] > 0]
    ablation = Ablation(*compare_rows(known, run.seed))
    kind = "simulated captures" if run.simulated else "recorded captures"
    figure = to_svg(ablation_figure(ablation, kind), "What each part is worth")
    return figure, ablation_tables(ablation)


def film_exhibits(films: FilmEvidence) -> dict[str, Any]:
    """Tables and charts of films, by the names that the template has for them."""
    names = list(dict.fromkeys(entry.film for entry in films.times))[:MOST_FILMS]
    found = [film for film in films.seen if film.places]
    times = [(name, [entry for entry in films.times if entry.film == name]) for name in names]
    return {
        "told": exhibits.told_table(films.told),
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
    run: Run, swept: Sequence[SweptAccuracy]
) -> list[tuple[SweepCurve, Markup, Table, list[SweptAccuracy]]]:
    """For each sweep with a known bit what was swept, its chart, its table, and its accuracies."""
    least = min([entry.accuracy for entry in swept], default=1.0)
    bottom = max(0.5, least) if least > 0.45 else 0.3
    found = []
    for curve in run.sweeps:
        mine = [entry for entry in swept if entry.curve is curve]
        if mine:
            figure = exhibits.sweep_figure(curve, mine, bottom)
            svg = to_svg(figure, f"Accuracy by {curve.axis}")
            found.append((curve, svg, exhibits.sweep_table(curve, mine), mine))
    return found


def llr_curves(run: Run) -> Curves | None:
    """Bins of confidence of the methods whose scores are log-likelihood ratios, if there are any.

    A condition in which one of them has no known bit is left out.
    """
    swept = run.swept.assign(condition=SWEPT)
    records = pd.concat([run.records.assign(condition=MAIN), swept], ignore_index=True)
    records = records[records["known"] > 0]
    present = set(records["method"])
    methods = [m for m in run.methods if m in present and m in DECODERS and DECODERS[m].llr]
    whole = [
        name
        for name, part in records.groupby("condition", sort=False)
        if methods and set(methods) <= set(part["method"])
    ]
    if not whole:
        return None
    return reliability_curves(records[records["condition"].isin(whole)], methods)


def reliability_charts(curves: Curves | None) -> list[Markup]:
    """A diagram of each condition, unless it would show one dot of each method alone."""
    if curves is None:
        return []
    names = [name for name in next(iter(curves.values())) if name != ALL]
    return [
        to_svg(reliability_figure(curves, [name]), f"Reliability, {name}")
        for name in names
        if any(
            sum(b.count >= SHOWN_BITS for b in by_condition[name]) > 1
            for by_condition in curves.values()
        )
    ]


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


def cost_chart(cost: Cost) -> Markup | None:
    """The time of each method as dots; None where no method was timed."""
    timed = exhibits.cost_table(cost).rows
    return to_svg(exhibits.cost_figure(cost), "Time of each method") if timed else None


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
