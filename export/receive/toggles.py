"""How much the tiles of label 1 of the ratex patches are brighter than their twins of label 0."""

import numpy as np
from numpy.typing import NDArray

from link.layout import Layout
from link.ratex import match_patches

MIN_CORRELATION = 0.8
"""Smallest correlation of shown and captured tiles of a patch that nothing covers."""


def patch_toggles(frame: NDArray[np.uint8], layout: Layout) -> NDArray[np.float64]:
    """Measure how much brighter tiles of label 1 are than their twins of label 0, in each patch.

    No change of exposure can mimic this, because both tiles of a pair of twins show the same
    intensity.

    Args:
        frame: (H, W) or (H, W, 3) uint8, encoded, rectified.
        layout: with at least one patch.

    Returns:
        (patches,) in displayed gray levels, as the patch's own contrast tells; NaN where something
        covers the patch.
    """
    match = match_patches(frame, layout)
    gain = (match.captured * match.shown).sum(axis=1) / (match.shown**2).sum(axis=1)
    contrast = np.where(match.correlation > MIN_CORRELATION, gain, np.nan)
    return np.asarray(2 * (match.captured * (2 * match.label - 1)).mean(axis=1) / contrast)
