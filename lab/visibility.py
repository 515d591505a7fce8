"""How visible the presets and other settings are, as contrast over threshold; about a minute."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from lab.study import Study, StudyFlags, Tables, Workshop, blocks_of_tables
from link.embed import MAX_KAPPA
from link.errors import ParameterError
from link.layout import make_layout
from link.presets import PRESETS, Preset
from reports.render.tables import Table
from sender.visibility.flicker import (
    Visibility,
    contrast_over_threshold,
    random_message,
)
from sender.visibility.line_code import shown_amplitudes
from sender.visibility.viewing import PICTURE_LEVELS, Viewing, Where


@dataclass(frozen=True)
class VisibilityFlags(StudyFlags):
    """Compute the visibility of presets and of other settings."""

    limit: float = 1.0
    """Contrast over threshold that the largest kappas stay below; 1 is just seen."""
    seconds: float = 40.0
    """Length of the random messages, in seconds, at least 1."""


def setting(grid: tuple[int, int], line_code: str, kappa: int, state_hz: float) -> Preset:
    """Make a preset of what visibility depends on; its blocks all carry bits.

    Args:
        grid: number of rows and of columns.
        line_code: key of `sender.visibility.line_code.LINE_CODES`.
        kappa: gray levels between the states of a toggle.
        state_hz: states a second.
    """
    modulation = "on_off" if line_code == "on_off" else "antipodal"
    layout = make_layout(*grid, ratex=0, modulation=modulation)
    return Preset(layout, kappa, state_hz, line_code)


def viewing_of(
    preset: Preset,
    level: float = 128.0,
    refresh_hz: float | None = None,
) -> Viewing:
    """Make the viewing of a preset that fills the standard display.

    Args:
        preset: grid, kappa and rate of the message.
        level: gray level of the picture.
        refresh_hz: refreshes a second; by default 60, or one a state where states are faster.
    """
    return Viewing(
        preset.layout.rows,
        preset.layout.cols,
        kappa=preset.kappa,
        states_hz=preset.state_hz,
        refresh_hz=max(60, preset.state_hz) if refresh_hz is None else refresh_hz,
        picture_level=level,
        whole_levels=True,
    )


def seen_of(
    preset: Preset,
    seed: int,
    seconds: float,
    where: Where = "block",
    level: float = 128.0,
    refresh_hz: float | None = None,
) -> Visibility:
    """Work out the visibility of a random message of a preset on the standard display.

    Args:
        preset: the message's grid, line code, kappa and rate.
        seed: seed of the random message.
        seconds: length of the random message.
        where: "block" for one block, "screen" for all blocks in phase.
        level: gray level as `viewing_of` takes it.
        refresh_hz: refreshes a second as `viewing_of` takes them.
    """
    viewing = viewing_of(preset, level, refresh_hz)
    shown = random_message(viewing, preset.line_code, np.random.default_rng(seed), seconds)
    return contrast_over_threshold(shown, viewing, where)


def setting_name(preset: Preset) -> str:
    """Say what tables call a preset: its grid, line code and kappa."""
    layout = preset.layout
    return f"{layout.rows} × {layout.cols}, {preset.line_code}, κ {preset.kappa}"


def raw_bits_hz(preset: Preset) -> float:
    """Count the bits that all blocks of a preset carry a second, before coding."""
    return preset.layout.rows * preset.layout.cols * preset.state_hz / 2


OTHERS = (
    setting((8, 8), "on_off", 5, 15),
    setting((8, 8), "toggle", 3, 15),
    setting((8, 8), "on_off", 3, 60),
    setting((8, 8), "toggle", 1, 60),
    setting((24, 32), "toggle", 1, 60),
    setting((48, 64), "toggle", 3, 60),
    setting((96, 128), "toggle", 1, 60),
    setting((48, 64), "toggle", 3, 120),
)
"""Settings that the table lists beside the presets."""


def preset_table(seed: int, seconds: float, others: Sequence[Preset] = OTHERS) -> Table:
    """Tabulate how visible random messages of the presets, and of other settings, are."""
    rows = []
    for name, preset in [*PRESETS.items(), *(("", other) for other in others)]:
        middle = seen_of(preset, seed, seconds)
        grays = [seen_of(preset, seed, seconds, level=level) for level in PICTURE_LEVELS]
        screen = seen_of(preset, seed, seconds, "screen")
        rows.append(
            [
                name,
                setting_name(preset),
                f"{preset.state_hz:g} of {viewing_of(preset).refresh_hz:g}",
                f"{raw_bits_hz(preset):,.0f}",
                f"{middle.mean:.2f}",
                f"{middle.high:.2f}",
                f"{max(gray.mean for gray in grays):.2f}",
                f"{max(gray.high for gray in grays):.2f}",
                f"{screen.mean:.2f}",
            ]
        )
    heads = ["preset", "setting", "states/s of refreshes/s", "raw bits/s", "one block",
             "its high end", "worst gray", "its high end", "whole screen"]  # fmt: skip
    return Table(heads, rows, left=2)


GRIDS = ((8, 8), (24, 32), (48, 64), (96, 128))
"""Grids, as rows and columns, of the table of largest kappas."""
RATES = ((15, 60), (30, 60), (60, 60), (60, 120), (120, 120))
"""States and refreshes a second of the table of largest kappas."""


def kappa_table(seed: int, seconds: float, limit: float = 1.0) -> Table:
    """Tabulate the largest whole kappa of a toggle that stays below a contrast over threshold."""
    rows = []
    for grid in GRIDS:
        cells = []
        for states, refreshes in RATES:
            viewing = Viewing(*grid, states_hz=states, refresh_hz=refreshes, whole_levels=True)
            shown = random_message(viewing, "toggle", np.random.default_rng(seed), seconds)
            views = (replace(viewing, kappa=kappa) for kappa in range(1, MAX_KAPPA + 1))
            hidden = (v.kappa for v in views if contrast_over_threshold(shown, v).high <= limit)
            found = max(hidden, default=0)
            cells.append(str(found) if found else "–")
        rows.append([f"{grid[0]} × {grid[1]}", *cells])
    return Table(["grid", *(f"{s} of {r}" for s, r in RATES)], rows)


def square_wave_table() -> Table:
    """Tabulate a block that toggles all the time, which is a message of ones in the paper's code.

    Windows of two seconds hold whole periods, so that this is the fundamental and its harmonics.
    """
    rows = []
    for grid in GRIDS:
        for states in (15, 30, 60):
            cells = []
            for kappa in (1, 3):
                seen = []
                for level in PICTURE_LEVELS:
                    viewing = replace(
                        Viewing(*grid, kappa=kappa, states_hz=states), picture_level=level
                    )
                    shown = shown_amplitudes("on_off", [1] * 4 * states, viewing.refreshes)
                    seen.append(contrast_over_threshold(shown, viewing, window_s=2.0).mean)
                cells.append(f"{seen[1]:.2f} ({max(seen):.2f})")
            rows.append([f"{grid[0]} × {grid[1]}", str(states), *cells])
    return Table(["grid", "states/s", "κ 1", "κ 3"], rows, left=2)


def check_visibility(flags: VisibilityFlags) -> None:
    """Raise an `InputError` that names the first flag with a wrong value."""
    if not 1 <= flags.seconds <= 3600:
        raise ParameterError("seconds", f"need 1 to 3600 s, got {flags.seconds:g}")
    if not flags.limit > 0:
        raise ParameterError("limit", f"need a number above 0, got {flags.limit}")


def measure_visibility(flags: VisibilityFlags, workshop: Workshop) -> Tables:
    """Compute all tables."""
    return Tables(
        {
            "visibility_presets": [preset_table(flags.seed, flags.seconds)],
            "visibility_square": [square_wave_table()],
            "visibility_kappa": [kappa_table(flags.seed, flags.seconds, flags.limit)],
        }
    )


STUDY = Study(
    name="visibility",
    flags=VisibilityFlags,
    content=Tables,
    measure=measure_visibility,
    blocks=blocks_of_tables,
    page=Path("docs/visibility.md"),
    check=check_visibility,
)
"""The study that `python -m lab visibility` runs."""
