"""What the receiver notes: the time spent in each stage, and sums of what the frames show."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from link.clock import DisplayClock
from receiver.diagnosis import CLIPPED, CUT
from receiver.seen import SeenFrame


@dataclass
class StageTimes:
    """Time that was spent in each of some stages, such as those of the receiver.

    >>> timing = StageTimes()
    >>> with timing.stage("nothing"):
    ...     pass
    >>> timing.spent["nothing"] < 1, timing.count
    (True, {'nothing': 1})
    """

    spent: dict[str, float] = field(default_factory=dict)
    """Seconds spent in each stage, by its name."""
    count: dict[str, int] = field(default_factory=dict)
    """Number of times that each stage ran, by its name."""

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Add the time that the statements of a ``with`` take to a stage."""
        start = perf_counter()
        yield
        self.spent[name] = self.spent.get(name, 0.0) + perf_counter() - start
        self.count[name] = self.count.get(name, 0) + 1


@dataclass
class Sight:
    """Sums of what the frames show, for the reason why no message came."""

    found: bool = False
    """Whether the display was found. Before, whole frames are measured; after, it alone is."""
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
    state_hz: float | None = None
    """Number of states a second by the clock that was known last, or None where none was."""
    exposed: float = 0.0
    """Length of an exposure by that clock, in states."""

    def take(
        self, frame: NDArray[np.uint8], seen: SeenFrame | None, clock: DisplayClock | None
    ) -> None:
        """Take a camera frame, what is seen of the display in it, and the clock known by then."""
        if seen is not None:
            if not self.found:
                self.found, self.first = True, seen.time
                self.measured, self.level, self.clipped = 0, 0.0, 0.0
            self.last = seen.time
            self.cut += seen.in_view is not None and float(seen.in_view.mean()) < CUT
            if clock is not None:
                self.state_hz, self.exposed = 1 / clock.period, clock.shutter / clock.period
        elif self.found:
            return
        sample = (frame if seen is None else seen.rectified)[::8, ::8]
        self.measured += 1
        self.level += float(sample.mean())
        self.clipped += float((sample >= CLIPPED).mean())
