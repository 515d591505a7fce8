"""How many bits are read, beside what is seen, by grid and modulation; takes some minutes.

Every layout is filmed on held-out pictures and channel draws of all nine camera-display pairs, at 0
and 45 degrees. Beside the bits that each method reads stand the contrast over threshold of what the
display shows, and its PSNR.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean

import pandas as pd

from data_gen.frame_pair import Cell, FramePair, Source
from data_gen.pairs import PAIRS
from export.visibility.line_code import CODE_OF_MODULATION
from lab.study import Picture, Results, Study, StudyFlags, Workshop
from lab.visibility.frontier_charts import frontier_figure
from lab.visibility.frontier_reading import read_rows
from lab.visibility.frontier_results import (
    PAPER_SETTING,
    FrontierResults,
    FrontierSetting,
    SettingResult,
    ShownRate,
)
from lab.visibility.frontier_tables import frontier_blocks
from lab.visibility.presets import seen_of
from link.embed import with_head_room
from link.errors import ParameterError, at_least, each_once
from link.images.quality import psnr
from link.presets import Preset
from reports.engine.methods import methods_for
from reports.engine.predict import Condition

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
class FrontierFlags(StudyFlags):
    """Compare layouts by what is seen and what is read."""

    methods: tuple[str, ...] = ("naive", "oorc", "learned")
    """Methods that read; the rates are those of ``learned``, which must be among them."""
    frames: int = 4
    """Number of frame pairs in each cell."""
    observed: int = 0
    """Number of them that the observer ``ideal_change`` reads, too, which takes seconds for each;
    0 leaves it out."""


def check_frontier(flags: FrontierFlags) -> None:
    """Raise an `InputError` that names the first flag with a wrong value."""
    each_once(methods=flags.methods)
    at_least(1, frames=flags.frames)
    at_least(0, observed=flags.observed)
    if "learned" not in flags.methods:
        raise ParameterError("methods", "name learned, whose scores give the rates")


def measure_frontier(flags: FrontierFlags, workshop: Workshop) -> FrontierResults:
    """Decode every setting, and work out what it shows."""
    readers = [(flags.methods, flags.frames), (("ideal_change",), flags.observed)]
    found = []
    for setting in SETTINGS:
        parts = []
        for names, frames in readers[: 2 if flags.observed else 1]:
            methods = methods_for(names)
            few = condition_of(setting, frames, flags.seed)
            parts.append(workshop.predict([few], methods))
        found.append(
            SettingResult(
                setting=setting,
                message_bits=setting.layout.n_bits,
                psnr=displayed_psnr(condition_of(setting, flags.frames, flags.seed)),
                shown=[shown_rate(setting, rate, flags.seed) for rate in RATES_HZ],
                read=read_rows(pd.concat(parts, ignore_index=True), flags.seed),
            )
        )
    return FrontierResults(found)


def condition_of(setting: FrontierSetting, frames: int, seed: int) -> Condition:
    """Make held-out frame pairs of a setting, of all nine pairs at both views."""
    cells = tuple(Cell(pair, view, setting.kappa) for view in VIEWS for pair in PAIRS)
    return Condition(setting.name, Source(setting.layout, "test", seed), cells, frames)


def shown_rate(setting: FrontierSetting, states_hz: int, seed: int) -> ShownRate:
    """Work out how visible random messages of a setting are at one rate, at 60 refreshes a second.

    Args:
        setting: layout and kappa.
        states_hz: states a second.
        seed: seed of the messages.
    """
    line_code = CODE_OF_MODULATION[setting.modulation]
    preset = Preset(setting.layout, setting.kappa, states_hz, line_code)
    return ShownRate(states_hz, seen_of(preset, seed, 20.0).mean)


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


def frontier_pictures(results: Mapping[str, Results[FrontierResults]]) -> dict[str, Picture]:
    """Draw the charts."""
    return {"hidden_frontier.png": frontier_figure(results["frontier"].content)}


STUDY = Study(
    name="frontier",
    flags=FrontierFlags,
    content=FrontierResults,
    measure=measure_frontier,
    blocks=frontier_blocks,
    page=Path("docs/hidden.md"),
    pictures=frontier_pictures,
    check=check_frontier,
)
"""The study that `python -m lab frontier` runs."""
