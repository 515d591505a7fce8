"""Propose where a display may be and what it shows, and measure how surely pilots toggle there."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise, product
from math import prod
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from export.region_graph import shipped_region_graph
from link.layout import Layout
from link.pilot_code import PLAIN
from link.pilots import expected_changes, pilot_values, standing_out
from link.steps import Steps
from link.types import Array, Corners, Gray
from models.region import CELL_PX, LEAST_PX
from receiver.locate.candidates import display_candidates, leaving_quads
from receiver.locate.edges import snap_to_edges
from receiver.locate.quads import upright
from receiver.pilots.motion import moved_corners
from receiver.pilots.search.film import HeldFrame, positions
from receiver.pilots.search.parts import COARSE_SIZE, coarse_shift, rough_series, shifted_togglings
from receiver.pilots.search.regions import (
    leaning,
    leaving_regions,
    likeliest,
    outline_regions,
    portrait_parts,
)
from receiver.pilots.search.watch import Watch
from receiver.pilots.toggling import TogglePattern, Wave, find_toggling

EDGES, STRONGEST = 60, 6
"""Largest number of quadrilaterals that are made of the edges of an image, of which the map of what
toggles chooses, and number of those, with the strongest edges, that are weighed whatever it says.
They bound the work; chosen by hand."""
VIEW_SIZE = 128, 96
"""Smallest width and height, in pixels, of the small views in which quadrilaterals are weighed: a
pixel a block of the preset `fast`, and several a block of coarser grids, so that what moves in a
neighbouring block hardly counts. Layouts with finer grids have a pixel a block, too."""
BRIGHT_PX, DARK_PX = 13, 9
"""Sides of the squares, in pixels of the mean frame, below which bright details of the picture are
taken off before dark ones, and dark ones before bright ones: wider than strokes of letters or
streets of a map, narrower than the display. Chosen by hand."""
PARTLY_SEEN = 200
"""Largest number of quadrilaterals of edges with a corner outside the image, of which the map of
what toggles chooses. It bounds the work; chosen by hand."""
LEAVING = 2
"""Number of these quadrilaterals, those of the strongest edges, that are weighed coarsely, too, and
in which pictures between black bars are sought. It bounds the work; chosen by hand."""
MAPPED = 24
"""Largest number of frames, the newest ones, by which it is mapped what toggles. It bounds the
work; the network learned from no more."""
SNAP_SHARE = 0.09
"""Distance, as a share of the root of a region's area, that its sides may move to an edge: the
outlines of half of the simulated displays whose picture moves are so near."""
SNAP_STEP_PX = 4
"""Step, in pixels of the stills, to which that distance is rounded: what is prepared for a distance
serves many regions. Chosen by hand."""
EDGE_BLUR_PX = 1.0
"""Standard deviation, in pixels of the stills, by which noise is smoothed before edges are sought.
Chosen by hand."""
LOG_LEVELS = 12.0
"""Number of levels by which an image of changes (`change_levels`) is brighter where the mean
squared change is e times as large. The largest one, 255 squared, then has level 133, and all fit
into 8 bits. Chosen by hand."""
STATES_HZ = (15.0, 30.0, 60.0, 120.0)
"""Numbers of states a second at which the pilots of layouts without a code are fitted to
quadrilaterals that may be far off; where edges bound the display, it is found at any rate. Panels
show states at whole parts of 60 and 120 Hz."""
ANY_TURN = 0, 1
"""Quarter turns after which quadrilaterals are tried upright and upside down, so that any of their
sides may be up."""
PROMISING = 9.0
"""Evidence of a quadrilateral, before the number of trials is taken off, at which its corners are
refined at once. The false-alarm probability of one quadrilateral is then e to the -9, one in 8,000,
so that slow steps are taken for few."""


PilotsSeen = list[list[NDArray[np.float32]]]
"""For each frame, the values (pilots,) of each layout's pilots, upright and upside down."""


