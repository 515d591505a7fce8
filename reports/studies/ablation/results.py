"""The numbers that ablation.json stores, read and checked."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from pydantic import Field

from link.outside import read_json
from reports.engine.checked import Count, Number, Share, checked
from reports.engine.provenance import Making
from reports.score.paired import Paired
from reports.studies.ablation.switches import ADDED, FLOORS, REMOVED, WHOLE_DECODERS

BLOCKS = {
    "Added to plain OORC": ("oorc", ("oorc", "phi", *ADDED, "full", "learned", *FLOORS)),
    "Removed from the full decoder": ("full", ("full", *REMOVED, "learned", *FLOORS)),
}
"""The two halves of the ablation by title: the reference row, and the rows compared with it."""


@dataclass(frozen=True)
class AblationEntry:
    """Errors of one row of the ablation in one condition."""

    row: str
    """Name of the row, such as "full-rows"."""
    condition: str
    """Name of the setting of the channel."""
    frames: Count
    """Number of frame pairs."""
    bits: Count
    """Number of bits whose truth is known."""
    errors: Count
    """Number of bits that are decided wrong."""
    error: Share
    """Share of the bits that are decided wrong, in [0, 1]."""
    ci_low: Share
    """Lower end of the 95 % interval of ``error``, which knows that errors cluster."""
    ci_high: Share
    """Upper end of the 95 % interval of ``error``."""
    against: dict[str, Paired]
    """Comparison with each reference row that was decoded, other than the row itself."""


@dataclass(frozen=True)
class CellBehind:
    """A cell in which a decoder to use is behind OORC beyond the paired 95 % interval."""

    row: str
    """Name of the decoder's row."""
    condition: str
    """Name of the setting of the channel."""
    pair: str
    """Name of the camera-display pair."""
    view_deg: Number
    """Angle of observation, degrees."""
    kappa: Count
    """Gray levels added for a bit 1."""
    difference: Number
    """Accuracy of the decoder less that of OORC, points."""
    low: Number
    """Lower end of the interval of the difference, points."""
    high: Number
    """Upper end of the interval of the difference, points; below 0."""


@dataclass(frozen=True)
class AblationSettings:
    """The part of the study's settings that its tables show."""

    frames: Annotated[int, Field(ge=1)]
    """Number of frame pairs in each cell."""


@dataclass(frozen=True)
class AblationMaking(Making):
    """What an ablation.json says of its making."""

    settings: AblationSettings
    """Settings of the study."""


@dataclass(frozen=True)
class Ablation:
    """Content of an ablation.json."""

    meta: AblationMaking
    """What produced the numbers."""
    entries: list[AblationEntry]
    """One entry for each row in each condition."""
    behind_oorc: list[CellBehind]
    """Cells in which a decoder to use is behind OORC."""

    def __post_init__(self) -> None:
        """Check that the tables find every entry and comparison that they show."""
        places = [(entry.row, entry.condition) for entry in self.entries]
        rows, conditions = ({place[side] for place in places} for side in (0, 1))
        if len(set(places)) != len(places) or len(places) != len(rows) * len(conditions):
            raise ValueError("needs one entry for each row in each condition")
        for entry in self.entries:
            against = {reference for reference, _ in BLOCKS.values()} & rows - {entry.row}
            against |= {"oorc"} if entry.row in WHOLE_DECODERS else set()
            if not against <= set(entry.against):
                raise ValueError(f"{entry.row:.40} lacks a comparison")


def read_ablation(file: Path) -> Ablation:
    """Read an ablation.json that `reports.studies.ablation` wrote.

    Raises:
        InputError: the file is missing or damaged.
    """
    return checked(Ablation, read_json(file), str(file))
