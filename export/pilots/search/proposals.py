"""Where a display may be, what it may show, and how surely its pilots toggle there."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from export.pilots.search.film import FilmFrame, positions
from export.pilots.signal import pilot_evidence, pilot_values, standing_out
from link.layout import Layout
from link.types import Corners


@dataclass(frozen=True, eq=False)
class Proposal:
    """Where a display may be."""

    corners: Corners
    """Pixels of the reference frame; the displayed picture's top left comes first."""
    layout: Layout
    """What it may show."""
    frequency: float
    """Frequency at which it may toggle, in periods for each nominal frame."""


def surest_proposal(
    corners: Corners,
    views: Sequence[NDArray[np.generic]],
    at: Sequence[float],
    layouts: Sequence[Layout],
) -> tuple[float, Proposal]:
    """Choose the layout, upright or upside down, whose pilots toggle most surely.

    Args:
        corners: pixels of the reference frame.
        views: what they bound in each frame, rectified to any size.
        at: positions of the frames.
        layouts: those that may be shown.

    Returns:
        the evidence, before it pays for what was tried, and what it speaks for.
    """
    found = []
    for layout in layouts:
        blocks = [standing_out(view, layout) for view in views]
        for turn in (0, 2):
            turned = [block[::-1, ::-1] if turn else block for block in blocks]
            picked = [view.reshape(-1)[layout.pilot_blocks] for view in turned]  # -> (blocks,)
            evidence, frequency = pilot_evidence(picked, layout, at)
            found.append((evidence, Proposal(np.roll(corners, -turn, axis=0), layout, frequency)))
    return max(found, key=lambda each: each[0])


def proposal_evidence(proposal: Proposal, frames: Sequence[FilmFrame]) -> float:
    """Weigh a proposal by frames in full: the evidence, before it pays for what was tried."""
    values = []
    for frame in frames:
        view = frame.view(proposal.corners, proposal.layout)
        if view is None:
            return 0.0
        values.append(pilot_values(view, proposal.layout))
    return pilot_evidence(values, proposal.layout, positions(frames))[0]
