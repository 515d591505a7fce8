"""What layouts show and what is read from them: results of a study."""

from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from link.layout import Layout, make_layout
from reports.engine.checked import Count, Number, Share

Positive = Annotated[int, Field(ge=1, le=2**20)]
"""Type of a number of things in a stored file of which there is at least one."""
CHART_HZ = 60
"""States a second at which the charts of right bits show contrast over threshold."""


@dataclass(frozen=True)
class FrontierSetting:
    """A layout and a kappa that are compared."""

    rows: Positive
    """Number of rows of blocks."""
    cols: Positive
    """Number of columns of blocks."""
    modulation: str
    """Key of `link.layout.MODULATIONS`."""
    kappa: Positive
    """Number of gray levels by which blocks change."""
    ratex: bool = False
    """Whether five ratex patches calibrate, as in the paper, in place of pilots."""

    @property
    def layout(self) -> Layout:
        """The layout that the display shows."""
        pilots = 0 if self.ratex else "auto"
        return make_layout(self.rows, self.cols, modulation=self.modulation, pilots=pilots)

    @property
    def grid(self) -> str:
        """Rows and columns in words."""
        return f"{self.rows} × {self.cols}"

    @property
    def name(self) -> str:
        """What tables call the setting."""
        known = "ratex" if self.ratex else "pilots"
        return f"{self.grid} {self.modulation}, {known}, κ {self.kappa}"


PAPER_SETTING = FrontierSetting(8, 8, "on_off", 3, ratex=True)
"""The paper's setting, against which visibility and rates are compared."""
PAPER_HZ = 15
"""States a second of the paper's display."""


@dataclass(frozen=True)
class ShownRate:
    """How visible a setting is at one rate."""

    states_hz: Positive
    """States a second, on a display of 60 refreshes a second."""
    seen: Annotated[float, Field(ge=1e-9, le=1e9)]
    """Contrast over threshold of one block; above 1 it is seen."""


@dataclass(frozen=True)
class Lead:
    """How far `learned` is ahead of another method on identical captures."""

    points: Number
    """Accuracy of `learned` less that of the other method, points."""
    low: Number
    """Lower end of the 95 % interval of the lead, points, by a bootstrap over frame pairs."""
    high: Number
    """Upper end of the 95 % interval of the lead, points."""


@dataclass(frozen=True)
class ReadRow:
    """What one method reads of a setting at one view, over all camera-display pairs."""

    view_deg: Number
    """Angle of observation, in degrees from the display's normal."""
    method: str
    """Label of the method."""
    frames: Count
    """Number of frame pairs."""
    bits: Annotated[int, Field(ge=1, le=2**53)]
    """Number of bits in all frame pairs."""
    correct: Count
    """Number of bits that were read right."""
    accuracy: Share
    """Share of bits that were read right, in [0, 1]."""
    ci_low: Share
    """Lower end of the 95 % interval of the accuracy, which knows that errors cluster by frame
    pair."""
    ci_high: Share
    """Upper end of the 95 % interval of the accuracy."""
    information: Annotated[float, Field(ge=-1e9, le=1)]
    """Information about a sent bit, in bits, before coding: of the scores, where they are
    log-likelihood ratios, and else of the decided bits (`decided_information`)."""
    lead: Lead | None
    """How far `learned` is ahead of this method; None for `learned` itself."""


@dataclass(frozen=True)
class SettingResult:
    """What a setting shows, and what is read of it."""

    setting: FrontierSetting
    """The layout and its kappa."""
    message_bits: Positive
    """Number of message bits in a frame pair."""
    psnr: Number
    """Peak signal-to-noise ratio of a displayed frame against the picture, dB, mean over frame
    pairs. Ratex patches stand in both and do not count."""
    shown: Annotated[list[ShownRate], Field(min_length=1)]
    """One entry for each rate."""
    read: Annotated[list[ReadRow], Field(min_length=1)]
    """One row for each view and method."""

    @property
    def bits_a_pair(self) -> float:
        """Bits of information that the scores of `learned` carry a frame pair, over all views."""
        own = [row for row in self.read if row.method == "learned"]
        share = sum(row.bits * row.information for row in own) / sum(row.bits for row in own)
        return self.message_bits * max(0.0, share)

    def seen_at(self, states_hz: int) -> float:
        """Contrast over threshold at a rate that was measured."""
        return next(rate.seen for rate in self.shown if rate.states_hz == states_hz)


@dataclass(frozen=True)
class FrontierResults:
    """What was measured."""

    settings: Annotated[list[SettingResult], Field(min_length=1)]
    """One entry for each setting."""

    def __post_init__(self) -> None:
        """Check that the tables find what they compare with."""
        if len({result.setting for result in self.settings}) != len(self.settings):
            raise ValueError("a setting is there twice")
        rates = {tuple(rate.states_hz for rate in result.shown) for result in self.settings}
        if len(rates) != 1 or not {PAPER_HZ, CHART_HZ} <= set(*rates):
            raise ValueError(f"settings need the same rates, {PAPER_HZ} and {CHART_HZ} among them")
        if PAPER_SETTING not in [result.setting for result in self.settings]:
            raise ValueError("the paper's setting is missing")
        for result in self.settings:
            places = {(row.view_deg, row.method) for row in result.read}
            if len(places) != len(result.read):
                raise ValueError(f"{result.setting.name}: a view and method are there twice")
            if not places >= {(view, "learned") for view, _ in places}:
                raise ValueError(f"{result.setting.name}: learned is missing at a view")

    @property
    def paper(self) -> SettingResult:
        """The entry of the paper's setting."""
        return next(result for result in self.settings if result.setting == PAPER_SETTING)

    @property
    def views(self) -> list[float]:
        """Angles of observation in degrees, ascending."""
        return sorted({row.view_deg for result in self.settings for row in result.read})

    @property
    def methods(self) -> list[str]:
        """Labels of the methods in order of first appearance."""
        return list(dict.fromkeys(row.method for result in self.settings for row in result.read))
