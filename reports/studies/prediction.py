"""Predict the paper's 144 printed numbers: python -m reports.studies.prediction (about 12 minutes).

`reports.lab.calibrate` fitted the channel to the naive and two-step columns on training pictures;
here all four columns are predicted on test pictures. OORC and hidden ratex are held out. Writes
docs/prediction.md and its picture.
"""

import json
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import tyro
from scipy.stats import spearmanr

from data_gen.frame_pair import Source
from data_gen.pairs import FITTED_FILE, PAIRS
from link.errors import at_least, run_cli
from link.images import write_bytes
from link.layout import make_layout
from reports.engine.predict import Method, decode_cells, paper_cells
from reports.engine.protocols import PROTOCOLS, apply
from reports.render.tables import paper_tables, replace_block
from reports.score.metrics import Row, provenance, read_metrics, score, write_metrics
from reports.score.paper import METHODS, paper_accuracy

matplotlib.use("Agg")
import matplotlib.pyplot as plt

FITTED = ("naive", "two_step")
PAGE = Path("docs/prediction.md")
CANDOUR = (
    "Three choices were made after a first look at all four columns, and so are not blind: the "
    "backlights run near full brightness (`pwm_duty` 0.95; at 0.8 bands cost OORC several points), "
    "drift is at least 0.01 (0.005 had been allowed), and where the two columns do not tell, the "
    "nominal value is kept. The threshold of 2.5 was found by scanning the fitted columns. Jitter "
    "and noise are hardly told by these columns at all."
)


@dataclass(frozen=True)
class PredictionConfig:
    """The paper's 36 cells under `--protocol paper`, then briefly under every other protocol."""

    frames: int = 75
    """Frame pairs a cell under the paper's protocol: 15 pictures, 5 messages each."""
    train_frames: int = 40
    """Frame pairs a cell on the training pictures, to tell what the pictures do; 0 for none."""
    variant_frames: int = 15
    """Frame pairs a cell under the other protocols; 0 leaves them out."""
    seed: int = 0
    jobs: int = os.cpu_count() or 1
    out: Path = PAGE
    work: Path = Path("runs/prediction")


def printed(row: Row) -> float:
    """The paper's accuracy in per cent."""
    value = paper_accuracy(row.pair, row.view_deg or 0.0, row.kappa, row.method)
    assert value is not None
    return 100 * value


def predicted(row: Row) -> float:
    """Ours in per cent."""
    return 100 * (row.accuracy or 0.0)


def error(rows: Sequence[Row]) -> float:
    """Mean absolute difference from the paper, points."""
    return float(np.mean([abs(predicted(row) - printed(row)) for row in rows]))


def by_method(rows: Sequence[Row]) -> dict[str, list[Row]]:
    """Rows of each method, in the paper's order."""
    return {method: [row for row in rows if row.method == method] for method in METHODS}


def rankings(rows: Sequence[Row]) -> tuple[int, int, int]:
    """Of the cells: how many; OORC first in ours (ties count); the same method first as printed."""
    cells: dict[Any, list[Row]] = {}
    for row in rows:
        cells.setdefault((row.pair, row.view_deg, row.kappa), []).append(row)
    oorc_first = same_first = 0
    for group in cells.values():
        best = max(predicted(row) for row in group)
        first = {row.method for row in group if predicted(row) == best}
        oorc_first += "oorc" in first
        same_first += max(group, key=printed).method in first
    return len(cells), oorc_first, same_first


def summary(rows: Sequence[Row]) -> str:
    """Per method: error, bias, means, rank correlation over the cells."""
    lines = [
        "| method | | mean absolute error, points | our mean % | paper's mean % "
        "| rank correlation over 36 cells |",
        "|---|---|---:|---:|---:|---:|",
    ]
    for method, mine in by_method(rows).items():
        ours, theirs = [predicted(row) for row in mine], [printed(row) for row in mine]
        lines.append(
            f"| {method} | {'fitted' if method in FITTED else 'held out'} | {error(mine):.2f} "
            f"| {np.mean(ours):.2f} | {np.mean(theirs):.2f} "
            f"| {spearmanr(ours, theirs).statistic:.2f} |"
        )
    ours, theirs = [predicted(row) for row in rows], [printed(row) for row in rows]
    lines.append(
        f"| all 144 | | {error(rows):.2f} | {np.mean(ours):.2f} | {np.mean(theirs):.2f} "
        f"| {spearmanr(ours, theirs).statistic:.2f} |"
    )
    return "\n".join(lines)


def by_condition(rows: Sequence[Row]) -> str:
    """Means over the nine pairs, ours / the paper's."""
    conditions = list(dict.fromkeys((row.view_deg, row.kappa) for row in rows))
    titles = " | ".join(f"{view:g}°, κ {kappa}" for view, kappa in conditions)
    lines = [f"| method | {titles} |", f"|---|{'---:|' * len(conditions)}"]
    for method, mine in by_method(rows).items():
        parts = []
        for condition in conditions:
            group = [row for row in mine if (row.view_deg, row.kappa) == condition]
            ours, theirs = (np.mean([f(row) for row in group]) for f in (predicted, printed))
            parts.append(f"{ours:.1f} / {theirs:.1f}")
        lines.append(f"| {method} | {' | '.join(parts)} |")
    return "\n".join(lines)


