"""What the simulation predicts of the paper's 144 printed numbers; about 12 minutes.

`lab calibrate` fitted the channel to the paper's columns of naive and two-step, on training
pictures. Here all four columns are predicted, on test pictures. The columns of OORC and of hidden
ratex are held out: nothing was fitted to them.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from scipy.stats import spearmanr

from data_gen.frame_pair import Source
from data_gen.pairs import FITTED_FILE, PAIRS
from lab.study import Picture, Results, Study, StudyFlags, Workshop
from link.errors import at_least
from link.layout import make_layout
from reports.engine.methods import Method
from reports.engine.predict import Condition, paper_cells
from reports.engine.protocols import PROTOCOLS, apply_protocol
from reports.engine.records import CELL
from reports.render.charts import MUTED, colour_of, in_style, new_panels
from reports.render.tables import Table, cell_tables
from reports.score.accuracy import ScoreRow, score, to_score_rows, to_scores
from reports.score.paper import METHODS

FITTED = ("naive", "two_step")
"""Methods to whose printed columns the channel was fitted; those of the others are held out."""
WORST = 16
"""Number of cells that the table of the largest differences lists."""


@dataclass(frozen=True)
class PredictionFlags(StudyFlags):
    """Predict the paper's 36 cells as its protocol has it, then briefly under every other one."""

    frames: int = 75
    """Number of frame pairs in each cell under the paper's protocol: 15 pictures, 5 messages
    each."""
    train_frames: int = 40
    """Number of frame pairs in each cell on the training pictures, which tells what the pictures
    do; 0 for none."""
    variant_frames: int = 15
    """Number of frame pairs in each cell under the other protocols; 0 leaves these out."""


@dataclass(frozen=True)
class PredictionContent:
    """Accuracies in the paper's cells."""

    rows: list[ScoreRow]
    """Under the paper's protocol, on test pictures."""
    train: list[ScoreRow] = field(default_factory=list)
    """Under the paper's protocol, on training pictures; empty where these were left out."""
    protocols: dict[str, list[ScoreRow]] = field(default_factory=dict)
    """On test pictures by the name of the protocol; empty where these were left out."""


def decode_printed(
    workshop: Workshop, seed: int, protocol: str, frames: int, split: str = "test"
) -> list[ScoreRow]:
    """Decode the paper's 36 cells by its four methods.

    Args:
        workshop: where the cells are decoded.
        seed: seed of messages, poses and noise.
        protocol: a key of `PROTOCOLS`.
        frames: number of frame pairs in each cell.
        split: "train" or "test" pictures.

    Returns:
        rows of a score table.
    """
    methods = apply_protocol(protocol, [Method(name) for name in METHODS])
    ratex_kappa = PROTOCOLS[protocol].ratex_kappa
    source = Source(make_layout(), split, seed, ratex_kappa=ratex_kappa)
    condition = Condition(protocol, source, paper_cells(tuple(PAIRS)), frames)
    return to_score_rows(score(workshop.predict([condition], methods)))


def compare_with_paper(scores: pd.DataFrame) -> pd.DataFrame:
    """Set accuracies beside the printed ones.

    Args:
        scores: a score table of cells that the paper has.

    Returns:
        its rows, ordered as the paper orders the methods, and in per cent ``ours`` and ``printed``,
        and their ``difference`` in points, which is positive where ours is higher.
    """
    order = {name: number for number, name in enumerate(METHODS)}
    table = scores.sort_values("method", key=lambda names: names.map(order), kind="stable")
    table = table.reset_index(drop=True)
    table["ours"], table["printed"] = 100 * table["accuracy"], 100 * table["paper"]
    table["difference"] = table["ours"] - table["printed"]
    return table


def mean_error(compared: pd.DataFrame) -> float:
    """Mean absolute difference from the paper, points."""
    return float(compared["difference"].abs().mean())


@dataclass(frozen=True)
class Rankings:
    """How often the order of the methods in a cell is the paper's."""

    cells: int
    """Number of cells."""
    oorc_first: int
    """Number of cells in which no method is better than OORC in ours."""
    oorc_first_printed: int
    """Number of cells in which the paper prints no method better than OORC."""
    same_first: int
    """Number of cells in which no method is better in ours than the one that is printed best."""


def rank_methods(compared: pd.DataFrame) -> Rankings:
    """Count in how many cells a method comes first; of methods that tie, each does."""
    cells = [cell.set_index("method") for _, cell in compared.groupby(CELL, sort=False)]
    ours = [set(cell.index[cell["ours"] == cell["ours"].max()]) for cell in cells]
    printed = [cell["printed"] for cell in cells]
    return Rankings(
        cells=len(cells),
        oorc_first=sum("oorc" in first for first in ours),
        oorc_first_printed=sum(values["oorc"] >= values.max() for values in printed),
        same_first=sum(
            values.idxmax() in first for values, first in zip(printed, ours, strict=True)
        ),
    )


