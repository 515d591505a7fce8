"""Fit the corners of a display to parts of a pixel, by all of its blocks.

Pilots are one block in twenty. The other blocks toggle as well: in each period of the toggling,
which shows one frame pair, a block changes as a whole, in one direction or in the other. The bit
that decides the direction is not known, and it need not be. Where the grid lies about right, the
mean change of a block tells its direction. Then the edges between blocks that change in different
directions, and the border of the display, tell where the grid lies exactly. So both are estimated
in turn: the change of every block from its pixels, and a small motion of the whole grid from the
edges (expectation-maximisation; the motion as Lucas & Kanade 1981 do).
"""

from collections.abc import Sequence

import cv2
import numpy as np

from link.geometry import Lens, transform
from link.layout import Layout
from link.pilots import pilot_signs
from link.steps import Steps
from link.types import Array, Corners, Gray, Map
from receiver.pilots.motion import (
    UNIT_CORNERS,
    GridMaps,
    MotionEquations,
    pixels_from_unit,
    unit_homography,
)
from receiver.pilots.toggling import TogglePattern

LEAST_SIDE_PX, MOST_SHRUNK = 4.0, 2
"""Smallest side of a block, in pixels of the maps, and the largest factor by which the maps are
smaller than the layout: slopes at the borders of blocks need two pixels on either side
(`receiver.pilots.motion.MAP_PX`), and more pixels cost more."""
STEP_PERIODS = 32
"""Number of periods whose changes are measured in one step, which then takes about as long as other
steps of the search. Chosen by hand."""
SPAN = 0.15
"""Standard deviation, in blocks, over which the expected and the seen changes are smoothed:
edges of blocks keep a slope that is wider than a pixel of the maps. Chosen by hand."""
LEAST_NOISE, LEAST_TOGGLING = 0.02, 0.01
"""Smallest variance of the noise, and smallest squared toggling of a block, as shares of the mean
square of the blocks' changes. They keep likelihood ratios finite where a film has no noise, and
blocks in the fit that toggle less than can be told. Chosen by hand."""
SURE_RATIO = 9.0
"""Half a log-likelihood ratio from which on the direction of a block's change is no surer: the
hyperbolic tangent of 9 is 1 but for 3e-8, the rounding of float32."""
EXPECTED_BLOCKS = 0.1
"""Standard deviation, in blocks, that corners which the pilots fitted are expected to be off by:
where few blocks stand out of the noise, they do not lead the corners away. A lens that bends the
display by less counts as one that does not."""
EXPECTED_K = 0.05
"""Standard deviation that the lens's coefficient is expected to have, a third of `LARGEST_K`.
Chosen by hand."""
LARGEST_K = 0.15
"""Largest coefficient of a lens, either way, that is believed. Chosen by hand."""
K_STEP = 1e-3
"""Change of the lens's coefficient by which it is found how places of the display move with it: a
numerical derivative, small against `EXPECTED_K` and large against rounding."""
SETTLED_PX = 0.05
"""Motion, in pixels of the maps, below which a step is the last one: about a hundredth of a block,
while `EXPECTED_BLOCKS` is a tenth."""
FROM_UNIT = pixels_from_unit(2, 2)
"""(3, 3) homography from a display from -1 to 1 to a frame of 2 by 2 pixels."""


