"""Look for a display in one window of a film: the frames that follow a reference frame.

Edges propose where the display may be, and so do outlines of what toggles. Corners then move to
where the pilots fit the grid, and a display is detected if its blocks toggle with the pilots' signs
(`settle.verify`). That also tells which way up it is and which of several grids it shows.
"""

from collections.abc import Iterable, Sequence
from itertools import chain, product

from link.layout import Layout
from link.steps import Steps
from link.types import Array
from receiver.pilots.search.proposals import (
    ANY_TURN,
    LEAVING,
    PROMISING,
    STRONGEST,
    Proposal,
    Proposer,
    weigh,
)
from receiver.pilots.search.regions import (
    PANEL_SHAPES,
    WITH_BARS,
    about_middle,
    likely_turns,
    panels_of,
    pictures_in,
    portrait_beyond,
    reaching_beyond,
    ways_up,
)
from receiver.pilots.search.settle import HINT, Detection, verify
from receiver.pilots.search.watch import NEXT_FRAME, Watch

WEIGHED_AT_ONCE, KNOWN_AT_ONCE = 4, 8
"""Number of times that a quadrilateral is weighed coarsely in one step, which then takes about as
long as other steps of the search; and where its pilots were measured as the frames came, which is
more than half of the work. Chosen by hand."""
SURROUNDED = 4
"""Number of quadrilaterals, those of the strongest edges, that are followed by what surrounds them.
It bounds the work; chosen by hand."""
BOUNDING = 3
"""Number of quadrilaterals of edges that the map of what toggles proposes. It bounds the work;
chosen by hand."""
PROPOSED, BEFORE_LEAVING = 15, 7
"""Number of proposed quadrilaterals, the likeliest by the map, that are weighed, and number of
those where the display may leave the image: there the pilots' fit finds more. They bound the work;
chosen with 300 films of another simulation."""
COMPLETED, PLACED = 4, 2
"""Number of quadrilaterals of edges that leave the image, those of the strongest edges, that are
completed by the shapes of panels; and number of results, the likeliest by the map, that the pilots
are fitted to. They bound the work; chosen with 13 films of which one corner is outside."""
BARRED = 2
"""Number of pictures between black bars, those of the likeliest shape, that the pilots are fitted
to. It bounds the work; chosen by hand."""
Search = Steps[Detection | None]
"""Steps of the search, which end with the display that is detected, or None."""