def error_table(compared: pd.DataFrame) -> Table:
    """Show each method's error, its means and its rank correlation over the cells."""
    groups = [
        (method, "fitted" if method in FITTED else "held out", mine)
        for method, mine in compared.groupby("method", sort=False)
    ]
    rows = [
        [
            str(name),
            kind,
            f"{mean_error(mine):.2f}",
            f"{mine['ours'].mean():.2f}",
            f"{mine['printed'].mean():.2f}",
            f"{spearmanr(mine['ours'], mine['printed']).statistic:.2f}",
        ]
        for name, kind, mine in [*groups, (f"all {len(compared)}", "", compared)]
    ]
    heads = ["method", "", "mean absolute error, points", "our mean %", "paper's mean %"]
    cells = len(compared) // len(groups)
    return Table([*heads, f"rank correlation over {cells} cells"], rows, left=2)


def mean_table(compared: pd.DataFrame) -> Table:
    """Show means over the pairs for each view and kappa, ours / the paper's."""
    means = compared.groupby(["method", "view_deg", "kappa"], sort=False)[["ours", "printed"]]
    found = means.mean()
    settings = list(dict.fromkeys(zip(compared["view_deg"], compared["kappa"], strict=True)))
    rows = [
        [method]
        + ["{:.1f} / {:.1f}".format(*found.loc[(method, view, kappa)]) for view, kappa in settings]
        for method in compared["method"].unique()
    ]
    return Table(["method", *(f"{view:g}°, κ {kappa}" for view, kappa in settings)], rows)


def worst_table(compared: pd.DataFrame, count: int) -> Table:
    """Show the cells that differ most from the paper, the largest difference first."""
    order = compared["difference"].abs().sort_values(ascending=False, kind="stable").index
    rows = [
        [
            f"{row.pair}, {row.view_deg:g}°, κ {row.kappa}",
            row.method,
            f"{row.ours:.1f}",
            f"{row.printed:.1f}",
            f"{row.difference:+.1f}",
        ]
        for row in compared.loc[order[:count]].itertuples()
    ]
    return Table(["cell", "method", "ours %", "paper %", "difference, points"], rows, left=2)


def protocol_text(protocols: Mapping[str, list[ScoreRow]]) -> str:
    """State the errors of the prediction under each protocol."""
    errors = {}
    for name, stored in protocols.items():
        compared = compare_with_paper(to_scores(stored))
        errors[name] = {
            str(method): mean_error(mine) for method, mine in compared.groupby("method", sort=False)
        }
    frames = next(iter(protocols.values()))[0].frames
    rows = [
        [name, PROTOCOLS[name].description, *(f"{mine[method]:.1f}" for method in METHODS)]
        for name, mine in errors.items()
    ]
    fitted = {name: float(np.mean([mine[m] for m in FITTED])) for name, mine in errors.items()}
    best = min(fitted, key=lambda name: fitted[name])
    return "\n\n".join(
        [
            "Mean absolute error, points, under each way to read the paper, all at the fitted "
            f"nuisances ({frames} frame pairs a cell):",
            Table(["protocol", "what it does", *METHODS], rows, left=2).markdown(),
            f"The mean error of the naive and two-step columns is smallest under `{best}`: "
            f"{fitted[best]:.1f} points.",
        ]
    )


def fit_text() -> str:
    """State what `reports.lab.calibrate` fitted, beside the bounds, from nuisances.json."""
    fit = json.loads(FITTED_FILE.read_text())
    bounds = fit["bounds"]
    names = ("drift", "jitter_px", "noise_scale")
    nuisances = Table(
        ["camera, view", *(f"{n} [{bounds[n][0]:g} to {bounds[n][1]:g}]" for n in names)],
        [
            [f"{camera}, {view}°", *(f"{values[n]:g}" for n in names)]
            for camera, views in fit["fitted"].items()
            for view, values in views.items()
        ],
    )
    falloff = Table(
        ["display", "fall-off exponent of green", "bounds"],
        [
            [display, f"{green:g}", "{:g} to {:g}".format(*bounds["falloff"][display])]
            for display, (_, green, _) in fit["falloff"].items()
        ],
    )
    misfits = ", ".join(f"{k} {v:g}" for k, v in fit["meta"]["misfit_points"].items())
    learned = "; ".join(
        f"{kind}: {', '.join(f'{method} {value:g}' for method, value in values.items())}"
        for kind, values in fit["meta"]["learned_thresholds"].items()
    )
    return "\n\n".join(
        [
            nuisances.markdown(),
            falloff.markdown(),
            "Mean misfit of the two fitted columns, points, by how the threshold is set (each with "
            f"its own best nuisances): {misfits}. Thresholds learned once, in gray levels: "
            f"{learned}.",
        ]
    )


