"""The film as it is searched: small frames that are held still by the camera's motion."""

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from link.geometry import homography_from_corners, resized_homography, whole_factor
from link.types import Array


class Stills:
    """Frames that are held still, of which quadrilaterals are shown in small views."""

    def __init__(self) -> None:
        self._stills: list[NDArray[np.uint8]] = []
        self._shown: list[NDArray[np.uint8]] = []
        self._shrunk: dict[int, list[NDArray[Any]]] = {}

    def add(self, still: NDArray[np.uint8], changes: NDArray[np.uint8] | None = None) -> None:
        """Take the next frame.

        Args:
            still: (h, w) uint8, aligned with those before.
            changes: what views show instead of it, of the same shape; None to show the frame.
        """
        self._stills.append(still)
        self._shown.append(still if changes is None else changes)

    @property
    def frames(self) -> NDArray[np.uint8]:
        """All frames so far, (T, h, w) uint8."""
        return np.array(self._stills)

    def mean(self) -> NDArray[np.uint8]:
        """Average all frames so far, (h, w) uint8, rounded down."""
        return np.asarray(np.mean(self._stills, axis=0, dtype=np.float32), np.uint8)

    def views(
        self, quads: Sequence[Array], width: int, height: int, turn: int = 0, first: int = 0
    ) -> NDArray[Any]:
        """Show what a quadrilateral bounds in frames, (frames, height, width).

        Args:
            quads: (4, 2) pixels of the stills: one for all frames, or one for each of the first.
            width: width of the views, pixels.
            height: height of the views, pixels.
            turn: number of quarter turns after which they are upright.
            first: number of the first frame that is shown.
        """
        factor = whole_factor(np.roll(quads[0], -turn, axis=0), width, height)
        copies = self._copies(factor)
        H_copy_from_still = np.linalg.inv(resized_homography(factor, factor))
        places = [*quads] * len(copies) if len(quads) == 1 else quads
        how, size = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP, (width, height)
        views = []
        for copy, quad in zip(copies[first:], places[first:], strict=False):
            corners = np.roll(quad, -turn, axis=0)
            H = H_copy_from_still @ homography_from_corners(corners, width, height)
            view = cv2.warpPerspective(copy, H, size, flags=how, borderMode=cv2.BORDER_REPLICATE)
            views.append(view)
        return np.array(views)

    def _copies(self, factor: int) -> Sequence[NDArray[Any]]:
        """Average all that views show down by a whole factor, without rounding; 1 leaves them."""
        shrunk = self._shown if factor == 1 else self._shrunk.setdefault(factor, [])
        for still in self._shown[len(shrunk) :]:
            rows, cols = (side // factor for side in still.shape)
            whole = np.float32(still[: rows * factor, : cols * factor])
            shrunk.append(cv2.resize(whole, (cols, rows), interpolation=cv2.INTER_AREA))
        return shrunk
