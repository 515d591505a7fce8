"""Frames of a film that are kept, and what they show of a display."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from link.geometry import (
    corners_apart,
    homography_from_corners,
    homography_from_points,
    rectify,
    resized_homography,
    transform,
)
from link.layout import Layout
from link.types import Array, Corners, Gray, Homography
from receiver.pilots.motion import GridMaps
from receiver.pilots.outline import Border, Outline
from receiver.pilots.stabilise import Tracks

FAR_OUTSIDE = 0.5
"""Share of the image's size by which a corner may lie outside of it: farther off, corners were
moved amiss. Chosen by hand, above `receiver.locate.refine.OUTSIDE`."""
LEAST_AREA = 0.005
"""Smallest share of the image that a display covers: some 90 by 50 px of 1280 x 720. Chosen by
hand."""

OUTLINE_WIDTH = 96
"""Width, in pixels, of the views in which quadrilaterals are followed by what surrounds them. It
bounds the work; chosen by hand."""
VOTES = 3
"""Number of frames, less those that speak against it, that must show that a picture moves."""
APART, ABOUT = 0.006, 0.25
"""Distance, as a share of the square root of a quadrilateral's area, from which on its picture and
what surrounds it move in different ways, and within which what surrounds it tells of other corners,
too: a third of a block of the finest grids, and a frame around the picture. Chosen by hand."""


@dataclass(frozen=True, eq=False)
class HeldFrame:
    """A frame, and how what it shows has moved since a reference frame.

    A camera that moves sideways sees what is near move farther than what is behind it (parallax).
    So a display is held still by the points within it, and only where they do not suffice, by the
    room.
    """

    gray: Gray
    """The frame's gray image."""
    H_image_from_reference: Homography
    """Homography that maps points of the reference to where most of them lie in the frame."""
    at: float
    """Its position since the reference (`receiver.pilots.waves.position`)."""
    time: float
    """Time at which the frame was taken, in seconds."""
    tracks: Tracks | None = None
    """Points of the reference that were found again in it; None to go by the room alone, because
    pictures may move."""
    surrounded: tuple["Surrounded", ...] = ()
    """Quadrilaterals that are followed by what lies around them, too, with where they lie here."""
    changes: Gray | None = None
    """What a small copy of the frame shows beyond what has moved, as
    `receiver.pilots.compensate.Compensator` returns it; None to look at the frame itself."""

    def corners(self, corners: Corners) -> Corners:
        """Find where a display lies.

        Args:
            corners: pixels of the reference frame.

        Returns:
            pixels of this frame.
        """
        around = surroundings_of(corners, self.surrounded)
        if around is not None and around.outline.picture_moves:
            return transform(around.motion, corners)
        own = None if self.tracks is None else self.tracks.motion_within(corners)
        return transform(self.H_image_from_reference if own is None else own, corners)

    def view(self, corners: Corners, layout: Layout) -> Gray | None:
        """Rectify a display to the layout's size.

        Args:
            corners: pixels of the reference frame.
            layout: layout of the display.

        Returns:
            (height, width) uint8, or None where the corners make no sound quadrilateral near the
            image.
        """
        H = self._homography(corners, layout)
        return None if H is None else self._rectified(H, layout.width, layout.height)

    def block_view(self, corners: Corners, maps: GridMaps) -> Gray | None:
        """Rectify a display with what lies around it to the size of maps of its blocks.

        Args:
            corners: pixels of the reference frame.
            maps: maps of the display's layout.

        Returns:
            uint8 of ``maps.size``, or None where the corners make no sound quadrilateral near the
            image.
        """
        H = self._homography(corners, maps.layout)
        if H is None:
            return None
        shrunk = maps.layout.width // maps.inner[0]
        H_map_from_fine = resized_homography(1 / shrunk, 1 / shrunk)
        width, height = (shrunk * side for side in maps.size)
        fine = self._rectified(H @ maps.to_layout() @ H_map_from_fine, width, height)
        return np.asarray(cv2.resize(fine, maps.size, interpolation=cv2.INTER_AREA), np.uint8)

    def _rectified(self, H: Homography, width: int, height: int) -> Gray:
        """Rectify the frame, or what it shows beyond what has moved; H leads to its pixels."""
        shown = self.gray if self.changes is None else self.changes
        y, x = np.divide(shown.shape, self.gray.shape)
        return rectify(shown, resized_homography(x, y) @ H, width, height)

    def _homography(self, corners: Array, layout: Layout) -> Homography | None:
        """Find where pixels of a display lie here; None where its corners are not sound."""
        quad = self.corners(corners)
        size = np.array(self.gray.shape[::-1])
        if not ((quad > -FAR_OUTSIDE * size).all() and (quad < (1 + FAR_OUTSIDE) * size).all()):
            return None
        outline = np.asarray(quad, np.float32)
        least = LEAST_AREA * self.gray.size
        if not cv2.isContourConvex(outline) or cv2.contourArea(outline) < least:
            return None
        return homography_from_corners(quad, layout.width, layout.height)


