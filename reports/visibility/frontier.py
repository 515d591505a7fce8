"""Right bits beside visibility, by grid and modulation: python -m reports.visibility.frontier.

Every layout is filmed on held-out pictures and channel draws of all nine camera-display pairs, at 0
and 45 degrees. Beside the bits that each method reads stands the contrast over threshold of what
the display shows. Writes the blocks and the chart of docs/hidden.md; takes some minutes, and goes
on where it was cut off.
"""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import tyro
from matplotlib.figure import Figure

from data_gen.frame_pair import Cell, Source
from data_gen.pairs import PAIRS
from link.errors import ParameterError, at_least, each_once, read_flags, run_cli
from link.layout import Layout, make_layout
from link.presets import Preset
from link.visibility.line_code import CODE_OF_MODULATION
from models import shipped_checkpoint
from reports.engine.methods import methods_for
from reports.engine.predict import Condition, predict_all
from reports.render.charts import marker_of, new_panels, save_png, set_ticks
from reports.render.tables import Table, percent, share_interval, write_blocks
from reports.score.accuracy import pool, score
from reports.visibility.presets import seen_of

VIEWS = (0.0, 45.0)
"""Angles of observation, in degrees from the display's normal."""


@dataclass(frozen=True)
class FrontierSetting:
    """A layout and a kappa that are compared."""

    rows: int
    cols: int
    modulation: str
    kappa: int
    """Number of gray levels by which blocks change."""
    ratex: bool = False
    """Whether five ratex patches calibrate, as in the paper, in place of pilots."""

    @property
    def layout(self) -> Layout:
        """The layout that the display shows."""
        pilots = 0 if self.ratex else "auto"
        return make_layout(self.rows, self.cols, modulation=self.modulation, pilots=pilots)

    @property
    def name(self) -> str:
        """What tables call the setting."""
        known = "ratex" if self.ratex else "pilots"
        return f"{self.rows} × {self.cols} {self.modulation}, {known}, κ {self.kappa}"

    def condition(self, frames: int, seed: int) -> Condition:
        """Held-out frame pairs of all nine pairs at both views."""
        cells = tuple(Cell(pair, view, self.kappa) for view in VIEWS for pair in PAIRS)
        return Condition(self.name, Source(self.layout, "test", seed), cells, frames)

    def seen(self, states_hz: int, seed: int) -> float:
        """Contrast over threshold of one block, at 60 refreshes a second, over random messages."""
        line_code = CODE_OF_MODULATION[self.modulation]
        preset = Preset(self.layout, self.kappa, states_hz, line_code)
        return seen_of(preset, seed, 20.0).mean


PAPER = FrontierSetting(8, 8, "on_off", 3, ratex=True)
"""The paper's setting, at 15 states a second, against which rates are compared."""
PAPER_HZ = 15
SETTINGS = (
    PAPER,
    FrontierSetting(8, 8, "on_off", 1, ratex=True),
    FrontierSetting(8, 8, "antipodal", 1),
    FrontierSetting(24, 32, "on_off", 3),
    FrontierSetting(24, 32, "antipodal", 1),
    FrontierSetting(24, 32, "antipodal", 3),
    FrontierSetting(48, 64, "antipodal", 1),
    FrontierSetting(48, 64, "antipodal", 3),
    FrontierSetting(96, 128, "antipodal", 3),
)
"""Settings that are compared."""
RATES_HZ = (15, 30, 60)
"""States a second for which visibility and bits a second are given."""


@dataclass(frozen=True)
class FrontierConfig:
    """Compare layouts by what is seen and what is read."""

    methods: tuple[str, ...] = ("naive", "oorc", "learned")
    """Methods that read; the rates are those of ``learned``, which must be among them."""
    frames: int = 4
    """Number of frame pairs in each cell."""
    observed: int = 0
    """Number of them that the observer ``ideal_change`` reads, too, which takes seconds for each;
    0 leaves it out."""
    seed: int = 0
    """Seed of messages, channel draws and of the messages whose visibility is computed."""
    jobs: int = os.cpu_count() or 1
    """Number of processes."""
    work: Path = Path("runs/frontier")
    """Folder of the predictions, from which a run that was cut off goes on."""
    page: Path = Path("docs/hidden.md")
    """Page whose blocks are written; the chart is put beside it."""


def main() -> None:
    """Decode, tabulate, draw, write."""
    config = read_flags(lambda: tyro.cli(FrontierConfig))
    each_once(methods=config.methods)
    at_least(1, frames=config.frames, jobs=config.jobs)
    at_least(0, observed=config.observed)
    if "learned" not in config.methods:
        raise ParameterError("methods", "name learned, whose scores give the rates")
    readers = [(config.methods, config.frames), (("ideal_change",), config.observed)]
    parts = []
    for setting in SETTINGS:
        for names, frames in readers[: 2 if config.observed else 1]:
            methods = methods_for(names, shipped_checkpoint(setting.layout))
            condition = setting.condition(frames, config.seed)
            parts.append(predict_all([condition], methods, config.work, config.jobs))
    records = pd.concat(parts, ignore_index=True)
    rates = rate_rows(records, config.seed)
    how = f"Seed {config.seed}, {config.frames} frame pairs for each pair and view, simulated."
    if config.observed:
        how += f" ideal_change reads {config.observed} of them."
    texts = {
        "hidden_bits": f"{how}\n\n{bits_table(records).markdown()}",
        "hidden_rates": f"{how}\n\n{rate_table(rates).markdown()}",
    }
    for text in texts.values():
        print(text, end="\n\n")
    write_blocks(config.page, texts)
    chart = config.page.with_name("hidden_frontier.png")
    save_png(frontier_figure(rates), chart)
    print(f"written: {config.page}, {chart}")