def reason(row: Row) -> str:
    """Why a cell may disagree, as far as we can tell."""
    over = predicted(row) > printed(row)
    if row.method == "hidden_ratex" and row.pair.startswith("sony"):
        return (
            "the paper's hidden-ratex cells of the RX100 lie 10 to 20 points below the other "
            "cameras', its OORC cells do not; hidden ratex was filmed apart (no patches), perhaps "
            "with a camera that adapted its tone curve between frames, which the channel lacks"
        )
    if row.method == "hidden_ratex":
        return (
            "the offset that drift leaves decides at a constant threshold; hidden ratex was filmed "
            "apart from the captures whose drift was fitted"
        )
    if row.method == "naive" and row.view_deg == 45.0:
        return (
            "the captured κ lies near the threshold, so the cell turns on the slope of the CDTF at "
            f"45°, which must have been {'smaller' if over else 'larger'} than ours; how the panel "
            "behaves with angle is assumed within bounds"
        )
    if row.method == "naive":
        return (
            "bright blocks lie on the shoulder of our tone curve, where κ = 3 is captured as less "
            "than 2.5 levels; the real camera's curve or exposure must have been gentler"
            if not over
            else "the real CDTF must have been flatter, or its exposure drifted more"
        )
    if row.method == "two_step" and not over:
        return (
            "after g, κ = 3 is half a level above the threshold of 2.5; the printed cell needs a "
            "threshold nearer to κ / 2 (see protocol constant)"
            if row.kappa == 3
            else "the fitted drift of this camera and view is too large for this display"
        )
    return "the fitted drift or noise of this camera and view is too small for this display"


def worst(rows: Sequence[Row], count: int) -> str:
    """The cells that disagree most, each with a reason."""
    ranked = sorted(rows, key=lambda row: -abs(predicted(row) - printed(row)))[:count]
    lines = ["| cell | method | ours % | paper % | reason |", "|---|---|---:|---:|---|"]
    lines += [
        f"| {row.pair}, {row.view_deg:g}°, κ {row.kappa} | {row.method} | {predicted(row):.1f} "
        f"| {printed(row):.1f} | {reason(row)} |"
        for row in ranked
    ]
    return "\n".join(lines)


def variants(config: PredictionConfig) -> str:
    """Errors under every protocol, on fewer frames."""
    lines = [
        f"| protocol | {' | '.join(METHODS)} | what it does |",
        f"|---|{'---:|' * len(METHODS)}---|",
    ]
    fitted = {}
    for name, protocol in PROTOCOLS.items():
        rows = run(config, name, config.variant_frames, config.work / name)
        errors = {method: error(mine) for method, mine in by_method(rows).items()}
        fitted[name] = float(np.mean([errors[method] for method in FITTED]))
        parts = [f"{value:.1f}" for value in errors.values()]
        lines.append(f"| {name} | {' | '.join(parts)} | {protocol.description} |")
    best = min(fitted, key=lambda name: fitted[name])
    lines += [
        "",
        f"The naive and two-step columns support `{best}` most: {fitted[best]:.1f} points.",
    ]
    return "\n".join(lines)


def run(
    config: PredictionConfig, protocol: str, frames: int, folder: Path, split: str = "test"
) -> list[Row]:
    """The 36 cells with the paper's four methods under a protocol."""
    methods = apply(protocol, [Method(name) for name in METHODS])
    ratex_kappa = PROTOCOLS[protocol].ratex_kappa
    source = Source(make_layout(), split, config.seed, ratex_kappa=ratex_kappa)
    cells = paper_cells(tuple(PAIRS))
    return score(decode_cells(source, cells, frames, methods, folder, config.jobs))


def plot(path: Path, rows: Sequence[Row]) -> None:
    """Predicted against printed, one panel a method."""
    figure, panels = plt.subplots(1, 4, figsize=(13, 3.6), sharex=True, sharey=True)
    for panel, (method, mine) in zip(panels, by_method(rows).items(), strict=True):
        panel.plot([45, 100], [45, 100], color="0.7", linewidth=1)
        for view, marker in ((0.0, "o"), (45.0, "^")):
            for kappa, colour in ((5, "C0"), (3, "C1")):
                group = [r for r in mine if (r.view_deg, r.kappa) == (view, kappa)]
                panel.plot(
                    [printed(r) for r in group],
                    [predicted(r) for r in group],
                    marker,
                    color=colour,
                    label=f"{view:g}°, κ {kappa}",
                    alpha=0.8,
                )
        kind = "fitted" if method in FITTED else "held out"
        panel.set_title(f"{method} ({kind}), error {error(mine):.1f}")
        panel.set_xlabel("printed in the paper, %")
    panels[0].set_ylabel("predicted (simulated), %")
    panels[0].legend()
    figure.tight_layout()
    figure.savefig(path, dpi=110)
    plt.close(figure)


