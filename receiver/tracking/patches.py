"""Follow the display from frame to frame; find it again when it was lost.

A part of the display may lie outside the image. A search for a lost display takes the time of many
frames, so it goes in steps (`link.steps`), of which each frame takes some. What it finds
in the frame with which it began is then looked for once more in the frame at hand.
"""

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from link.errors import InputError
from link.geometry import frame_corners
from link.images import as_gray
from link.layout import Layout
from link.steps import Steps
from link.types import Corners, Image
from receiver.locate.candidates import Located
from receiver.locate.find import is_at, search_steps
from receiver.locate.patches import image_pyramid, patches_in_view, seen_correlation
from receiver.locate.refine import corners_on_patches, needed_correlation
from receiver.seen import SeenFrame
from receiver.tracking.follow import Follower

FOLLOWED_CORRELATION = 0.7
"""Smallest `receiver.locate.patches.seen_correlation` of a followed display."""
QUICK_WORK, SLOW_WORK = 60, 8
"""Units of work (`link.steps`) after which a frame takes no further step of a search: of the
first one after the display was lost or the image has changed, and of later ones, so that there is
time for other trackers."""
SAVED_WORK, MOST_SAVED = 4, 600
"""Units of work that each frame saves for quick searches, and how much is saved at most: a whole
search. Where an image changes all the time, none begins until the one before has been saved."""
THUMBNAIL_PX = 32
"""Width and height, in pixels, of the thumbnails that tell whether the image has changed."""
CHANGED_LEVELS, CHANGED_SHARE = 16.0, 0.03
"""Gray levels by which a thumbnail's pixel differs where something has changed, and share of such
pixels at which the image counts as changed: the smallest display that is found covers as much."""
ASIDE_S = 10.0
"""Time, in seconds, for which a place that was set aside is not found again."""


class Tracker:
    """Finds a display by its ratex patches, and follows it as long as these are seen.

    Args:
        layout: layout with at least one ratex patch.

    Raises:
        InputError: the layout has none; without them nothing tells which way up the display is.
    """

    def __init__(self, layout: Layout) -> None:
        if not layout.ratex:
            raise InputError(
                "the model's layout has no ratex patches; a receiver needs patches to find and "
                "follow the display"
            )
        self.layout = layout
        self._follower = Follower(layout)
        self._search: Steps[Located | None] | None = None
        self._searched: tuple[int, ...] = ()
        self._is_quick, self._saved = True, MOST_SAVED
        self._thumbnail: NDArray[np.float32] | None = None
        self._aside: list[tuple[float, Corners]] = []
        self._elsewhere = False

    def set_aside(self, time: float, *, forget: bool) -> None:
        """Look elsewhere, too, with the next frame, because what is followed does not toggle.

        Args:
            time: time of the frame, seconds.
            forget: whether it is followed no more, because another display was found.
        """
        corners = self._follower.corners
        if corners is not None:
            kept = [(at, place) for at, place in self._aside if not is_at(corners, [place])]
            self._aside, self._elsewhere = [*kept, (time, corners)], True
            self._is_quick = False
        if forget:
            self.lose()

    def lose(self) -> None:
        """Follow nothing any more."""
        self._follower.corners = None
        self._search, self._is_quick = None, True

    def follow(self, image: Image, time: float) -> SeenFrame | None:
        """Find the display in the next frame.

        Args:
            image: an `Image`.
            time: time of the frame, seconds; rising from frame to frame.

        Returns:
            the display, or None where it is not in view.
        """
        elsewhere, self._elsewhere = self._elsewhere, False
        self._aside = [(at, place) for at, place in self._aside if time - at < ASIDE_S]
        if self._follower.corners is not None:
            step = self._follower.step(image)
            found = None
            if step is not None:
                self._follower.advance(step[0])
                found = self._accept(image, time, *step)
            if found is not None:
                other = self._look(image, time) if elsewhere else None
                return found if other is None else replace(other, anew=True)
            self.lose()
        return self._look(image, time)

    def _look(self, image: NDArray[np.uint8], time: float) -> SeenFrame | None:
        """Take some steps of a search, and begin one where none is under way."""
        if self._searched != image.shape[:2]:
            self._search = None
        fresh = self._search is None
        if self._search is None:
            self._searched = image.shape[:2]
            whole = frame_corners(image.shape[1], image.shape[0])  # a screenshot, or rectified
            found = None if self._is_aside(whole) else self._accept(image, time, whole, True)
            if found is not None:
                return found
            self._search = self._begun(image)
        limit, work = self._work_limit(image), 0
        try:
            while work < limit:
                work += next(self._search)
        except StopIteration as end:
            located: Located | None = end.value
            self._search = None
            self._is_quick = False
            if located is None:
                return None
            corners = located.corners
            if not fresh:  # the camera has moved since
                pyramid = image_pyramid(as_gray(image))
                corners, seen = corners_on_patches(image, pyramid, corners, self.layout)
                if seen < needed_correlation(self.layout):
                    return None
            return None if self._is_aside(corners) else self._accept(image, time, corners, True)
        return None

    def _begun(self, image: NDArray[np.uint8]) -> Steps[Located | None]:
        """Begin a search in a frame, for what was not set aside."""
        return search_steps(image.copy(), self.layout, avoid=[place for _, place in self._aside])

    def _is_aside(self, corners: Corners) -> bool:
        """Tell whether a place was set aside."""
        return is_at(corners, [place for _, place in self._aside])

    def _work_limit(self, image: NDArray[np.uint8]) -> int:
        """Say after how many units of work this frame takes no further step of the search."""
        self._saved = min(self._saved + SAVED_WORK, MOST_SAVED)
        if not self._is_quick and self._saved > 0:
            gray = as_gray(image[::4, ::4])
            small = cv2.resize(gray, (THUMBNAIL_PX, THUMBNAIL_PX), interpolation=cv2.INTER_AREA)
            if self._thumbnail is None:  # of the image with which the slow searches begin
                self._thumbnail = np.asarray(small, np.float32)
            changed = np.abs(small - self._thumbnail) > CHANGED_LEVELS
            if changed.mean() >= CHANGED_SHARE:  # what was looked at is no longer what is seen
                self._search, self._is_quick = self._begun(image), True
        if not self._is_quick:
            return SLOW_WORK
        self._thumbnail = None
        self._saved -= QUICK_WORK
        return QUICK_WORK

    def _accept(
        self, image: NDArray[np.uint8], time: float, corners: Corners, fresh: bool
    ) -> SeenFrame | None:
        """Believe that the display is there if its patches are seen."""
        seen = self._follower.see(image, time, corners)
        if seen is None:
            return None
        in_view = patches_in_view(corners, self.layout, image.shape)
        if seen_correlation(seen.match.correlation, in_view) < FOLLOWED_CORRELATION:
            return None
        if fresh:
            self._follower.begin(image, corners, seen.rectified)
        return seen
