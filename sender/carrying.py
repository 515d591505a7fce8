"""How much of a message a picture carries: over dark gray a camera sees little of a change.

A display gives dark gray little light, and so a change of one gray level there little more, which
is soon less than what a camera's noise and compression leave. The picture alone tells this.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from link.images import as_gray

CARRIED = {
    "hidden": {0: 0.27, 8: 0.5, 16: 0.63, 24: 0.71, 32: 0.81, 48: 0.87, 80: 0.96, 160: 0.97},
    "fast": {0: 0.6, 8: 0.64, 16: 0.7, 24: 0.75, 32: 0.79, 48: 0.83, 80: 0.83, 160: 0.81},
    "robust": {0: 0.94, 8: 0.98, 16: 0.98, 24: 0.96, 32: 0.99, 48: 1.0, 80: 1.0, 160: 1.0},
}
"""By preset and a block's gray level the share of its bit that the scores of a frame pair tell, 1
for a bit that is certain: simulated, by ``python -m lab carrying --pairs canon-lg phone-laptop
phone-oled --seconds 0.8`` of commit 451fcc7e. Three cameras, with a frame for each state or two,
filmed patches of these levels. Scores of like confidence count by how often they are right, and
blocks that were erased tell nothing. Six films of `hidden`, six of `fast` and three of `robust`
were read, 135, 64 and 15 frame pairs. The 95 % interval of a mean is ± 0.5 at its widest and ± 0.1
at most over the bright levels of `hidden`, ± 0.4 and 0.3 of `fast`, and ± 0.2 of `robust`: cameras
differ more than levels do."""
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
    [0.63, 0.7, 0.98]
    """
    levels = cv2.resize(as_gray(picture), SHRUNK_PX, interpolation=cv2.INTER_AREA)
    table = CARRIED[preset]
    return float(np.interp(levels, list(table), list(table.values())).mean())
