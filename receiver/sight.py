"""What the receiver notes: the time spent in each stage, and sums of what the frames show."""

from dataclasses import dataclass, field
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from receiver.diagnosis import CLIPPED, CUT


@dataclass
class StageTimes:
    """Time that the receiver has spent in each of its stages."""

    spent: dict[str, float] = field(default_factory=dict)
    """Seconds spent in each stage, by its name."""
    count: dict[str, int] = field(default_factory=dict)
    """Number of times that each stage ran, by its name."""

    def add(self, stage: str, since: float) -> None:
        """Add the time since ``since`` (of `perf_counter`) to a stage."""
        self.spent[stage] = self.spent.get(stage, 0.0) + perf_counter() - since
        self.count[stage] = self.count.get(stage, 0) + 1


@dataclass
class Sight:
    """Sums of what the frames show, for the reason why no message came."""

    found: bool = False
    """Whether the display was found; until then whole frames are measured, and then it alone."""
    measured: int = 0
    """Number of frames measured."""
    level: float = 0.0
    """Sum of the mean gray levels of what was measured."""
    clipped: float = 0.0
    """Sum of the shares of pixels at the camera's limit."""
    cut: int = 0
    """Number of frames with a part of the display outside the image."""
    first: float = 0.0
    """Time of the first frame with the display, seconds."""
    last: float = 0.0
    """Time of the last frame with the display, seconds."""
    mixed: float = 0.0
    """Sum over frame pairs of the share of the blocks' trust that mixed exposures cost."""
    state_hz: float | None = None
    """Number of states a second by the clock that was known last, or None where none was."""
    exposed: float = 0.0
    """Length of an exposure by that clock, in states."""

    def miss(self, frame: NDArray[np.uint8]) -> None:
        """Take a frame in which the display was not found."""
        if not self.found:
            self._measure(frame)

    def see(
        self, rectified: NDArray[np.uint8], time: float, in_view: NDArray[np.bool_] | None
    ) -> None:
        """Take a frame in which the display was found."""
        if not self.found:
            self.found, self.first = True, time
            self.measured, self.level, self.clipped = 0, 0.0, 0.0
        self.last = time
        self.cut += in_view is not None and float(in_view.mean()) < CUT
        self._measure(rectified)

    def _measure(self, image: NDArray[np.uint8]) -> None:
        sample = image[::8, ::8]
        self.measured += 1
        self.level += float(sample.mean())
        self.clipped += float((sample >= CLIPPED).mean())
