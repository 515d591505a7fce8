"""How much what is known to toggle differs from what is known not to, or to toggle the other way.

Of ratex patches these are tiles of label 1 and their twins of label 0; of layouts without patches
these are pilots of bit 1 and of bit 0.
"""

import numpy as np

from link.layout import Layout
from link.pilots import pilot_signs
from link.ratex import CLEAR_MATCH, PatchMatch, patch_centres
from link.types import Array, Real

PARTS = (4, 4)
"""Number of parts of the display, from top to bottom and from left to right, over each of which the
toggles of pilots are averaged."""
LEAST_VARIANCE = 0.1
"""Squared gray levels added to a pilot's variance before its weight is the inverse, so that the few
frames of a short window do not make single pilots weigh all."""


def patch_toggles(match: PatchMatch) -> Array:
    """Measure how much brighter tiles of label 1 are than their twins of label 0, in each patch.

    No change of exposure can mimic this, because both tiles of a pair of twins show the same
    intensity.

    Args:
        match: how the patches look in a rectified frame.

    Returns:
        (patches,) in displayed gray levels, as the patch's own contrast tells; NaN where something
        covers the patch.
    """
    gain = (match.captured * match.shown).sum(axis=1) / (match.shown**2).sum(axis=1)
    contrast = np.where(match.correlation > CLEAR_MATCH, gain, np.nan)
    return np.asarray(2 * (match.captured * (2 * match.label - 1)).mean(axis=1) / contrast)


class PatchToggles:
    """Toggles of the ratex patches.

    Args:
        layout: layout with at least one patch.
    """

    def __init__(self, layout: Layout) -> None:
        self.places = patch_centres(layout)
        """(P, 2) x and y of the patches on the display, in [0, 1]."""

    def over_time(self, values: Real) -> Array:
        """Return the (n, patches) toggles as they are."""
        return np.asarray(values, np.float64)


class PilotToggles:
    """Toggles of pilots, averaged over the parts of the display.

    Pilots whose blocks vary much, because the picture is steep there, weigh less. All frames of a
    window get the same weights, and each pilot is taken less its mean. Otherwise what it shows of
    the picture itself, which is far more than it toggles, would change with the weights.

    Args:
        layout: layout with pilots.
    """

    def __init__(self, layout: Layout) -> None:
        row, col = np.divmod(layout.pilot_blocks, layout.cols)
        rows, cols = min(PARTS[0], layout.rows), min(PARTS[1], layout.cols)
        part = (row * rows // layout.rows) * cols + col * cols // layout.cols
        taken, self.parts = np.unique(part, return_inverse=True)
        """(pilots,) number of the part in which each pilot lies, of those that have any."""
        at_row, at_col = np.divmod(taken, cols)
        self.places = np.stack([(at_col + 0.5) / cols, (at_row + 0.5) / rows], axis=1)
        """(P, 2) x and y of the parts on the display, in [0, 1]."""
        parts = np.arange(len(taken))
        self._signs_of_parts = pilot_signs(layout)[:, None] * (self.parts[:, None] == parts)

    def over_time(self, values: Real) -> Array:
        """Average the (n, pilots) values of n frames: (n, P) toggles, in captured gray levels."""
        series = np.asarray(values, np.float64)
        apart = series - series.mean(axis=0)
        weights = 1 / ((apart**2).mean(axis=0) + LEAST_VARIANCE)
        sums = (apart * weights) @ self._signs_of_parts
        return np.asarray(2 * sums / np.bincount(self.parts, weights))


Toggles = PatchToggles | PilotToggles
"""Knows the toggling at some places of the display, from which its clock is found."""


def make_toggles(layout: Layout) -> Toggles:
    """Make what knows the toggling of a layout with patches or pilots."""
    return PilotToggles(layout) if layout.pilots else PatchToggles(layout)
