"""Find a display by its pilots, over some frames of a film: nothing visible marks it.

The frames of some tenths of a second are held still against the camera's motion (`stabilise`).
Edges and what toggles (`toggle_map`) propose where the display may be. Corners then move to where
the pilots fit the grid (`corners`), and the display is believed if its blocks toggle with the
pilots' signs beyond doubt (`evidence`). That also tells which way up it is and which of several
grids it shows.

Where nothing is found, the next search takes the display's picture for one that moves, as a video
does, and holds the room still alone.

The work is cut into steps, one or two for each frame, so that no frame takes long.
"""

from collections import deque
from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain, zip_longest

import cv2
import numpy as np
from numpy.typing import NDArray

from export.locate.candidates import display_candidates
from export.locate.pilots.all_blocks import BlockFit, BlockMaps
from export.locate.pilots.climb import climb_to_pilots
from export.locate.pilots.corners import (
    COARSE_SIZE,
    MANY,
    coarse_shift,
    map_size,
    moved_corners,
)
from export.locate.pilots.evidence import (
    LEAST_DEVIATION,
    pilot_evidence,
    pilot_signs,
    pilot_values,
    standing_out,
)
from export.locate.pilots.stabilise import Stabiliser
from export.locate.pilots.toggle_map import ToggleMap
from export.locate.pilots.waves import position, waves
from link.errors import InputError
from link.geometry import homography_from_corners, rectify, resized_homography, transform
from link.images import as_gray
from link.layout import Layout

Array = NDArray[np.float64]
Gray = NDArray[np.uint8]
CANDIDATES, FAINT_CANDIDATES = 6, 50
"""Number of quadrilaterals made of edges that are watched at once, and of those made of faint edges
among which what toggles chooses."""
GLANCES = 4
"""Number of quadrilaterals that are glanced at in one step."""
WINDOW_S, LEAST_WINDOW, MOST_WINDOW = 0.4, 24, 48
"""Time, in seconds, for which a room is watched before what toggles is outlined, and the smallest
and the largest number of frames that are watched: quick cameras see more of less light."""
STEPS_HZ = 60.0
"""Number of steps of the search that are done in a second, at least: the frames of a slow camera
leave time for several."""
SURE, SURE_SHARE = 16.0, 0.5
"""Smallest evidence, after paying for everything that was tried, at which a display is found: the
natural logarithm of one false alarm in some ten million searches. Few pilots cannot bring so much;
for them it is this share of their number."""
TRIALS = 1000
"""Number of quadrilaterals, turns, layouts and rounds that a search may try, for which evidence
pays."""
CLIMB_TRIALS = 500
"""Number of quadrilaterals that moving corners by the sum over the pilots may try, for which
evidence pays, too."""
CERTAIN, CERTAIN_SHARE = 35.0, 0.75
"""Evidence from which on a display is believed at once, and the share of the number of pilots that
is enough where it is less; below it, later frames must agree."""
CONFIRMED = 9.0
"""Evidence, before it pays for anything, that later frames must bring where they must agree."""
NEARLY = 0.5
"""Share of the evidence needed from which on later frames are waited for, to be weighed too."""
STATES_HZ = (15.0, 30.0, 60.0, 120.0)
"""Numbers of states a second at which what toggles is outlined; where edges bound the display, it
is found at any rate."""
PROMISING, HINT, CLIMBABLE = 9.0, 6.0, 3.0
"""Evidence of a quadrilateral, before it pays, at which its corners are refined at once, at which
they are once all frames were seen, and at which the sum over its pilots can lead them on."""
COARSE_ROUNDS, CLIMB_ROUNDS, BLOCK_ROUNDS = 5, 2, 5
"""Largest number of times that corners are moved by parts of the display, by the sum over its
pilots, and by all of its blocks."""
SETTLED_PX = 3.0
"""Distance, in layout pixels, below which a coarse move is the last one."""
FAR_OUTSIDE = 0.5
"""Share of the image's size by which a corner may lie outside of it."""
LEAST_AREA = 0.005
"""Smallest share of the image that a display covers."""


