"""Contrast over threshold of settings that people use, as tables."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from link.errors import ParameterError
from link.layout import COLOURS
from link.visibility.flicker import (
    Visibility,
    contrast_over_threshold,
    largest_kappa,
    message_visibility,
)
from link.visibility.line_code import LINE_CODES
from link.visibility.viewing import PICTURE_LEVELS, Viewing, Where
from reports.render.tables import Table

RED_GREEN = COLOURS["chroma"]
"""Gray levels of red, green and blue that change colour at nearly constant luminance."""


@dataclass(frozen=True)
class Preset:
    """A setting of the sender."""

    grid: tuple[int, int]
    """Number of rows and of columns."""
    line_code: str
    """Key of `link.visibility.line_code.LINE_CODES`."""
    kappa: int
    """Number of gray levels between the states of a toggle."""
    states_hz: int
    """Number of states a second."""
    refresh_hz: int = 60
    """Number of refreshes of the display a second."""
    colour: tuple[float, float, float] = (1.0, 1.0, 1.0)
    """Gray levels of red, green and blue for each of kappa."""

    def viewing(self, picture_level: float | tuple[float, float, float] = 128.0) -> Viewing:
        """Make the viewing of the preset on the standard display, over a gray or coloured area."""
        return Viewing(
            *self.grid,
            kappa=self.kappa,
            states_hz=self.states_hz,
            refresh_hz=self.refresh_hz,
            picture_level=picture_level,
            colour=self.colour,
            whole_levels=self.colour != RED_GREEN,  # the sender dithers what is no whole level
        )

    def seen(
        self,
        seed: int,
        seconds: float,
        where: Where = "block",
        level: float | tuple[float, float, float] = 128.0,
    ) -> Visibility:
        """Work out the visibility of a random message of the preset."""
        rng = np.random.default_rng(seed)
        return message_visibility(self.viewing(level), self.line_code, rng, seconds, where)

    @property
    def name(self) -> str:
        """What tables call the preset."""
        rows, cols = self.grid
        colour = "" if len(set(self.colour)) == 1 else ", red-green"
        return f"{rows} × {cols}, {self.line_code}, κ {self.kappa}{colour}"

    @property
    def bits_hz(self) -> float:
        """Number of bits that all blocks carry a second, before coding."""
        rows, cols = self.grid
        return rows * cols * self.states_hz / 2 / LINE_CODES[self.line_code].toggles


PRESETS = (
    Preset((8, 8), "on_off", 5, 15),
    Preset((8, 8), "on_off", 3, 15),
    Preset((8, 8), "toggle", 3, 15),
    Preset((8, 8), "on_off", 3, 60),
    Preset((8, 8), "toggle", 1, 60),
    Preset((24, 32), "toggle", 1, 60),
    Preset((48, 64), "toggle", 3, 60),
    Preset((48, 64), "toggle", 1, 60),
    Preset((48, 64), "hold2", 1, 60),
    Preset((48, 64), "soft2", 3, 60),
    Preset((48, 64), "soft4", 4, 60),
    Preset((96, 128), "toggle", 1, 60),
    Preset((48, 64), "toggle", 3, 120, 120),
    Preset((48, 64), "soft2", 6, 120, 120),
    Preset((8, 8), "on_off", 3, 15, colour=RED_GREEN),
    Preset((48, 64), "toggle", 3, 60, colour=RED_GREEN),
)
"""Settings that the table lists: the paper's first, then what it takes to hide a message."""


def check_seconds(seconds: float) -> None:
    """Check the length of random messages whose visibility is computed.

    Raises:
        ParameterError: it is below 1 s or above an hour.
    """
    if not 1 <= seconds <= 3600:
        raise ParameterError("seconds", f"need 1 to 3600 s, got {seconds:g}")


def preset_table(seed: int, seconds: float, presets: Sequence[Preset] = PRESETS) -> Table:
    """Tabulate how visible random messages of presets are."""
    rows = []
    for preset in presets:
        middle = preset.seen(seed, seconds)
        others = [preset.seen(seed, seconds, level=level).mean for level in PICTURE_LEVELS]
        screen = preset.seen(seed, seconds, "screen")
        rows.append(
            [
                preset.name,
                f"{preset.states_hz} of {preset.refresh_hz}",
                f"{preset.bits_hz:,.0f}",
                f"{middle.mean:.2f}",
                f"{middle.high:.2f}",
                f"{max(others):.2f}",
                f"{screen.mean:.2f}",
            ]
        )
    heads = ["setting", "states/s of refreshes/s", "raw bits/s", "one block", "its high end",
             "worst gray", "whole screen"]  # fmt: skip
    return Table(heads, rows)


GRIDS = ((8, 8), (24, 32), (48, 64), (96, 128))
"""Grids, as rows and columns, of the table of largest kappas."""
RATES = ((15, 60), (30, 60), (60, 60), (60, 120), (120, 120))
"""States and refreshes a second of the table of largest kappas."""


def kappa_table(seed: int, seconds: float, line_codes: Sequence[str], limit: float = 1.0) -> Table:
    """Tabulate the largest whole kappa that stays below a contrast over threshold."""
    rows = []
    for grid in GRIDS:
        for code in line_codes:
            cells = []
            for states, refreshes in RATES:
                viewing = Viewing(*grid, states_hz=states, refresh_hz=refreshes, whole_levels=True)
                rng = np.random.default_rng(seed)
                found = largest_kappa(viewing, limit, rng, code, seconds)
                cells.append(str(found) if found else "–")
            rows.append([f"{grid[0]} × {grid[1]}", code, *cells])
    heads = ["grid", "line code", *(f"{s} of {r}" for s, r in RATES)]
    return Table(heads, rows, left=2)


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
                    shown = LINE_CODES["on_off"].amplitudes([1] * 4 * states, viewing.refreshes)
                    seen.append(contrast_over_threshold(shown, viewing, window_s=2.0).mean)
                cells.append(f"{seen[1]:.2f} ({max(seen):.2f})")
            rows.append([f"{grid[0]} × {grid[1]}", str(states), *cells])
    return Table(["grid", "states/s", "κ 1", "κ 3"], rows, left=2)