def bits_table(records: pd.DataFrame) -> Table:
    """Tabulate right bits by setting, view and method, over all nine pairs."""
    scores = pool(score(records), ("condition", "view_deg", "method"))
    rows: list[list[str]] = []
    for setting in SETTINGS:
        of_setting = scores[scores["condition"] == setting.name]
        rows += [
            [
                row.condition,
                f"{row.view_deg:g}°",
                row.method,
                percent(row.accuracy),
                share_interval(row.low, row.high),
                f"{row.errors:,} of {row.bits:,}",
            ]
            for row in of_setting.sort_values("view_deg", kind="stable").itertuples()
        ]
    heads = ["setting", "view", "method", "right bits %", "95 % interval", "wrong"]
    return Table(heads, rows, left=3)


def information(scores: np.ndarray, bits: np.ndarray) -> float:
    """Mutual information of a bit and its calibrated score, in bits: 1 minus the cross-entropy.

    Args:
        scores: natural log-likelihood ratios.
        bits: true bits, 0 or 1, of the same shape.

    >>> round(information(np.array([2.0, -2.0]), np.array([1, 0])), 3)
    0.817
    """
    against = np.where(bits > 0, -scores, scores)
    return 1 - float(np.logaddexp(0, against).mean() / np.log(2))


@dataclass(frozen=True)
class RateRow:
    """What a setting shows and carries at one rate, over both views."""

    setting: FrontierSetting
    states_hz: int
    seen: float
    """Contrast over threshold of one block; above 1 it is seen."""
    bits_hz: float
    """Bits of information a second in the scores of ``learned``, before coding."""


def rate_rows(records: pd.DataFrame, seed: int) -> list[RateRow]:
    """Work out visibility and rate of every setting at every rate.

    What frame pairs carry is that of the simulated stills; a camera that films 60 states a second
    gathers less light for each than one that films 15, which is left out.
    """
    rows = []
    for setting in SETTINGS:
        of_setting = records[
            (records["condition"] == setting.name) & (records["method"] == "learned")
        ]
        scores, bits = (np.concatenate(list(of_setting[name])) for name in ("scores", "bits"))
        a_pair = setting.layout.n_bits * max(0.0, information(scores, bits))
        rows += [
            RateRow(setting, rate, setting.seen(rate, seed), a_pair * rate / 2) for rate in RATES_HZ
        ]
    return rows


def rate_table(rows: Sequence[RateRow]) -> Table:
    """Tabulate contrast over threshold and bits a second, and both against the paper's setting."""
    paper = next(row for row in rows if (row.setting, row.states_hz) == (PAPER, PAPER_HZ))
    cells = [
        [
            row.setting.name,
            str(row.states_hz),
            f"{row.seen:.2f}",
            f"{row.bits_hz:,.0f}",
            f"{row.seen / paper.seen:.2f}",
            f"{row.bits_hz / paper.bits_hz:.1f}",
        ]
        for row in rows
    ]
    heads = ["setting", "states/s", "contrast over threshold", "bits/s",
             "× seen of the paper's", "× bits/s of the paper's"]  # fmt: skip
    return Table(heads, cells)


def frontier_figure(rows: Sequence[RateRow]) -> Figure:
    """Draw bits a second over contrast over threshold, a line for each setting."""
    figure, (panel,) = new_panels(legend=3.6, size=(9.6, 4.2), title=True)
    for number, setting in enumerate(SETTINGS):
        own = [row for row in rows if row.setting == setting]
        label = setting.name
        panel.plot(
            [row.seen for row in own],
            [row.bits_hz for row in own],
            marker=marker_of(label),
            color=f"C{number}",
            label=label,
        )
    panel.axvline(1.0, linestyle=":", color="0.5")
    panel.set_xscale("log")
    panel.set_yscale("log")
    set_ticks(panel.xaxis, [0.3, 1, 3, 10], ["0.3", "1", "3", "10"])
    set_ticks(panel.yaxis, [1e2, 1e3, 1e4, 1e5], ["100", "1 k", "10 k", "100 k"])
    panel.set_xlabel("contrast over threshold of one block; above 1 it is seen")
    panel.set_title("bits a second, before coding", loc="left")
    panel.grid(axis="both")
    panel.legend(loc="center left", bbox_to_anchor=(1.02, 0.5))
    return figure


if __name__ == "__main__":
    run_cli(main)