class Regions(NamedTuple):
    """Quadrilaterals that bound what toggles, (4, 2) pixels of the reference; likeliest first."""

    outlines: list[Array]
    """Outlines of displays, whatever edges they have, to some blocks."""
    leaving: list[Array]
    """What may bound a display that leaves the image, where what toggles reaches its border."""
    portraits: list[Array]
    """Portrait pictures of which one side is not seen (`portrait_parts`). Where the display may
    leave the image, those that leave it come first, and a map whose cells are all likelier chooses
    some, too (`leaning`)."""


@dataclass(frozen=True, eq=False)
class Proposal:
    """A place where a display may be, with the layout and the toggling that it may show."""

    corners: Corners
    """Pixels of the reference frame; the displayed picture's top left comes first."""
    layout: Layout
    """Layout that the display may show."""
    toggling: TogglePattern
    """Pattern in which the display's blocks may toggle."""


def weigh(
    proposal: Proposal,
    frames: Sequence[HeldFrame],
    fps: float,
    known: dict[HeldFrame, NDArray[np.float32]] | None = None,
) -> tuple[float, TogglePattern]:
    """Weigh a proposal by frames in full.

    Args:
        proposal: where a display may be, and what it may show.
        frames: frames of the film.
        fps: nominal number of frames of the camera in a second.
        known: values of the proposal's pilots in frames by which it was weighed before; takes
            those of the others.

    Returns:
        the evidence, before it pays for what was tried, and how its pilots toggle in the frames.
    """
    known = {} if known is None else known
    for frame in frames:
        if frame in known:
            continue
        view = frame.view(proposal.corners, proposal.layout)
        if view is None:
            return 0.0, proposal.toggling
        known[frame] = pilot_values(view, proposal.layout)
    values = [known[frame] for frame in frames]
    return find_toggling(values, proposal.layout, positions(frames), fps)


