"""Find a display by its pilots, and follow it."""

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np

from link.layout import Layout
from link.types import Array, Image
from receiver.pilots.search.pilot_search import PilotDisplay, PilotSearch
from receiver.seen import SeenFrame
from receiver.tracking.follow import Follower

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
        self._follower: Follower | None = None
        self._followed = 0

    def set_aside(self, time: float, *, forget: bool) -> None:
        """Look for the display anew, because what is followed gives nothing to read.

        Neither argument matters: pilots are found only where they toggle.
        """
        self._follower = None

    def lose(self, *, amiss: bool = True) -> None:
        """Follow nothing any more.

        Args:
            amiss: whether something else may have been followed in place of the display.
        """
        if amiss and self._followed <= SOON:
            self._search.doubt_picture()
        self._follower = None

    def follow(self, image: Image, time: float) -> SeenFrame | None:
        """Find the display in the next frame, or return None where it is not in view."""
        if self._follower is None:
            found = self._search.push(image, time)
            return None if found is None else self._begin(found, image, time)
        step = self._follower.step(image)
        seen = None if step is None else self._accept(self._follower, image, time, *step)
        if seen is None:
            self.lose(amiss=self._search.picture_moves)
            return None
        self._followed += 1
        return replace(seen, followed=self._followed)

    def _begin(self, found: PilotDisplay, image: Image, time: float) -> SeenFrame | None:
        """Begin to follow a display that was found, and show it in the frames of the search."""
        follower = Follower(found.layout, found.k, picture_moves=found.picture_moves)
        seen = self._accept(follower, image, time, found.corners, fresh=True)
        if seen is None:
            return None
        self._follower, self._followed = follower, 0
        before = _seen_before(follower, found, image)
        return replace(seen, anew=True, before=before, clock=found.clock)

    def _accept(
        self, follower: Follower, image: Image, time: float, corners: Array, fresh: bool
    ) -> SeenFrame | None:
        """Believe that the display is where the motion of its points puts it, if that is sound."""
        seen = follower.see(image, time, corners)
        reference = follower.rectified(image, corners) if fresh else None
        if seen is None or (fresh and reference is None):
            return None
        follower.advance(corners)
        if reference is not None:
            follower.begin(image, corners, reference)
        return seen


def _seen_before(follower: Follower, found: PilotDisplay, image: Image) -> tuple[SeenFrame, ...]:
    """Show a display in the frames of its search, with as many channels as an image."""
    before: list[SeenFrame] = []
    for held in found.held:
        seen = follower.see(held.gray, held.time, held.corners(found.first_corners))
        if seen is None:
            before.clear()
        elif image.ndim == 2:
            before.append(seen)
        else:
            rgb = cv2.cvtColor(seen.rectified, cv2.COLOR_GRAY2RGB)
            before.append(replace(seen, rectified=np.asarray(rgb, np.uint8)))
    return tuple(before)
