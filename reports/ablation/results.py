"""Results of an ablation: every row against its references, on identical captures."""

from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from reports.ablation.switches import ADDED, REMOVED, WHOLE_DECODERS
from reports.engine.checked import Count, Share
from reports.score.accuracy import pool, score
from reports.score.paired import COUNTS, Paired, cells_behind, compare, tally
from reports.score.reliability import Bin

REFERENCES = ("oorc", "full")
"""Rows with which every other row is compared, where they are decoded."""
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
    cells_behind: Count = 0
    """Number of cells in which a decoder to use is behind OORC beyond the paired 95 % interval."""


@dataclass(frozen=True)
class Ablation:
    """Results of an ablation."""

    entries: list[AblationEntry]
    """One entry for each row in each condition."""
    curves: dict[str, dict[str, list[Bin]]] = field(default_factory=dict)
    """Reliability of the decoders to use, by row and condition; `reports.score.reliability.ALL`
    stands for all conditions. Empty in results that were stored before it was."""

    @property
    def by_place(self) -> dict[tuple[str, str], AblationEntry]:
        """Entries by row and condition."""
        return {(entry.row, entry.condition): entry for entry in self.entries}

    def __post_init__(self) -> None:
        """Check that the tables find every entry and comparison that they show."""
        places = self.by_place
        rows, conditions = ({place[side] for place in places} for side in (0, 1))
        if not len(self.entries) == len(places) == len(rows) * len(conditions):
            raise ValueError("needs one entry for each row in each condition")
        for entry in self.entries:
            against = {reference for reference, _ in BLOCKS.values()} & rows - {entry.row}
            against |= {"oorc"} if entry.row in WHOLE_DECODERS else set()
            if not against <= set(entry.against):
                raise ValueError(f"{entry.row:.40} lacks a comparison")


def compare_rows(records: pd.DataFrame, seed: int) -> list[AblationEntry]:
    """Count the errors of every row in every condition, and compare rows with the references.

    Args:
        records: predictions of all rows in all conditions.
        seed: seed of the resamples, which are the same for every comparison.
    """
    entries = []
    for condition, mine in records.groupby("condition", sort=False):
        rows = list(mine["method"].unique())
        for row in pool(score(mine)).itertuples():
            against, behind = {}, 0
            for reference in REFERENCES:
                if reference in rows and reference != row.method:
                    counts = tally(mine, row.method, reference)
                    rng = np.random.default_rng(seed)
                    against[reference] = compare(counts[COUNTS].to_numpy(), rng)
                    if reference == "oorc" and row.method in WHOLE_DECODERS:
                        behind = cells_behind(counts, np.random.default_rng(seed))
            entries.append(
                AblationEntry(
                    row=row.method,
                    condition=str(condition),
                    frames=int(row.frames),
                    bits=int(row.bits),
                    errors=int(row.errors),
                    error=row.errors / row.bits,
                    ci_low=1 - row.high,
                    ci_high=1 - row.low,
                    against=against,
                    cells_behind=behind,
                )
            )
    return entries
