"""How a lens bends a display, in views that were rectified as if it bent nothing."""

from dataclasses import dataclass

import cv2
import numpy as np

from export.locate.pilots.motion import POWERS, UNIT_CORNERS, pixels_from_unit
from link.geometry import Lens, homography_from_corners, transform
from link.types import Array, Corners, Homography, Map

K_STEP = 1e-3
"""Change of a lens's coefficient by which it is found how places of the display move with it."""


@dataclass(frozen=True, eq=False)
class BentDisplay:
    """A display in views that were rectified by the corners at which the lens shows it.

    Displays go from -1 to 1 along both axes. The lens moves the places between the corners; the
    corners themselves stay where they are seen.

    >>> corners = np.array([[0.0, 0.0], [99.0, 0.0], [99.0, 79.0], [0.0, 79.0]])
    >>> bending = BentDisplay(corners, (100, 80)).bending(np.eye(3), 0.0)
    >>> bending[:, 0, 0].round(3).tolist()  # of the centre, which stays
    [0.0, 0.0]
    """

    corners: Corners
    """Pixels of the image by which the views were rectified."""
    image_size: tuple[int, int]
    """Width and height of the image, pixels."""

    def before_lens(self, H_old_from_new: Homography, k: float) -> tuple[Lens, Homography]:
        """Make a lens, and the homography from the display to an image without distortion.

        Args:
            H_old_from_new: where the display's corners lie in the views, from -1 to 1.
            k: coefficient of the lens.

        Returns:
            the lens, and ``H_straight_from_new``.
        """
        lens = Lens(k, self.image_size)
        corners = transform(self._captured_from_old @ H_old_from_new, UNIT_CORNERS)
        return lens, lens.homography(corners, 2, 2) @ pixels_from_unit(2, 2)

    def seen_at(
        self, H_old_from_new: Homography, k: float, map_from_unit: Array, size: tuple[int, int]
    ) -> tuple[Map, Map]:
        """Find where in the views the pixels of a map of the display are seen, x and y.

        Args:
            H_old_from_new: where the display's corners lie in the views, from -1 to 1.
            k: coefficient of the lens.
            map_from_unit: (3, 3) homography to pixels of maps and views.
            size: width and height of the maps, pixels.
        """
        lens, H_straight_from_new = self.before_lens(H_old_from_new, k)
        captured = lens.seen_at(H_straight_from_new @ np.linalg.inv(map_from_unit), size)
        H_view_from_captured = map_from_unit @ np.linalg.inv(self._captured_from_old)
        x, y = cv2.split(cv2.perspectiveTransform(cv2.merge(captured), H_view_from_captured))
        return np.asarray(x, np.float32), np.asarray(y, np.float32)

    def bending(self, H_old_from_new: Homography, k: float) -> Array:
        """Find how places of the display move for each unit of the lens's coefficient.

        Args:
            H_old_from_new: where the display's corners lie in the views, from -1 to 1.
            k: coefficient of the lens.

        Returns:
            (2, `POWERS`, `POWERS`) factors of powers of y, by rows, and of x: for the motion along
            x, and for that along y.
        """
        nodes = np.linspace(-1, 1, POWERS)
        # (POWERS, POWERS, 2) -> (POWERS POWERS, 2)
        places: Array = np.stack(np.meshgrid(nodes, nodes), axis=-1).reshape(-1, 2)
        lens, H = self.before_lens(H_old_from_new, k)
        stronger, H_stronger = self.before_lens(H_old_from_new, k + K_STEP)
        there = lens.undistort(stronger.distort(transform(H_stronger, places)))
        motion = (transform(np.asarray(np.linalg.inv(H), np.float64), there) - places) / K_STEP
        from_values = np.linalg.inv(np.vander(nodes, increasing=True))
        # (POWERS POWERS, 2) -> (2, POWERS, POWERS)
        return np.asarray(from_values @ motion.T.reshape(2, POWERS, POWERS) @ from_values.T)

    @property
    def _captured_from_old(self) -> Homography:
        """(3, 3) homography from the display in the views, from -1 to 1, to the image."""
        return homography_from_corners(self.corners, 2, 2) @ pixels_from_unit(2, 2)