def fitted_table() -> str:
    """The fitted parameters beside their bounds."""
    fit = json.loads(FITTED_FILE.read_text())
    bounds = fit["bounds"]
    names = ("drift", "jitter_px", "noise_scale")
    heads = " | ".join(f"{n} [{bounds[n][0]:g} to {bounds[n][1]:g}]" for n in names)
    lines = [f"| camera, view | {heads} |", "|---|---:|---:|---:|"]
    for camera, views in fit["fitted"].items():
        for view, values in views.items():
            lines.append(f"| {camera}, {view}° | {' | '.join(f'{values[n]:g}' for n in names)} |")
    lines += ["", "| display | fall-off exponent of green | bounds |", "|---|---:|---|"]
    for display, (_, green, _) in fit["falloff"].items():
        low, high = bounds["falloff"][display]
        lines.append(f"| {display} | {green:g} | {low:g} to {high:g} |")
    misfits = ", ".join(f"{k} {v:g}" for k, v in fit["meta"]["misfit_points"].items())
    learned = json.dumps(fit["meta"]["learned_thresholds"])
    return "\n".join(
        [
            *lines,
            "",
            "Mean misfit of the two fitted columns, points, by how the threshold is set (each with "
            f"its own best nuisances): {misfits}. Thresholds learned once, gray levels: {learned}.",
        ]
    )


def readme_block(metrics: Path) -> str:
    """What README says of the prediction, from stored metrics."""
    rows, _ = read_metrics(metrics)
    means = "Means over the nine pairs, ours (simulated) / the paper's, per cent:"
    return "\n\n".join([summary(rows), means, by_condition(rows)])


def main() -> None:
    """Predict, compare, write."""
    config = tyro.cli(PredictionConfig)
    at_least(1, frames=config.frames, jobs=config.jobs)
    at_least(0, variant_frames=config.variant_frames, train_frames=config.train_frames)
    at_least(0, seed=config.seed)
    rows = run(config, "paper", config.frames, config.work / "main")
    stored = config.out.with_suffix(".json")
    write_metrics(stored, rows, provenance(config.seed, simulated=True))
    count, oorc_first, same_first = rankings(rows)
    picture = config.out.with_suffix(".png")
    config.out.parent.mkdir(parents=True, exist_ok=True)
    plot(picture, rows)
    parts = [
        "# The paper's Tables 1–4, predicted",
        "Generated by `python -m reports.studies.prediction`, which "
        f"`python -m reports.lab.calibrate` calls last. "
        f"Simulated: 36 cells × {config.frames} frame pairs ("
        f"{sum(r.bits for r in rows if r.method == 'oorc')} bits a method), test pictures and test "
        f"channel draws, seed {config.seed}. *naive* and *two_step* were fitted to (on training "
        "pictures and draws); *oorc* and *hidden_ratex* were held out. Protocol `paper`: "
        f"{PROTOCOLS['paper'].description}.",
        summary(rows),
        f"OORC is first in {oorc_first} of {count} cells (the paper prints it first, or tied, in "
        f"{sum(_paper_oorc_first(r.pair, r.view_deg, r.kappa) for r in rows if r.method == 'oorc')}"
        f"). The method printed first is first in ours in {same_first}.",
        f"![predicted against printed]({picture.name})",
        "Means over the nine pairs, ours / the paper's, per cent:",
        by_condition(rows),
        "## What was fitted",
        fitted_table(),
        CANDOUR,
        "## The cells that disagree most",
        worst(rows, 16),
    ]
    if config.train_frames:
        train = run(config, "paper", config.train_frames, config.work / "train", "train")
        parts += [
            "## Other pictures",
            "The paper's fifteen pictures are unknown. The same prediction on the twenty training "
            f"pictures ({config.train_frames} frame pairs a cell), on which naive and two-step "
            "were fitted:",
            summary(train),
        ]
    if config.variant_frames:
        parts += [
            "## What the paper leaves open",
            "Mean absolute error, points, under each way to read the paper, all at the fitted "
            f"nuisances ({config.variant_frames} frame pairs a cell):",
            variants(config),
        ]
    parts += ["## All 144 cells", paper_tables(rows)]
    write_bytes(config.out, ("\n\n".join(parts) + "\n").encode())
    if config.out == PAGE:
        replace_block(Path("README.md"), "prediction", readme_block(stored))
    print(parts[2], parts[3], sep="\n\n")


def _paper_oorc_first(pair: str, view: float | None, kappa: int | None) -> bool:
    values = {m: paper_accuracy(pair, view or 0.0, kappa, m) or 0.0 for m in METHODS}
    return values["oorc"] >= max(values.values())


if __name__ == "__main__":
    run_cli(main)