class Proposer:
    """Proposes where the display may be in a film, and what it may show.

    Quadrilaterals of edges in the reference are weighed coarsely while frames are being watched.
    Others are outlines of what toggles, as they are and moved to edges, and what the pilots' fit
    makes of a display partly in view.

    Args:
        watch: the film, of which the reference frame has come.
        layouts: those that may be shown.
    """

    def __init__(self, watch: Watch, layouts: Sequence[Layout]) -> None:
        self._watch, self._layouts, self._fps = watch, layouts, watch.fps
        grids = ((layout.cols, layout.rows) for layout in layouts)
        self._view_size = max(VIEW_SIZE, *grids, key=prod)
        periods = (np.array(STATES_HZ) / 2 / watch.fps) % 1
        self._frequencies = sorted({float(f) for f in np.minimum(periods, 1 - periods) if f > 0})
        self._kept: dict[tuple[bytes, int, bool], PilotsSeen] = {}
        self.partly_seen: list[Corners] = []
        """Quadrilaterals of edges, pixels of the reference, that may bound a display which is
        partly in view, those of the strongest edges first; none before `edges` has ended."""
        self._log_odds: NDArray[np.float32] | None = None  # of the newest map of what toggles

    def edges(self) -> Steps[list[Array]]:
        """Propose quadrilaterals of edges, (4, 2) pixels of the reference, the strongest first."""
        reference = self._watch.reference
        found = [candidate.corners for candidate in display_candidates(reference, EDGES)]
        yield 2  # it took as long as two other steps
        self.partly_seen = leaving_quads(reference, PARTLY_SEEN)
        return found

    def regions(self, edges: Sequence[Array]) -> Steps[Regions]:
        """Propose quadrilaterals that bound what toggles.

        Args:
            edges: (4, 2) quadrilaterals of edges, pixels of the reference.
        """
        watch, stills = self._watch, self._watch.stills.frames[-MAPPED:]
        if min(stills.shape[1:]) < LEAST_PX:
            return Regions([], [], [])
        log_odds = self._log_odds = shipped_region_graph().log_odds(stills)
        yield 1
        whole, partly = self._on_cells(edges), self._on_cells(self.partly_seen)
        leaving = leaving_regions(partly, log_odds)
        yield 1
        found = []
        bounded = (partly, whole) if leaving else (whole,)
        maps = (leaning(log_odds), log_odds) if leaving else (log_odds,)
        portraits = [part for quads in bounded for part in portrait_parts(quads, maps)]
        for cells in outline_regions(log_odds), leaving, portraits:
            quads = upright(CELL_PX * np.reshape(cells, (-1, 4, 2)) - 0.5)  # N may be 0
            found.append([watch.on_image(quad) for quad in quads])
        return Regions(*found)

    def likeliest(self, quads: Sequence[Array], limit: int, *, lean: bool = False) -> list[Array]:
        """Choose by the newest map of what toggles (`receiver.pilots.search.regions.likeliest`).

        Args:
            quads: (4, 2) pixels of the reference each.
            limit: largest number chosen.
            lean: whether all cells count as likelier (`receiver.pilots.search.regions.leaning`).

        Returns:
            the likeliest first; none before there is a map.
        """
        if self._log_odds is None:
            return []
        odds = leaning(self._log_odds) if lean else self._log_odds
        return [quads[i] for i in likeliest(self._on_cells(quads), odds, limit)]

    def _on_cells(self, quads: Sequence[Array]) -> Array:
        """Move quadrilaterals of the reference into the cells of a map: (N, 4, 2), upright."""
        cells = [(self._watch.on_copy(quad) + 0.5) / CELL_PX for quad in quads]
        return upright(np.reshape(cells, (-1, 4, 2)))  # N may be 0

    def snapped(self, region: Array) -> list[Array]:
        """Move the sides of a region to edges that are seen, and to those of what changes.

        A picture that moves changes up to its border, even where it is as dark as what is around
        it.

        Args:
            region: (4, 2) pixels of the reference, as `regions` proposes it.

        Returns:
            two quadrilaterals, (4, 2) pixels of the reference.
        """
        stills, quad = self._watch.stills.frames[-MAPPED:], self._watch.on_copy(region)
        size = float(np.sqrt(cv2.contourArea(np.float32(quad))))
        reach = SNAP_STEP_PX * max(1, round(SNAP_SHARE * size / SNAP_STEP_PX))
        found = []
        for levels in (stills[0], change_levels(stills)):
            smooth = cv2.GaussianBlur(levels, (0, 0), EDGE_BLUR_PX).astype(np.float32)
            found.append(self._watch.on_image(snap_to_edges(smooth, quad[None], reach)[0]))
        return found

    def faint_edges(self) -> Iterator[list[Array]]:
        """Propose quadrilaterals in the mean of all frames, which has less noise than a frame.

        Its histogram is made even, which shows the edges of dark pictures. It is looked at as it
        is, and twice without details, such as letters or a map's streets, whose edges would hide
        those of the display.

        Yields:
            quadrilaterals in each of them, (4, 2) pixels of the reference, the strongest first.
        """
        mean = np.asarray(self._watch.stills.mean(), np.uint8)
        bright_first = cv2.MORPH_OPEN, cv2.MORPH_CLOSE
        for side, ways in ((1, ()), (BRIGHT_PX, bright_first), (DARK_PX, bright_first[::-1])):
            even = np.asarray(cv2.equalizeHist(_without_details(mean, side, ways)), np.uint8)
            found = display_candidates(even, EDGES)
            yield [self._watch.on_image(candidate.corners) for candidate in found]

    def weigh_coarsely(
        self, quad: Array, turn: int, count: int | None = None
    ) -> tuple[float, Proposal]:
        """Weigh a quadrilateral, upright and upside down, by small views of what toggles in it.

        Args:
            quad: (4, 2) pixels of the reference frame.
            turn: number of quarter turns after which it is seen upright.
            count: as `Watch.places` takes it.

        Returns:
            the evidence, before it pays, and what it speaks for.
        """
        values = self.pilots_seen(quad, turn, count)
        return self._likeliest(np.roll(quad, -turn, axis=0), values)

    def pilots_seen(self, quad: Array, turn: int, count: int | None = None) -> PilotsSeen:
        """Measure what may be pilots in small views of a quadrilateral.

        Of quadrilaterals that follow their own motion, what is measured in a frame is kept, until
        their picture is seen to move.

        Args:
            quad: (4, 2) pixels of the reference frame.
            turn: number of quarter turns after which it is seen upright.
            count: as `Watch.places` takes it.
        """
        key = quad.tobytes(), turn, self._watch.moves(quad)
        values = self._kept.setdefault(key, []) if count is not None else []
        places = self._watch.places(quad, count)
        views = self._watch.stills.views(places, *self._view_size, turn, first=len(values))
        values += [_pilots_in(view, self._layouts) for view in views]
        return values

    def likeliest_in(self, corners: Array) -> tuple[float, Proposal]:
        """Choose the layout, either side up, that is likeliest in small views of corners."""
        views = self._watch.stills.views(self._watch.places(corners), *self._view_size)
        return self._likeliest(corners, [_pilots_in(view, self._layouts) for view in views])

    def _likeliest(self, corners: Array, values: PilotsSeen) -> tuple[float, Proposal]:
        """Choose the layout, upright or upside down, that is likeliest by pilots in the frames."""
        at, found = positions(self._watch.frames[: len(values)]), []
        for way, (layout, half) in enumerate(product(self._layouts, (0, 2))):
            picked = [each[way] for each in values]
            evidence, toggling = find_toggling(picked, layout, at, self._fps)
            found.append((evidence, Proposal(np.roll(corners, -half, axis=0), layout, toggling)))
        return max(found, key=lambda each: each[0])

    def first_fit(self, quad: Array) -> Steps[Array | None]:
        """Fit every layout to a quadrilateral that may be far off, in steps.

        Args:
            quad: (4, 2) pixels of the reference frame, the displayed picture's top left first.

        Returns:
            its corners, (4, 2), after the shift from far that fits best, or None where none does.
        """
        views = self._watch.stills.views(self._watch.places(quad), *COARSE_SIZE).astype(np.float32)
        at = positions(self._watch.frames)
        most, best = 0, None
        for number, layout in enumerate(self._layouts):
            if number:
                yield 1
            series, blocks = rough_series(views, layout), expected_changes(layout)
            ways: Sequence[TogglePattern] = [Wave(frequency) for frequency in self._frequencies]
            if layout.code != PLAIN:
                ways = shifted_togglings(series, blocks, layout, at, self._fps)
            for toggling in ways:
                fit = coarse_shift(toggling.amplitudes(series, at), blocks, layout, far=True)
                if fit is not None and fit[1] > most:
                    most, best = fit[1], moved_corners(quad, fit[0], layout)
        return best


