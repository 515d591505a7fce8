"""A camera frame of a film, and the truth about it."""

import json
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from link.types import Homography


@dataclass(frozen=True, eq=False)
class VideoFrame:
    """A camera frame and the truth about it."""

    rgb: NDArray[np.uint8]
    """Pixels of the frame, (H, W, 3), encoded RGB."""
    number: int
    """Number of the sensor's frame; lost frames are counted, too."""
    time_s: float
    """Time by the camera's own clock at which the first row opens, in seconds. It is number / fps,
    and a little more or less where the sensor jitters."""
    display_s: float
    """Time of the loop, in seconds by the display's clock, at which the first row opens."""
    H_captured_from_display: Homography
    """Homography from display pixels to pixels of the frame."""
    states: dict[int, float]
    """Share of each state in the light of the display's part of the image; they sum to 1. State k
    is number k modulo the loop's length; in a frame without display, what it would have shown."""
    visible: bool
    """Whether the whole picture lies within the image; someone may stand before it all the same."""
    duplicate: bool
    """Whether ``rgb`` is that of the frame before."""

    def truth(self, file: str | None) -> str:
        """Return the truth about the frame as a line of JSON, with the name of its file if any."""
        line = {
            "file": file,
            "number": self.number,
            "time_s": round(self.time_s, 6),
            "display_s": round(self.display_s, 6),
            "states": {str(k): round(share, 4) for k, share in self.states.items()},
            "visible": self.visible,
            "duplicate": self.duplicate,
            "H_captured_from_display": self.H_captured_from_display.tolist(),
        }
        return json.dumps(line, allow_nan=False)
