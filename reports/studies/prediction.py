"""Predict the paper's 144 printed numbers: python -m reports.studies.prediction (about 12 minutes).

`reports.lab.calibrate` fitted the channel to the paper's columns of naive and two-step, on training
pictures. Here all four columns are predicted, on test pictures. The columns of OORC and of hidden
ratex are held out: nothing was fitted to them. The results go to docs/prediction.json and .png, and
into the marked blocks of docs/prediction.md, whose other text is written by hand.
"""

import json
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import tyro
from matplotlib.figure import Figure
from scipy.stats import spearmanr

from data_gen.frame_pair import Source
from data_gen.pairs import FITTED_FILE, PAIRS
from link.cli import read_flags, run_cli
from link.errors import at_least
from link.files.lock import locked
from link.layout import make_layout
from reports.engine.backends import Backend
from reports.engine.methods import Method
from reports.engine.predict import Condition, paper_cells, predict_all
from reports.engine.protocols import PROTOCOLS, apply_protocol
from reports.engine.provenance import provenance
from reports.engine.records import CELL
from reports.render.charts import MUTED, colour_of, in_style, new_panels, save_png
from reports.render.tables import Table, cell_tables, write_blocks
from reports.score.accuracy import read_scores, score, write_scores
from reports.score.paper import METHODS

FITTED = ("naive", "two_step")
"""Methods to whose printed columns the channel was fitted; those of the others are held out."""
PAGE = Path("docs/prediction.md")
"""Page whose marked blocks hold the prediction that the repository states."""
WORST = 16
"""Number of cells that the table of the largest differences lists."""


@dataclass(frozen=True)
class PredictionConfig:
    """Predict the paper's 36 cells as its protocol has it, then briefly under every other one."""

    frames: int = 75
    """Number of frame pairs in each cell under the paper's protocol: 15 pictures, 5 messages
    each."""
    train_frames: int = 40
    """Number of frame pairs in each cell on the training pictures, which tells what the pictures
    do; 0 for none."""
    variant_frames: int = 15
    """Number of frame pairs in each cell under the other protocols; 0 leaves these out."""
    seed: int = 0
    """Seed of messages, poses and noise."""
    jobs: int = os.cpu_count() or 1
    """Number of processes."""
    out: Path = PAGE
    """Page whose marked blocks are replaced; the numbers and the picture are written beside it."""
    work: Path = Path("runs/prediction")
    """Folder of the predictions, from which a command that was cut off goes on."""


def decode_printed(
    config: PredictionConfig, protocol: str, frames: int, split: str = "test"
) -> pd.DataFrame:
    """Decode the paper's 36 cells by its four methods.

    Args:
        config: seed, processes and folder of the predictions.
        protocol: a key of `PROTOCOLS`.
        frames: number of frame pairs in each cell.
        split: "train" or "test" pictures.

    Returns:
        a score table.
    """
    methods = apply_protocol(protocol, [Method(name) for name in METHODS])
    ratex_kappa = PROTOCOLS[protocol].ratex_kappa
    source = Source(make_layout(), split, config.seed, ratex_kappa=ratex_kappa)
    condition = Condition(protocol, source, paper_cells(tuple(PAIRS)), frames)
    return score(predict_all([condition], methods, config.work, Backend(config.jobs)))


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


def protocol_text(config: PredictionConfig) -> str:
    """Decode under every protocol on few frame pairs, and state the errors of each."""
    errors = {}
    for name in PROTOCOLS:
        compared = compare_with_paper(decode_printed(config, name, config.variant_frames))
        errors[name] = {
            str(method): mean_error(mine) for method, mine in compared.groupby("method", sort=False)
        }
    rows = [
        [name, PROTOCOLS[name].description, *(f"{mine[method]:.1f}" for method in METHODS)]
        for name, mine in errors.items()
    ]
    fitted = {name: float(np.mean([mine[m] for m in FITTED])) for name, mine in errors.items()}
    best = min(fitted, key=lambda name: fitted[name])
    return "\n\n".join(
        [
            "Mean absolute error, points, under each way to read the paper, all at the fitted "
            f"nuisances ({config.variant_frames} frame pairs a cell):",
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


def prediction_blocks(stored: Path) -> dict[str, str]:
    """Render what docs/prediction.md shows of the stored numbers, by the marker of the block."""
    scores, meta = read_scores(stored)
    compared = compare_with_paper(scores)
    oorc, ranks = compared[compared["method"] == "oorc"], rank_methods(compared)
    return {
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


def main() -> None:
    """Predict, compare, write the numbers, the picture and the page's blocks."""
    config = read_flags(lambda: tyro.cli(PredictionConfig))
    at_least(1, frames=config.frames, jobs=config.jobs)
    at_least(0, variant_frames=config.variant_frames, train_frames=config.train_frames)
    at_least(0, seed=config.seed)
    with locked(config.work):
        _run(config)


def _run(config: PredictionConfig) -> None:
    """Predict, compare, write, while no other process writes the folder."""
    scores = decode_printed(config, "paper", config.frames)
    stored = config.out.with_suffix(".json")
    write_scores(stored, scores, provenance(config.seed, simulated=True))
    save_png(prediction_figure(compare_with_paper(scores)), config.out.with_suffix(".png"))
    blocks = prediction_blocks(stored)
    print(blocks["prediction_errors"], blocks["prediction_order"], sep="\n\n")
    if config.train_frames:
        train = compare_with_paper(decode_printed(config, "paper", config.train_frames, "train"))
        blocks["prediction_pictures"] = (
            "The same prediction on the twenty training pictures "
            f"({config.train_frames} frame pairs a cell), on which naive and two-step were "
            f"fitted:\n\n{error_table(train).markdown()}"
        )
    if config.variant_frames:
        blocks["prediction_protocols"] = protocol_text(config)
    write_blocks(config.out, blocks)


if __name__ == "__main__":
    run_cli(main)
