"""What an ablation measures, checked."""

from dataclasses import dataclass, field

from lab.ablation.switches import ADDED, REMOVED, WHOLE_DECODERS
from reports.engine.checked import Count, Number, Share
from reports.score.paired import Paired
from reports.score.reliability import Bin

BLOCKS = {
    "Added to plain OORC": ("oorc", ("oorc", "phi", *ADDED, "full", "learned")),
    "Removed from the full decoder": ("full", ("full", *REMOVED, "learned")),
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
class Ablation:
    """What was measured."""

    entries: list[AblationEntry]
    """One entry for each row in each condition."""
    behind_oorc: list[CellBehind]
    """Cells in which a decoder to use is behind OORC."""
    curves: dict[str, dict[str, list[Bin]]] = field(default_factory=dict)
    """Reliability of the decoders to use, by row and condition; `reports.score.reliability.ALL`
    stands for all conditions. Empty in results that were stored before it was."""

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