@dataclass(frozen=True, eq=False)
class Surrounded:
    """The place of a quadrilateral in a frame, found by what surrounds it."""

    outline: "MovingOutline"
    """Outline that follows the quadrilateral."""
    motion: Homography
    """Homography from the reference to the frame."""


def surroundings_of(corners: Corners, near: Sequence[Surrounded]) -> Surrounded | None:
    """Choose the quadrilateral that is nearest to corners of the reference; None where none is."""
    nearest = min(near, key=lambda each: each.outline.distance(corners), default=None)
    return nearest if nearest and nearest.outline.distance(corners) <= ABOUT else None


class MovingOutline:
    """Follows a quadrilateral by what surrounds it, and notices where its picture moves.

    Args:
        gray: the reference frame.
        quad: (4, 2) pixels of it.
    """

    def __init__(self, gray: Gray, quad: Corners) -> None:
        self.quad = quad
        """(4, 2) pixels of the reference."""
        self.size = float(np.sqrt(cv2.contourArea(quad.astype(np.float32))))
        """Square root of the quadrilateral's area, pixels."""
        self._votes = 0
        self._distances: dict[bytes, float] = {}
        self._outline = Outline(gray, quad, OUTLINE_WIDTH)
        self._border = Border(gray, quad)

    @property
    def picture_moves(self) -> bool:
        """Whether the quadrilateral's picture has moved in another way than what surrounds it."""
        return self._votes >= VOTES

    def distance(self, corners: Corners) -> float:
        """Tell how far corners are from those of the quadrilateral, as a share of its size.

        It is asked several times a frame of the same corners, so it is kept.
        """
        key = corners.tobytes()
        if key not in self._distances:
            self._distances[key] = corners_apart(corners, self.quad) / self.size
        return self._distances[key]

    def take(self, gray: Gray, shown: Corners | None) -> Surrounded | None:
        """Find the quadrilateral in the next frame; None where its surroundings do not tell.

        Args:
            gray: the frame.
            shown: pixels of the frame where the points within it say that it lies, if they agree.
        """
        if not self._outline.is_clear:
            return None
        corners = self._outline.follow(gray)
        if corners is None and shown is not None:
            corners = self._outline.follow(gray, shown)
        if corners is None:
            return None
        if shown is None:
            self._votes += 1
        elif float(np.abs(corners - shown).max()) > APART * self.size:
            self._votes += self._border.is_rather(gray, corners, shown)
            self._votes -= self._border.is_rather(gray, shown, corners)
        return Surrounded(self, homography_from_points(self.quad, corners))


def positions(frames: Sequence[HeldFrame]) -> list[float]:
    """List the frames' positions since the reference."""
    return [frame.at for frame in frames]


def rectified_views(
    corners: Array, layout: Layout, frames: Sequence[HeldFrame], size: tuple[int, int]
) -> NDArray[np.float32] | None:
    """Rectify all frames to maps of a size, (frames, h, w); None where corners are not sound."""
    views = []
    for frame in frames:
        view = frame.view(corners, layout)
        if view is None:
            return None
        views.append(cv2.resize(view, size, interpolation=cv2.INTER_AREA))
    return np.array(views, np.float32)