@dataclass(frozen=True)
class PilotDisplay:
    """A display that its pilots have given away."""

    layout: Layout
    """Layout that it shows, one of those that were looked for."""
    corners: Array
    """(4, 2) pixels of the newest frame, from the top left of the displayed picture on."""
    evidence: float
    """Natural logarithm of the odds against chance, after paying for everything that was tried."""


@dataclass(frozen=True)
class _Frame:
    """One frame of the film."""

    gray: Gray
    """(H, W) uint8."""
    H_image_from_reference: Array
    """(3, 3) homography: where points of the reference lie in it."""
    at: float
    """Its position since the reference (`export.locate.pilots.waves.position`)."""


@dataclass(frozen=True)
class _Proposal:
    """Where a display may be."""

    corners: Array
    """(4, 2) pixels of the reference frame; the displayed picture's top left comes first."""
    layout: Layout
    """What it may show."""
    frequency: float
    """Frequency at which it may toggle, in periods for each nominal frame."""


_Sure = tuple[_Proposal, float]
"""What is found in the end: corners in the reference frame, and the evidence."""


class PilotSearch:
    """Looks for a display that shows one of several layouts with pilots.

    Args:
        layouts: layouts that are looked for, at least one, each with pilots.
        fps: nominal number of frames of the camera in a second; some may be missing.

    Raises:
        InputError: a layout has no pilots.
    """

    def __init__(self, layouts: Sequence[Layout], fps: float = 30.0) -> None:
        if not layouts or any(layout.pilots == 0 for layout in layouts):
            raise InputError("layouts: need at least one, each with pilots")
        self.layouts = tuple(layouts)
        self._largest = max(layouts, key=lambda layout: layout.width * layout.height)
        self._finest = max(layouts, key=lambda layout: layout.rows * layout.cols)
        self._expected = {layout: _expected_changes(layout) for layout in layouts}
        periods = (np.array(STATES_HZ) / 2 / fps) % 1
        self._frequencies = sorted({float(f) for f in np.minimum(periods, 1 - periods) if f > 0})
        self._window = int(np.clip(round(WINDOW_S * fps), LEAST_WINDOW, MOST_WINDOW))
        self._steps = max(1, round(STEPS_HZ / fps))
        self._check_every = self._window // 4
        self._confirming = 2 * self._window // 3
        self._stabiliser = Stabiliser()
        self.picture_moves = False
        """Whether displays are looked for whose picture moves; a search in vain changes it."""
        self._frames: list[_Frame] = []
        self._later: deque[_Frame] = deque(maxlen=self._confirming)
        self._newest: _Frame
        self._reference: NDArray[np.uint8]
        self._fps, self._start = fps, 0.0
        self._watched: list[Array] = []
        self._values: list[list[NDArray[np.float32]]] = []
        self._proposed: list[_Proposal] = []
        self._work: Iterator[_Sure | None] | None = None

    def push(self, image: NDArray[np.uint8], time: float) -> PilotDisplay | None:
        """Take the next frame.

        Args:
            image: (H, W) or (H, W, 3) uint8, encoded RGB.
            time: time of the frame, seconds; rising from frame to frame.

        Returns:
            the display once it is sure, else None.
        """
        gray = as_gray(image)
        H = self._stabiliser.follow(gray)
        if H is None:
            self._stabiliser.begin(gray, far_apart=self.picture_moves)
            self._reference, self._start = image, time
            self._frames, self._proposed, self._work = [], [], None
            self._later.clear()
            return None
        if not self._frames:
            self._begin()
        self._newest = _Frame(gray, H, position(time - self._start, self._fps))
        if len(self._frames) < self._window:
            self._watch(self._newest)
        else:
            self._later.append(self._newest)
        if self._work is None:
            return None
        found: _Sure | None = None
        for _ in range(self._steps):
            try:
                found = next(self._work)
            except StopIteration:
                self._stabiliser.forget()
                self.picture_moves = not self.picture_moves
                return None
            if found is not None:
                break
        if found is None:
            return None
        proposal, evidence = found
        self._stabiliser.forget()
        return PilotDisplay(proposal.layout, transform(H, proposal.corners), evidence)

    def _begin(self) -> None:
        """Propose quadrilaterals in the reference, now that the film can be held still."""
        self._map = ToggleMap()
        self._watched = [
            np.roll(candidate.corners, -turn, axis=0)
            for candidate in display_candidates(self._reference, CANDIDATES)
            for turn in (0, 1)
        ]
        self._values = [[] for _ in self._watched]
        self._watch(_Frame(as_gray(self._reference), np.eye(3), 0.0))

    def _watch(self, frame: _Frame) -> None:
        """Record what this frame shows, and propose what looks promising after some frames."""
        self._frames.append(frame)
        self._map.add(self._stabiliser.still(frame.gray, frame.H_image_from_reference), frame.at)
        size = 2 * self._finest.cols, 2 * self._finest.rows
        for corners, values in zip(self._watched, self._values, strict=True):
            view = _rectified(frame, corners, self._largest)
            small = np.zeros(size[::-1], np.uint8) if view is None else view
            values.append(cv2.resize(small, size, interpolation=cv2.INTER_AREA).astype(np.float32))
        count = len(self._frames)
        every = self._check_every
        if self._work is None and count >= 2 * every and count % every == 0:
            self._propose_watched()
        if self._work is None and (self._proposed or count == self._window):
            self._work = self._settle_all()

    def _propose_watched(self) -> None:
        """Propose the quadrilateral of edges that toggles most surely, where any is promising."""
        watched = zip(self._watched, self._values, strict=True)
        surest = [self._surest(corners, values) for corners, values in watched]
        if surest:
            evidence, proposal = max(surest, key=lambda found: found[0])
            if evidence > PROMISING:
                self._proposed.append(proposal)

    def _surest(
        self, corners: Array, views: Sequence[NDArray[np.generic]]
    ) -> tuple[float, _Proposal]:
        """Choose the layout, upright or upside down, whose pilots toggle most surely.

        Args:
            corners: (4, 2) pixels of the reference frame.
            views: what they bound in each frame, rectified to any size.

        Returns:
            the evidence, before it pays, and what it speaks for.
        """
        found = []
        at = [frame.at for frame in self._frames]
        for layout in self.layouts:
            blocks = [standing_out(view, layout) for view in views]
            for turn in (0, 2):
                turned = [block[::-1, ::-1] if turn else block for block in blocks]
                picked = [view.reshape(-1)[layout.pilot_blocks] for view in turned]
                evidence, frequency = pilot_evidence(picked, layout, at)
                moved = np.roll(corners, -turn, axis=0)
                found.append((evidence, _Proposal(moved, layout, frequency)))
        return max(found, key=lambda each: each[0])

    def _settle_all(self) -> Iterator[_Sure | None]:
        """Settle one proposal after another; None after each step, and what is sure in the end."""
        while self._proposed:
            proposal = self._proposed.pop(0)
            evidence = _evidence(proposal, self._frames)
            yield None
            yield from self._settle(proposal, evidence)
        while len(self._frames) < self._window:
            yield None
        quads, usual = yield from self._all_quads()
        glances = []
        for number, quad in enumerate(quads):
            glances.append(self._glance(quad))
            if number % GLANCES == GLANCES - 1:
                yield None
        for evidence, proposal in sorted(glances, key=lambda glance: -glance[0]):
            if evidence > HINT:
                evidence = _evidence(proposal, self._frames)
                yield None
                yield from self._settle(proposal, evidence)
        ranked = self._ranked(quads, [evidence for evidence, _ in glances], usual)
        yield from self._settle_fits([quads[number] for number in ranked])

    def _all_quads(self) -> Generator[None, None, tuple[list[Array], int]]:
        """Propose quadrilaterals by faint edges, by what toggles, and by the edges watched so far.

        Returns:
            quadrilaterals, and the number of them, from the first on, that are tried in any case.
        """
        faint = self._faint_edges()
        yield None
        outlines = []
        for frequency in self._frequencies:
            outline = self._map.outline(frequency)
            yield None
            if outline is not None:
                outlines.append(self._stabiliser.on_image(outline))
        usual = [*faint[:CANDIDATES], *outlines, *self._watched[::2]]
        return [*usual, *faint[CANDIDATES:]], len(usual)

    def _settle_fits(self, quads: Sequence[Array]) -> Iterator[_Sure | None]:
        """Fit the pilots to quadrilaterals that may be far off, and settle what is clear first."""
        doubtful = []
        for quad in quads:
            for turn in (0, 1):
                fit = self._first_fit(np.roll(quad, -turn, axis=0))
                yield None
                if fit is None:
                    continue
                evidence = self._glance_at(fit)
                if evidence > HINT:
                    yield from self._settle(fit, evidence)
                else:
                    doubtful.append((evidence, fit))
        for evidence, fit in sorted(doubtful, key=lambda each: -each[0]):
            yield from self._settle(fit, evidence)

    def _glance(self, quad: Array) -> tuple[float, _Proposal]:
        """Weigh a quadrilateral, any side up, by small views of what toggles in it.

        Returns:
            the evidence, before it pays, and what it speaks for.
        """
        ways = [
            self._surest(corners, list(self._small_views(corners)))
            for corners in (quad, np.roll(quad, -1, axis=0))
        ]
        return max(ways, key=lambda way: way[0])

    def _glance_at(self, proposal: _Proposal) -> float:
        """Weigh a proposal by small views: the evidence, before it pays."""
        layout = proposal.layout
        values = [pilot_values(view, layout) for view in self._small_views(proposal.corners)]
        return pilot_evidence(values, layout, [frame.at for frame in self._frames])[0]

    def _small_views(self, corners: Array) -> NDArray[np.uint8]:
        """Show what corners in the reference bound, in maps of `COARSE_SIZE`, (frames, h, w)."""
        return self._map.views(self._stabiliser.on_copy(corners), *COARSE_SIZE)

    def _ranked(self, quads: list[Array], evidence: list[float], usual: int) -> list[int]:
        """Choose the quadrilaterals to which the pilots are fitted, and their order.

        Those for which a first glance speaks most come by turns with those that best bound what
        toggles.

        Args:
            quads: quadrilaterals.
            evidence: evidence of each at a first glance.
            usual: number of quadrilaterals, from the first on, that are tried in any case.

        Returns:
            numbers of quadrilaterals.
        """
        worth = [self._map.worth(self._stabiliser.on_copy(quad)) for quad in quads]
        numbers = range(len(quads))
        clearest = sorted(numbers, key=lambda i: -evidence[i])[:CANDIDATES]
        bounding = sorted(numbers, key=lambda i: -worth[i])[:CANDIDATES]
        by_turns = chain(*zip_longest(clearest, [i for i in bounding if worth[i] > 0]))
        first = [i for i in by_turns if i is not None]
        return list(dict.fromkeys([*first, *range(usual)]))

    def _faint_edges(self) -> list[Array]:
        """Propose quadrilaterals in the mean of all frames, its levels spread over the whole range.

        The mean has less noise than a frame, and its histogram, made even, shows the edges of a
        dark picture in a dark frame.
        """
        even = np.asarray(cv2.equalizeHist(self._map.mean()), np.uint8)
        found = display_candidates(even, FAINT_CANDIDATES)
        return [self._stabiliser.on_image(candidate.corners) for candidate in found]

    def _first_fit(self, quad: Array) -> _Proposal | None:
        """Fit every layout, upright and upside down, to a quadrilateral that may be far off.

        Returns:
            what fits best after a shift, or None where nothing does.
        """
        views = self._small_views(quad).astype(np.float32)
        best: tuple[int, _Proposal] | None = None
        for frequency in self._frequencies:
            line = _line(views, self._frames, frequency)
            for layout in self.layouts:
                blocks = self._expected[layout]
                for turn in (0, 2):
                    shown = blocks[::-1, ::-1] if turn else blocks
                    fit = coarse_shift(line, shown, layout, far=True)
                    if fit is not None and (best is None or fit[1] > best[0]):
                        corners = np.roll(moved_corners(quad, fit[0], layout), -turn, axis=0)
                        best = fit[1], _Proposal(corners, layout, frequency)
        return None if best is None else best[1]

    def _settle(self, proposal: _Proposal, evidence: float) -> Iterator[_Sure | None]:
        """Move corners to where the pilots fit the grid; None after each step, and what is sure.

        A move by the pilots is kept only if they then toggle more surely: in a dark picture, parts
        may have been matched amiss. What all blocks say of the corners is kept where the display is
        sure there, too.

        Args:
            proposal: where a display may be.
            evidence: evidence of the proposal in all frames so far, before it pays for anything.
        """
        layout, frames = proposal.layout, list(self._frames)
        needed = min(SURE, SURE_SHARE * layout.pilots)
        certain = min(CERTAIN, CERTAIN_SHARE * layout.pilots)
        best, tried = proposal, float(TRIALS)
        evidence -= float(np.log(tried))
        for move, tries in ((self._by_parts, 1), (self._by_climbing, CLIMB_TRIALS)):
            sum_needed = CLIMBABLE - float(np.log(tried)) <= evidence < certain
            if tries > 1 and not sum_needed:  # it need not pay for so many trials, or is hopeless
                continue
            moved = replace(best, corners=(yield from move(best, frames)))
            now = _evidence(moved, frames) - float(np.log(tried * tries))
            yield None
            if now > evidence:
                best, evidence, tried = moved, now, tried * tries
        if evidence < HINT - float(np.log(tried)):
            return
        used = len(self._frames)
        fitted = replace(best, corners=(yield from self._by_blocks(best, self._frames[:used])))
        now = _evidence(fitted, frames) - float(np.log(tried))
        yield None
        evidence = max(evidence, now)
        if evidence < NEARLY * needed:
            return
        if now >= NEARLY * needed:
            best = fitted
        if evidence < certain:  # corners were fitted to these frames; later ones must agree
            while len(later := [*self._frames[used:], *self._later]) < self._confirming:
                yield None
            if _evidence(best, later) < CONFIRMED:
                return
            if evidence < needed:
                evidence = _evidence(best, [*frames, *later]) - float(np.log(tried))
                yield None
        if evidence >= needed:
            yield best, evidence

    def _by_parts(
        self, proposal: _Proposal, frames: Sequence[_Frame]
    ) -> Generator[None, None, Array]:
        """Move corners by parts of the display, step by step."""
        layout, corners = proposal.layout, proposal.corners
        for _ in range(COARSE_ROUNDS):
            views = _views(corners, layout, frames, COARSE_SIZE)
            if views is None:
                break
            line = _line(views, frames, proposal.frequency)
            fit = coarse_shift(line, self._expected[layout], layout)
            yield None
            if fit is None:
                break
            moved = moved_corners(corners, fit[0], layout)
            far = float(np.linalg.norm(moved - corners, axis=1).max())
            corners = moved
            if fit[1] >= MANY and far < SETTLED_PX:
                break
        return corners

    def _by_climbing(
        self, proposal: _Proposal, frames: Sequence[_Frame]
    ) -> Generator[None, None, Array]:
        """Move corners while the sum over all pilots grows, step by step."""
        layout, corners = proposal.layout, proposal.corners
        for _ in range(CLIMB_ROUNDS):
            views = _views(corners, layout, frames, map_size(layout))
            if views is None:
                break
            H_old_from_new = climb_to_pilots(_line(views, frames, proposal.frequency), layout)
            yield None
            corners = moved_corners(corners, H_old_from_new, layout)
        return corners

    def _by_blocks(
        self, proposal: _Proposal, frames: Sequence[_Frame]
    ) -> Generator[None, None, Array]:
        """Move corners by all blocks at once, to parts of a pixel, step by step."""
        maps = BlockMaps(proposal.layout)
        views = []
        for frame in frames:
            view = _rectified(frame, proposal.corners, proposal.layout, maps)
            if view is None:
                return proposal.corners
            views.append(cv2.resize(view, maps.size, interpolation=cv2.INTER_AREA))
        at = [frame.at for frame in frames]
        fit = BlockFit(maps, np.array(views, np.float32), at, proposal.frequency)
        for _ in range(BLOCK_ROUNDS):
            yield None
            if fit.step():
                break
        return moved_corners(proposal.corners, fit.shift(), proposal.layout)


