"""How much of a message a picture carries: over dark gray a camera sees little of a change.

A display gives dark gray little light, and so a change of one gray level there little more, which
is soon less than what a camera's noise and compression leave. The picture alone tells this.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from link.images import as_gray

CARRIED = {
    "hidden": {
        0: 0.09, 4: 0.12, 8: 0.25, 12: 0.47, 16: 0.55, 20: 0.66, 26: 0.72, 32: 0.75, 40: 0.86,
        52: 0.94, 80: 0.96, 128: 0.98,
    },
    "fast": {
        0: 0.44, 8: 0.52, 12: 0.53, 16: 0.61, 20: 0.69, 26: 0.77, 32: 0.88, 40: 0.92, 52: 0.97,
        80: 0.98,
    },
    "robust": {0: 0.98, 8: 0.99, 20: 1.0},
}  # fmt: skip
"""Share of a bit's information that the scores of one frame pair give, from 0 to 1, by preset and
gray level of the block. It was measured with two simulated cameras, whose frame rates were the
states' and half of it, on displays of which patches of 18 gray levels covered 40 %."""
DIM = 0.65
"""Share of the bits from which on a picture counts as bright enough."""
SHRUNK_PX = (64, 48)
"""Width and height, in pixels, to which a picture is shrunk before its levels are looked at, so
that they are about those of blocks."""
DARK = (
    "note: the picture is dark: about {:.0%} of the bits come through ({:,.0f} a second), and the "
    "display is found late or not at all; a brighter picture or display helps, and preset robust"
)
"""Note that is printed for a dark picture."""


def carried_share(picture: NDArray[np.uint8], preset: str) -> float:
    """Work out which share of a frame pair's bits comes through over a picture.

    Args:
        picture: (H, W) or (H, W, 3) uint8, encoded.
        preset: key of `CARRIED`, by which the blocks change.

    Returns:
        0 to 1.

    >>> gray = np.full((480, 640), 16, np.uint8)
    >>> [round(carried_share(gray, name), 2) for name in CARRIED]
    [0.55, 0.61, 1.0]
    """
    levels = cv2.resize(as_gray(picture), SHRUNK_PX, interpolation=cv2.INTER_AREA)
    table = CARRIED[preset]
    return float(np.interp(levels, list(table), list(table.values())).mean())
