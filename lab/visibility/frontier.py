"""Right bits beside visibility, by grid and modulation: python -m reports.visibility.frontier.

Every layout is filmed on held-out pictures and channel draws of all nine camera-display pairs, at 0
and 45 degrees. Beside the bits that each method reads stand the contrast over threshold of what the
display shows, its PSNR, and its JOD where `reports.visibility.second_model` measured it. Writes the
results beside docs/hidden.md, and its blocks and chart; takes some minutes, and goes on where it
was cut off.
"""

import os
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean

import pandas as pd
import tyro

from data_gen.frame_pair import Cell, FramePair, Source
from data_gen.pairs import PAIRS
from export.visibility.line_code import CODE_OF_MODULATION
from lab.visibility.presets import seen_of, setting_name, viewing_of
from link.cli import read_flags, run_cli
from link.embed import with_head_room
from link.errors import ParameterError, at_least, each_once
from link.images.quality import psnr
from link.outside import is_file
from link.presets import Preset
from models import shipped_checkpoint
from reports.engine.backends import Backend
from reports.engine.methods import methods_for
from reports.engine.predict import Condition, predict_all
from reports.engine.provenance import commit, provenance
from reports.render.charts import save_png
from reports.render.tables import write_blocks
from reports.studies.peers.page import read_peers
from reports.visibility.frontier_charts import frontier_figure
from reports.visibility.frontier_reading import read_rows
from reports.visibility.frontier_results import (
    PAPER_SETTING,
    FrontierResults,
    FrontierSetting,
    SettingResult,
    ShownRate,
    read_frontier,
    write_frontier,
)
from reports.visibility.frontier_tables import frontier_blocks

VIEWS = (0.0, 45.0)
"""Angles of observation, in degrees from the display's normal."""
SETTINGS = (
    PAPER_SETTING,
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
    """Page whose blocks are written; hidden.json and the chart are put beside it."""
    rated: Path = Path("docs/visibility.md")
    """Page with the table of JOD that `reports.visibility.second_model` wrote."""
    peers: Path = Path("docs/peers.json")
    """Results of other systems, which the chart shows where they are there."""


def main() -> None:
    """Decode, work out, store, tabulate, draw."""
    config = read_flags(lambda: tyro.cli(FrontierConfig))
    each_once(methods=config.methods)
    at_least(1, frames=config.frames, jobs=config.jobs)
    at_least(0, observed=config.observed, seed=config.seed)
    if "learned" not in config.methods:
        raise ParameterError("methods", "name learned, whose scores give the rates")
    readers = [(config.methods, config.frames), (("ideal_change",), config.observed)]
    found = []
    for setting in SETTINGS:
        condition = condition_of(setting, config.frames, config.seed)
        parts = []
        for names, frames in readers[: 2 if config.observed else 1]:
            methods = methods_for(names, shipped_checkpoint(setting.layout))
            few = condition_of(setting, frames, config.seed)
            parts.append(predict_all([few], methods, config.work, Backend(config.jobs)))
        shown = [shown_rate(setting, rate, config.seed, config.rated) for rate in RATES_HZ]
        found.append(
            SettingResult(
                setting=setting,
                message_bits=setting.layout.n_bits,
                psnr=displayed_psnr(condition),
                shown=shown,
                read=read_rows(pd.concat(parts, ignore_index=True), config.seed),
            )
        )
    meta = provenance(config.seed, simulated=True) | {"commit": commit()}
    stored = config.page.with_suffix(".json")
    write_frontier(stored, FrontierResults(meta, found))
    texts = frontier_blocks(stored)
    for text in texts.values():
        print(text, end="\n\n")
    write_blocks(config.page, texts)
    peers = read_peers(config.peers).rows if is_file(config.peers) else []
    chart = config.page.with_name("hidden_frontier.png")
    save_png(frontier_figure(read_frontier(stored), peers), chart)
    print(f"written: {config.page}, {stored}, {chart}")


def condition_of(setting: FrontierSetting, frames: int, seed: int) -> Condition:
    """Make held-out frame pairs of a setting, of all nine pairs at both views."""
    cells = tuple(Cell(pair, view, setting.kappa) for view in VIEWS for pair in PAIRS)
    return Condition(setting.name, Source(setting.layout, "test", seed), cells, frames)


def shown_rate(setting: FrontierSetting, states_hz: int, seed: int, rated: Path) -> ShownRate:
    """Work out how visible random messages of a setting are at one rate, at 60 refreshes a second.

    Args:
        setting: layout and kappa.
        states_hz: states a second.
        seed: seed of the messages.
        rated: page with the table of JOD.
    """
    line_code = CODE_OF_MODULATION[setting.modulation]
    preset = Preset(setting.layout, setting.kappa, states_hz, line_code)
    seen = seen_of(preset, seed, 20.0).mean
    return ShownRate(states_hz, seen, measured_jod(rated, preset))


def measured_jod(page: Path, preset: Preset) -> float | None:
    """Find what ColorVideoVDP said of a preset in the table that the second model's command wrote.

    Args:
        page: Markdown with the table; may be missing.
        preset: setting and rate.

    Returns:
        JOD to two digits; None where the setting was not rated at this rate.
    """
    rates = f"{preset.state_hz:g} of {viewing_of(preset).refresh_hz:g}"
    start = f"| {setting_name(preset)} | {rates} | "
    block = page.read_text().partition("<!-- visibility_jod -->")[2] if is_file(page) else ""
    lines = block.partition("<!-- /visibility_jod -->")[0].splitlines()
    found = [line.split("|")[-2] for line in lines if line.startswith(start)]
    return float(found[0]) if found else None


def displayed_psnr(condition: Condition) -> float:
    """Mean PSNR of embedded frames against the picture, dB, over a condition's frame pairs.

    With on-off blocks, the original frame is the picture, with its ratex patches where there are
    some; with antipodal blocks, both frames lie around the picture.
    """
    decibels = []
    for cell in dict.fromkeys(Cell(cell.pair, VIEWS[0], cell.kappa) for cell in condition.cells):
        for index in range(condition.frames):
            pair = FramePair(condition.source, cell, index)
            shown, layout = pair.displayed, condition.source.layout
            picture = shown.original
            if layout.modulation == "antipodal":
                picture = with_head_room(pair.picture.rgb, cell.kappa, layout.modulation)
            decibels.append(psnr(picture, shown.embedded))
    return fmean(decibels)


if __name__ == "__main__":
    run_cli(main)
