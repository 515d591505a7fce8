"""Frames in which the display was seen: one record of each, in one store that every stage reads."""

from collections import deque
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from link.clock import DisplayClock
from link.geometry import homography_from_corners, in_image, transform
from link.layout import Layout
from link.pilots import pilot_values
from link.ratex import PatchMatch, match_patches
from link.types import Corners, Image, Map, Real
from models.film.window import shrunk_gray
from receiver.timing.toggles import patch_toggles
from receiver.tracking.corners import Placement

MOST_WHOLE = 256
"""Largest number of frames that are kept whole. Most are kept while the clock is unknown: each
takes 0.8 MB where a display is rectified to 512 x 384 pixels in colours, so 200 MB together. Once
frames are read, some 40 are kept."""
MOST_TOGGLES = 1024
"""Largest number of frames whose toggles are kept: the work of a search for a clock grows with its
square. Toggles of a frame take 5 kB at most."""
MESH = 16
"""Number of points along each side of the display at which exposure is worked out."""
PLACES = np.stack(np.meshgrid(*2 * [(np.arange(MESH) + 0.5) / MESH]), axis=-1).reshape(
    -1, 2
)  # (MESH, MESH, 2) -> (MESH MESH, 2)
"""Points of the display, x and y in [0, 1], at which exposure is worked out."""


@dataclass(frozen=True, eq=False)
class SeenFrame:
    """A camera frame in which the display was seen. What is measured in it is measured once."""

    layout: Layout
    """Layout of the display."""
    time: float
    """Seconds of the camera's clock."""
    corners: Corners
    """Corners of the display, in pixels of the camera frame."""
    rectified: Image
    """The display, an `Image` of the layout's size."""
    in_view: NDArray[np.bool_] | None = None
    """(MESH, MESH) whether each point of the display lies within the camera frame; None where the
    whole display does."""
    placement: Placement | None = None
    """Correction of the corners by the blocks decoded so far; None for layouts with patches."""
    followed: int = 0
    """Number of frames for which a display with pilots has been followed since it was found."""
    anew: bool = False
    """Whether the display was found in this frame, and not followed from the frame before: by its
    pilots, or at another place than the display that was followed."""
    before: tuple["SeenFrame", ...] = ()
    """Earlier frames that show the display, if it was found by its pilots in this one."""
    clock: DisplayClock | None = None
    """Clock of a display that was found by its pilots' code in this frame, else None."""

    @cached_property
    def match(self) -> PatchMatch:
        """Comparison of the frame's ratex patches, if there are any, with those displayed."""
        return match_patches(self.rectified, self.layout)

    @cached_property
    def toggles(self) -> Real:
        """(V,) gray levels by which this frame shows that pilots or patches toggle.

        These are the values of the pilots (`link.pilots.pilot_values`), or the toggles of the
        patches (`receiver.timing.toggles.patch_toggles`), NaN where something covers a patch.
        """
        if self.layout.pilots:
            return pilot_values(self.rectified, self.layout)
        return patch_toggles(self.match)

    @cached_property
    def shrunk(self) -> Map:
        """The display as windows of film have it (`models.film.window.shrunk_gray`)."""
        return shrunk_gray(self.rectified)

    @cached_property
    def blocks_in_view(self) -> Map:
        """Blocks of the display, (rows, cols) float32: 1 if wholly within the frame, else 0."""
        rows, cols = self.layout.rows, self.layout.cols
        if self.in_view is None:
            return np.ones((rows, cols), np.float32)
        in_view = self.in_view.astype(np.float32)
        shares = cv2.resize(in_view, (cols, rows), interpolation=cv2.INTER_AREA)
        return np.asarray(shares > 1 - 1e-6, np.float32)


class SeenFrames:
    """The frames in which the display was seen, the oldest first.

    A frame is kept whole until its frame pairs have been read; of earlier ones, time and toggles
    are kept. Every stage remembers itself up to which time it has read.
    """

    def __init__(self) -> None:
        self.whole: deque[SeenFrame] = deque(maxlen=MOST_WHOLE)
        """The newest frames, from the first on that is not read yet."""
        self.toggles: deque[tuple[float, Real]] = deque(maxlen=MOST_TOGGLES)
        """Times, in seconds, and toggles (V,) of the newest frames that show any."""

    @property
    def newest(self) -> float:
        """Time of the newest frame, seconds; minus infinity where none is kept."""
        return self.whole[-1].time if self.whole else -np.inf

    def add(self, frame: SeenFrame) -> None:
        """Keep a frame, later than those before."""
        self.whole.append(frame)
        if np.isfinite(frame.toggles).any():
            self.toggles.append((frame.time, frame.toggles))

    def after(self, time: float) -> list[SeenFrame]:
        """List the frames later than a time, in seconds."""
        return [frame for frame in self.whole if frame.time > time]

    def end(self, clock: DisplayClock, now: float) -> float:
        """Give the number of the state up to which no later frame can show anything.

        Args:
            clock: says when the display shows which state.
            now: time of the newest frame, seconds; infinite where the frames have ended.
        """
        return clock.number(self.newest + clock.latest if np.isinf(now) else now + clock.earliest)

    def let_go(self, time: float) -> None:
        """Keep no frame whole that is not later than a time, in seconds."""
        while self.whole and self.whole[0].time <= time:
            self.whole.popleft()


def points_in_view(corners: Corners, shape: tuple[int, ...]) -> NDArray[np.bool_] | None:
    """Tell which points of the display lie within a camera frame.

    Args:
        corners: pixels of the camera frame.
        shape: shape of the camera frame, height and width first.

    Returns:
        (MESH, MESH), or None where the whole display lies within the frame.
    """
    if in_image(corners, shape).all():
        return None
    H_captured_from_display = homography_from_corners(corners, MESH, MESH)
    points = transform(H_captured_from_display, MESH * PLACES - 0.5)
    return np.asarray(in_image(points, shape).reshape(MESH, MESH))
