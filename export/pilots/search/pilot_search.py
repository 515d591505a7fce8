"""Find a display by its pilots, over some frames of a film: nothing visible marks it.

The frames of some tenths of a second are held still against the camera's motion (`stabilise`).
Edges and what toggles (`toggle_map`) propose where the display may be. Corners then move to where
the pilots fit the grid, and the display is believed if its blocks toggle with the pilots' signs
beyond doubt (`settle`). That also tells which way up it is and which of several grids it shows.

Where something toggled like a display and none was sure, the next search takes the picture for one
that moves, as a video does, and holds the room still alone. The work is cut into steps, one or two
for each frame, so that no frame takes long.
"""

from collections.abc import Generator, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from export.pilots.clock import DisplayClock
from export.pilots.search.film import HeldFrame
from export.pilots.search.proposals import (
    CANDIDATES,
    CLEAREST,
    FRAME_SHARE,
    PROMISING,
    STRONGEST,
    Proposal,
    Proposer,
    inset,
    weigh,
)
from export.pilots.search.settle import HINT, Settled, settle
from export.pilots.search.watch import Watch
from link.errors import InputError
from link.images import as_gray
from link.layout import Layout
from link.pilot_code import PLAIN
from link.types import Array, Corners, Image

GLANCES = 2
"""Number of quadrilaterals that are glanced at in one step."""
STEPS_HZ = 60.0
"""Number of steps of the search that are done in a second, at least: the frames of a slow camera
leave time for several."""
ANY_TURN = 0, 1
"""Quarter turns after which quadrilaterals are tried upright and upside down, so that any of their
sides may be up. Where one search was in vain, the next ones try them by turns."""
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
    clock: DisplayClock | None
    """When the display shows which state, where its code tells; the camera's time, in seconds."""
    held: tuple[HeldFrame, ...]
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
        self.layouts, self._fps = tuple(layouts), fps
        self._steps = max(1, round(STEPS_HZ / fps))
        self._coded = any(layout.code != PLAIN for layout in layouts)
        self.picture_moves = False
        """Whether displays are looked for whose picture moves (`doubt_picture`)."""
        self._failed = 0
        self._surest_seen = 0.0
        self._watch: Watch | None = None
        self._work: Search | None = None

    def push(self, image: Image, time: float) -> PilotDisplay | None:
        """Take the next frame.

        Args:
            image: an `Image`.
            time: time of the frame, seconds; rising from frame to frame.

        Returns:
            the display once it is sure, else None.
        """
        gray, watch = as_gray(image), self._watch
        newest = None if watch is None else watch.next_frame(gray, time)
        if watch is not None and newest is not None and not watch.is_in_view(newest):
            self._give_up()
            newest = None
        if watch is None or newest is None:
            longer = 2 if self._failed and self._coded else 1
            self._watch = Watch(
                image, time, self._fps, picture_moves=self.picture_moves, longer=longer
            )
            self._work = None
            self._surest_seen = 0.0
            return None
        if self._work is None:  # now the film can be held still
            watch.add(watch.first)
            self._work = self._search(watch)
        watch.held.append(newest)
        if len(watch.frames) < watch.window:
            watch.add(newest)
        else:
            watch.later.append(newest)
        for _ in range(self._steps):
            try:
                next(self._work)
            except StopIteration as end:
                return self._ended(end.value, watch)
        return None

    def doubt_picture(self) -> None:
        """Take the picture for one that moves, or no longer for one, from the next search on."""
        self.picture_moves = not self.picture_moves

    def _give_up(self) -> None:
        """Choose how the next search begins after one in vain."""
        self.picture_moves = not self.picture_moves and self._surest_seen > PROMISING

    def _ended(self, settled: Settled | None, watch: Watch) -> PilotDisplay | None:
        """Say what a search has found, and choose how the next one begins."""
        self._watch = None
        if settled is None:
            self._failed += 1
            self._give_up()
            return None
        self._failed = 0
        proposal, (*held, newest) = settled.proposal, watch.held
        return PilotDisplay(
            layout=proposal.layout,
            corners=newest.corners(proposal.corners),
            evidence=settled.evidence,
            first_corners=proposal.corners,
            k=settled.k,
            clock=proposal.toggling.clock_in_seconds(self._fps, watch.first.time),
            held=tuple(held),
        )

    def _search(self, watch: Watch) -> Search:
        """Look for the display in the film that follows the reference.

        Edges are glanced at after half of the window and after each quarter. Once all frames have
        been watched, other quadrilaterals are, and the pilots are fitted to those that probably
        bound a display, if not exactly.
        """
        proposer = Proposer(watch, self.layouts, self._fps)
        edges = proposer.edges
        count, seen = watch.window // 2, 0
        while seen < watch.window:
            while len(watch.frames) < min(count, watch.window):
                for quad in edges:
                    watch.places(quad, len(watch.frames))  # each frame does its own share
                yield None
            seen = len(watch.frames)
            count = seen + watch.window // 4
            if found := (yield from self._glance(edges, proposer, watch, seen)):
                return found
        faint: list[Array] = []
        for quads in proposer.faint_edges():
            yield None
            faint += quads
            if found := (yield from self._glance(quads, proposer, watch)):
                return found
        strongest = [*edges[:STRONGEST], *faint[:1]]
        if found := (yield from self._fit(strongest, proposer, watch)):
            return found
        outlines = yield from proposer.outlines()
        framed = [inset(quad, FRAME_SHARE) for quad in (*edges, *faint[:CANDIDATES])]
        if found := (yield from self._glance([*outlines, *framed], proposer, watch)):
            return found
        glances = proposer.glances()
        for proposal in [proposal for evidence, proposal, _ in glances if evidence > HINT]:
            if found := (yield from self._weigh_and_settle(proposal, watch)):
                return found
        tried = {id(quad) for quad in strongest}
        clearest = [quad for _, _, quad in glances if id(quad) not in tried][:CLEAREST]
        return (yield from self._fit([*clearest, *outlines], proposer, watch))

    @property
    def _turns(self) -> tuple[int, ...]:
        """Turns of quadrilaterals that are proposed late: fewer in searches after one in vain."""
        return (ANY_TURN[(self._failed - 1) % 2],) if self._failed else ANY_TURN

    def _glance(
        self, quads: Sequence[Array], proposer: Proposer, watch: Watch, count: int | None = None
    ) -> Search:
        """Glance at quadrilaterals, and settle each that is promising.

        Args:
            quads: (4, 2) pixels of the reference frame each, the likeliest first.
            proposer: glances at them.
            watch: the film.
            count: as `Watch.places` takes it; None for those that are proposed late.
        """
        turns = self._turns if count is None else ANY_TURN
        for number, quad in enumerate(quads):
            evidence, proposal = proposer.glance(quad, turns, count)
            if evidence > PROMISING and (
                found := (yield from self._weigh_and_settle(proposal, watch))
            ):
                return found
            if number % GLANCES == GLANCES - 1:
                yield None
        return None

    def _fit(self, quads: Sequence[Array], proposer: Proposer, watch: Watch) -> Search:
        """Fit the pilots to quadrilaterals, and settle each fit that is a hint.

        Args:
            quads: (4, 2) pixels of the reference frame each, the likeliest first.
            proposer: fits the pilots.
            watch: the film.
        """
        for quad, turn in product(quads, self._turns):
            fit = yield from proposer.first_fit(np.roll(quad, -turn, axis=0))
            if fit is None:
                continue
            evidence, _ = proposer.surest_in(fit.corners, [fit.layout])
            yield None
            if evidence > HINT and (found := (yield from self._settle(fit, evidence, watch))):
                return found
        return None

    def _weigh_and_settle(self, proposal: Proposal, watch: Watch) -> Search:
        """Weigh a proposal by all frames so far, and settle it."""
        evidence, _ = weigh(proposal, watch.frames, self._fps)
        yield None
        return (yield from self._settle(proposal, evidence, watch))

    def _settle(self, proposal: Proposal, evidence: float, watch: Watch) -> Search:
        """Settle a proposal with this evidence in all frames so far, before it pays."""
        self._surest_seen = max(self._surest_seen, evidence)
        return (yield from settle(proposal, evidence, watch))