class WindowSearch:
    """Looks for a display in the frames that follow a reference frame.

    Args:
        watch: the film, of which the reference frame has come.
        layouts: those that may be shown.
    """

    def __init__(self, watch: Watch, layouts: Sequence[Layout]) -> None:
        self.watch = watch
        self._proposer = Proposer(watch, layouts)
        self.has_looked = False
        """Whether edges have been weighed coarsely at all."""
        self.is_late = False
        """Whether edges have been weighed coarsely in all frames that are watched."""
        self.is_settling = False
        """Whether a proposal is being verified."""
        self.waiting: list[Search] = []
        """Verifications that have waited for a frame, or wait for one."""

    def steps(self) -> Search:
        """Search, each step with the frames that have come so far.

        What waited for a frame goes on first once the frame has come.
        """
        search, newest, is_over = self._search(), self.watch.first, False
        last: Detection | None = None
        while last is None and (self.waiting or not is_over):
            if self.watch.held[-1] is not newest:
                newest = self.watch.held[-1]
                for verification in tuple(self.waiting):
                    if found := (yield from self._go_on(verification)):
                        return found
            try:
                yield NEXT_FRAME if is_over else next(search)
            except StopIteration as end:
                is_over, last = True, end.value
        return last

    def _search(self) -> Search:
        """Look for the display in the film that follows the reference.

        Edges are weighed coarsely soon and after each quarter of the window. After the first time,
        and once all frames have been watched, others are weighed, too.
        """
        watch, proposer = self.watch, self._proposer
        edges = yield from proposer.edges()
        watch.surround(edges[:SURROUNDED])
        strongest = [*edges[:STRONGEST], *proposer.partly_seen[:LEAVING]]
        count, seen = watch.soon, 0
        while seen < watch.window:
            while len(watch.frames) < min(count, watch.window):
                yield NEXT_FRAME
                for quad, turn in product(strongest, ANY_TURN):  # each frame does its own share
                    proposer.pilots_seen(quad, turn, len(watch.frames))
            first, seen = seen == 0, len(watch.frames)
            count = seen + watch.window // 4
            if found := (yield from self._weigh_coarsely(strongest, seen)):
                return found
            self.has_looked = True
            if first and (found := (yield from self._weigh_others(edges))):
                return found
        self.is_late = True
        return (yield from self._weigh_others(edges))

    def _weigh_others(self, edges: Sequence[Array]) -> Search:
        """Weigh faint edges, and what is likeliest by a map of what toggles.

        The pilots are fitted to the best of it, first to what may leave the image. What costs least
        and what is likeliest comes first.

        Args:
            edges: (4, 2) quadrilaterals of edges in the reference, the strongest first.
        """
        proposer = self._proposer
        faint = proposer.faint_edges()
        first = next(faint)
        if found := (yield from self._weigh_coarsely(first[:STRONGEST])):
            return found
        strongest = edges[:STRONGEST], first[:STRONGEST]
        regions, leaving, portraits = yield from proposer.regions([*chain(*strongest)])
        snapped = proposer.snapped(regions[0]) if regions else []
        bounding = proposer.likeliest([*edges, *first], BOUNDING)
        whole = [*bounding[:1], *chain(*map(panels_of, strongest))]
        partly = pictures_in(proposer.partly_seen[:LEAVING]) if leaving else []
        between = pictures_in(whole)
        proposed = [*bounding, *snapped, *regions, *between]
        most = BEFORE_LEAVING if leaving else PROPOSED
        if found := (yield from self._weigh_coarsely(proposer.likeliest(proposed, most))):
            return found
        if found := (yield from self._fit(partly[:BARRED])):
            return found
        if found := (yield from self._weigh_coarsely(portraits)):
            return found
        size = self.watch.reference.shape[1::-1]
        beyond = [quad for part in portraits[:1] for quad in portrait_beyond(part, *size)]
        likely = [*leaving, *regions[:1], *bounding[:1]]
        if found := (yield from self._fit(chain(ways_up(beyond), ways_up(likely)))):
            return found
        panels = proposer.partly_seen[:COMPLETED] if leaving else []
        placed = [quad for each in panels for quad in reaching_beyond(each, PANEL_SHAPES, *size)]
        placed = proposer.likeliest(placed, PLACED, lean=True)
        if found := (yield from self._fit(ways_up(placed))):
            return found
        for quads in faint:
            others = [*quads[:STRONGEST], *proposer.likeliest(quads, BOUNDING)]
            if found := (yield from self._weigh_coarsely(others)):
                return found
        films = [about_middle(each, down=WITH_BARS) for each in regions[:1]]
        turned = ways_up(regions[:1], likely=False)
        return (yield from self._fit(chain(between[:BARRED], films, ways_up(edges[:1]), turned)))

    def _weigh_coarsely(self, quads: Sequence[Array], count: int | None = None) -> Search:
        """Weigh quadrilaterals coarsely, and verify each that is promising.

        Quarter turns that are not likely for a quadrilateral's shape come last.

        Args:
            quads: (4, 2) pixels of the reference frame each, the likeliest first.
            count: as `Watch.places` takes it; None for those that are proposed late.
        """
        ways = sorted(product(quads, ANY_TURN), key=_is_unlikely)
        at_once = WEIGHED_AT_ONCE if count is None else KNOWN_AT_ONCE
        for number, (quad, turn) in enumerate(ways):
            evidence, proposal = self._proposer.weigh_coarsely(quad, turn, count)
            self.watch.tell("weighed", quad, evidence)
            if evidence > PROMISING and (found := (yield from self._weigh_and_verify(proposal))):
                return found
            if number % at_once == at_once - 1:
                yield 1
        return None

    def _fit(self, ways: Iterable[Array]) -> Search:
        """Fit the pilots to quadrilaterals, and verify each fit that is a hint.

        Args:
            ways: (4, 2) pixels of the reference frame each, the displayed picture's top left first;
                the likeliest first.
        """
        for corners in ways:
            fitted = yield from self._proposer.first_fit(corners)
            if fitted is None:
                yield 1
                continue
            evidence, proposal = self._proposer.likeliest_in(fitted)
            self.watch.tell("weighed", fitted, evidence)
            yield 1
            if evidence > HINT and (found := (yield from self._verify(proposal, evidence))):
                return found
        return None

    def _weigh_and_verify(self, proposal: Proposal) -> Search:
        """Weigh a proposal by all frames so far, and verify it."""
        evidence, _ = weigh(proposal, self.watch.frames, self.watch.fps)
        yield 1
        return (yield from self._verify(proposal, evidence))

    def _verify(self, proposal: Proposal, evidence: float) -> Search:
        """Verify a proposal with this evidence in all frames so far, before it pays."""
        self.watch.tell("verifying", proposal.corners, evidence)
        return (yield from self._go_on(verify(proposal, evidence, self.watch)))

    def _go_on(self, verification: Search) -> Search:
        """Verify a proposal until it needs a frame that has yet to come; then it waits."""
        while True:
            try:
                work = next(verification)
                self.is_settling = work != NEXT_FRAME
            except StopIteration as end:
                self.is_settling = False
                self.waiting = [each for each in self.waiting if each is not verification]
                found: Detection | None = end.value
                return found
            if work == NEXT_FRAME:
                if verification not in self.waiting:
                    self.waiting.append(verification)
                return None
            yield work


def _is_unlikely(way: tuple[Array, int]) -> bool:
    """Tell whether a quadrilateral is unlikely to be upright or upside down after quarter turns."""
    quad, turn = way
    return turn not in [likely % 2 for likely in likely_turns(quad)]