def _expected_changes(layout: Layout) -> Array:
    """Expected changes of the blocks, (rows, cols): the pilots' signs, 0 elsewhere."""
    blocks = np.zeros(layout.rows * layout.cols)
    blocks[layout.pilot_blocks] = pilot_signs(layout)
    return blocks.reshape(layout.rows, layout.cols)  # (blocks,) -> (rows, cols)


def _views(
    corners: Array, layout: Layout, frames: Sequence[_Frame], size: tuple[int, int]
) -> NDArray[np.float32] | None:
    """Rectify all frames to maps of a size, (frames, h, w); None where corners are not sound."""
    views = []
    for frame in frames:
        view = _rectified(frame, corners, layout)
        if view is None:
            return None
        views.append(cv2.resize(view, size, interpolation=cv2.INTER_AREA))
    return np.array(views, np.float32)


def _line(
    views: NDArray[np.float32], frames: Sequence[_Frame], frequency: float
) -> NDArray[np.complex64]:
    """Amplitude (h, w) of (T, h, w) maps of T frames, over each place's deviation."""
    stack = views - views.mean(axis=0)
    at = [frame.at for frame in frames]
    turns = waves(at, np.array([frequency]), np.zeros(1))[0].round(12).astype(np.complex64)
    line = np.tensordot(turns, stack, axes=1) / (stack.std(axis=0) + LEAST_DEVIATION)
    return np.asarray(line, np.complex64)


