"""Find a display by its pilots, over some frames of a film: nothing visible marks it.

The frames of some tenths of a second are held still against the camera's motion (`stabilise`).
Edges and what toggles (`toggle_map`) propose where the display may be. Corners then move to where
the pilots fit the grid, and the display is believed if its blocks toggle with the pilots' signs
beyond doubt (`settle`). That also tells which way up it is and which of several grids it shows.

Where something toggled like a display and none was sure, the next search takes the picture for one
that moves, as a video does, and holds the room still alone. The first searches are given up early:
perhaps the display came into view, or began to play, only after the frames that they look at.

The work is cut into steps, one or two for each frame, so that no frame takes long.
"""

from collections import deque
from collections.abc import Generator, Sequence
from dataclasses import dataclass
from itertools import chain, zip_longest

import cv2
import numpy as np
from numpy.typing import NDArray

from export.locate.candidates import display_candidates
from export.pilots.motion import moved_corners
from export.pilots.search.film import FilmFrame, amplitudes, positions
from export.pilots.search.parts import COARSE_SIZE, coarse_shift
from export.pilots.search.proposals import Proposal, proposal_evidence, surest_proposal
from export.pilots.search.settle import HINT, Settled, settle
from export.pilots.search.toggle_map import ToggleMap
from export.pilots.signal import expected_changes, pilot_evidence, pilot_values
from export.pilots.stabilise import Stabiliser
from export.pilots.waves import position
from link.errors import InputError
from link.geometry import in_image, transform
from link.images import as_gray
from link.layout import Layout
from link.types import Array, Corners, Image

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
STATES_HZ = (15.0, 30.0, 60.0, 120.0)
"""Numbers of states a second at which what toggles is outlined; where edges bound the display, it
is found at any rate."""
PATIENCE_S, MOST_DOUBLED = 2.0, 3
"""Time, in seconds of frames that were seen, after which the first two searches are given up, and
number of times that it doubles, each time for the next two searches: some displays take longer."""
IN_VIEW = 0.75
"""Smallest share of the reference frame that must still be in view for a search to go on."""
CHECKED = (np.indices((8, 8)).reshape(2, -1).T + 0.5) / 8  # (2, 8, 8) -> (64, 2)
"""Places of the reference frame, x and y in [0, 1], that are looked for in the newest one."""
HELD_S, LEAST_HELD = 0.5, 35
"""Time, in seconds, and smallest number of frames for which the newest frames are kept: a display
that is found is read in them, too."""
PROMISING = 9.0
"""Evidence of a quadrilateral, before it pays, at which its corners are refined at once; without so
much in a search in vain, there was probably no display to be seen."""

Search = Generator[None, None, Settled | None]
"""Steps of the search, which end with the display that is sure, or None."""