def block_maps(layout: Layout) -> GridMaps:
    """Choose maps in which a display's corners are fitted by all of its blocks.

    They hold the display and one block around it, since nothing toggles beyond its border.

    Args:
        layout: layout of the display, with pilots.

    >>> from link.layout import make_layout
    >>> maps = block_maps(make_layout(48, 64, pilots=8))
    >>> maps.inner, maps.margin, maps.size
    ((256, 192), (4, 4), (264, 200))
    """
    side = min(layout.width / layout.cols, layout.height / layout.rows)
    shrunk = min(MOST_SHRUNK, max(1, int(side / LEAST_SIDE_PX)))
    width, height = layout.width // shrunk, layout.height // shrunk
    return GridMaps(layout, (width, height), (-(-width // layout.cols), -(-height // layout.rows)))


def block_fit(
    maps: GridMaps, views: Sequence[Gray], at: Sequence[float], toggling: TogglePattern
) -> Steps["BlockFit"]:
    """Make ready to fit the corners of a display by all of its blocks.

    Args:
        maps: geometry of the maps.
        views: (h, w) gray levels of T frames, rectified to the maps.
        at: (T,) positions of the frames (`receiver.pilots.waves.position`).
        toggling: how the display toggles.
    """
    changes = []
    for change in toggling.period_changes(maps, np.array(views), at):
        changes.append(maps.smooth(change, SPAN))
        if len(changes) % STEP_PERIODS == 0:
            yield 1
    return BlockFit(maps, np.array(changes))


class BlockFit:
    """Moves the grid of a display, step by step, until its blocks change as wholes.

    Args:
        maps: geometry of the maps.
        changes: (K, h, w) smooth changes in K periods, without slope.
    """

    def __init__(self, maps: GridMaps, changes: Map) -> None:
        self.maps, self.changes = maps, changes
        self._H_old_from_new, self._k = np.eye(3), 0.0
        self._best = self._H_old_from_new, self._k
        self._score = -1.0
        self._H_captured_from_unit: Array | None = None
        self._image_size = 0, 0
        self._map_from_unit = pixels_from_unit(*maps.inner)
        self._map_from_unit[:2, 2] += maps.margin

    @property
    def k(self) -> float:
        """Coefficient of the lens (`link.geometry.Lens`); 0 before `free_lens`."""
        return self._best[1]

    def shift(self) -> Array:
        """Say where points of the display, as it should have been rectified, lie in the views.

        Returns:
            H_old_from_new, (3, 3) in layout pixels.
        """
        H_layout_from_unit = self.maps.to_layout() @ self._map_from_unit
        H = H_layout_from_unit @ self._best[0] @ np.linalg.inv(H_layout_from_unit)
        return np.asarray(H / H[2, 2])

    def free_lens(self, corners: Corners, image_size: tuple[int, int]) -> None:
        """Let the next steps find by how much the lens bends the display, too.

        The lens moves the places between the corners; the corners stay where they are seen.

        Args:
            corners: pixels of the image by which the views were rectified.
            image_size: width and height of the image, pixels.
        """
        self._H_captured_from_unit = Lens(0.0, image_size).homography(corners, 2, 2) @ FROM_UNIT
        self._image_size, self._score = image_size, -1.0
        self._H_old_from_new, self._k = self._best

    def step(self) -> bool:
        """Move the grid once, and return whether it has come to rest."""
        if len(self.changes) < 2:  # one period does not tell toggling from noise
            return True
        seen = self._seen()
        expected = self._expected(seen)
        power = float((expected**2).sum()) + 1e-12
        along = float((expected * seen).sum())
        score = along / np.sqrt(power * (float((seen**2).sum()) + 1e-12))
        if score <= self._score:  # the last step led away
            return True
        self._score, self._best = score, (self._H_old_from_new, self._k)
        expected *= along / power
        move = self._move(expected, seen - expected)
        H = self._H_old_from_new @ unit_homography(move[:8])
        self._H_old_from_new = H / H[2, 2]
        self._k = float(np.clip(self._k + move[8:].sum(), -LARGEST_K, LARGEST_K))
        at_rest = bool(np.abs(move).max() * self.maps.inner[0] / 2 < SETTLED_PX)
        if at_rest:
            self._best = self._H_old_from_new, self._k
        return at_rest

    def bends(self) -> bool:
        """Tell whether the lens that the next step tries bends the display by much of a block."""
        bent = np.abs(self._places(self._k) - self._places(0.0)).max(axis=(1, 2))
        return bool((bent > EXPECTED_BLOCKS * self.maps.block).any())

    def _places(self, k: float) -> Map:
        """Find where a lens shows the pixels of the maps: (2, h, w), x and y in the views."""
        H_map_from_unit, H_captured_from_unit = self._map_from_unit, self._H_captured_from_unit
        assert H_captured_from_unit is not None, "the lens is not free"
        lens = Lens(k, self._image_size)
        corners = transform(H_captured_from_unit @ self._H_old_from_new, UNIT_CORNERS)
        H = lens.homography(corners, 2, 2) @ FROM_UNIT @ np.linalg.inv(H_map_from_unit)
        seen_at = cv2.merge(lens.seen_at(H, self.maps.size))
        H_map_from_captured = H_map_from_unit @ np.linalg.inv(H_captured_from_unit)
        places = cv2.perspectiveTransform(seen_at, H_map_from_captured)
        return np.array(cv2.split(places), np.float32)

    def _seen(self) -> Map:
        """Show the changes, (K, h, w), as they are with the grid where it now is."""
        size, border = self.maps.size, cv2.BORDER_REPLICATE
        if self._H_captured_from_unit is not None:
            x, y = self._places(self._k)
            seen = [
                cv2.remap(change, x, y, cv2.INTER_LINEAR, borderMode=border)
                for change in self.changes
            ]
        elif self._score >= 0:
            H = self._map_from_unit @ self._H_old_from_new @ np.linalg.inv(self._map_from_unit)
            flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
            seen = [
                cv2.warpPerspective(change, H, size, flags=flags, borderMode=border)
                for change in self.changes
            ]
        else:
            return self.changes
        return np.array(seen)

    def _expected(self, seen: Map) -> Map:
        """Draw by how much each block is expected to have changed in each period, (K, h, w)."""
        layout = self.maps.layout
        grid, signs = (layout.cols, layout.rows), pilot_signs(layout)
        means = np.array(
            [
                cv2.resize(np.ascontiguousarray(change), grid, interpolation=cv2.INTER_AREA)
                for change in self.maps.within(seen)
            ]
        )
        flat = means.reshape(len(means), -1)  # (K, rows, cols) -> (K, blocks)
        mean_square = float((flat**2).mean())
        # all pilots change alike in all periods; what differs is noise
        noise = float((flat[:, layout.pilot_blocks]).var(axis=0, ddof=1).mean())
        noise = max(noise, LEAST_NOISE * mean_square) + 1e-12
        squares = cv2.blur((means**2).mean(axis=0) - noise, (3, 3)).reshape(-1)
        toggling = np.sqrt(np.maximum(squares, LEAST_TOGGLING * mean_square))
        sure = np.tanh(np.clip(toggling * flat / noise, -SURE_RATIO, SURE_RATIO))
        sure[:, layout.pilot_blocks] = signs
        blocks = (toggling * sure).reshape(means.shape)
        return np.array([self.maps.drawn(each, SPAN) for each in blocks])

    def _move(self, expected: Map, residual: Map) -> Array:
        """Find the (8,) numbers of the homography that explain the residual changes.

        Where the lens is free, the change of its coefficient is the ninth.
        """
        maps = self.maps
        equations = MotionEquations(maps)
        for change, left in zip(expected, residual, strict=True):
            equations.take(change, left)
        bent: Map | None = None
        if self._H_captured_from_unit is not None:
            moved = (self._places(self._k + K_STEP) - self._places(self._k)) / np.float32(K_STEP)
            bent = np.array([each * 2 / side for each, side in zip(moved, maps.inner, strict=True)])
        matrix, right = equations.normal(bent)
        noise = float((residual**2).mean() * maps.block.prod()) + 1e-12  # alike over a block
        known = np.full(8, noise / (2 * EXPECTED_BLOCKS / maps.layout.cols) ** 2)
        off = (self._H_old_from_new - np.eye(3)).flat[:8]
        if bent is not None:
            known, off = np.append(known, noise / EXPECTED_K**2), np.append(off, self._k)
        return np.asarray(-np.linalg.solve(matrix + np.diag(known), right + known * off))
