"""Find a display by its pilots, over some frames of a film: nothing visible marks it.

A search looks at a window of some tenths of a second (`window_search`). Once it has looked at
edges, the next window begins, so that a display need not wait for the end of the first one.

The first window takes pictures to stand still, the next one takes them to move, as a video does,
and so on by turns. Where they are taken to move, frames are held still by the room alone, and what
has only moved is taken off them (`receiver.pilots.compensate`). The work is cut into steps, one or
two for each frame, so that no frame takes long.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil

from link.clock import DisplayClock
from link.errors import InputError
from link.images import as_gray
from link.layout import Layout
from link.types import Corners, Image
from receiver.pilots.search.film import HeldFrame
from receiver.pilots.search.settle import Detection
from receiver.pilots.search.watch import NEXT_FRAME, Observer, Watch
from receiver.pilots.search.window_search import Search, WindowSearch

WINDOWS = 2
"""Largest number of windows in which a display is looked for at once: in one, while the next one is
watched."""
STEPS_HZ = 60.0
"""Number of steps of the search that are done in a second, at least: the frames of a slow camera
leave time for several. What is proposed late takes half of them. Chosen by hand."""


@dataclass(frozen=True)
class PilotDisplay:
    """A display that was found by its pilots."""

    layout: Layout
    """Layout that the display shows, one of those that were looked for."""
    corners: Corners
    """Pixels of the newest frame, from the top left of the displayed picture on."""
    first_corners: Corners
    """Pixels of the frame with which the search began."""
    k: float
    """Coefficient of the lens (`link.geometry.Lens`)."""
    clock: DisplayClock | None
    """Clock of a display with a code, in seconds of the camera's time; None for other displays."""
    picture_moves: bool
    """Whether the display's picture was taken, or seen, to move by itself."""
    held: tuple[HeldFrame, ...]
    """The frames before the newest one, from the oldest on, of those that are kept."""


class PilotSearch:
    """Looks for a display that shows one of several layouts with pilots.

    Args:
        layouts: layouts that are looked for, at least one, each with pilots.
        fps: nominal number of frames of the camera in a second; some may be missing.
        observer: takes what becomes of each place that is tried, if anybody asks.

    Raises:
        InputError: a layout has no pilots.
    """

    def __init__(
        self, layouts: Sequence[Layout], fps: float = 30.0, observer: Observer | None = None
    ) -> None:
        if not layouts or any(layout.pilots == 0 for layout in layouts):
            raise InputError("layouts: need at least one, each with pilots")
        self.layouts, self._fps, self._observer = tuple(layouts), fps, observer
        self._steps = max(1, round(STEPS_HZ / fps))
        self.picture_moves = False
        """Whether the picture of the display that was found last was taken, or seen, to move."""
        self._begun = 0  # number of the next window, from the last display on
        # steps hold their window, which knows nothing of them: it is freed where it is dropped
        self._windows: dict[WindowSearch, Search] = {}

    def push(self, image: Image, time: float) -> PilotDisplay | None:
        """Take the next frame.

        Args:
            image: an `Image`.
            time: time of the frame, seconds; rising from frame to frame.

        Returns:
            the display once it is detected, else None.
        """
        gray = as_gray(image)
        for window in tuple(self._windows):
            if not window.watch.take(gray, time):
                del self._windows[window]
                if not window.watch.frames:  # what began with a blank frame does not count
                    self._begun -= 1
        if len(self._windows) < WINDOWS and all(w.has_looked for w in self._windows):
            self._begin(image, time)
        left = self._steps
        for window in sorted(
            self._windows, key=lambda w: (not w.is_settling, w.is_late, not w.waiting)
        ):
            if window.is_late and not window.is_settling:
                left = ceil(left / 2)
            while left > 0:
                try:
                    work = next(self._windows[window])
                except StopIteration as end:
                    return self._ended(end.value, window)
                if work == NEXT_FRAME:
                    break
                left -= work
        return None

    def doubt_picture(self) -> None:
        """Take pictures in the next window for what the last display's was not taken for.

        They move if it was taken to stand still, and stand still if it was taken to move. That may
        have been wrong, because the display has been lost.
        """
        self._begun = int(not self.picture_moves)

    def _begin(self, image: Image, time: float) -> None:
        """Begin a window with a frame.

        By turns, windows take pictures to stand still and to move. After the first one, windows are
        longer.
        """
        number, self._begun = self._begun, self._begun + 1
        watch = Watch(
            image,
            time,
            self._fps,
            picture_moves=number % 2 == 1,
            longer=2 if number else 1,
            observer=self._observer,
        )
        window = WindowSearch(watch, self.layouts)
        self._windows[window] = window.steps()

    def _ended(self, detection: Detection | None, window: WindowSearch) -> PilotDisplay | None:
        """Say what was found in a window, and choose how the next one begins."""
        watch = window.watch
        if detection is None:
            del self._windows[window]
            return None
        self._begun, self._windows = 0, {}
        self.picture_moves = watch.picture_moves or watch.moves(detection.proposal.corners)
        proposal, (*held, newest) = detection.proposal, watch.held
        return PilotDisplay(
            layout=proposal.layout,
            corners=newest.corners(proposal.corners),
            first_corners=proposal.corners,
            k=detection.k,
            clock=proposal.toggling.clock_in_seconds(self._fps, watch.first.time),
            picture_moves=self.picture_moves,
            held=tuple(held),
        )
