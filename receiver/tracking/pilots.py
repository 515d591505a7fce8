"""Find a display by its pilots, follow it, and notice when it is no longer the display."""

from collections import deque
from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from link.layout import Layout
from link.pilots import pilot_values
from link.types import Array, Homography, Image
from receiver.pilots.motion import moved_corners
from receiver.pilots.search.pilot_search import PilotDisplay, PilotSearch
from receiver.pilots.toggling import find_toggling
from receiver.pilots.waves import position
from receiver.tracking.follow import Follower
from receiver.tracking.patches import Tracked

WATCHED = 48
"""Number of frames over which the pilots of a followed display are watched."""
CHECK_EVERY = 24
"""Number of frames from one look at the pilots to the next."""
LEAST_EVIDENCE = 4.0
"""Smallest evidence (`receiver.pilots.toggling.find_toggling`) at which the pilots are still
seen."""
PATIENCE = 3
"""Number of looks in a row without evidence after which the display counts as lost. One is enough
at the first look: pilots that were beyond doubt a moment ago are gone."""
SOON = 240
"""Number of frames within which a display that is found and lost again has probably been followed
by what did not move with it, its picture if that moves, or by a room in which nothing is seen."""


class PilotTracker:
    """Finds a display that shows one of several layouts with pilots, and follows it.

    Args:
        layouts: layouts that are looked for, at least one, each with pilots.
        fps: nominal number of frames of the camera in a second.

    Raises:
        InputError: a layout has no pilots.
    """

    def __init__(self, layouts: Sequence[Layout], fps: float) -> None:
        self._search = PilotSearch(layouts, fps)
        self._fps, self._start = fps, 0.0
        self.layout = layouts[0]
        self._follower = Follower(self.layout)
        self._H_followed_from_shown = np.eye(3)
        self._values: deque[NDArray[np.float32]] = deque(maxlen=WATCHED)
        self._at: deque[float] = deque(maxlen=WATCHED)
        self._count = self._missed = 0

    def correct(self, H_old_from_new: Homography) -> None:
        """Move the display within its rectified image, from the next frame on.

        Args:
            H_old_from_new: as `Tracker.correct` takes it.
        """
        H = self._H_followed_from_shown @ H_old_from_new
        self._H_followed_from_shown = H / H[2, 2]

    def set_aside(self, time: float, *, forget: bool) -> None:
        """Look for the display anew, because what is followed gives nothing to read.

        Neither argument matters: pilots are found only where they toggle.
        """
        self._follower.forget()

    def follow(self, image: Image, time: float) -> Tracked | None:
        """Find the display in the next frame, or return None where it is not in view."""
        if self._follower.corners is None:
            return self._look(image, time)
        step = self._follower.step(image)
        tracked = None if step is None else self._accept(image, step[0], fresh=step[1])
        if tracked is not None and self._still_there(tracked, time):
            return tracked
        followed_amiss = tracked is not None or self._search.picture_moves
        if followed_amiss and self._count <= SOON:
            self._search.doubt_picture()
        self._follower.forget()
        return None

    def _look(self, image: Image, time: float) -> Tracked | None:
        found = self._search.push(image, time)
        if found is None:
            return None
        self.layout, moves = found.layout, self._search.picture_moves
        self._follower = Follower(found.layout, found.k, picture_moves=moves)
        self._H_followed_from_shown = np.eye(3)
        self._start = time
        self._values.clear()
        self._at.clear()
        self._count = self._missed = 0
        tracked = self._accept(image, found.corners, fresh=True)
        if tracked is None:
            return None
        before = self._before(found, image)
        return replace(tracked, anew=True, before=before, clock=found.clock)

    def _before(self, found: PilotDisplay, image: Image) -> tuple[tuple[float, Tracked], ...]:
        """Show the display in the frames in which it was looked for, with as many channels."""
        shown: list[tuple[float, Tracked]] = []
        for frame in found.held:
            corners = frame.corners(found.first_corners)
            view = self._follower.rectified(frame.gray, corners)
            if view is None:
                shown.clear()
                continue
            view = view if image.ndim == 2 else cv2.cvtColor(view, cv2.COLOR_GRAY2RGB)
            shown.append((frame.time, Tracked(corners, np.asarray(view, np.uint8))))
        return tuple(shown)

    def _accept(self, image: Image, corners: Array, *, fresh: bool) -> Tracked | None:
        """Rectify the display where the motion of its points puts it."""
        follower = self._follower
        H, lens = self._H_followed_from_shown, follower.lens(image)
        shown = moved_corners(corners, H, follower.layout, lens)
        rectified = follower.rectified(image, shown)
        if rectified is None:
            return None
        if follower.corners is not None:
            follower.advance(corners)
        if fresh:
            reference = follower.rectified(image, corners)
            if reference is None:
                return None
            follower.begin(image, corners, reference)
        return Tracked(shown, rectified)

    def _still_there(self, tracked: Tracked, time: float) -> bool:
        """Look at the pilots from time to time, and tell whether they are still seen."""
        layout = self.layout
        self._values.append(pilot_values(tracked.rectified, layout))
        self._at.append(position(time - self._start, self._fps))
        self._count += 1
        if self._count % CHECK_EVERY or len(self._values) < WATCHED:
            return True
        evidence, _ = find_toggling(list(self._values), layout, list(self._at), self._fps)
        self._missed = 0 if evidence >= LEAST_EVIDENCE else self._missed + 1
        return self._missed < (PATIENCE if self._count > WATCHED else 1)