def _pilots_in(view: Gray, layouts: Sequence[Layout]) -> list[NDArray[np.float32]]:
    """Measure the pilots of each layout in a view, (pilots,) each, upright and upside down."""
    values = []
    for layout in layouts:
        blocks = standing_out(view, layout).ravel()
        values += [blocks[layout.pilot_blocks], blocks[::-1][layout.pilot_blocks]]
    return values


def change_levels(stills: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Show by how much pixels change from still to still, as an image.

    Args:
        stills: (T, h, w) uint8, at least two frames held still.

    Returns:
        (h, w) uint8: `LOG_LEVELS` times the natural logarithm of 1 plus the mean squared change,
        the change in gray levels; rounded down.
    """
    power = np.zeros(stills.shape[1:], np.float32)
    for before, after in pairwise(stills):
        cv2.accumulateSquare(cv2.absdiff(after, before), power)
    return np.asarray(LOG_LEVELS * np.log(power / (len(stills) - 1) + 1), np.uint8)


def _without_details(gray: Gray, side: int, ways: Sequence[int]) -> Gray:
    """Take details off an image that are smaller than a square, by opening and closing."""
    square = np.ones((side, side), np.uint8)
    for way in ways:
        gray = np.asarray(cv2.morphologyEx(gray, way, square), np.uint8)
    return gray