def _evidence(proposal: _Proposal, frames: Sequence[_Frame]) -> float:
    """Evidence of a proposal, before it pays for what was tried."""
    values = []
    for frame in frames:
        view = _rectified(frame, proposal.corners, proposal.layout)
        if view is None:
            return 0.0
        values.append(pilot_values(view, proposal.layout))
    return pilot_evidence(values, proposal.layout, [frame.at for frame in frames])[0]


def _rectified(
    frame: _Frame, corners: Array, layout: Layout, maps: BlockMaps | None = None
) -> Gray | None:
    """Rectify a frame, or return None where the corners make no sound quadrilateral near it.

    Args:
        frame: frame of the film.
        corners: (4, 2) pixels of the reference frame.
        layout: layout to whose size it is rectified.
        maps: maps, with what lies around the display, to whose pixels it is rectified instead; they
            are as fine as the layout.
    """
    quad = transform(frame.H_image_from_reference, corners)
    size = np.array(frame.gray.shape[::-1])
    inside = (quad > -FAR_OUTSIDE * size).all() and (quad < (1 + FAR_OUTSIDE) * size).all()
    outline = np.asarray(quad, np.float32)
    if not inside or not cv2.isContourConvex(outline):
        return None
    if cv2.contourArea(outline) < LEAST_AREA * frame.gray.size:
        return None
    H = homography_from_corners(quad, layout.width, layout.height)
    if maps is None:
        return rectify(frame.gray, H, layout.width, layout.height)
    H_map_from_fine = resized_homography(1 / maps.shrunk, 1 / maps.shrunk)
    width, height = (maps.shrunk * side for side in maps.size)
    return rectify(frame.gray, H @ maps.to_layout() @ H_map_from_fine, width, height)