@in_style
def prediction_figure(compared: pd.DataFrame) -> Figure:
    """Draw ours against the printed accuracies, a panel for each method."""
    groups = list(compared.groupby("method", sort=False))
    figure, panels = new_panels(len(groups), columns=2, legend=0.1, title=True)
    for panel, (method, mine) in zip(panels, groups, strict=True):
        panel.plot([45, 100], [45, 100], color=MUTED, linewidth=1)
        for view, marker in ((0.0, "o"), (45.0, "^")):
            for kappa, face in ((5, None), (3, "none")):
                some = mine[(mine["view_deg"] == view) & (mine["kappa"] == kappa)]
                panel.plot(
                    some["printed"],
                    some["ours"],
                    marker,
                    color=colour_of(str(method)),
                    markerfacecolor=face,
                    label=f"{view:g}°, κ {kappa}",
                )
        kind = "fitted" if method in FITTED else "held out"
        panel.set_title(f"{method} ({kind}), error {mean_error(mine):.1f}")
        panel.set_xlabel("printed in the paper, %")
        panel.set_ylabel("predicted (simulated), %")
    panels[0].legend()
    return figure


def prediction_blocks(results: Mapping[str, Results[PredictionContent]]) -> dict[str, str]:
    """Show the prediction, by the name of the page's block."""
    meta, content = results["prediction"].meta, results["prediction"].content
    scores = to_scores(content.rows)
    compared = compare_with_paper(scores)
    oorc, ranks = compared[compared["method"] == "oorc"], rank_methods(compared)
    blocks = {
        "prediction_sample": (
            f"Simulated: {len(oorc)} cells × {oorc['frames'].iloc[0]} frame pairs "
            f"({oorc['bits'].sum()} bits a method), test pictures and test channel draws, "
            f"seed {meta['seed']}. Protocol `paper`: {PROTOCOLS['paper'].description}."
        ),
        "prediction_errors": error_table(compared).markdown(),
        "prediction_order": (
            f"OORC is first in {ranks.oorc_first} of {ranks.cells} cells (the paper prints it "
            f"first, or tied, in {ranks.oorc_first_printed}). The method printed first is first in "
            f"ours in {ranks.same_first}."
        ),
        "prediction_means": mean_table(compared).markdown(),
        "prediction_fit": fit_text(),
        "prediction_worst": worst_table(compared, WORST).markdown(),
        "prediction_cells": "\n\n".join(table.markdown() for table in cell_tables(scores)),
    }
    if content.train:
        blocks["prediction_pictures"] = (
            "The same prediction on the twenty training pictures "
            f"({content.train[0].frames} frame pairs a cell), on which naive and two-step were "
            f"fitted:\n\n{error_table(compare_with_paper(to_scores(content.train))).markdown()}"
        )
    if content.protocols:
        blocks["prediction_protocols"] = protocol_text(content.protocols)
    return blocks


def prediction_pictures(results: Mapping[str, Results[PredictionContent]]) -> dict[str, Picture]:
    """Draw ours against the printed accuracies."""
    compared = compare_with_paper(to_scores(results["prediction"].content.rows))
    return {"prediction.png": prediction_figure(compared)}


def check_prediction(flags: PredictionFlags) -> None:
    """Raise an `InputError` that names the first flag with a wrong value."""
    at_least(1, frames=flags.frames)
    at_least(0, variant_frames=flags.variant_frames, train_frames=flags.train_frames)


def measure_prediction(flags: PredictionFlags, workshop: Workshop) -> PredictionContent:
    """Predict under the paper's protocol, on training pictures, and under every other protocol."""
    content = PredictionContent(decode_printed(workshop, flags.seed, "paper", flags.frames))
    if flags.train_frames:
        content.train[:] = decode_printed(
            workshop, flags.seed, "paper", flags.train_frames, "train"
        )
    if flags.variant_frames:
        for name in PROTOCOLS:
            few = decode_printed(workshop, flags.seed, name, flags.variant_frames)
            content.protocols[name] = few
    return content


STUDY = Study(
    name="prediction",
    flags=PredictionFlags,
    content=PredictionContent,
    measure=measure_prediction,
    blocks=prediction_blocks,
    page=Path("docs/prediction.md"),
    pictures=prediction_pictures,
    check=check_prediction,
)
"""The study that `python -m lab prediction` runs."""
