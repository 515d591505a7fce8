"""Look for a display in one window of a film: the frames that follow a reference frame.

Edges propose where the display may be, and so do outlines of what toggles. Corners then move to
where the pilots fit the grid, and a display is detected if its blocks toggle with the pilots' signs
(`settle.verify`). That also tells which way up it is and which of several grids it shows.
"""

from collections.abc import Iterable, Sequence
from itertools import chain, product

from link.layout import Layout
from link.steps import Steps
from link.types import Array, Corners
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
    WITH_BARS,
    about_middle,
    panels_of,
    pictures_in,
    reaching_beyond,
    ways_up,
)
from receiver.pilots.search.settle import HINT, Detection, verify
from receiver.pilots.search.watch import NEXT_FRAME, Watch

WEIGHED_AT_ONCE = 2
"""Number of quadrilaterals that are weighed coarsely in one step, which then takes about as long as
other steps of the search. Chosen by hand."""
SURROUNDED = 4
"""Number of quadrilaterals, those of the strongest edges, that are followed by what surrounds them.
It bounds the work; chosen by hand."""
LEAVING_AT_ONCE, LEAVING_LATER = 2, 6
"""Number of quadrilaterals which leave the image that the pilots are fitted to before outlines of
what toggles, where the display may do so, and after all else. They bound the work; chosen by
hand."""
HINTS = 2
"""Number of quadrilaterals, those of most evidence that is less than promising, that the pilots are
fitted to. It bounds the work; chosen by hand."""
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
        self._leaving: list[Array] = []  # what may bound a display partly in view, by what toggles
        # quadrilaterals of evidence that is less than promising: it, and the likeliest corners
        self._hints: dict[bytes, tuple[float, Corners]] = {}
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
        and once all frames have been watched, faint edges are weighed, and the pilots are fitted to
        outlines of what toggles. Last, they are fitted to more quadrilaterals that may bound a
        display of which a part is in view, and to the strongest edges in every way up.
        """
        watch, proposer = self.watch, self._proposer
        edges = yield from proposer.edges()
        watch.surround(edges[:SURROUNDED])
        count, seen = watch.soon, 0
        while seen < watch.window:
            while len(watch.frames) < min(count, watch.window):
                yield NEXT_FRAME
                for quad, turn in product(edges, ANY_TURN):  # each frame does its own share
                    proposer.pilots_seen(quad, turn, len(watch.frames))
            first, seen = seen == 0, len(watch.frames)
            count = seen + watch.window // 4
            if found := (yield from self._weigh_coarsely(edges, seen)):
                return found
            self.has_looked = True
            if first and (found := (yield from self._weigh_others(edges))):
                return found
        self.is_late = True
        if found := (yield from self._weigh_others(edges)):
            return found
        partly_seen = (self._leaving[LEAVING_AT_ONCE:] or proposer.partly_seen)[:LEAVING_LATER]
        strongest = edges[:STRONGEST]
        last = ways_up(partly_seen), ways_up(strongest[1:]), ways_up(strongest, likely=False)
        return (yield from self._fit(chain(*last)))

    def _weigh_others(self, edges: Sequence[Array]) -> Search:
        """Weigh faint edges, and fit the pilots to outlines of what toggles and of panels.

        What costs least and what is likeliest comes first.

        Args:
            edges: (4, 2) quadrilaterals of edges in the reference, the strongest first.
        """
        faint = self._proposer.faint_edges()
        first = next(faint)
        if found := (yield from self._weigh_coarsely(first)):
            return found
        regions, self._leaving, portraits = yield from self._proposer.regions([*edges, *first])
        snapped = self._proposer.snapped(regions[0]) if regions else []
        between = pictures_in([*panels_of(edges), *panels_of(first)])
        partly = pictures_in(self._proposer.partly_seen[:LEAVING] if self._leaving else [])
        proposed = [*snapped, *regions, *portraits, *partly, *between]
        if found := (yield from self._weigh_coarsely(proposed)):
            return found
        leaving = ways_up(self._leaving[:LEAVING_AT_ONCE])
        likely = ways_up([*regions[:1], *edges[:1]])
        size = self.watch.reference.shape[1::-1]
        beyond = [quad for part in portraits[:1] for quad in reaching_beyond(part, *size)]
        first_fits = chain(partly[:BARRED], ways_up(beyond), leaving)
        likeliest = chain(first_fits, self._best_hints(), likely)
        if found := (yield from self._fit(likeliest)):
            return found
        for quads in faint:
            if found := (yield from self._weigh_coarsely(quads)):
                return found
        barred = [*between[:BARRED], *(about_middle(each, down=WITH_BARS) for each in regions[:1])]
        last = barred, ways_up(regions[1:]), ways_up(regions[:1], likely=False)
        return (yield from self._fit(chain(*last)))

    def _weigh_coarsely(self, quads: Sequence[Array], count: int | None = None) -> Search:
        """Weigh quadrilaterals coarsely, and verify each that is promising.

        Args:
            quads: (4, 2) pixels of the reference frame each, the likeliest first.
            count: as `Watch.places` takes it; None for those that are proposed late.
        """
        for number, quad in enumerate(quads):
            evidence, proposal = self._proposer.weigh_coarsely(quad, count)
            self.watch.tell("weighed", quad, evidence)
            if evidence > PROMISING:
                if found := (yield from self._weigh_and_verify(proposal)):
                    return found
            elif evidence > HINT:
                self._hints[quad.tobytes()] = evidence, proposal.corners
            if number % WEIGHED_AT_ONCE == WEIGHED_AT_ONCE - 1:
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

    def _best_hints(self) -> list[Corners]:
        """Take what was weighed coarsely and is likeliest of what is less than promising."""
        hints = sorted(self._hints.values(), key=lambda hint: -hint[0])[:HINTS]
        self._hints = {}
        return [corners for _, corners in hints]

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