@dataclass(frozen=True)
class PilotDisplay:
    """A display that its pilots have given away."""

    layout: Layout
    """Layout that it shows, one of those that were looked for."""
    corners: Corners
    """Pixels of the newest frame, from the top left of the displayed picture on."""
    evidence: float
    """Natural logarithm of the odds against chance, after paying for everything that was tried."""
    first_corners: Corners
    """Pixels of the frame with which the search began."""
    k: float
    """Coefficient of the lens (`link.geometry.Lens`)."""
    held: tuple[FilmFrame, ...]
    """The frames before the newest one, from the oldest on, of those that are kept."""


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
        periods = (np.array(STATES_HZ) / 2 / fps) % 1
        self._frequencies = sorted({float(f) for f in np.minimum(periods, 1 - periods) if f > 0})
        self._window = int(np.clip(round(WINDOW_S * fps), LEAST_WINDOW, MOST_WINDOW))
        self._steps = max(1, round(STEPS_HZ / fps))
        self._check_every = self._window // 4
        self._confirming = 2 * self._window // 3
        self._stabiliser = Stabiliser()
        self.picture_moves = False
        """Whether displays are looked for whose picture moves (`doubt_picture`)."""
        self._failed = self._seen = 0
        self._surest_seen = 0.0
        self._frames: list[FilmFrame] = []
        self._later: deque[FilmFrame] = deque(maxlen=self._confirming)
        self._held: deque[FilmFrame] = deque(maxlen=max(LEAST_HELD, round(HELD_S * fps)))
        self._reference: NDArray[np.uint8]
        self._first: FilmFrame
        self._fps = fps
        self._watched: list[Array] = []
        self._values: list[list[NDArray[np.float32]]] = []
        self._promising: Proposal | None = None
        self._work: Search | None = None

    def push(self, image: Image, time: float) -> PilotDisplay | None:
        """Take the next frame.

        Args:
            image: an `Image`.
            time: time of the frame, seconds; rising from frame to frame.

        Returns:
            the display once it is sure, else None.
        """
        gray = as_gray(image)
        H = self._stabiliser.follow(gray)
        if H is not None and not self._in_view(H):
            self._give_up()
            H = None
        if H is None:
            self._stabiliser.begin(gray, far_apart=self.picture_moves)
            self._reference = image
            self._seen, self._surest_seen = 0, 0.0
            self._frames, self._promising, self._work = [], None, None
            self._later.clear()
            self._held.clear()
            self._first = FilmFrame(gray, np.eye(3), 0.0, time)
            self._held.append(self._first)
            return None
        if not self._frames:
            self._begin()
        at = position(time - self._first.time, self._fps)
        newest = FilmFrame(gray, H, at, time, self._stabiliser.tracks)
        self._held.append(newest)
        self._seen += 1
        if len(self._frames) < self._window:
            self._watch(newest)
        else:
            self._later.append(newest)
        if self._work is None:
            return None
        for _ in range(self._steps):
            try:
                next(self._work)
            except StopIteration as end:
                return self._ended(end.value, newest)
        patience = PATIENCE_S * 2 ** min(self._failed // 2, MOST_DOUBLED)
        return self._ended(None, newest) if self._seen > patience * self._fps else None

    def _in_view(self, H_newest_from_reference: Array) -> bool:
        """Tell whether enough of the reference frame is still in view."""
        size = np.array(self._reference.shape[1::-1])
        places = transform(H_newest_from_reference, CHECKED * size - 0.5)
        return float(in_image(places, self._reference.shape).mean()) >= IN_VIEW

    def doubt_picture(self) -> None:
        """Take the picture for one that moves, or no longer for one, from the next search on."""
        self.picture_moves = not self.picture_moves

    def _give_up(self) -> None:
        """Choose how the next search begins after one in vain."""
        self.picture_moves = not self.picture_moves and self._surest_seen > PROMISING

    def _ended(self, settled: Settled | None, newest: FilmFrame) -> PilotDisplay | None:
        """Say what a search has found, and choose how the next one begins."""
        self._stabiliser.forget()
        if settled is None:
            self._failed += 1
            self._give_up()
            return None
        self._failed = 0
        proposal = settled.proposal
        return PilotDisplay(
            layout=proposal.layout,
            corners=newest.corners(proposal.corners),
            evidence=settled.evidence,
            first_corners=proposal.corners,
            k=settled.k,
            held=tuple(self._held)[:-1],
        )

    def _begin(self) -> None:
        """Propose quadrilaterals in the reference, now that the film can be held still."""
        self._map = ToggleMap()
        self._watched = [
            np.roll(candidate.corners, -turn, axis=0)
            for candidate in display_candidates(self._reference, CANDIDATES)
            for turn in (0, 1)
        ]
        self._values = [[] for _ in self._watched]
        self._watch(self._first)

    def _watch(self, frame: FilmFrame) -> None:
        """Record what this frame shows, and propose what looks promising after some frames."""
        self._frames.append(frame)
        self._map.add(self._stabiliser.still(frame.gray, frame.H_image_from_reference), frame.at)
        size = 2 * self._finest.cols, 2 * self._finest.rows
        for corners, values in zip(self._watched, self._values, strict=True):
            view = frame.view(corners, self._largest)
            small = np.zeros(size[::-1], np.uint8) if view is None else view
            values.append(cv2.resize(small, size, interpolation=cv2.INTER_AREA).astype(np.float32))
        count = len(self._frames)
        every = self._check_every
        if self._work is None and count >= 2 * every and count % every == 0:
            self._promising = self._surest_watched()
        if self._work is None and (self._promising is not None or count == self._window):
            self._work = self._search()

    def _surest_watched(self) -> Proposal | None:
        """Choose the quadrilateral of edges that toggles most surely, where it is promising."""
        watched = zip(self._watched, self._values, strict=True)
        surest = [self._surest(corners, values) for corners, values in watched]
        evidence, proposal = max(surest, key=lambda found: found[0], default=(0.0, None))
        return proposal if evidence > PROMISING else None

    def _surest(
        self, corners: Array, views: Sequence[NDArray[np.generic]]
    ) -> tuple[float, Proposal]:
        """Weigh what corners in the reference bound, shown in each frame, as any layout."""
        return surest_proposal(corners, views, positions(self._frames), self.layouts)

    def _search(self) -> Search:
        """Settle one proposal after another until one is sure."""
        promising = self._promising
        if promising and (found := (yield from self._weigh_and_settle(promising))):
            return found
        while len(self._frames) < self._window:
            yield None
        quads, usual = yield from self._all_quads()
        glances = []
        for number, quad in enumerate(quads):
            glances.append(self._glance(quad))
            if number % GLANCES == GLANCES - 1:
                yield None
        for evidence, proposal in sorted(glances, key=lambda glance: -glance[0]):
            if evidence <= HINT:
                break
            if found := (yield from self._weigh_and_settle(proposal)):
                return found
        ranked = self._ranked(quads, [evidence for evidence, _ in glances], usual)
        return (yield from self._settle_fits([quads[number] for number in ranked]))

    def _weigh_and_settle(self, proposal: Proposal) -> Search:
        """Weigh a proposal by all frames so far, and settle it."""
        evidence = proposal_evidence(proposal, self._frames)
        yield None
        return (yield from self._settle(proposal, evidence))

    def _settle(self, proposal: Proposal, evidence: float) -> Search:
        """Settle a proposal with this evidence in all frames so far, before it pays."""
        self._surest_seen = max(self._surest_seen, evidence)
        return (yield from settle(proposal, evidence, self._frames, self._later, self._confirming))

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

    def _settle_fits(self, quads: Sequence[Array]) -> Search:
        """Fit the pilots to quadrilaterals that may be far off, and settle what is clear first."""
        doubtful = []
        for quad in quads:
            for turn in (0, 1):
                fit = self._first_fit(np.roll(quad, -turn, axis=0))
                yield None
                if fit is None:
                    continue
                evidence = self._glance_at(fit)
                if evidence <= HINT:
                    doubtful.append((evidence, fit))
                elif found := (yield from self._settle(fit, evidence)):
                    return found
        for evidence, fit in sorted(doubtful, key=lambda each: -each[0]):
            if found := (yield from self._settle(fit, evidence)):
                return found
        return None

    def _glance(self, quad: Array) -> tuple[float, Proposal]:
        """Weigh a quadrilateral, any side up, by small views of what toggles in it.

        Returns:
            the evidence, before it pays, and what it speaks for.
        """
        ways = [
            self._surest(corners, list(self._small_views(corners)))
            for corners in (quad, np.roll(quad, -1, axis=0))
        ]
        return max(ways, key=lambda way: way[0])

    def _glance_at(self, proposal: Proposal) -> float:
        """Weigh a proposal by small views: the evidence, before it pays."""
        layout = proposal.layout
        values = [pilot_values(view, layout) for view in self._small_views(proposal.corners)]
        return pilot_evidence(values, layout, positions(self._frames))[0]

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

    def _first_fit(self, quad: Array) -> Proposal | None:
        """Fit every layout, upright and upside down, to a quadrilateral that may be far off.

        Returns:
            what fits best after a shift, or None where nothing does.
        """
        views = self._small_views(quad).astype(np.float32)
        best: tuple[int, Proposal] | None = None
        for frequency in self._frequencies:
            line = amplitudes(views, positions(self._frames), frequency)
            for layout in self.layouts:
                blocks = expected_changes(layout)
                for turn in (0, 2):
                    shown = blocks[::-1, ::-1] if turn else blocks
                    fit = coarse_shift(line, shown, layout, far=True)
                    if fit is not None and (best is None or fit[1] > best[0]):
                        corners = np.roll(moved_corners(quad, fit[0], layout), -turn, axis=0)
                        best = fit[1], Proposal(corners, layout, frequency)
        return None if best is None else best[1]
